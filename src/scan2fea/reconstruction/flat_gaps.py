"""Volume that may hide behind gaps in the faces of a flat solid: such a face is far larger than the gaps in it, so each is looked at as a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, label
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.reconstruction.budget import WALL_ENDS
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.hidden_volume import REACH, hidden_check
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, TriangleMesh, Value

PIXEL = 0.5  # spacings
ENDS = 0.02  # of the volume: as `wall_ends`
MOST_CARRIED = 0.5  # of a face: a gap is carried over that is no larger than what was measured of it
BORDER = 1.75  # spacings from a measured point: random points leave 0.03 % of a face so bare
FACING = -0.99  # cosine between the two faces of a wall
MOST_PIXELS = 4e6  # of one face: a larger one is looked at more coarsely
BESIDE = ((1, 0), (-1, 0), (0, 1), (0, -1))


def hidden_volume_flat(mesh: TriangleMesh, points: FloatArray, spacing_m: float) -> Check:
    """As `hidden_volume`, of a solid of flat faces (`face_region` is set), each triangle of which is larger than the gaps in it.

    A gap is what lies farther than REACH spacings from the points of its face.
    points : (n, 3) measured, or inferred from a support that was seen.
    """
    tree, hidden, where = cKDTree(points), 0.0, [np.zeros((0, 3))]
    for picture in _pictures(mesh, points, spacing_m).values():
        far = picture.far(REACH * spacing_m)
        for at in _patches(far):
            size, sides = len(at) * picture.pixel**2, picture.pixel * _sides(picture, far, at, tree, REACH * spacing_m)
            hidden += size**2 / max(sides, math.sqrt(size))
            where.append(picture.places(at))
    return hidden_check(hidden / abs(volume(mesh)), np.concatenate(where))


def flat_ends(mesh: TriangleMesh, points: FloatArray, spacing_m: float) -> Check:
    """How much may hide beyond places of flat faces (`face_region` is set) that lie far from all points, of whatever face?

    Where a wall ends, the points of its end or of either of its faces go up to the edge. A place that has none, of area A and L across, hides
    A L / pi, as a face without points does (`bare_faces`).
    """
    tree, hidden, where = cKDTree(points), 0.0, [np.zeros((0, 3))]
    for picture in _pictures(mesh, points, spacing_m).values():
        far = picture.far(REACH * spacing_m)
        at = np.argwhere(far)
        near = np.asarray(tree.query(picture.places(at))[0]) <= REACH * spacing_m
        far[tuple(at[near].T)] = False
        for own in _patches(far):
            across = picture.pixel * float(np.linalg.norm(np.ptp(own, axis=0) + 1))
            hidden += len(own) * picture.pixel**2 * across / math.pi
            where.append(picture.places(own))
    share = min(1.0, hidden / abs(volume(mesh)))
    says = (
        f"{share:.1%} of the volume may hide beyond ends of walls where no point was measured (limit {ENDS:.0%}){around(np.concatenate(where))}: "
        "the scan may end there, not the wall; scan the edges too, or fit the member"
    )
    return at_most(WALL_ENDS, share, ENDS, says)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Picture(Value):
    """A flat face in pixels.   inside : (r, c) its own.   away : (r, c) distance from its points, m.   low : (2,) corner.   pixel : size, m."""

    plane: Plane
    inside: BoolArray
    away: FloatArray
    low: FloatArray
    pixel: float

    def far(self, reach_m: float) -> BoolArray:
        """(r, c) pixels farther than that from the points of the face."""
        return np.asarray(self.inside & (self.away > reach_m))

    def places(self, at: IntArray) -> FloatArray:
        """(k, 3) middles of the pixels (k, 2)."""
        return np.asarray((self.low + (at + 0.5) * self.pixel) @ self.plane.axes() + self.plane.offset * self.plane.normal)


def _pictures(mesh: TriangleMesh, points: FloatArray, spacing_m: float) -> dict[int, _Picture]:
    """Those of the faces that have gaps, by number."""
    region, near, normals = regions(mesh), PointToMesh(mesh).nearest(points), face_normals(mesh)
    of, out = region[near.face], {}
    for number in np.unique(region):
        own = np.flatnonzero(region == number)
        corners = mesh.vertices[mesh.faces[own]]
        plane = Plane(normal=normals[own[0]], offset=float((corners @ normals[own[0]]).mean()))
        picture = _picture(plane, corners, near.closest[of == number], spacing_m)
        if picture is not None:
            out[int(number)] = picture
    return out


def _picture(plane: Plane, corners: FloatArray, places: FloatArray, spacing_m: float) -> _Picture | None:
    """That of a face, None where it has no gap. corners : (k, 3, 3) its triangles.   places : (n, 3) of its points."""
    axes = plane.axes()
    flat, seen_at = corners @ axes.T, places @ axes.T
    low, extent = flat.min(axis=(0, 1)), np.ptp(flat.reshape(-1, 2), axis=0)
    pixel = max(PIXEL * spacing_m, math.sqrt(float(np.prod(extent)) / MOST_PIXELS))
    shape = tuple((np.ceil(extent / pixel) + 1).astype(np.int64).tolist())
    seen = np.zeros(shape, bool)
    row, column = np.clip(((seen_at - low) / pixel).astype(np.int64), 0, np.array(shape) - 1).T
    seen[row, column] = True
    away = np.full(shape, math.inf) if not len(places) else pixel * np.asarray(distance_transform_edt(~seen))
    if away.max() <= REACH * spacing_m:
        return None
    return _Picture(plane=plane, inside=_painted((flat - low) / pixel, shape), away=away, low=low, pixel=pixel)


def _patches(chosen: BoolArray) -> list[IntArray]:
    """Pixels (k, 2) of each set that hangs together."""
    patch, n_patches = label(chosen)
    return [np.argwhere(patch == number) for number in range(1, n_patches + 1)]


def _sides(picture: _Picture, far: BoolArray, at: IntArray, tree: cKDTree, reach_m: float) -> float:
    """Sides of pixels `at` where a gap ends.

    Where it meets the outline of the face it ends if points of other faces are near (tree : of all points); else it goes on round the edge.
    """
    sides, shape, places = np.zeros(len(at), np.int64), far.shape, picture.places(at)
    for step in BESIDE:
        i, j = (at + step).T
        on = (i >= 0) & (j >= 0) & (i < shape[0]) & (j < shape[1])
        on[on] = picture.inside[i[on], j[on]]
        ends = ~on
        ends[on] = ~far[i[on], j[on]]
        outer = np.flatnonzero(~on)
        ends[outer] = np.asarray(tree.query(places[outer])[0]) <= reach_m
        sides += ends
    return float(sides.sum())


def over_walls(mesh: TriangleMesh, points: FloatArray, spacing_m: float) -> FloatArray:
    """(k, 3) places on gaps of flat faces behind which the other face of a wall was measured, where most of the face itself was.

    points : (n, 3) measured. What `opposite` does for any surface: a wall goes on as thick as it was measured round about.
    """
    region, scene, normals = regions(mesh), scene_of(mesh), face_normals(mesh)
    near, hair = PointToMesh(mesh).nearest(points), 1e-6 * spacing_m
    of, out = region[near.face], [np.zeros((0, 3))]
    for picture in _pictures(mesh, points, spacing_m).values():
        gaps = [at for at in _patches(picture.far(BORDER * spacing_m)) if picture.away[tuple(at.T)].max() > REACH * spacing_m]
        if not gaps or sum(map(len, gaps)) > MOST_CARRIED * picture.inside.sum():
            continue
        places = picture.places(np.concatenate(gaps))
        way = np.tile(-picture.plane.normal, (len(places), 1))
        depth, hit = first_hits(scene, places + hair * way, way)
        is_wall = (hit >= 0) & (normals[hit] @ picture.plane.normal < FACING)
        foot = places + depth[:, None] * way
        for other in np.unique(region[hit[is_wall]]):
            rows = np.flatnonzero(is_wall & (region[hit] == other))
            seen = near.closest[of == other]
            is_wall[rows] = np.asarray(cKDTree(seen).query(foot[rows])[0]) <= BORDER * spacing_m if len(seen) else False
        out.append(places[is_wall])
    return np.concatenate(out)


def regions(mesh: TriangleMesh) -> IntArray:
    """(m,) number of the face that each triangle is of, from 0."""
    return np.zeros(len(mesh.faces), np.int64) if mesh.face_region is None else np.unique(mesh.face_region, return_inverse=True)[1].ravel()


def _painted(triangles: FloatArray, shape: tuple[int, ...]) -> BoolArray:
    """Pixels whose middles lie in one of the triangles (k, 3, 2), in pixels."""
    out = np.zeros(shape, bool)
    for a, b, c in triangles:
        low = np.maximum(np.floor(np.minimum(np.minimum(a, b), c) - 0.5), 0).astype(np.int64)
        high = np.minimum(np.ceil(np.maximum(np.maximum(a, b), c) + 0.5), shape).astype(np.int64)
        x, y = (np.arange(low[k], high[k]) + 0.5 for k in (0, 1))
        turns = [
            (q[0] - p[0]) * (y[None, :] - p[1]) - (q[1] - p[1]) * (x[:, None] - p[0]) for p, q in ((a, b), (b, c), (c, a))
        ]  # on its left or right, all alike inside
        out[low[0] : high[0], low[1] : high[1]] |= np.all([t >= 0 for t in turns], axis=0) | np.all([t <= 0 for t in turns], axis=0)
    return out
