"""What a point belongs to as a trained forest names it: floor, wall, member, body, clutter, or the classes of a user's own labels.

Neighbours vote once, and connected points of one class are one segment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import SegmentationError, require
from scan2fea.kernel.neighbors import k_nearest, radius_components
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.segmentation.features import most_frequent, point_features
from scan2fea.segmentation.forest import Forest, class_probabilities
from scan2fea.segmentation.options import SegmentationOptions
from scan2fea.segmentation.radius import link_radius
from scan2fea.segmentation.weights import weights_named
from scan2fea.types import FloatArray, IntArray, PointCloud, Value

SUPPORT_CLASSES, CLUTTER_CLASSES = ("floor", "wall", "ground", "ceiling", "support"), ("clutter",)
_MOST = 200_000  # points that are looked at; the others follow the nearest of them
_VOTERS = 16


@dataclass(frozen=True, eq=False, kw_only=True)
class PointClasses(Value):
    """label : (n,) class of each point.   confidence : (n,) its share of the trees' votes."""

    label: IntArray
    confidence: FloatArray


def classes_of_points(forest: Forest, points: FloatArray) -> PointClasses:
    """The class of each point (n, 3): the forest on features of the points thinned to their spacing, then the vote of 16 neighbours."""
    thin, stands_for, h = thinned_for_features(points)
    p = class_probabilities(forest, point_features(thin, h))
    label = most_frequent(p.argmax(axis=1).astype(np.int64), k_nearest(thin, _VOTERS)[1], len(forest.classes))
    return PointClasses(label=label[stands_for], confidence=p[np.arange(len(thin)), label].astype(float)[stands_for])


def thinned_for_features(points: FloatArray) -> tuple[FloatArray, IntArray, float]:
    """Voxel means one spacing wide (m, 3), the mean that stands for each point (n,), and the width: features do not follow the density of a scan."""
    h = spacing(points) if len(points) > 1 else math.nan
    require(h > 0 and math.isfinite(h), SegmentationError, "the points lie at one place: features need points that spread")
    cells = voxel_mean(points - points.min(axis=0), h)
    while cells.n_cells > _MOST:
        h *= 1.05 * math.sqrt(cells.n_cells / _MOST)
        cells = voxel_mean(points - points.min(axis=0), h)
    return cells.mean + points.min(axis=0), cells.cell_of_point, h


def learned_parts(cloud: PointCloud, options: SegmentationOptions = SegmentationOptions()) -> list[tuple[IntArray, str]]:
    """Connected points of one class, `min_points` or more: the rows of each part, ascending, and its role ("support", "clutter" or "object").

    Raises SegmentationError where the cloud cannot be looked at, InputError for weights that cannot be read.
    """
    forest = weights_named(options.weights).forest
    found = classes_of_points(forest, cloud.points)
    radius = options.radius_m or link_radius(cloud.points, options.seed)
    require(math.isfinite(radius) and radius > 0, SegmentationError, "segmentation.radius_m cannot be told from the data: give it")
    parts = []
    for number, name in enumerate(forest.classes):
        rows = np.flatnonzero(found.label == number)
        if not len(rows):
            continue
        part = radius_components(cloud.points[rows], radius)
        role = "support" if name in SUPPORT_CLASSES else "clutter" if name in CLUTTER_CLASSES else "object"
        parts += [(rows[part == piece], role) for piece in np.flatnonzero(np.bincount(part) >= options.min_points)]
    return parts


def learned(cloud: PointCloud, options: SegmentationOptions = SegmentationOptions()) -> IntArray:
    """(n,) labels from 0, in the order of `learned_parts`; -1 for points of no part."""
    labels = np.full(len(cloud), -1, np.int64)
    for label, (rows, _) in enumerate(learned_parts(cloud, options)):
        labels[rows] = label
    return labels
