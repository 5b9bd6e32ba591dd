"""Divisive clustering: from the whole down, the widest cluster is split (DIANA; Macnaughton-Smith et al. 1964, Kaufman and Rousseeuw 1990).

A split begins with the point that is farthest, in the mean, from all others of its cluster. Then one point after the other leaves the rest for the
splinter, each time the one that gains most, while it is nearer in the mean to the splinter than to the rest. All pairs are compared, so the method
works on a draw of the points and every point follows the nearest drawn one.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from scan2fea.segmentation.clusters import number_of_clusters, require_points, thinned
from scan2fea.segmentation.options import SegmentationOptions
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud

REPRESENTATIVES = 2_000  # all pairs of them take 32 MB


def divisive(cloud: PointCloud, options: SegmentationOptions = SegmentationOptions()) -> IntArray:
    """(n,) labels of `options.clusters` clusters, or of as many as the data show.

    Raises SegmentationError where there are fewer points or places than clusters.
    """
    if len(cloud) == 0:
        return np.zeros(0, np.int64)
    require_points(cloud.points, options.clusters)
    drawn, nearest = thinned(cloud.points, REPRESENTATIVES, options.seed)
    k = options.clusters or number_of_clusters(drawn, diana, options.most_clusters, options.seed)
    return diana(drawn, k)[nearest]


def diana(points: FloatArray, k: int) -> IntArray:
    """(n,) labels after k - 1 splits of the cluster of largest diameter; fewer where all points of every cluster are equal."""
    distance = cdist(points, points)
    labels = np.zeros(len(points), np.int64)
    diameter = [float(distance.max(initial=0.0))]
    while len(diameter) < k and max(diameter) > 0:
        widest = int(np.argmax(diameter))
        rows = np.flatnonzero(labels == widest)
        leaves = splinter(distance[np.ix_(rows, rows)])
        labels[rows[leaves]] = len(diameter)
        own, other = rows[~leaves], rows[leaves]
        diameter[widest] = float(distance[np.ix_(own, own)].max())
        diameter.append(float(distance[np.ix_(other, other)].max()))
    return labels


def splinter(distance: FloatArray) -> BoolArray:
    """(n,) which of n points leave, from their distances (n, n). At least one leaves and one stays."""
    n = len(distance)
    to_rest = distance.sum(axis=1)
    first = int(np.argmax(to_rest))
    left = np.zeros(n, bool)
    to_left = np.zeros(n)
    leaving = first
    while True:
        left[leaving] = True
        to_rest = to_rest - distance[leaving]
        to_left += distance[leaving]
        stay = n - int(left.sum())
        if stay <= 1:
            return left
        gain = np.where(left, -np.inf, to_rest / (stay - 1) - to_left / (n - stay))
        leaving = int(np.argmax(gain))
        if not gain[leaving] > 0:
            return left
