"""How well found segments agree with true ones: figures that need no names of segments, only which points are together.

Truth and result are one label per point. A true label below 0 means "nobody knows": such points are left out. A found label below 0 means "belongs
to nothing": each such point counts as a segment of its own for the Rand index and as missed for the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from scan2fea.errors import SegmentationError, require
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

MATCH_IOU = 0.5  # above it a match is unique: two segments cannot both hold more than half of a union


@dataclass(frozen=True, eq=False, kw_only=True)
class Agreement(Value):
    """The agreement of a result with the truth.

    objects : (t,) true labels, ascending.   n_points : (t,) of each.   iou : (t,) with the segment matched to it (0 without one); the matching is the
    one of highest sum (Kuhn 1955).   over, under : (t,) 1 - overlap / object and 1 - overlap / segment for the segment that overlaps it most
    (Clinton et al. 2010): the share of the object that lies elsewhere, and the share of that segment that is not the object's.
    adjusted_rand : Hubert and Arabie (1985).   f1 : of objects, those matched at an IoU of 0.5 or more against objects and segments.
    """

    objects: IntArray
    n_points: IntArray
    iou: FloatArray
    over: FloatArray
    under: FloatArray
    adjusted_rand: float
    mean_iou: float
    precision: float
    recall: float
    f1: float

    _ROWS = (("objects", "n_points", "iou", "over", "under"),)


def agreement(truth: IntArray, found: IntArray, *, is_counted: BoolArray | None = None) -> Agreement:
    """Compare labels (n,) with the truth (n,).

    is_counted : (s,) by found label, which segments are said to be objects (others, floors say, may overlap anything); all where None.
    Raises SegmentationError if the lengths differ or no true label is known.
    """
    require(len(truth) == len(found), SegmentationError, f"{len(truth)} true labels for {len(found)} points: they must belong to the same cloud")
    known = truth >= 0
    require(known.any(), SegmentationError, "no point has a true label of 0 or more: there is nothing to compare with")
    objects, row = np.unique(truth[known], return_inverse=True)
    labels, column = np.unique(found[known], return_inverse=True)
    table = np.zeros((len(objects), len(labels)), np.int64)
    np.add.at(table, (row, column), 1)
    rand = _adjusted_rand(table, labels)
    table, labels = table[:, labels >= 0], labels[labels >= 0]
    sizes = np.bincount(row, minlength=len(objects))
    segment_sizes = table.sum(axis=0)
    iou = np.zeros(len(objects))
    if len(labels):
        ratio = table / (sizes[:, None] + segment_sizes[None] - table)
        matched = linear_sum_assignment(-ratio)
        iou[matched[0]] = ratio[matched]
    over, under = _over_under(table, sizes, segment_sizes)
    counted = np.ones(len(labels), bool) if is_counted is None else is_counted[labels]
    hits = float((iou >= MATCH_IOU).sum())
    precision, recall = hits / max(int(counted.sum()), 1), hits / len(objects)
    return Agreement(
        objects=objects.astype(np.int64),
        n_points=sizes.astype(np.int64),
        iou=iou,
        over=over,
        under=under,
        adjusted_rand=rand,
        mean_iou=float(iou.mean()),
        precision=min(precision, 1.0),
        recall=recall,
        f1=2 * hits / (len(objects) + max(int(counted.sum()), int(hits))),
    )


def adjusted_rand(a: IntArray, b: IntArray) -> float:
    """Adjusted Rand index of two labellings (n,) of the same points: 1 where they agree, 0 in the mean of random ones."""
    return agreement(a, b).adjusted_rand


def _pairs(counts: IntArray) -> float:
    return float((counts.astype(float) * (counts - 1.0)).sum() / 2.0)


def _adjusted_rand(table: IntArray, labels: IntArray) -> float:
    """table : (t, s) points by true object and found label; the column of label -1 stands for segments of one point each."""
    alone = table[:, labels < 0].sum()
    of_segments = table[:, labels >= 0]
    both, rows, columns = _pairs(of_segments), _pairs(table.sum(axis=1)), _pairs(of_segments.sum(axis=0))
    n = float(of_segments.sum() + alone)
    every = n * (n - 1.0) / 2.0
    expected = rows * columns / every if every else 0.0
    most = (rows + columns) / 2.0
    return 1.0 if most == expected else (both - expected) / (most - expected)


def _over_under(table: IntArray, sizes: IntArray, segment_sizes: IntArray) -> tuple[FloatArray, FloatArray]:
    if not table.shape[1]:
        return np.ones(len(sizes)), np.zeros(len(sizes))
    best = table.argmax(axis=1)
    overlap = table[np.arange(len(sizes)), best]
    inside = np.maximum(segment_sizes[best], 1)
    return 1.0 - overlap / sizes, np.where(overlap > 0, 1.0 - overlap / inside, 0.0)
