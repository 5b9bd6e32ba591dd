"""Do distant sweeps agree, beam by beam? What one saw, carried by the poses found, must be what the beams of another ended at.

A surface that a sweep saw lies, for another sweep, within the fan of its beams or outside of it. Within, a beam near that direction ends there, or
on something nearer. Where all of them end farther away, or none came back at all, the two contradict each other. A floor whose rings travel with the
sensor looks the same from every place, but its edges do not, nor what stands on it: this is what a motion that was missed cannot explain.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.trajectories import between
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.registration.motion import moved
from scan2fea.types import FloatArray, IntArray, Value

CONTRADICTED = 0.05  # of what is compared: docs/design.md's limit for rays that pass through; neighbours' own share is added, up to as much again
SIGMAS = 3.0
_COMPARED = 1_000  # points of a sweep
_LEAST = 50  # points within the fan, below which two sweeps tell nothing of each other
_REACH = 1.1  # gaps between beams: how far from a direction its beams are
_FINE = 8.0  # beams are thinned to so many per gap
_NEAREST = 64
_MOMENTS = 2  # rounds in which the moment of a beam and the place of the sensor settle


@dataclass(frozen=True, kw_only=True)
class Agreement(Value):
    """contradicted : worst share of the points of one sweep that another contradicts, nan where none overlap.   limit : what it may be.
    pair : the sweep they are of, and the one that contradicts.
    """

    contradicted: float
    limit: float
    pair: tuple[int, int]

    @property
    def holds(self) -> bool:
        """True where sweeps were compared and none contradicts another by more than the limit."""
        return self.contradicted <= self.limit


class Fans:
    """The beams of all sweeps, by direction in the sensor's own frame. Never leaves this package."""

    def __init__(self, points: FloatArray, sweep: IntArray, share: FloatArray, sigma_m: float, gap_rad: float) -> None:
        self.points, self.sweep, self.share = points, sweep, share
        self.bounds = np.searchsorted(sweep, np.arange(int(sweep[-1]) + 2))
        self.range_m = np.linalg.norm(points, axis=1)
        self.direction = points / np.maximum(self.range_m, 1e-300)[:, None]
        self.gap = gap_rad if gap_rad > 0 else _gap_told(self.direction[: self.bounds[1]])
        self.tolerance = SIGMAS * math.sqrt(2.0) * sigma_m
        self.farthest = float(np.quantile(self.range_m, 0.99))
        self.anywhere = cKDTree(voxel_mean(self.direction, self.gap / 2).mean)
        self._trees: dict[int, tuple[cKDTree, IntArray]] = {}

    def __len__(self) -> int:
        return len(self.bounds) - 1

    def contradicted(self, a: int, b: int, T_world_knot: FloatArray) -> tuple[int, float]:
        """How many points of sweep a lie within the fan of sweep b, and the share of them that it contradicts."""
        rows = np.arange(self.bounds[a], self.bounds[a + 1], max(1, (self.bounds[a + 1] - self.bounds[a]) // _COMPARED))
        tree, of_b = self._tree(b)
        if not len(rows) or not len(of_b):
            return 0, math.nan
        world = moved(self.points[rows], T_world_knot, self.sweep[rows], self.share[rows])
        at = np.full(len(rows), 0.5)
        for _ in range(_MOMENTS):
            R, x = between(T_world_knot, np.full(len(rows), b), at)
            own = np.einsum("nji,nj->ni", R, world - x)
            far = np.linalg.norm(own, axis=1)
            toward = own / np.maximum(far, 1e-300)[:, None]
            at = self.share[of_b[np.asarray(tree.query(toward, k=1, workers=1)[1])]]
        within = (np.asarray(self.anywhere.query(toward, k=1, workers=1)[0]) < self.gap / 2) & (far < self.farthest)
        if not within.any():
            return 0, math.nan
        near = np.asarray(tree.query(toward[within], k=_NEAREST, distance_upper_bound=_REACH * self.gap, workers=1)[1])
        ends = np.append(self.range_m[of_b], np.inf)[near]  # inf where no beam came back
        return int(within.sum()), float((far[within] < ends.min(axis=1) - self.tolerance).mean())

    def _tree(self, b: int) -> tuple[cKDTree, IntArray]:
        if b not in self._trees:
            rows = np.arange(self.bounds[b], self.bounds[b + 1])
            if len(rows):
                rows = rows[np.sort(voxel_mean(self.direction[rows], self.gap / _FINE).first_row)]
            self._trees[b] = cKDTree(self.direction[rows]), rows
        return self._trees[b]


def agreement(fans: Fans, T_world_knot: FloatArray) -> Agreement:
    """Worst contradiction between sweeps from half of them apart down to neighbours, both ways; T_world_knot (k + 1, 4, 4) poses of their ends."""
    worst, pair, beside = math.nan, (0, 0), []
    for a, b in _pairs(len(fans)):
        n, share = fans.contradicted(a, b, T_world_knot)
        if n < _LEAST:
            continue
        if abs(a - b) == 1:
            beside.append(share)
        if not share <= worst:
            worst, pair = share, (a, b)
    flicker = min(float(np.median(beside)), CONTRADICTED) if beside else 0.0
    return Agreement(contradicted=worst, limit=CONTRADICTED + flicker, pair=pair)


def _pairs(n: int) -> Iterator[tuple[int, int]]:
    """Sweeps as far apart as there are, half as far, and so on to neighbours: at the begin, the middle and the end of the way."""
    apart = n - 1
    while apart >= 1:
        for low in sorted({0, (n - 1 - apart) // 2, n - 1 - apart}):
            yield low, low + apart
            yield low + apart, low
        apart //= 2


def _gap_told(direction: FloatArray) -> float:
    """Angle between neighbouring beams where the fan is not known: three times the median angle to the nearest other beam."""
    if len(direction) < 2:
        return math.radians(1.0)
    return 3.0 * float(np.median(np.asarray(cKDTree(direction).query(direction, k=[2], workers=1)[0])))
