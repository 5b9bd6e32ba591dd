"""Labels that somebody has already given."""

from __future__ import annotations

import numpy as np

from scan2fea.errors import SegmentationError, require
from scan2fea.segmentation.options import SegmentationOptions
from scan2fea.types import IntArray, PointCloud


def given(cloud: PointCloud, options: SegmentationOptions = SegmentationOptions()) -> IntArray:
    """(n,) the labels of the file, renumbered from 0 in ascending order; negative ones stay "no object".

    Raises SegmentationError where the file has none.
    """
    says = "segmentation.method is given, but no input carries labels: name their column with --labels"
    require(cloud.label is not None, SegmentationError, says)
    if cloud.label is None:
        return np.zeros(0, np.int64)
    labels = np.full(len(cloud), -1, np.int64)
    known = cloud.label >= 0
    labels[known] = np.unique(cloud.label[known], return_inverse=True)[1]
    return labels
