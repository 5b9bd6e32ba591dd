"""One member whose section goes on where its points have taken other directions.

The surface of a wall no thicker than the points lie apart has normals that lean, and near its edges its points take directions of their own: streaks
that lie in the section of a member and are none. Where the section still shows, whatever direction its points have taken, the member goes on.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from scan2fea.segmentation.extents import PARALLEL, Extent, extent_of
from scan2fea.segmentation.pieces import LEAST_PIECE, Thin
from scan2fea.segmentation.sweeps import COLUMN, OF_SECTION, SHOWS, SLICE
from scan2fea.types import BoolArray, FloatArray, IntArray

_ALL = 0.95  # of the points: strays apart
_AROUND = 3  # columns beside the section that are looked at


def is_one(thin: Thin, group: IntArray) -> bool:
    """Whether the longest of the groups (n,), -1 none, led on as far as its section shows, is all there is but for strays."""
    sizes = np.bincount(group[group >= 0], minlength=1)
    extents = {g: extent_of(thin.points[group == g], thin.normals[group == g]) for g in np.flatnonzero(sizes >= LEAST_PIECE).tolist()}
    if not extents:
        return False
    longest = max(extents, key=lambda g: extents[g].length)
    along = [g for g, extent in extents.items() if abs(float(extent.axis @ extents[longest].axis)) >= PARALLEL]
    own = group == longest
    inside = _in_section(thin, own, ((group < 0) | np.isin(group, along)) & ~own, extents[longest])
    return bool((own | inside).mean() >= _ALL)


def _in_section(thin: Thin, own: BoolArray, free: BoolArray, extent: Extent) -> BoolArray:
    """(n,) which free points lie in the section that the own points show, in a slice joined to theirs by slices that show it.

    A slice shows it where three quarters of its columns, or columns beside them, hold points, own or free, and of the columns clear of them no more
    than a quarter do (leaves fill all alike).
    """
    rows = np.flatnonzero(own | free)
    local = (thin.points[rows] - extent.middle) @ extent.frame.T
    at = np.floor(local[:, 2] / (SLICE * thin.h)).astype(np.int64)
    column = np.floor(local[:, :2] / (COLUMN * thin.h)).astype(np.int64)
    is_own = own[rows]
    low, high = column[is_own].min(axis=0) - _AROUND, column[is_own].max(axis=0) + _AROUND
    near = ((column >= low) & (column <= high)).all(axis=1)
    rows, at, column, is_own = rows[near], at[near] - at[near].min(), column[near] - low, is_own[near]
    shape = (*(high - low + 1).tolist(), int(at.max()) + 1)
    seen, mine = np.zeros(shape, bool), np.zeros(shape, bool)
    seen[column[:, 0], column[:, 1], at] = True
    mine[column[is_own, 0], column[is_own, 1], at[is_own]] = True
    first, last = int(at[is_own].min()), int(at[is_own].max())
    section = mine[:, :, first : last + 1].mean(axis=2) >= OF_SECTION
    wide = ndimage.maximum_filter(section, 3)
    shows = (_share(ndimage.maximum_filter(seen, (3, 3, 1)), section) >= SHOWS) & (_share(seen, ~wide) <= 1.0 - SHOWS)
    shows[first : last + 1] = True
    run = ndimage.label(shows)[0]
    inside = np.zeros(len(own), bool)
    inside[rows] = wide[column[:, 0], column[:, 1]] & (run[at] == run[first]) & ~is_own
    return inside


def _share(seen: BoolArray, columns: BoolArray) -> FloatArray:
    """(s,) share of the columns (u, v) in which each slice of `seen` (u, v, s) holds points; 0 of none."""
    return np.asarray(seen[columns].mean(axis=0)) if columns.any() else np.zeros(seen.shape[2])
