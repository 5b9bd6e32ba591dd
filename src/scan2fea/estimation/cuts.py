"""Places of a member at which no side of a wall was seen: copes, notches, corners cut off, or hidden from both sides.

A hole is enclosed (`holes.py`); what lies open to the rim of a face may be hidden. But where a wall was cut through, its cut was scanned like the
rest: points lie inside the wall, along the border of the bare place, where points of an intact wall never lie. Such a place is cut. Where its border
shows no such points it may be hidden from both sides or cut and the cut unseen, and all that can be said is that no side of the wall was seen there:
beside places of the same strip where both were seen, or, along the whole member, between two such strips of one straight wall (a face never seen, and
all beyond it, follows from the other faces).

Points inside are counted deeper than `_DEEP_SIGMAS` of noise and a quarter of the wall under the nearest side, and compared with how often such
points occur along those two sides elsewhere (strays; the tail of the noise).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.special import gammainc

from scan2fea.estimation.holes import VOID_CELLS, VOID_POINTS
from scan2fea.estimation.outline import edge_lengths, first_across, inward
from scan2fea.kernel.region_margins import region_margins
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.sections import section
from scan2fea.types import BoolArray, FloatArray, IntArray, Member, Section, Value

_CELL_POINTS = 6.0  # on average: an empty cell is a chance of 1 in 400
_DEEP_SIGMAS, _DEEP_WALL = 3.0, 0.25
_SEEN = 0.5  # of a strip along the member: a side that was seen
_CHANCE = 1e-6  # of as many points inside a wall that is whole
_LEAST_DEEP = 8
_BESIDE = 2  # cells beside a bare region that tell how dense its surroundings are
_NARROW = 8.0  # cells of another shape: a flange that is narrower than its fellow lacks strips that squares are too wide to show
_LEAST_BARE = 8.0  # points that both sides of a bare place would hold, at least, where its border tells that it was cut


@dataclass(frozen=True, kw_only=True)
class Cut(Value):
    """face : a side of the wall.   from_m, to_m : along the member.   area_m2 : of that side.   missed : points that both sides would hold there.
    deep : points inside the wall along the border; by_chance : as many as there would be in a whole wall.
    """

    face: str
    from_m: float
    to_m: float
    area_m2: float
    missed: float
    deep: int
    by_chance: float

    @property
    def is_cut(self) -> bool:
        """Whether the border shows where the wall was cut."""
        return self.deep >= _LEAST_DEEP and float(gammainc(self.deep, max(self.by_chance, 1e-9))) < _CHANCE


@dataclass(frozen=True, eq=False, kw_only=True)
class _Strips(Value):
    """Strips of the outline along the member. edge, low, high : (m,) the edge each lies on and where it begins and ends on it, m.   at, inward :
    (m, 2) middle, and unit normal into the material.   across : (m,) the strip on the other side of the wall.   wall_m : (m,) how far that is.
    """

    edge: IntArray
    low: FloatArray
    high: FloatArray
    at: FloatArray
    inward: FloatArray
    across: IntArray
    wall_m: FloatArray


def share_of_sides(places: Iterable[Cut], member: Member) -> float:
    """Of the area of the member's sides, that of the bare places."""
    shape = section(member.family, member.values())
    return sum(place.area_m2 for place in places) / float(edge_lengths(shape).sum() * member.values()["length"])


@dataclass(frozen=True, eq=False, kw_only=True)
class _Counted(Value):
    """Per strip and place along the member: shown : points of the side.   within : points inside the wall.   own : whether it is of the member.
    step_m : from place to place.
    """

    shown: IntArray
    within: IntArray
    own: BoolArray
    step_m: float


def cuts(member: Member, side: FloatArray, edge: IntArray, along: FloatArray, z: FloatArray, sigma_m: float) -> tuple[Cut, ...]:
    """The bare places, the largest first: cut, or such as chance cannot have left.

    side, edge, along, z : (n,) of the points: signed distance to the outline, m, negative inside; the nearest edge; place along it; along the member.
    sigma_m : noise.
    """
    found = _places(member, side, edge, along, z, sigma_m)
    if any("TOE" in name for name in faces(member.family)) and not any(cut.is_cut for cut in found):  # rounded corners of tubes and bars lie within
        found += [cut for cut in _places(member, side, edge, along, z, sigma_m, _NARROW) if cut.is_cut]
    return tuple(sorted(found, key=lambda cut: -cut.area_m2))


def _places(member: Member, side: FloatArray, edge: IntArray, along: FloatArray, z: FloatArray, sigma_m: float, narrow: float = 1.0) -> list[Cut]:
    """As `cuts`, in cells that many times as narrow as a square of as many points, and as many times as long."""
    shape, length = section(member.family, member.values()), member.values()["length"]
    cell = math.sqrt(_CELL_POINTS * float(edge_lengths(shape).sum()) * length / max(len(z), 1))
    n_z = min(round(length / (narrow * cell)), 2000)
    if n_z < VOID_CELLS:
        return []
    strips = _strips(shape, cell / narrow)
    row = _row(strips, edge, along)
    place = np.clip((z / length * n_z).astype(np.int64), 0, n_z - 1)
    inside = (z > 0) & (z < length) & (np.abs(side) < np.maximum(4 * sigma_m, strips.wall_m[row]))
    deep = inside & (-side > np.maximum(_DEEP_SIGMAS * sigma_m, _DEEP_WALL * strips.wall_m[row]))
    shown = _counts(row[inside & ~deep], place[inside & ~deep], len(strips.edge), n_z)
    within = _counts(row[deep], place[deep], len(strips.edge), n_z)
    counted = _Counted(shown=shown, within=within, own=_of_member(member, strips, n_z), step_m=length / n_z)
    return _found(shape, strips, counted, 4 * sigma_m)


def _counts(row: IntArray, place: IntArray, n_rows: int, n_z: int) -> IntArray:
    return np.bincount(row * n_z + place, minlength=n_rows * n_z).reshape(n_rows, n_z)


def _strips(shape: Section, cell: float) -> _Strips:
    """Every edge parted into strips of about `cell`."""
    start = np.concatenate(shape.loops)
    way = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    long = edge_lengths(shape)
    n = np.maximum(np.round(long / cell), 1).astype(np.int64)
    edge = np.repeat(np.arange(len(n)), n)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(n) - n, n)
    low, high = number / n[edge] * long[edge], (number + 1) / n[edge] * long[edge]
    unit = way / long[:, None]
    at = start[edge] + (low + high)[:, None] / 2 * unit[edge]
    into = inward(shape)[edge]
    hit, far = first_across(at, into, shape, edge)
    beyond = np.einsum("ij,ij->i", at + far[:, None] * into - start[hit], unit[hit])
    row = _row(_Strips(edge=edge, low=low, high=high, at=at, inward=into, across=edge, wall_m=far), hit, beyond)
    return _Strips(edge=edge, low=low, high=high, at=at, inward=into, across=row, wall_m=far)


def _row(strips: _Strips, edge: IntArray, along: FloatArray) -> IntArray:
    """(n,) the strip of each place."""
    first = np.searchsorted(strips.edge, edge)
    n = np.searchsorted(strips.edge, edge, side="right") - first
    width = strips.high[first] - strips.low[first]
    return np.asarray(first + np.clip((along / width).astype(np.int64), 0, n - 1))


def _of_member(member: Member, strips: _Strips, n_z: int) -> BoolArray:
    """(strips, places) whether a cell lies wholly within the member's end planes."""
    length = member.values()["length"]
    border = np.linspace(0, length, n_z + 1)
    own = np.ones((len(strips.edge), n_z), bool)
    for end, normal in zip((0.0, length), member.end_normals, strict=True):
        for z in (border[:-1], border[1:]):
            own &= (strips.at @ normal[:2])[:, None] + (z - end)[None] * normal[2] < 0.5 * length / n_z
    return own


def _found(shape: Section, strips: _Strips, counted: _Counted, blur_m: float) -> list[Cut]:
    """Regions of neighbouring cells of which neither side was seen: cut, or where both sides were to be expected. blur_m : reach of the noise."""
    across = strips.across
    bare = (counted.shown == 0) & (counted.shown[across] == 0) & counted.own
    seen = ((counted.shown > 0) & counted.own).sum(axis=1) / np.maximum(counted.own.sum(axis=1), 1) >= _SEEN
    seen &= seen[across]
    expected = bare & (seen | _between(shape, strips, seen, blur_m))[:, None]
    names = [name for loop in shape.face_names for name in loop]
    of_face = np.array([names[k] for k in strips.edge])
    found = []
    for name in dict.fromkeys(names):
        rows = np.flatnonzero(of_face == name)
        found += [cut for cut, _ in _cuts(name, rows, bare, strips, counted) if cut.is_cut]
        found += [cut for cut, n in _cuts(name, rows, expected, strips, counted) if not cut.is_cut and n >= VOID_CELLS and cut.missed > VOID_POINTS]
    return found


def _between(shape: Section, strips: _Strips, seen: BoolArray, blur_m: float) -> BoolArray:
    """(strips,) whether a strip lies between two of its edge that were seen, on both sides, clear of the walls and the noise at the corners."""
    long = edge_lengths(shape)
    clear = float(strips.wall_m.min()) + blur_m
    sure = seen & (strips.low >= clear) & (strips.high <= long[strips.edge] - clear)
    between = np.zeros(len(seen), bool)
    for edge in np.unique(strips.edge[sure]):
        rows = np.flatnonzero(sure & (strips.edge == edge))
        between[rows[0] : rows[-1] + 1] = True
    return between


def _cuts(name: str, rows: IntArray, bare: BoolArray, strips: _Strips, counted: _Counted) -> list[tuple[Cut, int]]:
    """The bare regions of a face that chance cannot have left, and of how many cells each is."""
    label, n_regions = ndimage.label(bare[rows])
    other, step = strips.across[rows], counted.step_m
    cells, density = region_margins(label.astype(np.int64), n_regions, counted.shown[rows], counted.shown[other], counted.own[rows], _BESIDE)
    missed, places, found = cells * density, ndimage.find_objects(label), []
    for k in np.flatnonzero(missed > _LEAST_BARE).tolist():
        region, (across, along) = k + 1, places[k]
        window = slice(max(across.start - _BESIDE, 0), across.stop + _BESIDE), slice(max(along.start - _BESIDE, 0), along.stop + _BESIDE)
        of_region = label[window] == region
        beside = _grown(of_region) & ~of_region & counted.own[rows[window[0]], window[1]]
        inside, around = np.zeros((2, *label.shape), bool)
        inside[window], around[window] = of_region, beside
        border = np.zeros(bare.shape, bool)
        border[rows] = inside | around
        np.logical_or.at(border, other, inside | around)
        at, widths = np.flatnonzero(inside.any(axis=0)), (strips.high - strips.low)[rows]
        cut = Cut(
            face=name, from_m=float(at[0] * step), to_m=float((at[-1] + 1) * step), area_m2=float((inside.sum(axis=1) * widths).sum() * step),
            missed=float(missed[k]), deep=int(counted.within[border].sum()), by_chance=_by_chance(border, rows, strips, counted),
        )  # fmt: skip
        found.append((cut, int(cells[k])))
    return found


def _grown(inside: BoolArray) -> BoolArray:
    """The cells of a region and those up to `_BESIDE` steps from side to side away from it."""
    grown = inside
    for _ in range(_BESIDE):
        before, grown = grown, grown.copy()
        grown[1:] |= before[:-1]
        grown[:-1] |= before[1:]
        grown[:, 1:] |= before[:, :-1]
        grown[:, :-1] |= before[:, 1:]
    return grown


def _by_chance(border: BoolArray, rows: IntArray, strips: _Strips, counted: _Counted) -> float:
    """Points inside the wall that a border would have by chance: as many as elsewhere on these two sides or on all, by cell (strays) or by point of
    a side (the tail of the noise), whichever is more.
    """
    asked = np.zeros(len(strips.edge), bool)
    asked[rows], asked[strips.across[rows]] = True, True
    most = 0.0
    for of in (asked, np.ones_like(asked)):
        elsewhere = of[:, None] & ~border & counted.own
        deep = float(counted.within[elsewhere].sum())
        by_cell = deep / max(int(elsewhere.sum()), 1) * int(border.sum())
        by_point = deep / max(float(counted.shown[elsewhere].sum()), 1.0) * float(counted.shown[border].sum())
        most = max(most, by_cell, by_point)
    return most
