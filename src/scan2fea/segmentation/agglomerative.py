"""Agglomerative clustering: from single points up, the two nearest clusters become one (thesis 2.4.2; Lance and Williams 1967).

The distance of two clusters is that of their nearest points (single), of their farthest (complete), the mean over all pairs (average), or the
growth of the sum of squares (Ward 1963). Single linkage is a spanning tree and takes every point; the others compare all pairs, so they work on a
draw of the points and every point follows the nearest drawn one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.cluster.hierarchy import linkage

from scan2fea.errors import SegmentationError, require
from scan2fea.kernel.near_tree import near_tree
from scan2fea.kernel.spanning_tree import spanning_tree, tree_parts
from scan2fea.segmentation.clusters import number_of_clusters, require_points, thinned
from scan2fea.segmentation.euclidean import absorbed, usable_radius
from scan2fea.segmentation.options import LINKAGES, SegmentationOptions
from scan2fea.segmentation.radius import link_radius
from scan2fea.types import FloatArray, IntArray, PointCloud

REPRESENTATIVES = 4_000  # all pairs of them take 64 MB


def agglomerative(cloud: PointCloud, options: SegmentationOptions = SegmentationOptions()) -> IntArray:
    """(n,) labels of `options.clusters` clusters.

    Where that is not given: single linkage is cut at `radius_m` (or the radius that the spacing gives), and is then the method euclidean with one
    radius; the others take the number that the data show. Raises SegmentationError for a linkage that does not exist and where there are fewer
    points or places than clusters.
    """
    points = cloud.points
    says = f"segmentation.linkage {options.linkage!r} does not exist: use one of {', '.join(LINKAGES)}"
    require(options.linkage in LINKAGES, SegmentationError, says)
    if len(points) == 0:
        return np.zeros(0, np.int64)
    require_points(points, options.clusters)
    if options.linkage == "single":
        return _single(points, options)
    drawn, nearest = thinned(points, REPRESENTATIVES, options.seed)

    def cut(sample: FloatArray, k: int) -> IntArray:
        return joined(sample, options.linkage, k)

    k = options.clusters or number_of_clusters(drawn, cut, options.most_clusters, options.seed)
    return cut(drawn, k)[nearest]


def _single(points: FloatArray, options: SegmentationOptions) -> IntArray:
    tree = near_tree(points)
    edges, length = spanning_tree(points, tree)
    if options.clusters is not None:
        return tree_parts(edges[: len(points) - options.clusters], len(points))
    radius = link_radius(points, options.seed, tree) if options.radius_m is None else usable_radius(points, options.radius_m)
    if not radius > 0:
        return np.zeros(len(points), np.int64)
    return absorbed(points, tree_parts(edges[length <= radius], len(points)), radius, options.min_points, tree)


def joined(points: FloatArray, how: str, k: int) -> IntArray:
    """(n,) labels of k clusters under complete, average or Ward linkage, numbered by their first point."""
    n = len(points)
    if n <= k:
        return np.arange(n, dtype=np.int64)
    name: Any = how
    merges = linkage(points, name)[: n - k, :2].astype(np.int64)
    member = np.concatenate([np.arange(n), np.zeros(len(merges), np.int64)])  # one point of each cluster
    for i, (a, _) in enumerate(merges):
        member[n + i] = member[a]
    return tree_parts(member[merges], n)
