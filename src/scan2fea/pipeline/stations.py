"""How far the places that one file was scanned from lie off each other, told by the faces that several of them saw.

Stations are known by where their rays begin. Their scans were put together before the file was written, and what that left is in no noise: the
points of a station move together, and those of stations that agree with each other, as they were put together first. The variance of such sets is
what their means on a face differ by beyond noise (one-way analysis of variance, unequal numbers: Searle, Casella, McCulloch 1992, 3.6).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.errors import StageError
from scan2fea.estimation.solid import solid_of
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.kernel.noise import sampled_rows
from scan2fea.pipeline.dimension_doubt import FramePose, PoseDoubt, design
from scan2fea.types import FloatArray, IntArray, Member, PointCloud, Scan, TriangleMesh, Value

_POINTS = 60_000
_EACH = 30  # points of a station, in the mean: a scanner that moved has fewer at each of its places
_REACH = 5.0  # standard deviations from a face
_FACING = 0.1  # least cosine between a ray and the normal of the face it is on
_STRETCHES, _LEAST = 12, 8  # stretches along the member; points of a station in one
_TURNS = 16  # of a full circle: the normal of a round face in a cell changes by so much
_COARSE, _CUBE = 2.0, 8.0  # normals that round to the same halves are of one face; spacings along a cell of a surface
_SHARE = 0.15  # of the noise: members whose stations agree show up to 0.1 of it
_SIGMAS = 5.0  # of noise, by which two stations differ on a face: many faces and pairs are asked
_FREE = 3  # degrees of freedom; with two or less Student's t has no variance


def stations_of(scan: Scan) -> IntArray | None:
    """(n,) number of the place each point was seen from, -1 where none is known; None where less than two are told, or a scanner moved."""
    cloud = scan.cloud
    if scan.rays is None or not len(cloud):
        return None
    known = cloud.ray >= 0
    if cloud.is_inferred is not None:
        known &= ~cloud.is_inferred
    places, number = np.unique(np.round(scan.rays.origin[cloud.ray[known]], 6), axis=0, return_inverse=True)
    if len(places) < 2 or len(places) * _EACH > int(known.sum()):
        return None
    station = np.full(len(cloud), -1, np.int64)
    station[known] = number.ravel()
    return station


def larger_doubt(scan: Scan, member: Member, doubt: PoseDoubt) -> tuple[PointCloud, PoseDoubt]:
    """The doubt of the poses, or of the stations where faces of a member tell a larger one, and the cloud with the frames that it is of."""
    station = stations_of(scan)
    try:
        solid = solid_of(member) if station is not None else None
    except StageError:
        solid = None
    if station is None or solid is None:
        return scan.cloud, doubt

    def places(points: FloatArray) -> _Places:
        _, normal, field = design(member, solid, points)
        x, y = (normal @ member.T_world_member[:3, :2]).T
        turn = np.round(np.arctan2(y, x) / (2 * math.pi) * _TURNS).astype(np.int64) % _TURNS
        stretch = np.clip(field.z_m / member.values()["length"] * _STRETCHES, 0, _STRETCHES - 1).astype(np.int64)
        return _Places(cell=np.stack([field.face * _TURNS + turn, turn % (_TURNS // 2), stretch], axis=1), normal=normal, off_m=field.off_m)

    sets, variance = _apart(scan, station, places, _REACH * member.sigma_m, 2)
    if 2 * variance <= doubt.between_m**2:
        return scan.cloud, doubt
    frames = []
    for k in np.unique(sets[sets >= 0]).tolist():
        x, y, z = scan.cloud.points[sets == k].mean(axis=0).tolist()
        frames.append(FramePose(frame=k, centre_m=(x, y, z), std_m=math.sqrt(3 * variance), std_rad=0.0))
    return scan.cloud.replaced(frame=sets), PoseDoubt(frames=tuple(frames), between_m=math.sqrt(2 * variance))


def open_volume(scan: Scan, mesh: TriangleMesh, spacing_m: float, sigma_m: float) -> tuple[float, float]:
    """Share of the volume of a surface that the places of the stations leave open, and the deviation (m) of the difference of two along a normal.

    Each set of stations moves its part of the area, shared with the others that saw it: as far as it saw all of it from one side.
    """
    station = stations_of(scan)
    if station is None:
        return 0.0, 0.0
    normals, tree = face_normals(mesh), PointToMesh(mesh)

    def places(points: FloatArray) -> _Places:
        near = tree.nearest(points)
        normal = normals[near.face]
        ways, face = np.unique(np.round(normal * _COARSE).astype(np.int64), axis=0, return_inverse=True)
        axis = np.unique(ways * np.where((ways @ [9, 3, 1]) < 0, -1, 1)[:, None], axis=0, return_inverse=True)[1].ravel()
        cube = np.unique(np.floor(near.closest / (_CUBE * spacing_m)).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
        off = np.einsum("ij,ij->i", points - near.closest, normal)
        return _Places(cell=np.stack([face.ravel(), axis[face.ravel()], cube], axis=1), normal=normal, off_m=off)

    sets, variance = _apart(scan, station, places, _REACH * sigma_m + spacing_m, 3)
    if not variance > 0:
        return 0.0, 0.0
    rows = np.flatnonzero(sets >= 0)
    rows = rows[sampled_rows(len(rows), _POINTS, 0)]
    area = np.bincount(sets[rows]) / len(rows) * float(face_areas(mesh).sum())
    return math.sqrt(variance) * float(np.linalg.norm(area)) / abs(volume(mesh)), math.sqrt(2 * variance)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Places(Value):
    """Of points: cell (n, 3) the face, the axis that it looks along and a stretch of it; its normal (n, 3); how far off it they lie (n,)."""

    cell: IntArray
    normal: FloatArray
    off_m: FloatArray


def _apart(scan: Scan, station: IntArray, places: Callable[[FloatArray], _Places], reach_m: float, n_ways: int) -> tuple[IntArray, float]:
    """(n,) sets of stations that agree, and the variance (m2) of their places along a normal: 0 where noise explains what they differ by.

    Student's t widens it, as few differences tell it.   n_ways : coordinates of a place that normals can tell.
    """
    none = np.full(len(scan.cloud), -1, np.int64), 0.0
    if scan.rays is None:
        return none
    rows = np.flatnonzero(station >= 0)
    rows = rows[sampled_rows(len(rows), _POINTS, 0)]
    at = places(scan.cloud.points[rows])
    facing = -np.einsum("ij,ij->i", at.normal, scan.rays.direction[scan.cloud.ray[rows]])
    on = (np.abs(at.off_m) <= reach_m) & (facing > _FACING)
    cell, own, off = at.cell[on], station[rows][on], at.off_m[on]
    alone = _Means(cell, own, off)
    sets = _alike(alone, int(station.max()) + 1)
    variance, free = _between(_Means(cell, sets[own], off), n_ways)
    if variance <= _SHARE**2 * alone.noise:
        return none
    return np.where(station >= 0, sets[station], -1), variance * max(free, _FREE) / (max(free, _FREE) - 2)


class _Means:
    """Mean distance from the face of each station's points in each cell. keys : (m, 4) cell and station.   noise : variance of points in them."""

    def __init__(self, cells: IntArray, station: IntArray, off: FloatArray) -> None:
        keys, number = np.unique(np.column_stack([cells, station]), axis=0, return_inverse=True)
        number = number.ravel()
        n = np.bincount(number, minlength=len(keys)).astype(float)
        mean = np.bincount(number, off, len(keys)) / np.maximum(n, 1)
        within = np.bincount(number, (off - mean[number]) ** 2, len(keys))
        use = n >= _LEAST
        self.keys, self.n, self.mean = keys[use], n[use], mean[use]
        self.noise = float(within[use].sum() / max((n[use] - 1).sum(), 1.0))
        self.place = np.unique(self.keys[:, :3], axis=0, return_inverse=True)[1].ravel()


def _alike(told: _Means, n_stations: int) -> IntArray:
    """(n_stations,) sets of stations that agree on each face that two of them saw."""
    i, j = _pairs(told.place)
    weight = 1.0 / (1.0 / told.n[i] + 1.0 / told.n[j])
    faces, number = np.unique(np.column_stack([told.keys[i][:, [0, 3]], told.keys[j][:, 3]]), axis=0, return_inverse=True)
    number = number.ravel()
    total = np.bincount(number, weight, len(faces))
    apart = np.abs(np.bincount(number, weight * (told.mean[i] - told.mean[j]), len(faces))) / total
    differ = apart > math.sqrt(told.noise) * np.maximum(_SIGMAS / np.sqrt(total), _SHARE)
    pair = faces[:, 1] * n_stations + faces[:, 2]
    same = np.setdiff1d(pair, pair[differ])
    graph = coo_array((np.ones(len(same)), (same // n_stations, same % n_stations)), shape=(n_stations, n_stations))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _pairs(place: IntArray) -> tuple[IntArray, IntArray]:
    """The pairs of rows (k,), (k,) that lie in one place."""
    order = np.argsort(place, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(place[order])) + 1)
    pairs = [rows[np.stack(np.triu_indices(len(rows), 1))] for rows in groups]
    first, second = np.concatenate(pairs, axis=1) if pairs else np.zeros((2, 0), np.int64)
    return first, second


def _between(told: _Means, n_ways: int) -> tuple[float, int]:
    """Variance (m2) of the places of sets along the normals of faces, and on how many independent differences it rests.

    In each cell the means of k sets with n points each differ by it and by their noise: E[sum of n (mean - grand mean)^2] = (k - 1) noise
    + (N - sum of n^2 / N) variance, N = sum of n.
    """
    place, n = told.place, told.n
    k, N, squares, total = (np.bincount(place, w) for w in (np.ones(len(n)), n, n**2, n * told.mean))
    both = k >= 2
    if not both.any():
        return 0.0, 0
    spread = np.bincount(place, n * (told.mean - (total / N)[place]) ** 2)
    variance = float((spread - (k - 1) * told.noise)[both].sum() / (N - squares / N)[both].sum())
    seen = told.keys[both[place]]
    return max(variance, 0.0), min(len(np.unique(seen[:, 1])), n_ways) * (len(np.unique(seen[:, 3])) - 1)
