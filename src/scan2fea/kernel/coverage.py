"""Which parts of a surface were measured, and how far the measured points lie from it. Taken on the final geometry only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.neighbors import radius_components
from scan2fea.types import INTERPOLATED, INVENTED, MEASURED, BoolArray, FloatArray, IntArray, TriangleMesh, Value

REACH_SPACINGS = 1.5  # a measured point every spacing leaves no place farther from one than 1.5, on any lattice
HOLE_SPACINGS = 5.0  # a place within this of a measured point lies in a small hole: filled between its rims
NOISE_SIGMAS = 3.0
STRAY_SPACINGS = 0.5  # half a spacing is as far as a surface between points may cut a corner
MAX_ROWS = 12  # rows of samples across a face
EXPECTED = 9.0  # points: where so many should lie chance leaves none once in e^9 = 8,000 times
HARDLY = 0.05  # of them: strays


@dataclass(frozen=True, eq=False, kw_only=True)
class Deviation(Value):
    """Distances of the measured points from the surface, metres, and of the surface from the points.

    mean_m : signed, positive outside.   rms_m, p95_m, max_m : points to surface.   surface_p95_m : surface to its nearest measured points,
    over the measured area.   stray_share : of the points, farther off than 3 sigma and half a spacing.
    own_p95_m : as p95_m, of the points without those that were told to be strays.
    per_vertex_m : (n,) mean signed distance of the points nearest to the faces of each vertex, nan where there are none.
    """

    mean_m: float
    rms_m: float
    p95_m: float
    max_m: float
    surface_p95_m: float
    measured_area_fraction: float
    stray_share: float
    own_p95_m: float
    per_vertex_m: FloatArray


def _samples(mesh: TriangleMesh, pitch: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Points spread over each face about `pitch` apart: positions, faces, and the area each stands for."""
    tri = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(tri - np.roll(tri, -1, axis=1), axis=2).max(1)
    rows = np.clip(np.ceil(longest / pitch), 1, MAX_ROWS).astype(np.int64)
    points, faces, shares = [], [], []
    areas = face_areas(mesh)
    for k in np.unique(rows):
        of = np.flatnonzero(rows == k)
        i, j = np.meshgrid(np.arange(k), np.arange(k), indexing="ij")
        # centroids of the k^2 parts into which k rows cut a triangle: upright and inverted ones
        up = np.stack([i, j], axis=-1)[i + j < k] + 1 / 3
        down = np.stack([i, j], axis=-1)[i + j < k - 1] + 2 / 3
        uv = np.concatenate([up, down]) / k
        bary = np.column_stack([1 - uv.sum(1), uv])
        points.append(np.einsum("sk,fkj->fsj", bary, tri[of]).reshape(-1, 3))
        faces.append(np.repeat(of, len(bary)))
        shares.append(np.repeat(areas[of] / len(bary), len(bary)))
    if not points:
        return np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0)
    return np.concatenate(points), np.concatenate(faces).astype(np.int64), np.concatenate(shares)


def _gap_to_points(places: FloatArray, normals: FloatArray, points: FloatArray, point_normals: FloatArray, reach: float) -> FloatArray:
    """Distance from each place to the nearest point of its own side, inf beyond `reach`.

    Search in six dimensions, position and reach / 2 times the normal: points of the far side of a wall, whose normals oppose, fall out of reach
    even where the wall is thinner than that.
    """
    if not len(points) or not len(places):
        return np.full(len(places), np.inf)
    scale = reach / 2
    tree = cKDTree(np.concatenate([points, scale * point_normals], axis=1))
    _, row_of = tree.query(np.concatenate([places, scale * normals], axis=1), distance_upper_bound=reach)
    row = np.asarray(row_of, np.int64)
    found = row < len(points)
    gap = np.full(len(places), np.inf)
    gap[found] = np.linalg.norm(places[found] - points[row[found]], axis=1)
    return gap


def _coverage(
    mesh: TriangleMesh, points: FloatArray, point_face: IntArray, spacing_m: float, sigma_m: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Origin, face, area and gap to the nearest measured point of samples spread over the surface."""
    noise = NOISE_SIGMAS * sigma_m
    places, face, share = _samples(mesh, 1.5 * spacing_m)
    normals = face_normals(mesh)
    gap = _gap_to_points(places, normals[face], points, normals[point_face], REACH_SPACINGS * spacing_m + noise)
    origin = np.where(np.isfinite(gap), MEASURED, INVENTED).astype(np.int64)
    far = np.flatnonzero(origin == INVENTED)
    near = np.isfinite(_gap_to_points(places[far], normals[face[far]], points, normals[point_face], HOLE_SPACINGS * spacing_m + noise))
    origin[far[near]] = INTERPOLATED
    return origin, face, share, gap


def _measured(points: FloatArray, is_inferred: BoolArray | None) -> FloatArray:
    return points if is_inferred is None else points[~is_inferred]


def face_origin(mesh: TriangleMesh, points: FloatArray, is_inferred: BoolArray | None, spacing_m: float, sigma_m: float) -> IntArray:
    """(m,) MEASURED, INTERPOLATED or INVENTED: what stands behind most of the area of each face.

    Measured: a measured point of the same side within 1.5 spacings and 3 sigma. Interpolated: within 5 spacings and 3 sigma. Invented: beyond.
    """
    seen = _measured(points, is_inferred)
    face_of_point = PointToMesh(mesh).nearest(seen).face
    origin, face, _, _ = _coverage(mesh, seen, face_of_point, spacing_m, sigma_m)
    votes = np.stack([np.bincount(face[origin == kind], minlength=len(mesh.faces)) for kind in (MEASURED, INTERPOLATED, INVENTED)], axis=1)
    backed = votes.cumsum(axis=1) * 2 >= votes.sum(axis=1, keepdims=True)  # the middle sample decides, ties to the better
    return np.asarray(backed.argmax(axis=1), np.int64)


def is_unmeasured(area_m2: float, n_points: int, density: float) -> bool:
    """Whether nobody measured a part of a surface: next to no point lies where there would be some at the scan's density, per m2."""
    expected = area_m2 * density
    return expected >= EXPECTED and n_points <= HARDLY * expected


def measured_part(mesh: TriangleMesh, origin: IntArray) -> TriangleMesh:
    """The faces that points stand behind, by `face_origin`: the open sheet that is left where no solid is possible."""
    used, packed = np.unique(mesh.faces[origin == MEASURED], return_inverse=True)
    return TriangleMesh(vertices=mesh.vertices[used], faces=packed.reshape(-1, 3).astype(np.int64))


def unmeasured_share(mesh: TriangleMesh, points: FloatArray, reach_m: float, face_of_point: IntArray | None = None) -> float:
    """Share of the area with no point of its own side within `reach_m`.

    points : (n, 3) measured ones only.   face_of_point : (n,) the nearest face of each, where known.
    """
    if not len(points) or not len(mesh.faces):
        return 1.0
    normals = face_normals(mesh)
    places, face, share = _samples(mesh, reach_m / 2)
    own = PointToMesh(mesh).nearest(points).face if face_of_point is None else face_of_point
    gap = _gap_to_points(places, normals[face], points, normals[own], reach_m)
    return float(share[~np.isfinite(gap)].sum() / share.sum())


def area_shares(mesh: TriangleMesh, origin: IntArray) -> dict[str, float]:
    """{measured, interpolated, invented} shares of the area; they add up to 1."""
    areas = np.bincount(origin, weights=face_areas(mesh), minlength=3)
    total = float(areas.sum()) or 1.0
    kinds = {"measured": MEASURED, "interpolated": INTERPOLATED, "invented": INVENTED}
    return {name: float(areas[kind] / total) for name, kind in kinds.items()}


def deviation(
    mesh: TriangleMesh, points: FloatArray, spacing_m: float, sigma_m: float, is_inferred: BoolArray | None = None, strays: float = 0.0
) -> Deviation:
    """How far the measured points lie from the surface and how much of the surface they cover.

    strays : share of the points, the farthest ones, that is known to belong to nothing.
    """
    seen = _measured(points, is_inferred)
    nearest = PointToMesh(mesh).nearest(seen)
    # the face's own normal decides the side; at rims it may err, which the mean hardly feels
    outside = np.einsum("ij,ij->i", seen - nearest.closest, face_normals(mesh)[nearest.face]) >= 0
    signed = np.where(outside, nearest.distance, -nearest.distance)
    at = mesh.faces[nearest.face].ravel()
    weight = np.bincount(at, weights=nearest.weights.ravel(), minlength=len(mesh.vertices))
    total = np.bincount(at, weights=(nearest.weights * signed[:, None]).ravel(), minlength=len(mesh.vertices))
    per_vertex = np.divide(total, weight, out=np.full(len(weight), np.nan), where=weight > 0)
    origin, _, share, gap = _coverage(mesh, seen, nearest.face, spacing_m, sigma_m)
    measured = origin == MEASURED
    return Deviation(
        mean_m=float(signed.mean()) if len(seen) else float("nan"),
        rms_m=float(np.sqrt((signed**2).mean())) if len(seen) else float("nan"),
        p95_m=float(np.percentile(nearest.distance, 95)) if len(seen) else float("nan"),
        own_p95_m=float(np.percentile(nearest.distance, 95 * (1 - strays))) if len(seen) else float("nan"),
        max_m=float(nearest.distance.max(initial=0.0)),
        surface_p95_m=float(np.percentile(gap[measured], 95)) if measured.any() else float("nan"),
        measured_area_fraction=float(share[measured].sum() / (share.sum() or 1.0)),
        stray_share=float(np.mean(nearest.distance > NOISE_SIGMAS * sigma_m + STRAY_SPACINGS * spacing_m)) if len(seen) else float("nan"),
        per_vertex_m=per_vertex,
    )


def largest_left_out(points: FloatArray, off_m: FloatArray, before: TriangleMesh, far_m: float, apart_m: float) -> IntArray:
    """(k,) rows of the most points side by side that lie on a surface and off what was made of it: a part of it was lost. Strays lie on neither.

    points : (n, 3).   off_m : (n,) of each from what was made.   before : the surface.   far_m : by so much more a point lies off the one than
    off the other; its own noise is in both distances.   apart_m : neighbours lie no farther from each other.
    """
    off = np.flatnonzero(off_m > far_m)
    if len(off):
        off = off[off_m[off] - PointToMesh(before).nearest(points[off]).distance > far_m]
    if not len(off):
        return off
    part = radius_components(points[off], apart_m)
    return np.asarray(off[part == np.argmax(np.bincount(part))], np.int64)
