"""Parts that hang together: connected components of the graph that joins near points (thesis 2.4.2; Rusu 2009)."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.errors import SegmentationError, require
from scan2fea.kernel.near_tree import NearTree, near_tree, nearest_marked
from scan2fea.kernel.neighbors import radius_components
from scan2fea.segmentation.options import SegmentationOptions
from scan2fea.segmentation.radius import link_radius
from scan2fea.types import FloatArray, IntArray, PointCloud

_LEAST_PART = 0.02
_LOST = 0.02
_FINER = 0.8  # a radius must shrink at least to this to be worth trying


def euclidean(cloud: PointCloud, options: SegmentationOptions = SegmentationOptions()) -> IntArray:
    """(n,) labels, -1 for points of no part.

    The radius comes from the data (see `radius.link_radius`) unless given. It suits the sparsest region, so each part is then tried with
    the radius of its own points: the finer cut is kept where it gives at least two parts of 2 % or more and loses no more than 2 % of the
    points; so a dense object beside a sparse one parts from it, and an object of uneven density does not fall apart. Parts below
    `min_points` join the nearest larger part within two radii, else they get -1, as do parts above `max_points`.

    Raises SegmentationError if `radius_m` is not positive or exceeds the extent of the cloud.
    """
    points = cloud.points
    if len(points) == 0:
        return np.zeros(0, np.int64)
    radius = options.radius_m
    if radius is None:
        labels = _refined(points, options)
    else:
        usable_radius(points, radius)
        tree = near_tree(points)
        labels = absorbed(points, radius_components(points, radius, tree), radius, options.min_points, tree)
    return labels if options.max_points is None else _without_large(labels, options.max_points)


def usable_radius(points: FloatArray, radius_m: float) -> float:
    """The radius, if it can join and part points (n, 3). Raises SegmentationError if it is not positive or exceeds their extent."""
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    says = f"segmentation.radius_m is {radius_m} m: it must be positive and below the size of the cloud, {extent:.4g} m"
    require(math.isfinite(radius_m) and 0 < radius_m < extent, SegmentationError, says)
    return radius_m


def _without_large(labels: IntArray, max_points: int) -> IntArray:
    """Labels of parts of at most so many points, without gaps; -1 for the others."""
    keep = np.bincount(labels[labels >= 0], minlength=1) <= max_points
    number = np.append(np.where(keep, np.cumsum(keep) - 1, -1), -1)
    kept: IntArray = number[labels]
    return kept


def _refined(points: FloatArray, options: SegmentationOptions) -> IntArray:
    labels = np.full(len(points), -1, np.int64)
    count = 0
    todo = [(np.arange(len(points)), math.inf)]
    while todo:
        rows, coarser = todo.pop(0)
        own = points if len(rows) == len(points) else points[rows]
        tree = near_tree(own)
        radius = link_radius(own, options.seed, tree)
        if not (radius > 0 and radius <= _FINER * coarser):
            labels[rows] = count
            count += 1
            continue
        parts = absorbed(own, radius_components(own, radius, tree), radius, options.min_points, tree)
        sizes = np.bincount(parts[parts >= 0], minlength=1)
        is_first = coarser == math.inf
        lost = len(rows) - sizes[sizes >= _LEAST_PART * len(rows)].sum()
        if not is_first and ((sizes >= _LEAST_PART * len(rows)).sum() < 2 or lost > _LOST * len(rows)):
            labels[rows] = count
            count += 1
            continue
        todo += [(rows[parts == part], radius) for part in range(len(sizes)) if sizes[part]]
    return labels


def absorbed(points: FloatArray, labels: IntArray, radius_m: float, min_points: int, tree: NearTree | None = None) -> IntArray:
    """Parts below `min_points` joined to the nearest larger part within two radii, -1 where there is none; labels from 0 without gaps.

    tree : of the points, where one is there already.
    """
    counts = np.bincount(labels)
    large = counts >= min_points
    if not large.any():
        large = counts == counts.max()
    number = np.where(large, np.cumsum(large) - 1, -1)
    joined: IntArray = number[labels]
    small = np.flatnonzero(joined < 0)
    if len(small):
        distance, near = nearest_marked(tree or near_tree(points), points[small], joined >= 0, 2.0 * radius_m * (1.0 + 1e-9))
        nearest = np.full(len(counts), np.inf)
        np.minimum.at(nearest, labels[small], distance)
        first = distance <= np.minimum(nearest[labels[small]], 2.0 * radius_m)
        target = np.full(len(counts), -1, np.int64)
        target[labels[small[first]]] = joined[near[first]]
        joined[small] = target[labels[small]]
    return joined
