"""Fuzzy c-means: each point belongs to every centre to a degree (thesis eq 2.14 and 2.15; Bezdek 1981).

c_k = sum w^m x / sum w^m,  w_ik = 1 / sum_j (d_ik / d_ij)^(2 / (m - 1)). The memberships of all points are never stored: one pass over the points
sums what the new centres need; `memberships` gives them for the points that somebody asks for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.segmentation.clusters import number_of_clusters, require_points
from scan2fea.segmentation.kmeans import best_run
from scan2fea.segmentation.options import SegmentationOptions
from scan2fea.types import FloatArray, IntArray, PointCloud, Value

_STEPS = 300
_STILL = 1e-5  # of the spread of the cloud


@dataclass(frozen=True, eq=False, kw_only=True)
class FuzzyCMeans(Value):
    """centres : (k, 3).   objective : (steps,) sum of w^m d^2, m2, of the centres before each step; it never rises.   converged : bool."""

    centres: FloatArray
    objective: FloatArray
    converged: bool


def fuzzy_cmeans(cloud: PointCloud, options: SegmentationOptions = SegmentationOptions()) -> IntArray:
    """(n,) label of the centre that each point belongs to most, which is the nearest.

    Raises SegmentationError where there are fewer points or places than clusters.
    """
    if len(cloud) == 0:
        return np.zeros(0, np.int64)
    require_points(cloud.points, options.clusters)

    def cut(points: FloatArray, k: int) -> IntArray:
        return nearest(points, fuzzy(points, k, 2, options.fuzziness, options.seed).centres)

    k = options.clusters or number_of_clusters(cloud.points, cut, options.most_clusters, options.seed)
    if k == 1:
        return np.zeros(len(cloud), np.int64)
    return nearest(cloud.points, fuzzy(cloud.points, k, options.restarts, options.fuzziness, options.seed).centres)


def fuzzy(points: FloatArray, k: int, restarts: int, m: float, seed: int) -> FuzzyCMeans:
    """The best of some runs from seeded starts (as k-means++), compared on a draw of 20,000 points."""
    middle = points.mean(axis=0)
    found = best_run(lambda p, centres: converged(p, centres, m), points - middle, k, restarts, seed)
    return FuzzyCMeans(centres=found.centres + middle, objective=found.objective, converged=found.converged)


def converged(points: FloatArray, centres: FloatArray, m: float) -> FuzzyCMeans:
    """Steps of eq 2.14 and 2.15 until no centre moves by more than 1e-5 of the cloud's spread."""
    spread = float(np.sqrt(points.var(axis=0).sum()))
    objective: list[float] = []
    moved = np.inf
    while len(objective) < _STEPS and moved > _STILL * spread:
        sums, weight, cost = _step(points, centres, m)
        objective.append(cost)
        new = np.where(weight[:, None] > 0, sums / np.where(weight > 0, weight, 1.0)[:, None], centres)
        moved = float(np.sqrt(((new - centres) ** 2).sum(axis=1).max()))
        centres = new
    return FuzzyCMeans(centres=centres, objective=np.array(objective), converged=bool(moved <= _STILL * spread))


def memberships(points: FloatArray, centres: FloatArray, m: float = 2.0) -> FloatArray:
    """(n, k) degrees to which points (n, 3) belong to the centres; rows sum to 1. A point on centres belongs to those alone, in equal parts."""
    d2 = ((points[:, None] - centres[None]) ** 2).sum(axis=2)
    least = d2.min(axis=1, keepdims=True)
    on = d2 == 0
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = (least / d2) ** (1.0 / (m - 1.0))
    relative = np.where(least == 0, on.astype(float), relative)
    degrees: FloatArray = relative / relative.sum(axis=1, keepdims=True)
    return degrees


def nearest(points: FloatArray, centres: FloatArray) -> IntArray:
    """(n,) row of the nearest centre, the first of equals."""
    labels = np.zeros(len(points), np.int64)
    least = np.full(len(points), np.inf)
    for c, centre in enumerate(centres):
        d2 = ((points - centre) ** 2).sum(axis=1)
        labels[d2 < least] = c
        np.minimum(least, d2, out=least)
    return labels


@jit
def _step(points: FloatArray, centres: FloatArray, m: float) -> tuple[FloatArray, FloatArray, float]:
    """Sum of w^m x (k, 3), sum of w^m (k,), and the objective under the memberships that the centres give."""
    k = len(centres)
    sums, weight, share = np.zeros((k, 3)), np.zeros(k), np.zeros(k)
    d2 = np.zeros(k)
    cost, power = 0.0, 1.0 / (m - 1.0)
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        least = np.inf
        for c in range(k):
            d2[c] = (x - centres[c, 0]) ** 2 + (y - centres[c, 1]) ** 2 + (z - centres[c, 2]) ** 2
            least = min(least, d2[c])
        total = 0.0
        for c in range(k):
            if least == 0.0:
                share[c] = 1.0 if d2[c] == 0.0 else 0.0
            elif m == 2.0:
                share[c] = least / d2[c]
            else:
                share[c] = (least / d2[c]) ** power
            total += share[c]
        for c in range(k):
            w = share[c] / total
            w = w * w if m == 2.0 else w**m
            sums[c, 0] += w * x
            sums[c, 1] += w * y
            sums[c, 2] += w * z
            weight[c] += w
            cost += w * d2[c]
    return sums, weight, cost
