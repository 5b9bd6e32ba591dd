"""k-means: each point belongs to the nearest of k centres, each centre is the mean of its points (thesis eq 2.13; Lloyd 1982)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.segmentation.clusters import number_of_clusters, require_points
from scan2fea.segmentation.options import SegmentationOptions
from scan2fea.types import FloatArray, IntArray, PointCloud, Value

_STEPS = 300
_STILL = 1e-5  # of the spread of the cloud: centres that move less stand still
_BLOCK = 256
_TRIAL_POINTS = 20_000  # restarts are compared on a draw of so many points


@dataclass(frozen=True, eq=False, kw_only=True)
class KMeans(Value):
    """labels : (n,).   centres : (k, 3).   objective : (steps,) sum of squared distances, m2, after each step; it never rises.   converged : bool."""

    labels: IntArray
    centres: FloatArray
    objective: FloatArray
    converged: bool


def kmeans(cloud: PointCloud, options: SegmentationOptions = SegmentationOptions()) -> IntArray:
    """(n,) labels of `options.clusters` clusters, or of as many as the data show (`clusters.number_of_clusters`).

    Raises SegmentationError where there are fewer points or places than clusters.
    """
    if len(cloud) == 0:
        return np.zeros(0, np.int64)
    require_points(cloud.points, options.clusters)
    k = options.clusters
    if k is None:
        k = number_of_clusters(cloud.points, lambda p, n: clustered(p, n, 2, options.seed).labels, options.most_clusters, options.seed)
    if k == 1:
        return np.zeros(len(cloud), np.int64)
    return clustered(cloud.points, k, options.restarts, options.seed).labels


def clustered(points: FloatArray, k: int, restarts: int, seed: int) -> KMeans:
    """The best of some runs from seeded starts (k-means++, Arthur and Vassilvitskii 2007), compared on a draw of 20,000 points."""
    found = best_run(lloyd, points - points.mean(axis=0), k, restarts, seed)
    return KMeans(labels=found.labels, centres=found.centres + points.mean(axis=0), objective=found.objective, converged=found.converged)


class Run(Protocol):
    """centres : (k, 3).   objective : (steps,)."""

    @property
    def centres(self) -> FloatArray: ...
    @property
    def objective(self) -> FloatArray: ...


R = TypeVar("R", bound=Run)


def best_run(run: Callable[[FloatArray, FloatArray], R], points: FloatArray, k: int, restarts: int, seed: int) -> R:
    """The run (points, first centres) with the least objective of some on a draw of 20,000 points, gone on with on all of them."""
    rng = np.random.default_rng(seed)
    rows = np.sort(rng.choice(len(points), _TRIAL_POINTS, replace=False)) if len(points) > _TRIAL_POINTS else np.arange(len(points))
    sample = np.ascontiguousarray(points[rows])
    best = min((run(sample, plus_plus(sample, k, rng)) for _ in range(restarts)), key=lambda one: float(one.objective[-1]))
    return best if len(rows) == len(points) else run(np.ascontiguousarray(points), best.centres)


def plus_plus(points: FloatArray, k: int, rng: np.random.Generator) -> FloatArray:
    """(k, 3) of the points, each drawn with a chance that grows with the squared distance to those drawn before."""
    centres = np.zeros((k, points.shape[1]))
    centres[0] = points[rng.integers(len(points))]
    nearest = ((points - centres[0]) ** 2).sum(axis=1)
    for i in range(1, k):
        summed = np.cumsum(nearest)
        row = int(np.searchsorted(summed, rng.random() * summed[-1], side="right")) if summed[-1] > 0 else 0
        centres[i] = points[min(row, len(points) - 1)]
        np.minimum(nearest, ((points - centres[i]) ** 2).sum(axis=1), out=nearest)
    return centres


def lloyd(points: FloatArray, centres: FloatArray) -> KMeans:
    """Assign, move to the mean, until no centre moves by more than 1e-5 of the cloud's spread; a centre without points goes to the farthest point."""
    columns = np.ascontiguousarray(points.T)
    k = len(centres)
    spread = float(np.sqrt(points.var(axis=0).sum()))
    labels, distance = np.zeros(len(points), np.int64), np.zeros(len(points))
    objective: list[float] = []
    moved = np.inf
    while len(objective) < _STEPS:
        _assign(columns, centres, labels, distance)
        objective.append(float(distance.sum()))
        if moved <= _STILL * spread:
            break
        count = np.bincount(labels, minlength=k)
        sums = np.stack([np.bincount(labels, weights=column, minlength=k) for column in columns], 1)
        new = np.where(count[:, None] > 0, sums / np.maximum(count, 1)[:, None], centres)
        for empty in np.flatnonzero(count == 0):
            far = int(distance.argmax())
            new[empty], distance[far] = points[far], 0.0
        moved = float(np.sqrt(((new - centres) ** 2).sum(axis=1).max()))
        centres = new
    return KMeans(labels=labels, centres=centres, objective=np.array(objective), converged=bool(moved <= _STILL * spread))


@jit
def _assign(columns: FloatArray, centres: FloatArray, labels: IntArray, distance: FloatArray) -> None:
    """Nearest centre of each point and its squared distance; ties go to the first. Blocks of points, one centre after the other: vector code."""
    n = columns.shape[1]
    d2, best, index = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK, np.int64)
    for start in range(0, n, _BLOCK):
        m = min(_BLOCK, n - start)
        best[:] = np.inf
        index[:] = 0
        for c in range(len(centres)):
            cx, cy, cz = centres[c, 0], centres[c, 1], centres[c, 2]
            for i in range(m):
                x, y, z = columns[0, start + i] - cx, columns[1, start + i] - cy, columns[2, start + i] - cz
                d2[i] = x * x + y * y + z * z
            for i in range(m):
                nearer = d2[i] < best[i]
                best[i] = d2[i] if nearer else best[i]
                index[i] = c if nearer else index[i]
        for i in range(m):
            labels[start + i], distance[start + i] = index[i], best[i]
