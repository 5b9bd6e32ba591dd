"""Scale space: points drawn onto the plane of their neighbours, again and again; meshed there; the vertices taken back to where they were measured.

Digne, Morel, Souzani, Lartigue, "Scale space meshing of raw data point sets", 2011: each point goes onto the plane of its neighbours, a step of mean
curvature motion, H r^2 / 4. The plain form takes every point within the radius: sheets nearer than that collapse onto each other. The side-aware form
takes those of the point's own side only, so that a wall keeps its thickness at any scale. The mesher is the minimum cut, or the pivoting ball (the
thesis's) or the advancing front made whole by it: the surface is closed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import ReconstructionError
from scan2fea.kernel.jit import jit
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.normals import least_axis
from scan2fea.kernel.predicates import intersections_of
from scan2fea.kernel.side_normals import SAME_SIDE, near_lists
from scan2fea.kernel.topology import degenerate_faces, vertex_faces
from scan2fea.options import option
from scan2fea.reconstruction.advancing_front import advancing_front
from scan2fea.reconstruction.ball_pivoting import ball_pivoting
from scan2fea.reconstruction.visibility import Reconstruction, VisibilityOptions, sides, told_images, visibility
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud, Scan, TriangleMesh

NEIGHBORS = 12  # the radius is the mean distance to the twelfth, over SAMPLES points, and stays (CGAL's default)
SAMPLES = 300
MESHERS: Mapping[str, Callable[[Scan, VisibilityOptions], Reconstruction]] = {
    "visibility": visibility,
    "ball_pivoting": ball_pivoting,
    "advancing_front": advancing_front,
}
FEWEST = 5  # points in the ball, with itself: with fewer a point is not moved
RETREATS = 30


@dataclass(frozen=True, kw_only=True)
class ScaleSpaceOptions(VisibilityOptions):
    scale: int = option(4, "scale_space: steps of smoothing before the surface is found", minimum=0, maximum=100)
    side_aware: bool = option(True, "scale_space: smooth with neighbours of the same side only, so that walls keep their thickness")
    mesher: str = option("visibility", "scale_space: how the smoothed points are meshed (the thesis's: ball_pivoting)", choices=tuple(MESHERS))


def smoothing_radius(points: FloatArray, seed: int = 0) -> float:
    """Mean distance to the twelfth neighbour, m."""
    distance, _ = k_nearest(points, NEIGHBORS + 1, points[sampled_rows(len(points), SAMPLES, seed)])
    return float(distance[:, -1].mean())


def smoothed(points: FloatArray, radius_m: float, scale: int, normals: FloatArray | None = None) -> FloatArray:
    """(n, 3) the points after `scale` steps at a fixed radius; point i stays point i.

    normals : (n, 3) outward: only neighbours whose normals agree with the point's are used (side-aware); None for all (plain).
    """
    now = np.array(points, float)
    for _ in range(scale):
        near = near_lists(now, radius_m)
        side = np.zeros((0, 3)) if normals is None else np.ascontiguousarray(normals)
        now = _projected(near.points, side, near.first, near.index)
    return now


@jit
def _projected(points: FloatArray, normals: FloatArray, first: IntArray, index: IntArray) -> FloatArray:
    """Each point on the least squares plane of its neighbours: two buffers, so that the order does not matter."""
    out = points.copy()
    sided = len(normals) > 0
    for p in range(len(points)):
        mx = my = mz = 0.0
        count = 0
        for o in range(first[p], first[p + 1]):
            q = index[o]
            if sided and normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2] <= SAME_SIDE:
                continue
            mx, my, mz, count = mx + points[q, 0], my + points[q, 1], mz + points[q, 2], count + 1
        if count < FEWEST:
            continue
        mx, my, mz = mx / count, my / count, mz / count
        xx = xy = xz = yy = yz = zz = 0.0
        for o in range(first[p], first[p + 1]):
            q = index[o]
            if sided and normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2] <= SAME_SIDE:
                continue
            x, y, z = points[q, 0] - mx, points[q, 1] - my, points[q, 2] - mz
            xx, xy, xz, yy, yz, zz = xx + x * x, xy + x * y, xz + x * z, yy + y * y, yz + y * z, zz + z * z
        ax, ay, az = least_axis(xx, xy, xz, yy, yz, zz)
        height = (points[p, 0] - mx) * ax + (points[p, 1] - my) * ay + (points[p, 2] - mz) * az
        out[p, 0], out[p, 1], out[p, 2] = points[p, 0] - height * ax, points[p, 1] - height * ay, points[p, 2] - height * az
    return out


def scale_space(scan: Scan, options: VisibilityOptions = ScaleSpaceOptions()) -> Reconstruction:
    """The closed surface at scale `options.scale`, its vertices taken back to scale 0.

    Where going back makes faces cross, the vertices there stay as far out as needed (told as `n_held_back`). Raises ReconstructionError.
    """
    given = options if isinstance(options, ScaleSpaceOptions) else ScaleSpaceOptions()
    if told_images(scan, options) is not None:
        raise ReconstructionError("scale_space has no rays to move along: shuffle the points or use reconstruction.method = visibility")
    first = sides(scan, options)
    points = scan.cloud.points
    radius = smoothing_radius(points, options.seed)
    moved = smoothed(points, radius, given.scale, first.normals if given.side_aware else None)
    coarse = MESHERS[given.mesher](_at(scan, moved, first.normals), options)
    mesh, n_held = returned(coarse.mesh, scale_zero(coarse.mesh, coarse.points, points, first.spacing_m))
    facts: Mapping[str, float | str] = {
        **coarse.how, "method": "scale_space", "scale": given.scale, "radius_m": radius, "n_held_back": n_held,
        "mesher": given.mesher,
        "side_aware": "yes" if given.side_aware else "no", "spacing_m": first.spacing_m, "sigma_m": first.sigma_m,
    }  # fmt: skip
    return replace(coarse, mesh=mesh, spacing_m=first.spacing_m, sigma_m=first.sigma_m, how=facts)


def _at(scan: Scan, points: FloatArray, normals: FloatArray) -> Scan:
    """The scan with its points elsewhere."""
    cloud: PointCloud = scan.cloud.replaced(points=points, normals=normals)
    return replace(scan, cloud=cloud)


def scale_zero(mesh: TriangleMesh, moved: FloatArray, points: FloatArray, spacing_m: float) -> FloatArray:
    """(k, 3) where the points that the vertices of a mesh are came from; a vertex farther than a spacing from all of them stays.

    moved, points : (n, 3) at the scale of the mesh, and before.
    """
    distance, row = k_nearest(moved, 1, mesh.vertices)
    return np.where(distance <= spacing_m, points[row[:, 0]], mesh.vertices)


def returned(mesh: TriangleMesh, target: FloatArray) -> tuple[TriangleMesh, int]:
    """The mesh with its vertices at `target` (n, 3), or part of the way there where faces would cross; and how many vertices were held back.

    The mesh must be free of crossings: then a share of 0 always is.
    """
    share = np.ones(len(target))
    start, faces_at = vertex_faces(mesh.faces, len(mesh.vertices))
    asked = np.arange(len(mesh.faces))
    for attempt in range(RETREATS):
        now = replace(mesh, vertices=mesh.vertices + share[:, None] * (target - mesh.vertices))
        bad: BoolArray = np.zeros(len(mesh.faces), bool)
        bad[asked] = degenerate_faces(now.vertices, now.faces[asked])
        bad[np.unique(intersections_of(now, asked))] = True
        if not bad.any():
            return now, int((share < 1.0).sum())
        corners = np.unique(now.faces[bad])
        for _ in range(attempt // 4):  # wider where holding the faces themselves back does not help
            ring = np.concatenate([faces_at[start[v] : start[v + 1]] for v in corners])
            corners = np.unique(mesh.faces[ring])
        share[corners] = np.where(share[corners] > 0.1, 0.5 * share[corners], 0.0)
        asked = np.flatnonzero(np.isin(mesh.faces, corners).any(axis=1))  # no others can have come to cross
    return mesh, len(target)
