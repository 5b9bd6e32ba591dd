"""Planes under a cloud whose outer side is known: grown from its flattest places, each as far as the noise allows, parallel ones joined.

A plane is judged by raw points, so that its place is an average over all of them; which points are its own is told by the normals, so that the two
faces of a wall thinner than the noise still part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.primitives import Plane, fit_plane
from scan2fea.reconstruction.hanging import Among
from scan2fea.reconstruction.regular import EXACT, WAYS_TRIED, near_ways, regular
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

FACING = -0.99  # cosine between the two faces of a wall
NEIGHBORS = 16
MOST_PLANES = 64  # the time grows as their cube
SIGMAS, SPACINGS = 3.0, 0.02  # of a plane's points: within three sigma, and a fiftieth of the spacing for exact data
OWN_SIDE = float(np.cos(np.radians(30.0)))
SEED = 0.98  # mean cosine of a seed's normal with its neighbours'
FIRST_REACH, GROWTH = 3.0, 2.0  # spacings round the seed that the first plane is fitted to, and how it widens
LEAST_POINTS = 12
FAILURES = 200  # seeds in a row that give no plane: what is left is not flat
SAME_DEG = 4.0
TURNED_HOLDS = 0.7
WIDENINGS = 24
INTERLEAVED = 0.5  # of the mixed neighbours that chance would make
SETTLED = 12


@dataclass(frozen=True, eq=False, kw_only=True)
class Planes(Value):
    """normal : (p, 3) outward.   offset : (p,).   label : (n,) plane of each point, -1 none.   std_m : (p,) of its offset."""

    normal: FloatArray
    offset: FloatArray
    label: IntArray
    std_m: FloatArray

    def __len__(self) -> int:
        return len(self.offset)

    def plane(self, number: int) -> Plane:
        return Plane(normal=self.normal[number], offset=float(self.offset[number]))


def tolerance_m(spacing_m: float, sigma_m: float) -> float:
    """How far a point may lie off its plane."""
    return SIGMAS * sigma_m + SPACINGS * spacing_m


def grow_planes(points: FloatArray, normals: FloatArray, spacing_m: float, sigma_m: float, ways: FloatArray | None = None) -> Planes:
    """The planes of (n, 3) raw points with outward normals, largest first.

    ways : (k, 3) directions that planes may well have, of cylinders: the ring at the end of a tube is too narrow to tell its own.

    Raises ReconstructionError beyond MOST_PLANES: a curved face falls into ever more of them.
    """
    off = tolerance_m(spacing_m, sigma_m)
    if not len(points):
        return Planes(normal=np.zeros((0, 3)), offset=np.zeros(0), label=np.zeros(0, np.int64), std_m=np.zeros(0))
    _, near = k_nearest(points, NEIGHBORS)
    alike = np.einsum("ni,nki->nk", normals, normals[near[:, 1:]])
    flatness = np.where(alike > 0, alike, 0.0).sum(axis=1) / np.maximum((alike > 0).sum(axis=1), 1)
    among = Among.of(points, normals, near)
    free = np.ones(len(points), bool)
    planes: list[Plane] = []
    failures = 0
    for seed in np.argsort(-flatness, kind="stable"):
        if not free[seed]:
            continue
        if flatness[seed] < SEED or failures >= FAILURES:
            break
        plane = grown_plane(among, int(seed), free, spacing_m, off)
        if plane is not None and sigma_m > EXACT:
            known = np.array([p.normal for p in planes]).reshape(-1, 3)
            plane = _turned(among, near, int(seed), free, off, plane, known if ways is None else np.vstack([ways, known]))
        own = np.zeros(len(points), bool) if plane is None else own_points(points, normals, plane, off) & free
        if plane is None or own.sum() < LEAST_POINTS or not own[seed]:
            failures += 1
            free[seed] = False
            continue
        planes.append(plane)
        says = f"the points would need more than {MOST_PLANES} planes: they are no solid of flat faces"
        require(len(planes) <= MOST_PLANES, ReconstructionError, says)
        free &= ~own
        failures = 0
    return settled(points, normals, planes, spacing_m, sigma_m)


def own_points(points: FloatArray, normals: FloatArray, plane: Plane, off: float) -> BoolArray:
    return np.asarray((np.abs(plane.distance(points)) <= off) & (normals @ plane.normal >= OWN_SIDE))


def grown_plane(among: Among, seed: int, free: BoolArray, spacing_m: float, off: float) -> Plane | None:
    """The plane through a seed's neighbourhood, widened until it takes no more points in that hang together."""
    points, normal = among.points, among.normals[seed]
    farthest = float(np.linalg.norm(np.maximum(points[seed] - among.low, among.high - points[seed])))
    plane = Plane(normal=normal, offset=float(normal @ points[seed]))
    reach, before = FIRST_REACH * spacing_m, -1
    slack = 2.0 * off
    for _ in range(WIDENINGS):
        own = among.near(seed, free, plane, slack, OWN_SIDE, reach)
        if len(own) < 4:
            return None
        plane = robust_plane(points[own], plane.normal)
        slack = off
        if len(own) == before and reach > farthest:
            break
        before, reach = len(own), reach * GROWTH
    return plane


def _turned(among: Among, near: IntArray, seed: int, free: BoolArray, off: float, plane: Plane, known: FloatArray) -> Plane:
    """The plane, or one along a direction that (k, 3) known ones give, if that holds nearly as many points: a plane may tilt to catch others."""
    wanted = TURNED_HOLDS * len(among.near(seed, free, plane, off, OWN_SIDE))
    for way in near_ways(known, plane.normal)[:WAYS_TRIED]:
        turned = Plane(normal=way, offset=float(np.median(among.points[near[seed]] @ way)))
        for _ in range(2):
            own = among.near(seed, free, turned, off, OWN_SIDE)
            if len(own) < LEAST_POINTS:
                break
            height = among.points[own] @ way
            turned = Plane(normal=way, offset=float(height.mean()), rms_m=float(height.std()))
        else:
            if len(own) >= wanted:
                return turned
    return plane


def robust_plane(points: FloatArray, towards: FloatArray) -> Plane:
    """Least squares plane, points farther than 3.5 times their own scatter left out: exact where most are exact."""
    plane = fit_plane(points, towards=towards)
    for _ in range(SETTLED):
        distance = np.abs(plane.distance(points))
        limit = 3.5 * 1.4826 * float(np.median(distance))
        keep = distance <= max(limit, 1e-15)
        if keep.sum() < 3 or keep.all():
            break
        better = fit_plane(points[keep], towards=towards)
        done = np.allclose(better.normal, plane.normal, atol=1e-15) and abs(better.offset - plane.offset) < 1e-15
        plane = better
        if done:
            break
    return plane


def settled(points: FloatArray, normals: FloatArray, planes: list[Plane], spacing_m: float, sigma_m: float) -> Planes:
    """The planes with every point given to the nearest one of its side, those that are one joined, and all fitted again."""
    off = tolerance_m(spacing_m, sigma_m)
    before = np.zeros(0, np.int64)
    for _ in range(SETTLED):
        label = assigned(points, normals, planes, off)
        planes, label = _fitted(points, planes, label)
        planes = regular(points, planes, label, sigma_m)
        joined = _joined(points, planes, label, spacing_m, sigma_m)
        if len(joined) == len(planes) and np.array_equal(label, before):
            break
        planes, before = joined, label
    else:  # the last round joined planes once more: the labels are still those of before
        label = assigned(points, normals, planes, off)
    count = np.bincount(label[label >= 0], minlength=len(planes))
    order = np.argsort(-count, kind="stable")
    rank = np.empty(len(planes) + 1, np.int64)
    rank[order], rank[-1] = np.arange(len(planes)), -1
    planes = [planes[k] for k in order]
    return Planes(
        normal=np.array([p.normal for p in planes]).reshape(-1, 3),
        offset=np.array([p.offset for p in planes]),
        label=rank[label],
        std_m=np.array([max(p.rms_m, 1e-300) for p in planes]) / np.sqrt(np.maximum(count[order], 1)),
    )


def assigned(points: FloatArray, normals: FloatArray, planes: list[Plane], off: float) -> IntArray:
    """(n,) the plane of its own side that each point lies nearest to, -1 beyond `off`."""
    label, best = np.full(len(points), -1, np.int64), np.full(len(points), off)
    for k, plane in enumerate(planes):
        distance = np.where(normals @ plane.normal >= OWN_SIDE, np.abs(plane.distance(points)), np.inf)
        closer = distance <= best
        label[closer], best[closer] = k, distance[closer]
    return label


def _fitted(points: FloatArray, planes: list[Plane], label: IntArray) -> tuple[list[Plane], IntArray]:
    """Each plane through its own points again; those left with too few are dropped."""
    out: list[Plane] = []
    number = np.full(len(planes) + 1, -1, np.int64)
    for k, plane in enumerate(planes):
        own = points[label == k]
        if len(own) >= LEAST_POINTS:
            number[k] = len(out)
            out.append(robust_plane(own, plane.normal))
    return out, number[label]


def _joined(points: FloatArray, planes: list[Plane], label: IntArray, spacing_m: float, sigma_m: float) -> list[Plane]:
    """Planes of one direction whose points lie, on average, on the larger one, or among its own: they are the same.

    Where two planes have settled within the noise of one face each holds the points of its side of it, and neither's mean is on the other.
    """
    size = np.bincount(label[label >= 0], minlength=len(planes))
    order = np.argsort(-size, kind="stable").tolist()
    kept: list[int] = []
    for k in order:
        own = points[label == k]
        for j in kept:
            if planes[j].normal @ planes[k].normal < np.cos(np.radians(SAME_DEG)):
                continue
            distance = planes[j].distance(own)
            scatter = max(planes[k].rms_m, sigma_m)
            mean = abs(float(distance.mean()))
            if mean <= 3.0 * scatter / np.sqrt(len(own)) + SPACINGS * spacing_m and distance.std() <= 1.2 * scatter + SPACINGS * spacing_m:
                break
            if mean <= 2.0 * tolerance_m(spacing_m, sigma_m) and interleaved(own, points[label == j], planes[j]):
                break
        else:
            kept.append(k)
    return [planes[k] for k in sorted(kept)]


def interleaved(one: FloatArray, other: FloatArray, plane: Plane) -> bool:
    """Do the points of two sets lie among each other along the plane? Two faces that look the same way cannot lie over each other so near."""
    across = np.concatenate([one, other]) @ plane.axes().T
    is_other = np.arange(len(across)) >= len(one)
    nearest = np.asarray(cKDTree(across).query(across, k=2)[1])[:, 1]
    mixed = float(np.mean(is_other[nearest] != is_other))
    share = len(one) / len(across)
    return mixed >= INTERLEAVED * 2.0 * share * (1.0 - share)
