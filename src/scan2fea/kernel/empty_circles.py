"""Circles in a plane that hold no point: their middles are the corners of the points' Voronoi cells.

Each cell is the box of the points, cut by the bisectors towards other points, nearest cells of a grid first, until what is farther cannot cut it any
more: twice the distance of its farthest corner. A corner between two bisectors is the middle of a circle through three points; the first of the three
tells it. A fifth of the time of a triangulation, and walls are asked with several hundred thousand points.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.kernel.planar_grid import PlanarGrid
from scan2fea.types import FloatArray, IntArray

_MOST_CORNERS = 256  # of a Voronoi cell: more neighbours on one circle are left out
_ROUNDING = 1e-12  # of distances: a bisector through a corner, as on a grid and of one point twice, cuts nothing
_PER_POINT = 3  # circles: two of points in general place, one more of those on a grid


def empty_circles(flat: FloatArray, grid: PlanarGrid | None = None) -> tuple[FloatArray, FloatArray]:
    """Middles (m, 2), radii (m,) of the circles through three of the points (n, 2) that hold no other and have their middle in the box of all.

    grid : of the points, where one is there already.
    """
    if grid is None and (len(flat) < 3 or not all(np.ptp(row) > 0 for row in flat.T)):
        return np.zeros((0, 2)), np.zeros(0)
    grid = grid or PlanarGrid.of(flat)
    found = _corners(grid.points, grid.cell, grid.first, grid.shape, grid.step, grid.size)
    return found[:, :2] + grid.low, np.ascontiguousarray(found[:, 2])


@jit_ieee
def _corners(xy: FloatArray, at: IntArray, first: IntArray, shape: IntArray, step: float, size: FloatArray) -> FloatArray:
    """(m, 3) middles and radii.

    xy : (n, 2) points in the order of their cells, from the corner of their box.   at : (n, 2) their cells.   first : point of each cell, row by row.
    """
    n, count = len(xy), 0
    found = np.empty((_PER_POINT * n, 3))
    x, y, by = np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS, np.int64)
    u, v, of = np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS, np.int64)
    for i in range(n):
        corners = _voronoi_cell(i, xy, at, first, shape, step, size, x, y, by, u, v, of)
        for k in range(corners):
            one, other = by[k - 1 if k > 0 else corners - 1], by[k]
            if i < one and i < other and count < len(found):
                found[count, 0], found[count, 1], found[count, 2] = xy[i, 0] + x[k], xy[i, 1] + y[k], math.sqrt(x[k] * x[k] + y[k] * y[k])
                count += 1
    return found[:count].copy()


@jit_ieee
def _voronoi_cell(
    i: int,
    xy: FloatArray,
    at: IntArray,
    first: IntArray,
    shape: IntArray,
    step: float,
    size: FloatArray,
    x: FloatArray,
    y: FloatArray,
    by: IntArray,
    u: FloatArray,
    v: FloatArray,
    of: IntArray,
) -> int:
    """Fills the corners x, y from point i on, and by whose bisector each is followed; their number, 0 of a point that stands earlier too."""
    px, py = xy[i, 0], xy[i, 1]
    x[0], y[0], x[1], y[1] = -px, -py, size[0] - px, -py
    x[2], y[2], x[3], y[3] = size[0] - px, size[1] - py, -px, size[1] - py
    by[:4] = -1
    corners = 4
    far = _farthest(x, y, corners)
    ring = 0
    while ring <= max(shape[0], shape[1]) and (ring <= 1 or ((ring - 1) * step) ** 2 < 4 * far):
        for a in range(max(at[i, 0] - ring, 0), min(at[i, 0] + ring, shape[0] - 1) + 1):
            is_side = ring == 0 or abs(a - at[i, 0]) == ring
            for b in range(at[i, 1] - ring, at[i, 1] + ring + 1, 1 if is_side else 2 * ring):
                row = a * shape[1] + b
                for j in range(first[row], first[row + 1]) if 0 <= b < shape[1] else range(0):
                    dx, dy = xy[j, 0] - px, xy[j, 1] - py
                    away = dx * dx + dy * dy
                    if away == 0.0 and j < i:
                        return 0
                    if 0.0 < away < 4 * far:
                        left = _cut(x, y, by, corners, dx, dy, 0.5 * away, _ROUNDING * math.sqrt(far * away), j, u, v, of)
                        if left > 0:
                            corners, far = left, _farthest(x, y, left)
        ring += 1
    return corners


@jit_ieee
def _farthest(x: FloatArray, y: FloatArray, n: int) -> float:
    """Square of the distance of the farthest corner."""
    far = 0.0
    for k in range(n):
        far = max(far, x[k] * x[k] + y[k] * y[k])
    return far


@jit_ieee
def _cut(
    x: FloatArray,
    y: FloatArray,
    by: IntArray,
    n: int,
    dx: float,
    dy: float,
    most: float,
    slack: float,
    j: int,
    u: FloatArray,
    v: FloatArray,
    of: IntArray,
) -> int:
    """Cuts a cell, in place, down to where x dx + y dy <= most; corners left, 0 where nothing is cut: none lies more than `slack` beyond.

    by : whose bisector follows each corner.   u, v, of : room for the new ones.
    """
    farthest = -math.inf
    for k in range(n):
        farthest = max(farthest, x[k] * dx + y[k] * dy)
    if farthest <= most + slack or n + 1 >= _MOST_CORNERS:
        return 0
    m = 0
    for k in range(n):
        after = k + 1 if k + 1 < n else 0
        one, other = x[k] * dx + y[k] * dy - most, x[after] * dx + y[after] * dy - most
        if one <= slack:
            u[m], v[m], of[m] = x[k], y[k], by[k]
            m += 1
        if (one <= slack) != (other <= slack):
            share = min(max(one / (one - other), 0.0), 1.0)
            u[m], v[m] = x[k] + share * (x[after] - x[k]), y[k] + share * (y[after] - y[k])
            of[m] = j if one <= slack else by[k]
            m += 1
    for k in range(m):
        x[k], y[k], by[k] = u[k], v[k], of[k]
    return m
