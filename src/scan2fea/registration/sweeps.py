"""Sweeps of a rotating scanner, and what their beams alone say of a motion: has it moved, and over how many sweeps is it seen?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.voxels import voxel_mean
from scan2fea.types import FloatArray, IntArray, Value

POINTS = 3_000  # of a sweep that are matched
SIGMAS = 3.0
VISIBLE = 0.04  # of the beams must have changed from one step to the next, or the motion is not seen; by less of them a scanner stands
LEAST_STEPS = 6
_STRIDES = (1, 2, 3, 4, 6, 8, 12, 16)
_LONGEST_STEP_S = 0.5
_LEAST_SIGMA_EDGES = 0.01


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweeps(Value):
    """Points of k sweeps. points : (n, 3) each in the frame of the sensor at its moment.   sweep : (n,) rising from 0.   share : (n,) of the sweep's
    time that had passed.   period_s : of a sweep.   gap_rad : between neighbouring beams of the fan, 0 where not known.   ring : (n,) beam of each
    point where that is known and the scanner turns about its z axis.
    """

    points: FloatArray
    sweep: IntArray
    share: FloatArray
    period_s: float
    gap_rad: float = 0.0
    ring: IntArray | None = None

    def __len__(self) -> int:
        return int(self.sweep[-1]) + 1

    def bounds(self) -> IntArray:
        """(k + 1,) first row of each sweep, and the end."""
        return np.searchsorted(self.sweep, np.arange(len(self) + 1))

    def largest(self) -> FloatArray:
        """Points of the sweep that has most."""
        bounds = self.bounds()
        k = int(np.argmax(np.diff(bounds)))
        return self.points[bounds[k] : bounds[k + 1]]


def edge_of(sweeps: Sweeps, sigma_m: float) -> float:
    """Edge of the voxels that leave about POINTS of the largest sweep and span three sigma, m."""
    own = sweeps.largest()
    edge = max(SIGMAS * sigma_m, 1e-4 * float(np.ptp(own, axis=0).max()))
    while (n := voxel_mean(own, edge).n_cells) > 1.1 * POINTS:
        edge *= max(1.05, math.sqrt(n / POINTS))
    return edge


def least_sigma(sigma_m: float, edge_m: float) -> float:
    """The noise of a range, no less than a hundredth of an edge: ranges without noise still differ by their steps."""
    return max(sigma_m, _LEAST_SIGMA_EDGES * edge_m)


def has_changed(sweeps: Sweeps, sigma_m: float) -> bool:
    """True where so many beams end elsewhere in the end that the sensor, or much of what it saw, has moved. sigma_m : noise of a range."""
    return len(sweeps) >= LEAST_STEPS and change(sweeps, least_sigma(sigma_m, edge_of(sweeps, sigma_m))) > VISIBLE


def change(sweeps: Sweeps, sigma_m: float) -> float:
    """Share of the beams that change from the first sweep to the last, beyond what changes from one to the next."""
    return _step_change(sweeps, max(len(sweeps) - 3, 1), sigma_m) - _step_change(sweeps, 1, sigma_m)


def strides_of(sweeps: Sweeps, sigma_m: float) -> list[int]:
    """Sweeps from one step of the search to the next: the least over which the motion is seen, and more, within half a second."""
    most = max(1, min(len(sweeps) // LEAST_STEPS, round(_LONGEST_STEP_S / sweeps.period_s)))
    strides = [m for m in _STRIDES if m <= most]
    return [m for m in strides if _step_change(sweeps, m, sigma_m) > VISIBLE] or strides[-1:]


def _step_change(sweeps: Sweeps, step: int, sigma_m: float) -> float:
    """Median share of beams that change over a step, of a few steps along the way."""
    last = len(sweeps) - 1 - step
    begin = np.unique(np.linspace(min(1, last), max(last - 1, 0), 5).astype(int)).tolist() if last >= 0 else []
    return float(np.median([changed(sweeps, a, a + step, sigma_m) for a in begin])) if begin else 0.0


def changed(sweeps: Sweeps, a: int, b: int, sigma_m: float) -> float:
    """Share of the returns of sweep b for which sweep a has none in the same direction, or one whose range differs by three deviations of chance."""
    bounds = np.searchsorted(sweeps.sweep, [a, a + 1, b, b + 1])
    one, two = sweeps.points[bounds[0] : bounds[1]], sweeps.points[bounds[2] : bounds[3]]
    if len(one) < 2 or len(two) < 1:
        return 0.0
    far, near = np.linalg.norm(one, axis=1), np.linalg.norm(two, axis=1)
    tree = cKDTree(one / far[:, None])
    beside = float(np.median(np.asarray(tree.query(one / far[:, None], k=[2], workers=1)[0])))
    angle, row = tree.query(two / near[:, None], k=1, workers=1)
    differs = np.abs(near - far[np.asarray(row)]) > SIGMAS * math.sqrt(2.0) * sigma_m
    return float((differs | (np.asarray(angle) > beside)).mean())
