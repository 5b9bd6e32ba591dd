"""Walls of a room whose floor is known: upright planes that bound the whole scene, whatever leans on them.

A plane is a wall only if

1. it is square to a floor, rises from it, is nearly as long as the floor is wide and a quarter of that tall at least;
2. nearly nothing of the scene lies beyond it, and sensors that are known stand before it;
3. it is a sheet, or a slab of which both faces are seen, a twentieth as thick as tall at most: at its upper border nothing goes on into the room,
   as the lid of a container or the flange of a beam does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scan2fea.segmentation.planes import Plane
from scan2fea.types import BoolArray, FloatArray

_UPRIGHT = 0.1
_BEYOND = 0.02
_LONG, _TALL = 0.8, 0.25  # of the floor's smaller side
_RIM = 2.0  # radii: depth of the upper border
_CAPPED = 0.25
_SLAB, _PARALLEL = 0.05, 0.995
_TAIL = 0.01


def wall_among(
    planes: Sequence[Plane], points: FloatArray, part: BoolArray, sensors: FloatArray, floor: Plane, width_m: float, radius_m: float
) -> tuple[Plane, float] | None:
    """The first of the planes of a part of the scene that is a wall, its normal into the room, and the depth of its points; None where none is.

    points, sensors : (n, 3) of the scene, sensors nan where not known.   part : (n,) where the planes were found.   width_m : of the floor.
    """
    for plane in planes:
        if abs(float(plane.normal @ floor.normal)) > _UPRIGHT:
            continue
        inward = plane if (plane.height(points) > plane.band_m).mean() > 0.5 else plane.flipped()
        if not _bounds(inward, points, part, sensors):
            continue
        depth = _depth(inward, planes, floor, points[part])
        if _is_sheet_on_floor(inward, depth, points[part], floor, width_m, radius_m):
            return inward, depth
    return None


def _depth(plane: Plane, planes: Sequence[Plane], floor: Plane, points: FloatArray) -> float:
    """How far into the room the points of the wall reach: to the end of its own band, or of that of its other face."""
    on = np.abs(plane.height(points)) <= plane.band_m
    thickest = _SLAB * float(np.ptp(np.quantile(floor.height(points[on]), [_TAIL, 1.0 - _TAIL]))) if on.any() else 0.0
    reach = plane.band_m
    for other in planes:
        if abs(float(other.normal @ plane.normal)) >= _PARALLEL:
            apart = float(np.median(plane.height(points[np.abs(other.height(points)) <= other.band_m])))
            if 0 < apart <= thickest:
                reach = max(reach, apart + other.band_m)
    return reach


def _bounds(plane: Plane, points: FloatArray, part: BoolArray, sensors: FloatArray) -> bool:
    height = plane.height(points)
    if (height < -plane.band_m).mean() > _BEYOND:
        return False
    seen = part & (np.abs(height) <= plane.band_m) & np.isfinite(sensors).all(axis=1)
    return not seen.any() or bool(np.median(plane.height(sensors[seen])) > 0)


def _is_sheet_on_floor(plane: Plane, reach: float, points: FloatArray, floor: Plane, width_m: float, radius_m: float) -> bool:
    depth, z = plane.height(points), floor.height(points)
    on = np.abs(depth) <= plane.band_m
    if not on.any():
        return False
    along = points @ np.cross(plane.normal, floor.normal)
    low, high = np.quantile(z[on], [_TAIL, 1.0 - _TAIL])
    length = float(np.ptp(np.quantile(along[on], [_TAIL, 1.0 - _TAIL])))
    if low > floor.band_m + _RIM * radius_m or length < _LONG * width_m or high - low < _TALL * width_m:
        return False
    place = np.floor((along - along[on].min()) / radius_m).astype(np.int64)
    n_places = int(place[on].max()) + 1
    top = np.full(n_places, -np.inf)
    np.maximum.at(top, place[on], z[on])
    near = (depth > reach) & (depth <= reach + _RIM * radius_m) & (place >= 0) & (place < n_places)
    caps = place[near][np.abs(z[near] - top[place[near]]) <= _RIM * radius_m]
    return bool(len(np.unique(caps)) <= _CAPPED * n_places)
