"""Points that stand alone, and points that stand twice. Nothing is dropped here: a mask says which are good.

Thesis eq 2.3 is printed wrong (it sums distances); what it means is: keep a point with at least k others within R. With R = the mean
nearest distance it deletes every plane; its workable forms, R = mean + 1 sd of the k-th distance ("density") and mean distance to k
neighbours <= mean + 1 sd ("statistical"; Rusu et al. 2008), still eat 3 to 15 % of good points, and whole regions where the density
differs. The default "isolated" compares each point with its own neighbours and their shape instead, which uneven density does not
disturb.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import UsageError, require
from scan2fea.filtering.crowding import crowded, repeated
from scan2fea.filtering.options import FilteringOptions
from scan2fea.kernel.near_tree import LEAF, near_tree, nearest_of_leaves
from scan2fea.kernel.neighbors import nearest_in_blocks
from scan2fea.types import BoolArray, FloatArray, Value

_BLOCK = 50_000
_SAMPLED_ABOVE, _SAMPLE = 200_000, 20_000  # points: the radius of the density filter is a mean and a deviation, which a sample tells
_NEIGHBOUR_QUANTILE = 0.8
_LEAST_RATIO = 3.0  # the corner of a plate sees a quarter of a disc: twice the distance; three times is no corner
_SIGMAS = 6.0
_SPARSE = 4.0
_NO_SURFACE = 0.35


@dataclass(frozen=True, eq=False, kw_only=True)
class Outliers(Value):
    """is_good : (n,) False for outliers and for all but the first of equal points.   how : what was decided, for the report."""

    is_good: BoolArray
    how: Mapping[str, Any]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Neighbours(Value):
    """The k nearest others of each point.

    mean : (n,) distance to them.   row : (n, k) int32, who they are.
    """

    mean: FloatArray
    row: npt.NDArray[np.int32]


def outliers(points: FloatArray, options: FilteringOptions = FilteringOptions()) -> Outliers:
    """Mark outliers of points (n, 3) by `options.outliers`, and exact duplicates. A cloud of fewer than 2 (k + 1) points is left as it is."""
    k = options.neighbours
    if len(points) < 2 * (k + 1):
        return Outliers(is_good=np.ones(len(points), bool), how={"outliers": "too few points to judge", "n_outliers": 0, "n_duplicates": 0})
    twice = repeated(points)
    bad, limit = METHODS[options.outliers](points, options)
    bad &= ~twice
    how = {"outliers": options.outliers, "limit": limit, "n_outliers": int(bad.sum()), "n_duplicates": int(twice.sum())}
    return Outliers(is_good=~(bad | twice), how=how)


def _neighbours(points: FloatArray, k: int) -> _Neighbours:
    n = len(points)
    mean, row = np.zeros(n), np.zeros((n, k), np.int32)
    for rows, distance, index in nearest_in_blocks(points, k + 1):
        mean[rows], row[rows] = distance[:, 1:].mean(axis=1), index[:, 1:]
    return _Neighbours(mean=mean, row=row)


def _kth_distances(points: FloatArray, k: int) -> FloatArray:
    """(m,) distance to the k-th other of every point, or of a drawn sample where there are many: its mean is then within a hundredth of its sd."""
    tree = near_tree(points)
    asked = tree
    if len(points) > _SAMPLED_ABOVE:
        asked = near_tree(points[np.sort(np.random.default_rng(0).choice(len(points), _SAMPLE, replace=False))])
    step, kth = max(1, _BLOCK // LEAF), np.zeros(len(asked.order))
    for first in range(0, asked.n_leaves, step):
        rows, distance, _ = nearest_of_leaves(tree, asked, k + 1, first, min(first + step, asked.n_leaves))
        kth[rows] = distance[:, k]
    return kth


def _isolated(points: FloatArray, options: FilteringOptions) -> tuple[BoolArray, float]:
    """Much farther from its neighbours than these are from theirs; or in a sparse region that is no surface.

    The ratio is taken to the 80 % quantile of the neighbours' own mean distances, so a point of a sparse region beside a dense one is
    judged by its sparse neighbours. The limit is the median ratio + 6 robust standard deviations, on the log scale, and at least 3.
    Strays in a crowd pass that test among themselves; see `_off_surface`.
    """
    near = _neighbours(points, options.neighbours)
    ratio = np.zeros(len(near.mean))
    rank = int(_NEIGHBOUR_QUANTILE * near.row.shape[1])
    for start in range(0, len(ratio), _BLOCK):
        part = slice(start, start + _BLOCK)
        typical = np.partition(near.mean[near.row[part]], rank, axis=1)[:, rank]
        ratio[part] = np.divide(near.mean[part], typical, out=np.ones_like(typical), where=typical > 0)
    log = np.log(np.maximum(ratio, 1e-12))
    centre = float(np.median(log))
    spread = 1.4826 * float(np.median(np.abs(log - centre)))
    limit = max(_LEAST_RATIO, float(np.exp(centre + _SIGMAS * spread)))
    return (ratio > limit) | _off_surface(points, near), limit


def _off_surface(points: FloatArray, near: _Neighbours) -> BoolArray:
    """True for points four times as sparse as the median whose neighbours form no surface, or that lie off the surface these form.

    Their own distance from the plane of their neighbours, or the spread of these across it, exceeds 0.35 of the spread along it: 0.6 in a
    cloud of random points, 0 on a sparse surface however uneven, 0 on a ring of a scanner.
    """
    off = np.zeros(len(points), bool)
    rows = np.flatnonzero(near.mean > _SPARSE * float(np.median(near.mean)))
    for start in range(0, len(rows), _BLOCK):
        part = rows[start : start + _BLOCK]
        patch = points[near.row[part]]
        centre = patch.mean(axis=1)
        patch = patch - centre[:, None]
        values, axes = np.linalg.eigh(np.einsum("mki,mkj->mij", patch, patch) / patch.shape[1])
        height = np.abs(np.einsum("mi,mi->m", points[part] - centre, axes[:, :, 0]))
        across = np.maximum(height, np.sqrt(np.maximum(values[:, 0], 0.0)))
        off[part] = across > _NO_SURFACE * np.sqrt(np.maximum(values[:, 2], 0.0))
    return off


def _density(points: FloatArray, options: FilteringOptions) -> tuple[BoolArray, float]:
    """Thesis eq 2.3, corrected: fewer than k others within R = mean + sd of the k-th distances."""
    kth = _kth_distances(points, options.neighbours)
    limit = float(kth.mean() + options.outlier_sd * kth.std())
    if len(kth) == len(points):
        return kth > limit, limit
    return (~crowded(points, limit, options.neighbours) if limit > 0 else np.zeros(len(points), bool)), limit


def _statistical(points: FloatArray, options: FilteringOptions) -> tuple[BoolArray, float]:
    """Rusu et al. (2008), as PCL does it: mean distance to the k nearest above mean + sd of these."""
    near = _neighbours(points, options.neighbours)
    limit = float(near.mean.mean() + options.outlier_sd * near.mean.std())
    return near.mean > limit, limit


def _radius(points: FloatArray, options: FilteringOptions) -> tuple[BoolArray, float]:
    """Fewer than k others within a radius that is given, or four times the median distance to the k-th: sixteen times sparser than the median."""
    limit = options.radius_m if options.radius_m is not None else _SPARSE * float(np.median(_kth_distances(points, options.neighbours)))
    require(limit > 0, UsageError, f"filtering.radius_m is {limit}: it must be a positive length in metres")
    return ~crowded(points, limit, options.neighbours), limit


def _none(points: FloatArray, options: FilteringOptions) -> tuple[BoolArray, float]:
    return np.zeros(len(points), bool), float("inf")


METHODS: Mapping[str, Callable[[FloatArray, FilteringOptions], tuple[BoolArray, float]]] = {
    "isolated": _isolated,
    "density": _density,
    "statistical": _statistical,
    "radius": _radius,
    "none": _none,
}
