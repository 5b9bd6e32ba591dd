"""What Lloyd and ODT in a volume share: which vertices may move, how far, and which tets must not get worse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.tetmeshing.work import shape_quality
from scan2fea.types import BoolArray, ByteArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class InVolume:
    """Half of a method: held boundary, step limit, guard. A tet may fall to `floor` (a quality of `work`), but not below what it was."""

    tets: IntArray
    held: ByteArray
    floor: float

    def reach(self, points: FloatArray) -> FloatArray:
        return _half_shortest_edges(points, self.tets, self.held)

    def projected(self, points: FloatArray, trial: FloatArray) -> FloatArray:
        return np.where(self.held[:, None] > 0, points, trial)

    def spoiled(self, points: FloatArray, trial: FloatArray) -> BoolArray:
        return _spoiled(points, trial, self.tets, self.floor)

    def reconnected(self, points: FloatArray) -> bool:
        return False  # the driver flips between the methods, for angles


@jit
def _half_shortest_edges(points: FloatArray, tets: IntArray, held: ByteArray) -> FloatArray:
    out = np.full(len(points), np.inf)
    for t in range(len(tets)):
        for i in range(4):
            for j in range(i + 1, 4):
                a, b = tets[t, i], tets[t, j]
                away = np.sqrt((points[a, 0] - points[b, 0]) ** 2 + (points[a, 1] - points[b, 1]) ** 2 + (points[a, 2] - points[b, 2]) ** 2)
                out[a] = min(out[a], away / 2)
                out[b] = min(out[b], away / 2)
    for v in range(len(points)):
        if held[v] or out[v] == np.inf:
            out[v] = 0.0
    return out


@jit
def _spoiled(points: FloatArray, trial: FloatArray, tets: IntArray, floor: float) -> BoolArray:
    moved = np.zeros(len(points), np.bool_)
    for v in range(len(points)):
        moved[v] = points[v, 0] != trial[v, 0] or points[v, 1] != trial[v, 1] or points[v, 2] != trial[v, 2]
    out = np.zeros(len(points), np.bool_)
    for t in range(len(tets)):
        a, b, c, d = tets[t]
        if not (moved[a] or moved[b] or moved[c] or moved[d]):
            continue
        after = shape_quality(trial[a], trial[b], trial[c], trial[d])
        if after < floor and after < shape_quality(points[a], points[b], points[c], points[d]):
            for v in (a, b, c, d):
                out[v] = moved[v]
    return out
