"""Planes between cylinders, which part space but no group of cells.

The sides of a prism reach as far as the cell that they cut: where many prisms cut one cell they would cut each other's pieces over and over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.arrangement import Arrangement
from scan2fea.reconstruction.round_cuts import Shapes
from scan2fea.types import FloatArray, IntArray, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Parting(Value):
    """normal : (s, 3).   offset : (s,).   after : (s, 2) the plane that parts what lies in front of each, and behind it; -1 none."""

    normal: FloatArray
    offset: FloatArray
    after: IntArray

    def __len__(self) -> int:
        return len(self.offset)

    def cut(self, space: Arrangement, first: int) -> list[int]:
        """(n_cells,) the cell of before that each piece counts as, with each half of a cell cut by the planes of its own half alone.

        first : row of the first of these planes in `space`.
        """
        group = list(range(space.n_cells))
        left = [(0, list(range(space.n_cells)))] if len(self) else []
        while left:
            plane, cells = left.pop()
            halves = list[int](), list[int]()
            for c in cells:
                before = space.n_cells
                for half, own in zip(halves, space.cut(first + plane, [c]), strict=True):
                    half += own
                group += [group[c]] * (space.n_cells - before)
            left += [(int(k), half) for k, half in zip(self.after[plane], halves, strict=True) if k >= 0]
        return group


def parting(points: FloatArray, every: Shapes) -> Parting:
    """Planes that part the cylinders as halves of halves, along the directions of the planes, in the middle of gaps between their points (n, 3)."""
    planes, rounds = every.planes, every.rounds
    ways = planes.normal[every.round_of < 0]
    spans = np.full((len(rounds), len(ways), 2), np.nan)
    for number in range(len(rounds)):
        own = points[np.isin(planes.label, every.rows(number))]
        if len(own):
            along = own @ ways.T
            spans[number] = np.stack([along.min(axis=0), along.max(axis=0)], axis=1)
    normal, offset, after = list[FloatArray](), list[float](), list[list[int]]()
    left = [(np.flatnonzero(np.isfinite(spans[:, 0, 0])), -1, 0)] if len(ways) else []
    while left:
        some, before, side = left.pop()
        found = _gap(spans[some])
        if found is None:
            continue
        way, place = found
        if before >= 0:
            after[before][side] = len(offset)
        in_front = spans[some, way, 0] > place
        left += [(some[in_front], len(offset), 0), (some[~in_front], len(offset), 1)]
        normal.append(ways[way])
        offset.append(place)
        after.append([-1, -1])
    return Parting(normal=np.array(normal).reshape(-1, 3), offset=np.array(offset), after=np.array(after, np.int64).reshape(-1, 2))


def _gap(spans: FloatArray) -> tuple[int, float] | None:
    """The direction, and the place on it, of the gap that parts spans (c, w, 2) most evenly; of those that do alike the widest. None: all overlap."""
    if len(spans) < 2:
        return None
    order = np.argsort(spans[..., 0], axis=0, kind="stable")
    low, high = (np.take_along_axis(spans[..., end], order, axis=0) for end in (0, 1))
    reached = np.maximum.accumulate(high, axis=0)[:-1]
    gap = low[1:] - reached
    k = np.arange(1, len(spans))[:, None]
    even = np.where(gap > 0, np.minimum(k, len(spans) - k), 0)
    best, way = np.unravel_index(np.lexsort((-gap.ravel(), -even.ravel()))[0], gap.shape)
    return (int(way), float(0.5 * (low[1:] + reached)[best, way])) if even[best, way] else None
