"""Floors, table tops and walls: large planes that carry things and are no part of them.

A plane is a support only if everything speaks for it; in doubt it stays with the object. A slab, a leg of an angle, the side of a box
are large planes too, so size decides nothing. What decides, for a plane of a connected part of the cloud:

1. one side: nearly nothing of the part lies behind it, and where the sensor is known, the sensor is on the other side too;
2. no body: what lies in front covers less than half of it. Every closed solid that a plane bounds casts its shadow on the whole plane;
3. something stands on it that is not a mere ring, and the plane goes on beyond that thing in at least three of the four directions of its
   footprint's axes (the fourth may lie in the scanner's shadow; in all four where the plane itself stands on another support). The web
   on a flange, the other leg of an angle run out at the ends of the plane; where their ends were not seen they still follow the plane for
   half its length or more, and what does that must be clear of it all round;
4. the plane is at least as wide as that thing is tall: a column on its base plate is one object, a column on a floor is not part of it;
   Where nothing does because all that stands there is joined to walls, the same is asked once more with those walls (`walls`) apart;
5. without a known sensor: no more than six tenths of the border of the plane are lined by walls going up (a box seen from outside with a
   pocket in its face, and a room seen from inside, are then the same points); where two things or more stand clear, three quarters.

What carries things is followed by the walls that bound them (`walls`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.near_tree import NearTree
from scan2fea.kernel.neighbors import k_nearest, radius_components
from scan2fea.kernel.threads import in_threads
from scan2fea.segmentation.footprint import (
    DIRECTIONS,
    Standing,
    border_share,
    directions_beyond,
    grid_on,
    is_covered,
    least_extent,
    share_along,
    standing_parts,
)
from scan2fea.segmentation.planes import Plane, PlaneFinder
from scan2fea.segmentation.walls import wall_among
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

_BEHIND = 0.05
_BODY = 0.5
_LINED, _LINED_BUSY = 0.6, 0.75  # two walls of four line half of it, what leans in their corner a little more
_PARALLEL = 0.95
_FOLLOWS = 0.5  # of the plane's length
_MOST = 8  # supports per scene
_STRAY_BANDS = 3.0  # nine sigma: the noise of a floor differs from place to place, its band is one
_AMONG = 8  # nearest points, of which all but one must lie on the support


@dataclass(frozen=True, eq=False, kw_only=True)
class Supports(Value):
    """number : (n,) int64, which support each point lies on, -1 none.   planes : normals towards what they carry.   width_m : their smaller sides."""

    number: IntArray
    planes: tuple[Plane, ...]
    width_m: tuple[float, ...]

    @classmethod
    def none(cls, n_points: int) -> Supports:
        """No support."""
        return cls(number=np.full(n_points, -1, np.int64), planes=(), width_m=())


def find_supports(finder: PlaneFinder, sensors: FloatArray, radius_m: float, min_points: int, tree: NearTree | None = None) -> Supports:
    """The supports of the scene that the finder was made for.

    sensors : (n, 3), nan where unknown.   radius_m : that joins points of one surface.   tree : of the points, where one is there already.
    """
    points = finder.points
    number = np.full(len(points), -1, np.int64)
    planes: list[Plane] = []
    todo: list[tuple[IntArray, Plane | None]] = [(np.arange(len(points)), None)]
    while todo and len(planes) < _MOST:
        part, floor = todo.pop()
        connected = _connected(points, part, radius_m, min_points, tree if len(part) == len(points) else None)
        in_threads(finder.of, connected)  # it keeps what it finds
        for rows in connected:
            plane = _support_of(finder, rows, sensors[rows], radius_m, min_points, floor)
            if plane is None:
                continue
            on = np.abs(plane.height(points[rows])) <= plane.band_m
            number[rows[on]] = len(planes)
            planes.append(plane)
            todo.append((rows[~on], floor or plane))
    if planes:
        _take_walls(finder, sensors, number, planes, radius_m, min_points)
        number = _with_strays(points, number, planes, tree)
    widths = tuple(_width(plane, points[number == i], radius_m) for i, plane in enumerate(planes))
    return Supports(number=number, planes=tuple(planes), width_m=widths)


def _take_walls(finder: PlaneFinder, sensors: FloatArray, number: IntArray, planes: list[Plane], radius_m: float, min_points: int) -> None:
    """Enter the walls that stand on the first support into `number` (n,) and `planes`."""
    points, floor = finder.points, planes[0]
    width = _width(floor, points[number == 0], radius_m)
    todo = [np.flatnonzero(number < 0)]
    while todo:
        for rows in _connected(points, todo.pop(), radius_m, min_points):
            part = np.isin(np.arange(len(points)), rows)
            wall = wall_among(finder.of(rows), points, part, sensors, floor, width, radius_m) if len(planes) < _MOST else None
            if wall is None:
                continue
            plane, depth = wall
            height = plane.height(points[rows])
            on = (height >= -plane.band_m) & (height <= depth)
            number[rows[on]] = len(planes)
            planes.append(plane)
            todo.append(rows[~on])  # the next wall of the corner


def _with_strays(points: FloatArray, number: IntArray, planes: Sequence[Plane], tree: NearTree | None) -> IntArray:
    """`number` with the tails of the supports' noise: points just off a support among its own.

    A floor of 80,000 points leaves hundreds beyond three sigma, more where its noise is uneven. Left to what stands on it, they lie so far
    apart that the radius found from them joins everything.
    """
    out = number.copy()
    for i, plane in enumerate(planes):
        off = np.flatnonzero(number < 0)
        off = off[np.abs(plane.height(points[off])) <= _STRAY_BANDS * plane.band_m]
        if len(off):
            near = k_nearest(points, _AMONG + 1, points[off], tree)[1]
            out[off[(number[near] == i).sum(axis=1) >= _AMONG - 1]] = i
    return out


def _width(plane: Plane, points: FloatArray, radius_m: float) -> float:
    grid = grid_on(plane, points, radius_m)
    return least_extent(grid.occupied(points), grid.edge_m)


def _connected(points: FloatArray, rows: IntArray, radius_m: float, min_points: int, tree: NearTree | None = None) -> list[IntArray]:
    """The connected parts of the rows that are large enough to hold a plane and something on it, largest first."""
    if len(rows) < 2 * min_points:
        return []
    labels = radius_components(points[rows], radius_m, tree)
    counts = np.bincount(labels)
    large = np.flatnonzero(counts >= 2 * min_points)
    return [rows[labels == label] for label in large[np.argsort(-counts[large], kind="stable")]]


def _support_of(finder: PlaneFinder, rows: IntArray, sensors: FloatArray, radius_m: float, min_points: int, floor: Plane | None) -> Plane | None:
    """The largest plane of one connected part that is a support; on another support only one that faces as it does."""
    points = finder.points[rows]
    upwards = []
    for plane in finder.of(rows):
        height = plane.height(points)
        upward = plane if (height > plane.band_m).sum() >= (height < -plane.band_m).sum() else plane.flipped()
        if floor is not None and upward.normal @ floor.normal < _PARALLEL:
            continue  # an upright plane with something on it is part of a thing as often as a wall: in doubt the thing stays whole
        if carries(upward, points, sensors, radius_m, min_points, DIRECTIONS - 1 if floor is None else DIRECTIONS):
            return upward
        upwards.append(upward)
    for upward in upwards if floor is None else ():
        walls = _walls_on(upward, finder, rows, sensors, radius_m)
        if walls.any() and carries(upward, points, sensors, radius_m, min_points, walls=walls):
            return upward
    return None


def _walls_on(floor: Plane, finder: PlaneFinder, rows: IntArray, sensors: FloatArray, radius_m: float) -> BoolArray:
    """(m,) which points of a connected part (rows (m,), their sensors) would be walls if the plane were a floor."""
    points = finder.points[rows]
    on = np.abs(floor.height(points)) <= floor.band_m
    width = _width(floor, points[on], radius_m)
    walls, part = np.zeros(len(rows), bool), np.ones(len(rows), bool)
    while (found := wall_among(finder.of(rows[part]), points, part, sensors, floor, width, radius_m)) is not None:
        plane, depth = found
        height = plane.height(points)
        walls |= part & ~on & (height >= -plane.band_m) & (height <= depth)
        part = ~on & ~walls
    return walls


def carries(
    plane: Plane,
    points: FloatArray,
    sensors: FloatArray,
    radius_m: float,
    min_points: int,
    directions: int = DIRECTIONS - 1,
    walls: BoolArray | None = None,
) -> bool:
    """The tests of the module's docstring, for the side the plane's normal points to. walls : (n,) points that line it and join nothing."""
    height = plane.height(points)
    apart = np.zeros(len(points), bool) if walls is None else walls
    on, above = np.abs(height) <= plane.band_m, height > plane.band_m
    if not above.any() or (~on & ~above).sum() > _BEHIND * len(points):
        return False
    known = on & np.isfinite(sensors).all(axis=1)
    is_seen = bool(known.sum() > 0.5 * on.sum())
    if is_seen and np.median(plane.height(sensors[known])) <= 0:
        return False
    grid = grid_on(plane, points, radius_m)
    floor, body = grid.occupied(points[on]), grid.occupied(points[above])
    if body.sum() >= _BODY * (floor | body).sum():
        return False
    parts = standing_parts(points[~apart], height[~apart], plane.band_m, grid, radius_m, min_points)
    width = least_extent(floor, grid.edge_m)
    stands = [_is_clear(part, floor, directions) and part.height_m <= width for part in parts]
    if not any(ok and is_covered(part.cells) for ok, part in zip(stands, parts, strict=True)):
        return False
    lining = grid.occupied(points[apart & above])
    for ok, part in zip(stands, parts, strict=True):
        lining |= part.cells & (not ok)
    n_clear = sum(ok and is_covered(part.cells) for ok, part in zip(stands, parts, strict=True))
    return is_seen or border_share(floor, lining) < (_LINED if n_clear < 2 else _LINED_BUSY)


def _is_clear(part: Standing, floor: BoolArray, directions: int) -> bool:
    """Whether the floor (cells) goes on beyond a part in that many directions, in all four where the part follows it as a leg its flange."""
    beyond = directions_beyond(part.cells, floor)
    return beyond >= directions and (beyond == DIRECTIONS or share_along(part.cells, floor) < _FOLLOWS)
