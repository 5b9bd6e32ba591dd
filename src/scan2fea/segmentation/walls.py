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
_FITS, _MAD, _THINNER, _FACE = 8, 1.4826, 5.0, 0.2
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
        inward, other = _faces(inward, points[part])
        if not _bounds(inward, points, part, sensors):
            continue
        depth = max(_depth(inward, planes, floor, points[part]), other)
        if _is_sheet_on_floor(inward, depth, points[part], floor, width_m, radius_m):
            return inward, depth
    return None


def _faces(plane: Plane, points: FloatArray) -> tuple[Plane, float]:
    """The outer face, and the depth of the inner one, of a plane that was laid aslant through both faces of a slab; else the plane itself and 0.

    Seen along the plane's normal the outer face lies below the inner one everywhere, so the lower half of the points is nearly all of it.
    """
    on = points[np.abs(plane.height(points)) <= plane.band_m]
    if len(on) < 3:
        return plane, 0.0
    height = plane.height(on)
    kept = height <= np.median(height)
    face = plane
    for _ in range(_FITS):
        middle = on[kept].mean(axis=0)
        normal = np.linalg.eigh((on[kept] - middle).T @ (on[kept] - middle))[1][:, 0]
        normal = normal if normal @ plane.normal > 0 else -normal
        height = (on - middle) @ normal
        sigma = _MAD * float(np.median(np.abs(height[kept])))
        face = Plane(normal=normal, offset=float(middle @ normal), sigma_m=max(sigma, 1e-3 * plane.sigma_m), share=plane.share * float(kept.mean()))
        before, kept = kept, np.abs(height) <= face.band_m
        if kept.sum() < 3:
            return plane, 0.0
        if np.array_equal(kept, before):
            break
    inner = height[height > face.band_m]
    if _THINNER * face.sigma_m > plane.sigma_m or len(inner) < _FACE * len(on):
        return plane, 0.0
    apart = float(np.median(inner))
    return face, apart + max(face.band_m, 4.0 * _MAD * float(np.median(np.abs(inner - apart))))


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
