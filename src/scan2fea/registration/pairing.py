"""Points of one surface with their nearest of another under a motion, and with it again under one that differs little.

Of each point the search keeps its nearest and how near any other can be. While it has moved by less than that leaves open, its nearest is still the
same and nothing is searched (the cached tree of Nuechter et al. 2007): exact, and after a few steps of ICP nearly free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.kernel.near_tree import NearTree, nearest_two
from scan2fea.kernel.transforms import rotated
from scan2fea.registration.surface import Surface
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

FACING = 0.6  # cosine between matched normals: 53 degrees
_SLACK_EDGES = 0.5  # how much farther than needed is looked, so that the next steps need not look


@dataclass(frozen=True, eq=False, kw_only=True)
class Pairs(Value):
    """Matched rows: point of the moved source, its point of the target, the signed distance across and the direction of that."""

    source: IntArray
    target: IntArray
    moved: FloatArray
    normal: FloatArray
    normal_source: FloatArray
    normal_target: FloatArray
    across_m: FloatArray

    _ROWS = (("source", "target", "moved", "normal", "normal_source", "normal_target", "across_m"),)


class Partners:
    """Points of a source and their nearest of a target, as last looked at. Changes in place; never leaves the function that makes it."""

    def __init__(self, source: Surface, target: Surface, tree: NearTree) -> None:
        n = len(source)
        self.source, self.target, self.tree = source, target, tree
        self.slack_m = _SLACK_EDGES * max(source.edge_m, target.edge_m)
        self._place, self._at, self._others = np.full(n, -1), np.full((n, 3), np.inf), np.zeros(n)
        self._rows, self._found, self._across = np.zeros((n, 2), np.int64), np.zeros((n, 6)), np.zeros(n)

    def under(self, T_target_source: FloatArray, reach_m: float) -> tuple[IntArray, FloatArray, FloatArray]:
        """Each source point with its nearest target point within reach, where both were seen from the same side and their normals agree.

        Returns rows (k, 2) of source and target, (k, 6) the moved point and the direction midway between both normals, and the distance (k,) across.
        They are overwritten by the next call.
        """
        if not len(self.target):
            return self._rows[:0], self._found[:0], self._across[:0]
        a, b, tree = self.source, self.target, self.tree
        T = np.array(T_target_source, float, order="C")  # one that may be written to: else the kernel is compiled twice
        k = _paired(
            T, a.points, a.normals, a.is_seen, tree.order, tree.xyz, tree.boxes, tree.levels, b.normals, b.is_seen, reach_m, self.slack_m,
            self._place, self._at, self._others, self._rows, self._found, self._across,
        )  # fmt: skip
        return self._rows[:k], self._found[:k], self._across[:k]


def pairs_of(source: Surface, target: Surface, tree: NearTree, T_target_source: FloatArray, reach_m: float) -> Pairs:
    """The pairs under one motion; see `Partners.under`."""
    rows, found, across = Partners(source, target, tree).under(T_target_source, reach_m)
    own, other = rotated(T_target_source, source.normals[rows[:, 0]]), target.normals[rows[:, 1]]
    opposite = np.einsum("nc,nc->n", own, other) < 0
    return Pairs(
        source=rows[:, 0],
        target=rows[:, 1],
        moved=found[:, :3],
        normal=found[:, 3:],
        normal_source=np.where(opposite[:, None], -own, own),
        normal_target=other,
        across_m=across,
    )


@jit_ieee
def _paired(
    T: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    is_seen: BoolArray,
    order: IntArray,
    xyz: FloatArray,
    boxes: FloatArray,
    levels: int,
    target_normals: FloatArray,
    target_is_seen: BoolArray,
    reach: float,
    slack: float,
    place: IntArray,
    at: FloatArray,
    others: FloatArray,
    rows: IntArray,
    found: FloatArray,
    across: FloatArray,
) -> int:
    """Fill the first rows of `rows`, `found` and `across`; returns how many."""
    stack, gaps = np.empty(levels + 2, np.int64), np.empty(levels + 2)
    k = 0
    for i in range(len(points)):
        x = T[0, 0] * points[i, 0] + T[0, 1] * points[i, 1] + T[0, 2] * points[i, 2] + T[0, 3]
        y = T[1, 0] * points[i, 0] + T[1, 1] * points[i, 1] + T[1, 2] * points[i, 2] + T[1, 3]
        z = T[2, 0] * points[i, 0] + T[2, 1] * points[i, 1] + T[2, 2] * points[i, 2] + T[2, 3]
        p = place[i]
        moved = math.sqrt((x - at[i, 0]) ** 2 + (y - at[i, 1]) ** 2 + (z - at[i, 2]) ** 2)
        far = math.inf if p < 0 else math.sqrt((x - xyz[p, 0]) ** 2 + (y - xyz[p, 1]) ** 2 + (z - xyz[p, 2]) ** 2)
        if not min(far, reach) < others[i] - moved:
            limit = min(reach, far) + slack
            p, squared, second = nearest_two(order, xyz, boxes, levels, x, y, z, limit * limit, stack, gaps)
            place[i], others[i], far = p, math.sqrt(second), math.sqrt(squared) if p >= 0 else math.inf
            at[i, 0], at[i, 1], at[i, 2] = x, y, z
        if p < 0 or not far < reach:
            continue
        j = order[p]
        u = T[0, 0] * normals[i, 0] + T[0, 1] * normals[i, 1] + T[0, 2] * normals[i, 2]
        v = T[1, 0] * normals[i, 0] + T[1, 1] * normals[i, 1] + T[1, 2] * normals[i, 2]
        w = T[2, 0] * normals[i, 0] + T[2, 1] * normals[i, 1] + T[2, 2] * normals[i, 2]
        cosine = u * target_normals[j, 0] + v * target_normals[j, 1] + w * target_normals[j, 2]
        if cosine < 0 and not (is_seen[i] and target_is_seen[j]):
            u, v, w, cosine = -u, -v, -w, -cosine
        if not cosine > FACING:
            continue
        a, b, c = u + target_normals[j, 0], v + target_normals[j, 1], w + target_normals[j, 2]
        length = math.sqrt(a * a + b * b + c * c)
        a, b, c = a / length, b / length, c / length
        rows[k, 0], rows[k, 1] = i, j
        found[k, 0], found[k, 1], found[k, 2], found[k, 3], found[k, 4], found[k, 5] = x, y, z, a, b, c
        across[k] = (x - xyz[p, 0]) * a + (y - xyz[p, 1]) * b + (z - xyz[p, 2]) * c
        k += 1
    return k
