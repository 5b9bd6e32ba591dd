"""What the clustering methods share: their input tested, points thinned to representatives, and the number of clusters from the data."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.distance import cdist

from scan2fea.errors import SegmentationError, require
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.types import FloatArray, IntArray

Cut = Callable[[FloatArray, int], IntArray]  # points (n, 3) and a number of clusters -> labels (n,)
_SAMPLE = 1_500  # points on which a number of clusters is judged
_ERRORS = 3.0
_REFERENCES = 10  # even clouds that one cluster is told from many by


def require_points(points: FloatArray, clusters: int | None) -> None:
    """Raises SegmentationError where points (n, 3) cannot be put into that many clusters; the message names the option, its value and the limit."""
    require(np.isfinite(points).all(), SegmentationError, "the cloud has coordinates that are not finite: clusters need numbers; drop those points")
    if clusters is None:
        return
    says = f"segmentation.clusters is {clusters}: the least is 2; segmentation.method = single makes one object of all"
    require(clusters >= 2, SegmentationError, says)
    says = f"segmentation.clusters is {clusters}, but the cloud has {len(points)} points: give at most that many"
    require(clusters <= len(points), SegmentationError, says)
    places = n_places(points, clusters)
    says = f"segmentation.clusters is {clusters}, but the points lie at {places} different place{'s' * (places != 1)}: give at most that many"
    require(clusters <= places, SegmentationError, says)


def n_places(points: FloatArray, at_most: int) -> int:
    """Number of different places among points (n, 3), counted up to `at_most`."""
    for few in (1000, len(points)):  # the first rows nearly always answer
        found = len(np.unique(points[:few], axis=0))
        if found >= at_most:
            return at_most
    return found


def thinned(points: FloatArray, at_most: int, seed: int) -> tuple[FloatArray, IntArray]:
    """At most so many of the points (m, 3), drawn with a seed so that dense places stay dense, and the nearest of them to each point (n,)."""
    rows = sampled_rows(len(points), at_most, seed)
    if len(rows) == len(points):
        return points, rows
    return points[rows], k_nearest(points[rows], 1, points)[1][:, 0]


def silhouette(distance: FloatArray, labels: IntArray) -> float:
    """Mean silhouette (Rousseeuw 1987) of labels (n,) under distances (n, n): -1 to 1; a cluster of one point counts 0."""
    k = int(labels.max()) + 1
    member = np.zeros((len(labels), k))
    member[np.arange(len(labels)), labels] = 1.0
    size = member.sum(axis=0)
    total = distance @ member
    own = size[labels]
    inside = total[np.arange(len(labels)), labels] / np.maximum(own - 1.0, 1.0)
    other = total / np.maximum(size, 1.0)
    other[np.arange(len(labels)), labels] = np.inf
    nearest = other.min(axis=1)
    scale = np.maximum(inside, nearest)
    score = np.where((own > 1) & (scale > 0), (nearest - inside) / np.where(scale > 0, scale, 1.0), 0.0)
    return float(score.mean())


def number_of_clusters(points: FloatArray, cut: Cut, most: int, seed: int) -> int:
    """How many clusters the points (n, 3) fall into under a method: the mean silhouette chooses, the gap statistic tells one from many.

    One, where the spread within the chosen clusters is no smaller, by more than three standard errors, than in clouds spread evenly over a box of the
    same second moments (Tibshirani, Walther and Hastie 2001, who take the box around the points: a turned sample fills it less, and one cluster
    reads as two). Judged on a seeded draw of 1,500 points.
    """
    sample = points[sampled_rows(len(points), _SAMPLE, seed)]
    most = min(most, n_places(sample, most + 1) - 1)
    if most < 2:
        return 1
    distance = cdist(sample, sample)
    scores = [silhouette(distance, cut(sample, k)) for k in range(2, most + 1)]
    best = 2 + int(np.argmax(scores))
    centred = sample - sample.mean(axis=0)
    extent = np.sqrt(12.0 * np.maximum(np.linalg.eigvalsh(centred.T @ centred / len(sample)), 0.0))
    rng = np.random.default_rng(seed)
    even = [extent * rng.random(sample.shape) for _ in range(_REFERENCES)]
    gained = [_gain(reference, cut(reference, best)) for reference in even]
    spread = _ERRORS * float(np.std(gained)) * np.sqrt(1.0 + 1.0 / _REFERENCES)
    return best if _gain(sample, cut(sample, best)) > np.mean(gained) + spread else 1


def _gain(points: FloatArray, labels: IntArray) -> float:
    """Log of the spread about the mean over the spread within the clusters."""
    within = 0.0
    for label in range(int(labels.max()) + 1):
        own = points[labels == label]
        within += float(((own - own.mean(axis=0)) ** 2).sum()) if len(own) else 0.0
    whole = float(((points - points.mean(axis=0)) ** 2).sum())
    return float(np.log(whole / within)) if within > 0 else np.inf
