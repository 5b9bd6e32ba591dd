"""Straight runs of a pipe found in its points: patches that are bent one way only, each grown along its cylinder as far as points lie on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.surface_fit import CYLINDER, descend
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

_SEEDS = 60  # places where a run is looked for
_ASKED, _CURVED = 12, 0.3  # seeds, and their share that must lie on something bent one way; growths of which one must come to a run
_PATCHES = (16, 32, 64, 128, 256, 512, 1024)  # points of the patches that tell a curvature
_PATCH_POINTS = 12
_TELLS = 5.0  # standard deviations of a curvature that is one
_FLAT = 1e-3  # of the inverse of a patch's size: a curvature below is none
_BENT_SIGMAS = 2.5
_ROUND = 0.25  # of the larger curvature of a cylinder's patch that the other may be
_FITTED = 3_000  # points of a fit
_LEAST_RUN = 30  # points
_GROWTHS = 20
_BESIDE = 1.5  # radii: what is as near to a run is told by it
_SHORTEST = 1.0  # of the radius: a run that is shorter has no direction
_LEAST = 0.02  # of the points, on a run
_ALIKE = 0.1  # of the radius by which runs of one pipe may differ: an inner and an outer skin may have been found
_SKIN = 0.05  # of the points, on a second skin
WIDE = 0.3  # of the radius: points that lie off a first guess by less are on the pipe

_Patch = tuple[FloatArray, FloatArray, float, IntArray]  # place on the axis, direction, radius, rows of the points


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Value):
    """A straight run: place and direction of its axis, radius, extent along it from the place, rows of its points."""

    at: FloatArray
    axis: FloatArray
    radius: float
    low: float
    high: float
    rows: BoolArray

    def end(self, k: int) -> FloatArray:
        return np.asarray(self.at + (self.high if k else self.low) * self.axis)

    def outward(self, k: int) -> FloatArray:
        return self.axis if k else -self.axis


def runs_of(points: FloatArray, h: float, tolerance: float, seed: int) -> list[Run]:
    """Straight runs of one radius, that of most points first."""
    tree = cKDTree(points)
    free = np.ones(len(points), bool)
    runs: list[Run] = []
    n_asked = n_curved = n_grown = 0
    for row in np.random.default_rng(seed).permutation(sampled_rows(len(points), _SEEDS, seed)):
        if not free[row]:
            continue
        begun = _curved(points, tree, int(row), tolerance)
        n_asked, n_curved = n_asked + 1, n_curved + (begun is not None)
        if n_asked >= _ASKED and n_curved < _CURVED * n_asked:
            return []  # nothing that is bent everywhere
        if n_grown >= _ASKED and not runs:
            return []  # bent at its edges: of a pipe the first few patches grow
        run = None if begun is None else _grown(points, begun, tolerance, h)
        n_grown += begun is not None
        if run is None or (runs and abs(run.radius - runs[0].radius) > _ALIKE * runs[0].radius):
            continue
        fresh = run.rows & free
        if fresh.sum() < max(_LEAST * len(points), _LEAST_RUN):
            continue
        runs.append(run)
        runs.sort(key=lambda one: -int(one.rows.sum()))
        away = np.linalg.norm(np.cross(points - run.at, run.axis), axis=1)
        z = (points - run.at) @ run.axis
        free &= ~((away < _BESIDE * run.radius) & (z > run.low) & (z < run.high))  # both skins
    return _in_one(points, runs, tolerance, h)


def _in_one(points: FloatArray, runs: list[Run], tolerance: float, h: float) -> list[Run]:
    """The runs, parts of one line grown again together."""
    whole: list[Run] = []
    for run in runs:
        k = next((k for k, one in enumerate(whole) if _goes_on(one, run)), None)
        if k is None:
            whole.append(run)
            continue
        one = whole[k]
        rows = np.flatnonzero(one.rows | run.rows).astype(np.int64)
        ends = np.array([(run.end(0) - one.at) @ one.axis, (run.end(1) - one.at) @ one.axis, one.low, one.high])
        both = _grown(points, (one.at, one.axis, one.radius, _few(rows)), tolerance, h, (float(ends.min()), float(ends.max())))
        whole[k] = one if both is None or both.rows.sum() < one.rows.sum() else both
    return sorted(whole, key=lambda one: -int(one.rows.sum()))


def _goes_on(one: Run, other: Run) -> bool:
    """Whether the other lies on the line of the one, beside it or close by."""
    local = np.array([other.end(0), other.end(1)]) - one.at
    z = local @ one.axis
    off = np.linalg.norm(local - z[:, None] * one.axis, axis=1)
    apart = max(float(z.min()) - one.high, one.low - float(z.max()))
    return bool(off.max() < WIDE * one.radius and apart < one.radius)


def _curved(points: FloatArray, tree: cKDTree, row: int, tolerance: float) -> _Patch | None:
    """Place on the axis, direction, radius and rows of a patch about one point that is bent one way only; the smallest patch that tells so.

    Of two skins the better seen one is fitted: once it is told by how far points lie off a quadric through both.
    """
    for size in _PATCHES:
        distance, near = tree.query(points[row], min(size, len(points)))
        rows, reach = np.asarray(near, np.int64), float(np.max(distance))
        if not reach > 0:
            continue
        local = points[rows] - points[row]
        turn = np.linalg.eigh(np.cov(local.T))[1][:, ::-1]  # the normal last
        u, v, w = (local @ turn).T
        A = np.column_stack([np.ones(len(u)), u, v, 0.5 * u * u, u * v, 0.5 * v * v])
        own = np.ones(len(u), bool)
        for _ in range(3):
            q = np.linalg.lstsq(A[own], w[own], rcond=None)[0]
            left = w - A @ q
            own = np.abs(left - mode(left, tolerance)) < tolerance
        if own.sum() < _PATCH_POINTS:
            continue
        variance = float((left[own] ** 2).sum()) / (own.sum() - 6)
        inverted = np.linalg.pinv(A[own].T @ A[own])
        std = math.sqrt(variance * max(inverted[3, 3], inverted[5, 5]))
        values, ways = np.linalg.eigh(np.array([[q[3], q[4]], [q[4], q[5]]]))
        k = int(np.argmax(np.abs(values)))
        bent, other = float(values[k]), float(values[1 - k])
        if abs(bent) < max(_TELLS * std, _FLAT / reach) or abs(other) > _ROUND * abs(bent) + _BENT_SIGMAS * std:
            continue
        if reach * abs(bent) > 1.0:
            return None  # the patch is larger than the radius: no smaller one told it
        return points[row] + (q[0] + 1 / bent) * turn[:, 2], turn[:, :2] @ ways[:, 1 - k], 1.0 / abs(bent), rows[own]
    return None


def mode(values: FloatArray, reach: float) -> float:
    """The middle of those of the values (n,) that most others lie within reach of."""
    order = np.sort(values)
    count = np.searchsorted(order, order + 2 * reach, side="right") - np.arange(len(order))
    k = int(np.argmax(count))
    return float(np.median(order[k : k + int(count[k])]))


def _grown(
    points: FloatArray,
    begun: _Patch,
    tolerance: float,
    h: float,
    span: tuple[float, float] = (0.0, 0.0),
) -> Run | None:
    """The run that a patch is part of: fitted again and again to what lies on it, each time farther along, until it grows no more."""
    at, axis, radius, rows = begun
    at, axis, radius = _cylinder(points[rows], at, axis, radius)
    low, high = span
    for _ in range(_GROWTHS):
        z, away = _about(points, at, axis)
        further = max(0.5 * radius, 0.5 * (high - low))
        near = (z > low - further) & (z < high + further)
        skin = _skin(away[near], radius, tolerance)
        if skin is None:
            return None
        rows = np.flatnonzero(near & (np.abs(away - skin) < tolerance)).astype(np.int64)
        if len(rows) < _LEAST_RUN:
            return None
        at, axis, radius = _cylinder(points[_few(rows)], at, axis, skin)
        z, away = _about(points, at, axis)
        before = high - low
        low, high = _extent(z, away, radius, tolerance, max(2 * h, 0.25 * radius))
        if 0 < high - low < 1.01 * before:
            break
    on = (np.abs(away - radius) < tolerance) & (z >= low) & (z <= high)
    if high - low < _SHORTEST * radius or not on.any():
        return None
    return Run(at=at, axis=axis, radius=radius, low=low, high=high, rows=on)


def _few(rows: IntArray) -> IntArray:
    return rows[:: max(1, len(rows) // _FITTED)]


def _about(points: FloatArray, at: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place along a line (n,), distance from it (n,)."""
    local = points - at
    z = local @ axis
    return z, np.asarray(np.linalg.norm(local - z[:, None] * axis, axis=1))


def _cylinder(points: FloatArray, at: FloatArray, axis: FloatArray, radius: float) -> tuple[FloatArray, FloatArray, float]:
    begin = np.array([*at, *axis, radius, 0.0])
    found, _ = descend(CYLINDER, begin, np.ascontiguousarray(points), np.ones(len(points)), np.ones(5, bool), radius, 30)
    way = found[3:6] / np.linalg.norm(found[3:6])
    return found[:3] + way * float((at - found[:3]) @ way), way, float(found[6])


def _skin(away: FloatArray, radius: float, tolerance: float) -> float | None:
    """The distance from the axis at which most points lie, near the radius: of two skins the one that was seen better."""
    near = away[np.abs(away - radius) < WIDE * radius]
    if len(near) < _PATCH_POINTS:
        return None
    return mode(near, tolerance)


def _extent(z: FloatArray, away: FloatArray, radius: float, tolerance: float, step: float) -> tuple[float, float]:
    """From where to where along the axis, about its place, most points near it lie on the run or within."""
    outer = float(skins(away[np.abs(z) < 2 * radius], radius, tolerance).max())
    beside = away < _BESIDE * radius
    cell = np.floor(z[beside] / step).astype(np.int64)
    first = int(cell.min(initial=0))
    n_on = np.bincount(cell - first, weights=np.abs(away[beside] - radius) < tolerance)
    n_out = np.bincount(cell - first, weights=away[beside] > outer + tolerance)
    good = n_on > n_out
    middle = min(max(-first, 0), len(good) - 1)
    if not good[middle]:
        return 0.0, 0.0
    high = middle + int(np.argmin(np.append(good[middle:], False)))
    low = middle - int(np.argmin(np.append(good[middle::-1], False)))
    return (low + 1 + first) * step, (high + first) * step


def skins(off: FloatArray, radius: float, tolerance: float) -> FloatArray:
    """(1 or 2,) radii of the skins that points (n,) from the axis lie on, one of which is known."""
    rest = off[(np.abs(off - radius) > 2 * tolerance) & (np.abs(off - radius) < WIDE * radius)]
    other = mode(rest, tolerance) if len(rest) else radius
    return np.array([radius, other]) if (np.abs(rest - other) < tolerance).sum() >= _SKIN * len(off) else np.array([radius])
