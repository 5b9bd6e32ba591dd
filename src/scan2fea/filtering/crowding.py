"""Has each point at least k others within a radius? Counted over sorted cells, stopping at k: nobody is listed.

Cells of the radius' size are numbered along z, then y, then x, so the 27 about a point are nine runs of the sorted points, whose ends only move
forward from cell to cell.
"""

from __future__ import annotations

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray

_MOST_CELLS = 2.0**62
_MIX = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F)


def crowded(points: FloatArray, radius_m: float, k: int) -> BoolArray:
    """(n,) True where k others or more of points (n, 3) lie within `radius_m`; at it counts. Raises InternalError for a radius that is none."""
    require(0 < radius_m < np.inf, InternalError, f"neighbours within a radius of {radius_m}")
    low = points.min(axis=0)
    sides = np.floor((points.max(axis=0) - low) / radius_m) + 3.0  # an empty cell on each side keeps rows apart
    edge = radius_m * max(1.0, float((sides.prod() / _MOST_CELLS) ** (1 / 3)))  # larger cells where there would be too many: slower, the same answer
    sides = np.floor((points.max(axis=0) - low) / edge) + 3.0
    ny, nz = int(sides[1]), int(sides[2])
    cell = _cells(np.ascontiguousarray(points, float), low, edge, ny, nz)
    order = np.argsort(cell)
    is_crowded = np.zeros(len(points), bool)
    _count(points[:, 0][order], points[:, 1][order], points[:, 2][order], cell[order], order, ny, nz, radius_m * radius_m, k, is_crowded)
    return is_crowded


def repeated(points: FloatArray) -> BoolArray:
    """(n,) True for each point that equals an earlier one."""
    bits = np.ascontiguousarray(points + 0.0, float).view(np.uint64).reshape(-1, 3)  # + 0: the two zeros are equal
    mixed = (bits[:, 0] * np.uint64(_MIX[0])) ^ (bits[:, 1] + (bits[:, 2] << np.uint64(1)) * np.uint64(_MIX[1]))
    ordered = np.sort(mixed)
    same = ordered[1:][ordered[1:] == ordered[:-1]]
    twice = np.zeros(len(points), bool)
    if len(same):
        rows = np.flatnonzero(np.isin(mixed, same))
        twice[rows] = True
        twice[rows[np.unique(points[rows], axis=0, return_index=True)[1]]] = False
    return twice


@jit
def _cells(points: FloatArray, low: FloatArray, edge: float, ny: int, nz: int) -> IntArray:
    cell = np.empty(len(points), np.int64)
    for i in range(len(points)):
        x, y, z = (points[i, 0] - low[0]) / edge, (points[i, 1] - low[1]) / edge, (points[i, 2] - low[2]) / edge
        cell[i] = ((np.int64(x) + 1) * ny + np.int64(y) + 1) * nz + np.int64(z) + 1
    return cell


@jit
def _count(
    x: FloatArray, y: FloatArray, z: FloatArray, cell: IntArray, order: IntArray, ny: int, nz: int, squared: float, k: int, is_crowded: BoolArray
) -> None:
    """x, y, z, cell : (n,) in the order of cells.   order : (n,) rows of `is_crowded`, which receives the answer."""
    n = len(x)
    begin, end, shift = np.zeros(9, np.int64), np.zeros(9, np.int64), np.empty(9, np.int64)
    for r in range(9):
        at = (r + 4) % 9  # the point's own run first: most are done there
        shift[r] = (at // 3 - 1) * ny * nz + (at % 3 - 1) * nz
    first = 0
    while first < n:
        last = first
        while last < n and cell[last] == cell[first]:
            last += 1
        for r in range(9):
            while begin[r] < n and cell[begin[r]] < cell[first] + shift[r] - 1:
                begin[r] += 1
            end[r] = max(end[r], begin[r])
            while end[r] < n and cell[end[r]] <= cell[first] + shift[r] + 1:
                end[r] += 1
        for i in range(first, last):
            u, v, w, found = x[i], y[i], z[i], -1  # itself
            for r in range(9):
                for j in range(begin[r], end[r]):  # to the end of a run: without a way out it is done several at a time
                    found += (x[j] - u) * (x[j] - u) + (y[j] - v) * (y[j] - v) + (z[j] - w) * (z[j] - w) <= squared
                if found >= k:
                    break
            is_crowded[order[i]] = found >= k
        first = last
