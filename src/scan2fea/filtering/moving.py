"""Things that moved: points through which rays of other inputs have gone, to what lay behind them.

A wall that two stations see at a glance is not seen through: where the ray passes beside the point the surface may step by what one spacing of
the rays changes at 80 degrees.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.noise import sampled_rows
from scan2fea.types import BoolArray, FloatArray, IntArray, Scan

PARTNERS = 8  # inputs that each is held against: the nearest in number
SIGMAS = 6.0
GRAZING = math.tan(math.radians(80.0))
NEAR_RAY = 0.75  # of the spacing of the rays: the point lies in the beam of one of them
_SAMPLE = 4000


def moving(scan: Scan, sigma_m: float) -> BoolArray:
    """(n,) True for points that more of the other inputs have seen through than have seen again. sigma_m : noise of a range.

    Inputs whose sensor is not known say nothing, nor does one alone.
    """
    cloud = scan.cloud
    gone = np.zeros(len(cloud), bool)
    if scan.rays is None:
        return gone
    frames = [int(k) for k in np.unique(cloud.frame[cloud.ray >= 0])]
    views = {k: _View(scan, np.flatnonzero((cloud.frame == k) & (cloud.ray >= 0))) for k in frames}
    for k in frames:
        rows = np.flatnonzero(cloud.frame == k)
        through, again = np.zeros(len(rows), np.int64), np.zeros(len(rows), np.int64)
        for j in sorted((j for j in frames if j != k), key=lambda j: (abs(j - k), j))[:PARTNERS]:
            past, seen = views[j].looked(cloud.points[rows], sigma_m)
            through += past
            again += seen
        gone[rows] = through > again
    return gone


class _View:
    """What one input saw, as directions from its middle. Never leaves this file."""

    def __init__(self, scan: Scan, rows: IntArray) -> None:
        if scan.rays is None:
            raise ValueError("a view needs rays")
        self.station: FloatArray = np.median(scan.rays.origin[scan.cloud.ray[rows]], axis=0)
        ray = scan.cloud.points[rows] - self.station
        self.range_m = np.linalg.norm(ray, axis=1)
        self.tree = cKDTree(ray / np.maximum(self.range_m, 1e-12)[:, None])
        drawn = sampled_rows(len(rows), _SAMPLE, 0)
        near = np.asarray(self.tree.query(self.tree.data[drawn], k=[2], workers=1)[0]) if len(rows) > 1 else np.zeros((1, 1))
        self.step = float(np.median(near))

    def looked(self, points: FloatArray, sigma_m: float) -> tuple[BoolArray, BoolArray]:
        """(n,) whether a ray went past the place of the point, and whether something was measured there."""
        ray = points - self.station
        r = np.linalg.norm(ray, axis=1)
        angle, near = self.tree.query(ray / np.maximum(r, 1e-12)[:, None], k=1, distance_upper_bound=4.0 * self.step, workers=1)
        angle, near = np.asarray(angle), np.asarray(near, np.int64)
        known = np.isfinite(angle)
        there = np.where(known, self.range_m[np.minimum(near, len(self.range_m) - 1)], np.nan)
        margin = SIGMAS * sigma_m + GRAZING * self.step * np.maximum(r, np.nan_to_num(there))
        return np.asarray((angle <= NEAR_RAY * self.step) & (there > r + margin)), np.asarray(known & (np.abs(there - r) <= margin))
