"""A part of the scene: inside a box, on one side of a plane, inside a region clicked in plan. Marks points; drops nothing."""

from __future__ import annotations

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.filtering.options import FilteringOptions
from scan2fea.types import BoolArray, FloatArray

_BOX, _PLANE, _LEAST_CORNERS = 6, 4, 3


def crop(points: FloatArray, options: FilteringOptions = FilteringOptions()) -> BoolArray:
    """(n,) True for the points (n, 3) that are kept: inside all that is given, borders included, or with `crop_outside` those that are not.

    Raises UsageError for a box, plane or region that is none.
    """
    box, plane, region = options.crop_box_m, options.crop_plane, options.crop_region_m
    keep = np.ones(len(points), bool)
    if not (box or plane or region):
        return keep
    if box:
        says = f"filtering.crop_box_m = {list(box)}: six numbers, the smallest x y z and then the largest, are needed"
        require(len(box) == _BOX and all(low < high for low, high in zip(box[:3], box[3:], strict=False)), UsageError, says)
        keep &= np.asarray(((points >= box[:3]) & (points <= box[3:])).all(axis=1))
    if plane:
        normal = np.asarray(plane[:3])
        says = f"filtering.crop_plane = {list(plane)}: a normal x y z that is not zero and a distance along it are needed"
        require(len(plane) == _PLANE and bool(np.linalg.norm(normal) > 0), UsageError, says)
        keep &= np.asarray(points @ normal >= plane[3] * np.linalg.norm(normal))
    if region:
        says = f"filtering.crop_region_m = {list(region)}: x y of three corners or more, one after the other, are needed"
        require(len(region) % 2 == 0 and len(region) >= 2 * _LEAST_CORNERS, UsageError, says)
        keep &= in_polygon(points[:, :2], np.asarray(region, float).reshape(-1, 2))
    return ~keep if options.crop_outside else keep


def in_polygon(xy: FloatArray, corners: FloatArray) -> BoolArray:
    """(n,) True for points (n, 2) inside a polygon (k, 2) or on its border, by the even-odd rule."""
    inside, border = np.zeros(len(xy), bool), np.zeros(len(xy), bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, to = b - a, xy - a
        cross = edge[0] * to[:, 1] - edge[1] * to[:, 0]
        along = to @ edge
        border |= (cross == 0) & (along >= 0) & (along <= edge @ edge)
        spans = (a[1] > xy[:, 1]) != (b[1] > xy[:, 1])
        inside ^= spans & ((cross > 0) == (edge[1] > 0))
    return inside | border
