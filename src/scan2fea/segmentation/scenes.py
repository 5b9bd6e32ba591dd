"""What only the whole scene tells: sheets and slabs that are floors or walls, leftovers of supports, and things that stand on things."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.segmentation.footprint import DIRECTIONS, directions_beyond, grid_on, is_covered, least_extent, standing_parts
from scan2fea.segmentation.planes import Plane, PlaneFinder
from scan2fea.segmentation.supports import Supports
from scan2fea.types import FloatArray, IntArray, Value

_PARALLEL = 0.97
_UPRIGHT = 0.3
_STACKED_SHARE = 0.25  # what stands on a table covers at most this share of it: a nozzle on its flange covers more and is one object with it
_STACKED_WIDTHS = 2.0  # and the table is at least this many times as wide as that is tall
_SLAB = 0.05  # thickness of a floor or wall over its smaller side
_SLAB_INSIDE = 0.9
_SLAB_BUSY = 0.6
_SLAB_THINGS = 2
_LEFTOVER_BANDS = 2.0
_SHEET = 0.95
_WALL_WIDTH = 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class Thing(Value):
    """One cluster. rows : of its points.   planes : its large planes.   kind : "object", "support" or "clutter"."""

    rows: IntArray
    planes: tuple[Plane, ...]
    kind: str = "object"


def things_of(finder: PlaneFinder, clusters: Sequence[IntArray], supports: Supports, radius_m: float, min_points: int) -> list[Thing]:
    """The clusters (rows of each) with their kinds; what stands on one of them becomes a thing of its own, after all others."""
    points = finder.points
    things = _off_slabs(finder, [Thing(rows=rows, planes=finder.of(rows)) for rows in clusters], radius_m, min_points)
    slabs = _slabs(points, things, radius_m)
    labelled = []
    stacked: list[Thing] = []
    for i, thing in enumerate(things):
        if i in slabs or _is_wall(points[thing.rows], thing, supports, radius_m):
            labelled.append(Thing(rows=thing.rows, planes=thing.planes, kind="support"))
        elif _is_leftover(points[thing.rows], supports):
            labelled.append(Thing(rows=thing.rows, planes=thing.planes, kind="clutter"))
        else:
            below, above = _unstacked(points, thing, supports, radius_m, min_points)
            labelled.append(below)
            stacked += above
    return labelled + stacked


def _floor_under(points: FloatArray, supports: Supports, radius_m: float) -> int | None:
    """The support that the thing stands on: it comes within a radius of its band, and no lower."""
    for i, floor in enumerate(supports.planes):
        lowest = float(np.quantile(floor.height(points), 0.001))
        if -floor.band_m <= lowest <= floor.band_m + radius_m:
            return i
    return None


def _unstacked(points: FloatArray, thing: Thing, supports: Supports, radius_m: float, min_points: int) -> tuple[Thing, list[Thing]]:
    """A thing that stands on a support, without what stands on it (a box on a table), and that. In doubt nothing is split.

    Only planes parallel to the support and facing as it does.
    """
    under = _floor_under(points[thing.rows], supports, radius_m)
    if under is None:
        return thing, []
    floor = supports.planes[under]
    left, above = thing.rows, []
    for plane in thing.planes:
        if abs(float(plane.normal @ floor.normal)) < _PARALLEL:
            continue
        up = plane if plane.normal @ floor.normal > 0 else plane.flipped()
        parts = [left[part] for part in _stacked_on(up, points[left], radius_m, min_points)]
        above += [Thing(rows=rows, planes=()) for rows in parts]
        for rows in parts:
            left = np.setdiff1d(left, rows, assume_unique=True)
    return Thing(rows=left, planes=thing.planes), above


def _stacked_on(plane: Plane, points: FloatArray, radius_m: float, min_points: int) -> list[IntArray]:
    height = plane.height(points)
    grid = grid_on(plane, points, radius_m)
    top = grid.occupied(points[np.abs(height) <= plane.band_m])
    width = least_extent(top, grid.edge_m)
    found = []
    for part in standing_parts(points, height, plane.band_m, grid, radius_m, min_points):
        is_small = part.cells.sum() <= _STACKED_SHARE * top.sum() and _STACKED_WIDTHS * part.height_m <= width
        if is_small and directions_beyond(part.cells, top) >= DIRECTIONS and is_covered(part.cells):
            found.append(part.rows)
    return found


def _is_wall(points: FloatArray, thing: Thing, supports: Supports, radius_m: float) -> bool:
    """One plane sheet that rises from a floor and is at least half as wide as it. Seen from one side, it could be no solid anyway."""
    under = _floor_under(points, supports, radius_m)
    if under is None or not thing.planes:
        return False
    plane = thing.planes[0]
    if abs(float(plane.normal @ supports.planes[under].normal)) > _UPRIGHT or (np.abs(plane.height(points)) <= plane.band_m).mean() < _SHEET:
        return False
    grid = grid_on(plane, points, radius_m)
    return least_extent(grid.occupied(points), grid.edge_m) >= _WALL_WIDTH * supports.width_m[under]


def _is_leftover(points: FloatArray, supports: Supports) -> bool:
    """True for what rises no more than two bands above a support: its warped rim, not a thing."""
    return any(float(np.abs(floor.height(points)).max()) <= _LEFTOVER_BANDS * floor.band_m for floor in supports.planes)


def _off_slabs(finder: PlaneFinder, things: list[Thing], radius_m: float, min_points: int) -> list[Thing]:
    """The same, with what stands on a slab and touches it apart: a floor of which both faces are there is no support to `supports`.

    What is left must be a slab as `_slabs` knows them, before which the other things of the scene stand, too.
    """
    points, apart, added = finder.points, list(things), list[Thing]()
    for i, thing in enumerate(things):
        others = [other.rows for k, other in enumerate(things) if k != i]
        if len(others) < _SLAB_THINGS:
            break
        before = points[np.concatenate(others)]
        for plane in thing.planes:
            up = plane if np.median(plane.height(before)) > 0 else plane.flipped()
            if up.height(before).min() < -radius_m:
                continue
            stacked = [thing.rows[part] for part in _stacked_on(up, points[thing.rows], radius_m, min_points)]
            left = np.setdiff1d(thing.rows, np.concatenate([*stacked, thing.rows[:0]]), assume_unique=True)
            beside = np.concatenate([before, *(points[rows] for rows in stacked)])
            if stacked and _is_thin(points[left], up, radius_m) and _lies_behind(up, points[left], beside, radius_m):
                apart[i] = Thing(rows=left, planes=finder.of(left))
                added += [Thing(rows=rows, planes=finder.of(rows)) for rows in stacked]
                break
    return apart + added


def _slabs(points: FloatArray, things: Sequence[Thing], radius_m: float) -> set[int]:
    """Thin plates that all other things of the scene stand before: floors and walls that touch nothing.

    Thickness below 5 % of the smaller side; at least two other things, all on one side of it, 9 tenths of their shadow on the plate,
    covering less than 6 tenths of it.
    """
    thin = {i for i, thing in enumerate(things) if thing.planes and _is_thin(points[thing.rows], thing.planes[0], radius_m)}
    others = [thing.rows for i, thing in enumerate(things) if i not in thin]
    if len(others) < _SLAB_THINGS:
        return set()
    rest = points[np.concatenate(others)]
    return {i for i in thin if _lies_behind(things[i].planes[0], points[things[i].rows], rest, radius_m)}


def _is_thin(points: FloatArray, plane: Plane, radius_m: float) -> bool:
    grid = grid_on(plane, points, radius_m)
    low, high = np.quantile(plane.height(points), [0.005, 0.995])
    return float(high - low) <= _SLAB * least_extent(grid.occupied(points), grid.edge_m)


def _lies_behind(plane: Plane, own: FloatArray, others: FloatArray, radius_m: float) -> bool:
    """True where all others are on one side of the plate, nearly all over it, with much of it free."""
    height, faces = plane.height(others), plane.height(own)
    if not (height.min() > faces.max() - radius_m or height.max() < faces.min() + radius_m):
        return False
    grid = grid_on(plane, np.concatenate([own, others]), radius_m)
    plate, shadow = grid.occupied(own), grid.occupied(others)
    return bool((plate & shadow).sum() >= _SLAB_INSIDE * shadow.sum() and shadow.sum() <= _SLAB_BUSY * plate.sum())
