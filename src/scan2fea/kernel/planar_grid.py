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
        low, size = flat.min(axis=0), np.ptp(flat, axis=0)
        step = max(math.sqrt(_PER_CELL * float(size[0] * size[1]) / len(flat)), float(size.max()) / len(flat))
        shape = np.ceil(size / step).astype(np.int64)
        cell = np.minimum(((flat - low) / step).astype(np.int64), shape - 1)
        number = cell[:, 0] * shape[1] + cell[:, 1]
        order = np.argsort(number, kind="stable")
        first = np.r_[0, np.cumsum(np.bincount(number, minlength=int(shape.prod())))]
        return cls(low=low, size=size, step=step, shape=shape, points=flat[order] - low, cell=cell[order], first=first)

    def n_within(self, at: FloatArray, reach: FloatArray) -> FloatArray:
        """(k,) points within reach (k,) of places at (k, 2)."""
        return _n_within(self.points, self.first, self.shape, self.step, np.ascontiguousarray(at - self.low), np.ascontiguousarray(reach))


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
