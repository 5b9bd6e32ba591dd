"""A face that was not seen, told by the end faces of the member: their points reach up to it and no farther.

Behind a hidden face, off its corners, an end face holds points evenly from the opposite face on; where they stop is the place of the hidden one,
known as any edge is (`ends.run_end`). Both halves of that strip must stop there alike, the strip must be as full as an end face that was scanned,
and empty beyond and just beside the end: where ends are hardly known, strays fill a strip up to wherever one stops to look.
A plane that nothing of the member reaches beyond might be a cut: such a face is told only where it lies askew to the file's axes,
and where both halves stop so sharply that few cuts along the member would look the same (3 % of all angles).
What stays open: something flat along the wall that hides a part of its end face.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.ends import RunEnd, run_end
from scan2fea.estimation.straight import Face, straight_faces
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.types import BoolArray, FloatArray, IntArray, Member, Value

_DEEP = 4.0  # sigma on either side of a plane: one point in 30,000 lies beyond
_ROOT = 0.15  # of a strip, at either of its sides: roots and toes are round
_WINDOW = 4.0  # of the way to the opposite face: how far beyond it a hidden face is looked for
_LEAST, _HALF_POINTS = 20, 8  # points of a strip, and of its halves; what is bare beyond it would hold as many
_CAP, _EMPTY = 1 / 3, 0.1  # density of an end face that was scanned against the sides', and of what lies beyond or beside against the strip's
_STRAYS = 2  # points beside an end that are no evidence
_BARE = 2.0  # over rho: what lies bare beyond the last point is exponential, and goes beyond four times that once in 1,000
_AGREE = 3.0  # standard deviations
CHANCE = 0.03  # of all angles of a cut, at which what bounds a hidden face would end as square as it does
GAP = 8.0  # a gap among n points is wider than (log n + 8) / rho by chance in 3e-4
SQUARE = math.sin(math.radians(1.0))  # to an axis of the file


def told_by_caps(points: FloatArray, member: Member, seen: Collection[str], spacing_m: float = 0.0) -> Mapping[str, tuple[float, float]]:
    """Hidden face -> how far outward of where the member has it the end faces stop, and the standard deviation of that (m).

    points : (n, 3) metres.   seen : names of the faces that were.   spacing_m : of points that keep a distance from each other, else 0.
    """
    local = sweep_of_member(member).coordinates(points)
    caps, density = _caps(local, member)
    told = {}
    every = [face for loop in straight_faces(member) for face in loop]
    for face in every:
        if face.name in seen:
            continue
        beyond = any(one.name in seen and one.axis != face.axis and _reaches(one, face) > _DEEP * member.sigma_m for one in every)
        normal = np.asarray(member.T_world_member)[:3, face.axis]
        if not beyond and np.abs(normal).max() > math.sqrt(1 - SQUARE**2):
            continue
        strip = _strip(caps, member, face, every)
        end = None if strip is None else _stop(strip, member.sigma_m, density, may_be_cut=not beyond)
        if end is not None:
            told[face.name] = end.edge_m, math.hypot(max(end.std_m, _BARE / end.rho), spacing_m / math.sqrt(3))
    return told


def _reaches(one: Face, face: Face) -> float:
    """How far a face across another one reaches beyond its plane, outward."""
    return max(face.outward * (end - face.place) for end in (one.low, one.high))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Caps(Value):
    """Points of the end faces that were scanned: xy (n, 2), end (n,) which of them, and how many ends there are.

    beside : (m, 2) those of half as much of the member, just beside them.
    """

    xy: FloatArray
    end: IntArray
    n_ends: int
    beside: FloatArray


def _caps(local: FloatArray, member: Member) -> tuple[_Caps, float]:
    """The points (n, 3) near the end planes, and how dense the sides are, per m2 of those that were seen."""
    length, sigma = member.values()["length"], member.sigma_m
    end_std = next(p.std_m or 0.0 for p in member.parameters if p.name == "length")
    reach = max(_DEEP * max(sigma, end_std), 1e-6 * length)
    away = np.stack([(local - np.array([0.0, 0.0, z])) @ normal for z, normal in zip((0.0, length), member.end_normals, strict=True)])
    near, end = np.abs(away).min(axis=0) < reach, np.argmin(np.abs(away), axis=0)
    around = sum((face.high - face.low) * member.seen.get(face.name, 0.0) for loop in straight_faces(member) for face in loop)
    inward = -away.max(axis=0)
    density = float((inward > reach).sum()) / max(around * (length - 2 * reach), 1e-300)
    beside = local[(inward > reach) & (inward < 2 * reach), :2]
    return _Caps(xy=local[near, :2], end=end[near], n_ends=len(np.unique(end[near])), beside=beside), density


@dataclass(frozen=True, eq=False, kw_only=True)
class _Strip(Value):
    """Points of the end faces behind a hidden face: out (n,) m outward of where the member has it, from `start` to `stop`.

    end, half : (n,) of which end and half of the strip.   width : m, of all ends (`n_ends`) together.   beside : (m,) as `out`, just beside the ends.
    """

    out: FloatArray
    beside: FloatArray
    end: IntArray
    half: BoolArray
    start: float
    stop: float
    width: float
    n_ends: int


def _strip(caps: _Caps, member: Member, face: Face, every: list[Face]) -> _Strip | None:
    """What lies behind a face, off the corners and the opposite face; None where that leaves nothing."""
    sigma = member.sigma_m
    behind = [one for one in every if one.axis == face.axis and one.outward == -face.outward and _overlap(one, face) > 0 and _depth(one, face) > 0]
    if not behind:
        return None
    wall = min(_depth(one, face) for one in behind)
    low = max(face.low, min(one.low for one in behind if _depth(one, face) == wall))
    high = min(face.high, max(one.high for one in behind if _depth(one, face) == wall))
    root = max(_ROOT * (high - low), _DEEP * sigma)
    start = _DEEP * sigma - wall
    if high - low <= 2 * root or start >= -_DEEP * sigma:
        return None
    stop = start + _WINDOW * wall

    def within(xy: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        along, out = xy[:, 1 - face.axis], face.outward * (xy[:, face.axis] - face.place)
        return along, out, (along > low + root) & (along < high - root) & (out > start) & (out < stop)

    along, out, own = within(caps.xy)
    _, beside, near = within(caps.beside)
    half, width = along[own] > 0.5 * (low + high), caps.n_ends * (high - low - 2 * root)
    return _Strip(
        out=out[own], beside=beside[near], end=caps.end[own], half=half, start=start, stop=stop, width=width, n_ends=caps.n_ends
    )  # fmt: skip


def _depth(one: Face, face: Face) -> float:
    return face.outward * (face.place - one.place)


def _overlap(one: Face, face: Face) -> float:
    return min(one.high, face.high) - max(one.low, face.low)


def _stop(strip: _Strip, sigma_m: float, density: float, *, may_be_cut: bool) -> RunEnd | None:
    """Where the points of a strip stop, at both its halves, and at both ends, alike; None where they do not."""
    out = strip.out
    if len(out) < _LEAST:
        return None
    stop = run_end(out, sigma_m, strip.start)
    inside, room = np.sort(out[out <= stop.edge_m]), strip.stop - stop.edge_m - _DEEP * sigma_m
    past = float((out > stop.edge_m + _DEEP * sigma_m).sum())
    if len(inside) < _LEAST or stop.rho < _CAP * density * strip.width or past > _EMPTY * stop.rho * room:
        return None
    strays = 2 * int((strip.beside <= stop.edge_m).sum())
    if stop.rho * room < _LEAST or strays > max(2 * _STRAYS, _EMPTY * len(inside)):
        return None
    if float(np.diff(inside).max()) > (math.log(len(inside)) + GAP) / stop.rho:
        return None
    halves, ends = ([out[of == k] for k in (0, 1)] for of in (strip.half, strip.end))
    enough = [(own <= stop.edge_m).sum() >= _HALF_POINTS for own in halves]
    parts = [run_end(own, sigma_m, strip.start) for own in (*halves, *ends) if (own <= stop.edge_m).sum() >= _HALF_POINTS]
    alike = all(abs(one.edge_m - stop.edge_m) < _AGREE * math.hypot(one.std_m, stop.std_m) + 1 / one.rho for one in parts)
    if not all(enough) or not alike:
        return None
    return None if may_be_cut and not _is_square(parts[0], parts[1], 0.5 * strip.width / strip.n_ends) else stop


def _is_square(one: RunEnd, two: RunEnd, apart_m: float) -> bool:
    """Whether both halves of a strip, apart_m from each other, stop as far out, and so sharply that a cut at another angle would show.

    The end of a narrow wall has too few points for that: cut aslant, it looks as it does.
    """
    doubt = _AGREE * math.hypot(max(one.std_m, 1 / one.rho), max(two.std_m, 1 / two.rho))
    return abs(one.edge_m - two.edge_m) <= doubt and 2 * doubt / (math.pi * apart_m) <= CHANCE
