"""Points in a plane sorted into the cells of a grid, a few to a cell, and how many of them lie within reach of places."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray, IntArray, Value

_PER_CELL = 2.0  # points


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanarGrid(Value):
    """low, size : (2,) corner of the box of the points, and its sides.   step : of the cells.   shape : (2,) numbers of cells.

    points : (n, 2) from that corner, in the order of their cells, row by row.   cell : (n, 2) of each.   first : point of each cell, and n.
    """

    low: FloatArray
    size: FloatArray
    step: float
    shape: IntArray
    points: FloatArray
    cell: IntArray
    first: IntArray

    @classmethod
    def of(cls, flat: FloatArray) -> PlanarGrid:
        """flat : (n, 2), not all on a line along either axis."""
        low = np.array([row.min() for row in flat.T])  # column by column: along the short side of an array numpy takes ten times as long
        size = np.array([row.max() for row in flat.T]) - low
        step = max(math.sqrt(_PER_CELL * float(size[0] * size[1]) / len(flat)), float(size.max()) / len(flat))
        shape = np.ceil(size / step).astype(np.int64)
        points, cell, first = _sorted(np.ascontiguousarray(flat), low, step, shape)
        return cls(low=low, size=size, step=step, shape=shape, points=points, cell=cell, first=first)

    def n_within(self, at: FloatArray, reach: FloatArray) -> FloatArray:
        """(k,) points within reach (k,) of places at (k, 2)."""
        return _n_within(self.points, self.first, self.shape, self.step, np.ascontiguousarray(at - self.low), np.ascontiguousarray(reach))


@jit_ieee
def _sorted(flat: FloatArray, low: FloatArray, step: float, shape: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """The points from the corner, in the order of their cells (of one cell in their own), their cells, and the first point of each cell."""
    n, n_cells = len(flat), shape[0] * shape[1]
    number, first = np.empty(n, np.int64), np.zeros(n_cells + 1, np.int64)
    for i in range(n):
        a, b = min(int((flat[i, 0] - low[0]) / step), shape[0] - 1), min(int((flat[i, 1] - low[1]) / step), shape[1] - 1)
        number[i] = a * shape[1] + b
        first[number[i] + 1] += 1
    for k in range(n_cells):
        first[k + 1] += first[k]
    filled, points, cell = first[:-1].copy(), np.empty((n, 2)), np.empty((n, 2), np.int64)
    for i in range(n):
        at = filled[number[i]]
        filled[number[i]] += 1
        points[at, 0], points[at, 1] = flat[i, 0] - low[0], flat[i, 1] - low[1]
        cell[at, 0], cell[at, 1] = number[i] // shape[1], number[i] % shape[1]
    return points, cell, first


@jit_ieee
def _n_within(points: FloatArray, first: IntArray, shape: IntArray, step: float, at: FloatArray, reach: FloatArray) -> FloatArray:
    found = np.zeros(len(at))
    for k in range(len(at)):
        x, y, r = at[k, 0], at[k, 1], reach[k]
        low, high = _cell((y - r) / step, shape[1]), _cell((y + r) / step, shape[1])
        for a in range(_cell((x - r) / step, shape[0]), _cell((x + r) / step, shape[0]) + 1):
            for j in range(first[a * shape[1] + low], first[a * shape[1] + high + 1]):  # the cells of a row stand side by side
                dx, dy = points[j, 0] - x, points[j, 1] - y
                found[k] += dx * dx + dy * dy <= r * r
    return found


@jit_ieee
def _cell(at: float, n: int) -> int:
    """The cell of 0 .. n - 1 that holds `at`, or the nearest: points on the far border are of the last."""
    return int(min(max(at, 0.0), n - 1.0))
