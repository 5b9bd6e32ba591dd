"""Intrinsic shape signatures: points whose surroundings have three directions of their own (Zhong 2009; thesis eq 2.1-2.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.neighbors import slot_of, sorted_into_cells
from scan2fea.options import option
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

_FLAT = 1e-10  # of the first eigenvalue: what rounding leaves across a plane


@dataclass(frozen=True, kw_only=True)
class KeypointOptions:
    """Which points are key points. Lengths None: from the edge of the voxels."""

    gamma_21: float = option(0.975, "Second by first eigenvalue of the scatter stays below this.", minimum=0.0, maximum=1.0)
    gamma_32: float = option(0.975, "Third by second eigenvalue stays below this.", minimum=0.0, maximum=1.0)
    at_most: int = option(1000, "Only so many, those of the largest third eigenvalue.", minimum=3)


@dataclass(frozen=True, eq=False, kw_only=True)
class Saliency(Value):
    """weight : (n,) eq 2.1.   values : (m, 3) eigenvalues of eq 2.2, largest first.   axes : (m, 3, 3), columns are their unit vectors."""

    weight: FloatArray
    values: FloatArray
    axes: FloatArray


def within(points: FloatArray, rows: IntArray, radius_m: float) -> tuple[IntArray, IntArray]:
    """Neighbours nearer than `radius_m` of some of the points, each its own: (m + 1,) starts into (k,) indices.

    points : (n, 3).   rows : (m,). Raises InternalError unless the radius is positive and finite.
    """
    require(0 < radius_m < math.inf, InternalError, f"within needs a positive radius, got {radius_m}")
    if len(points) == 0:
        return np.zeros(len(rows) + 1, np.int64), np.zeros(0, np.int64)
    xyz = np.array(points, float, order="C")  # one that may be written to: else kernels are compiled twice
    low = xyz.min(axis=0)
    _, cells, table, order, start = sorted_into_cells(xyz, low, float(radius_m))
    wanted = np.ascontiguousarray(rows, np.int64)
    nothing = np.zeros(0, np.int64)
    begin = np.zeros(len(wanted) + 1, np.int64)
    _within(xyz, wanted, low, float(radius_m), cells, table, order, start, begin, nothing)
    begin = np.concatenate([[0], np.cumsum(begin[:-1])])
    found = np.empty(int(begin[-1]), np.int64)
    _within(xyz, wanted, low, float(radius_m), cells, table, order, start, begin, found)
    return begin, found


def saliency(points: FloatArray, rows: IntArray, density_radius_m: float, frame_radius_m: float) -> Saliency:
    """Weights of all points and the weighted scatter about some of them.

    eq 2.1: w_j = 1 / #{k : |p_k - p_j| < r_density}, j counted (a count: the norms printed in the thesis are a misprint, Zhong 2009).
    eq 2.2: S_i = sum w_j (p_j - p_i)(p_j - p_i)^T / sum w_j over |p_j - p_i| < r_frame: about p_i itself, not about the mean.
    """
    begin, _ = within(points, np.arange(len(points)), density_radius_m)
    weight = 1.0 / np.diff(begin)
    begin, near = within(points, rows, frame_radius_m)
    scatter = _scatter(np.ascontiguousarray(points, float), np.ascontiguousarray(rows, np.int64), weight, begin, near)
    values, axes = np.linalg.eigh(scatter)
    return Saliency(weight=weight, values=np.maximum(values[:, ::-1], 0.0), axes=axes[:, :, ::-1])


def keypoints(
    points: FloatArray, density_radius_m: float, frame_radius_m: float, apart_m: float, options: KeypointOptions = KeypointOptions()
) -> IntArray:
    """Rows of the key points, largest third eigenvalue first.

    A key point has l2 / l1 < gamma_21 and l3 / l2 < gamma_32 and the largest l3 of all such points nearer than `apart_m` (of equal ones the
    first row). Invariant under rigid motion, scale (of points and radii) and, but for ties, the order of the points.
    """
    found = saliency(points, np.arange(len(points)), density_radius_m, frame_radius_m)
    l1, l2, l3 = found.values.T
    salient = (l2 < options.gamma_21 * l1) & (l3 < options.gamma_32 * l2) & (l3 > _FLAT * l1)
    rows = np.flatnonzero(salient)
    if len(rows) == 0:
        return rows
    begin, near = within(points[rows], np.arange(len(rows)), apart_m)
    kept = rows[_is_largest(l3[rows], begin, near)]
    largest: IntArray = kept[np.argsort(-l3[kept], kind="stable")][: options.at_most]
    return largest


@jit
def _within(
    points: FloatArray,
    rows: IntArray,
    low: FloatArray,
    radius: float,
    cells: IntArray,
    table: IntArray,
    order: IntArray,
    start: IntArray,
    begin: IntArray,
    found: IntArray,
) -> None:
    """Counts into `begin` where `found` is empty, else fills `found` from `begin`."""
    counting = len(found) == 0
    for r in range(len(rows)):
        p = rows[r]
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        i, j, k = math.floor((x - low[0]) / radius), math.floor((y - low[1]) / radius), math.floor((z - low[2]) / radius)
        n = 0
        for di in range(-1, 2):
            for dj in range(-1, 2):
                for dk in range(-1, 2):
                    c = table[slot_of(np.int64(i + di), np.int64(j + dj), np.int64(k + dk), cells, table)]
                    if c < 0:
                        continue
                    for a in range(start[c], start[c + 1]):
                        q = order[a]
                        d = (points[q, 0] - x) ** 2 + (points[q, 1] - y) ** 2 + (points[q, 2] - z) ** 2
                        if d < radius * radius:
                            if not counting:
                                found[begin[r] + n] = q
                            n += 1
        if counting:
            begin[r] = n


@jit
def _scatter(points: FloatArray, rows: IntArray, weight: FloatArray, begin: IntArray, near: IntArray) -> FloatArray:
    scatter = np.zeros((len(rows), 3, 3))
    for r in range(len(rows)):
        total = 0.0
        for a in range(begin[r], begin[r + 1]):
            q = near[a]
            w = weight[q]
            total += w
            for i in range(3):
                for j in range(i, 3):
                    scatter[r, i, j] += w * (points[q, i] - points[rows[r], i]) * (points[q, j] - points[rows[r], j])
        for i in range(3):
            for j in range(i, 3):
                scatter[r, i, j] /= total
                scatter[r, j, i] = scatter[r, i, j]
    return scatter


@jit
def _is_largest(value: FloatArray, begin: IntArray, near: IntArray) -> BoolArray:
    largest = np.ones(len(value), np.bool_)
    for r in range(len(value)):
        for a in range(begin[r], begin[r + 1]):
            q = near[a]
            if value[q] > value[r] or (value[q] == value[r] and q < r):
                largest[r] = False
                break
    return largest
