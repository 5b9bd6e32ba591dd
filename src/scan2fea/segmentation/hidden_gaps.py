"""One bar that something in front of it cuts in two: the far side of a shadow belongs to the near side.

Two parts are one bar where

1. the longer one is slender, and the other goes on in line with it: near the gap both show the same section, point by point, within spacing and
   noise;
2. the gap is no longer than the shorter of them, and nothing of the scene stands in it;
3. it is a shadow: every sensor that has seen the ends would have seen the section in the gap through something nearer, and no ray has passed there.

All three are asked. Where sensors are not known the parts stay two: two bars in line and one bar half hidden are then the same points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import noise_sigma, sampled_rows, spacing
from scan2fea.kernel.spanning_tree import tree_parts
from scan2fea.segmentation.extents import principal
from scan2fea.segmentation.sweeps import across
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

_DRAWN = 4_000
_SLENDER = 3.0  # length over width: EN 1992-1-1, 5.3.1, as in `members`
_SAME = 0.9  # of the points of one end that lie on the section of the other
_SPACINGS, _SIGMAS = 2.0, 4.0  # how far a point of the same section may lie from those of the other
_STATIONS = 64  # a sensor that moves while it scans has no shadow of its own
_LEAST_SEEN = 24  # points of the ends that a station tells from
_ASKED = 200
_SLICES = (0.25, 0.5, 0.75)  # of the gap, where its section is asked for: the borders of a shadow are uncertain
_BLOCKED = 0.9
_APART = 2.0  # angular spacings to what is in front
_SEEN_THROUGH = 3  # rays that pass a gap: one or two may be strays


@dataclass(frozen=True, eq=False, kw_only=True)
class _Bar(Value):
    """points : (m, 3) drawn from a part, rows (m,).   axis : (3,) its long one.   length, width : m.   reach_m : how far its section is unsure."""

    points: FloatArray
    rows: IntArray
    axis: FloatArray
    length: float
    width: float
    reach_m: float


def one_bar(points: FloatArray, parts: Sequence[IntArray], sensors: FloatArray, seed: int = 0) -> IntArray:
    """(p,) number from 0 of the bar that each part (rows of the points (n, 3)) belongs to.

    sensors : (n, 3) from where each point was seen, nan where that is not known.
    """
    alone = np.arange(len(parts))
    if len(parts) < 2 or not np.isfinite(sensors).all():
        return alone
    stations, of_station = np.unique(sensors, axis=0, return_inverse=True)
    if len(stations) > _STATIONS:
        return alone
    bars = [_bar(points, rows, seed) for rows in parts]
    edges = []
    for i, one in enumerate(bars):
        for j in range(i + 1, len(bars)):
            other = bars[j]
            if one is None or other is None:
                continue
            long, short = (one, other) if one.length >= other.length else (other, one)
            gap = _gap(long, short)
            if gap is not None and not _holds_points(gap, points) and _is_shadow(gap, points, stations, of_station.ravel()):
                edges.append((i, j))
    return tree_parts(np.array(edges, np.int64), len(parts)) if edges else alone


def _bar(points: FloatArray, rows: IntArray, seed: int) -> _Bar | None:
    """None where its spacing cannot be told."""
    drawn = rows[sampled_rows(len(rows), _DRAWN, seed)]
    own = points[drawn]
    h = spacing(own) if len(own) > 8 else np.nan
    if not h > 0:
        return None
    sigma = noise_sigma(own, seed=seed)
    axes, length, width = principal(own)
    reach = _SPACINGS * h + _SIGMAS * (sigma if np.isfinite(sigma) else 0.0)
    return _Bar(points=own, rows=drawn, axis=axes[:, 0], length=length, width=width, reach_m=reach)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Gap(Value):
    """frame : (3, 3) columns along and across the bar.   low, high : (3,) box of the gap in it.   rows : of the points of both ends."""

    frame: FloatArray
    low: FloatArray
    high: FloatArray
    rows: IntArray
    reach_m: float


def _gap(long: _Bar, short: _Bar) -> _Gap | None:
    """Between the ends of two bars of one section in line; None where they are not."""
    if long.length < _SLENDER * long.width:
        return None
    frame = np.stack([long.axis, *across(long.axis)], axis=1)
    one, other = long.points @ frame, short.points @ frame
    reach = max(long.reach_m, short.reach_m)
    if other[:, 0].mean() < one[:, 0].mean():  # so that the short one lies beyond the long one
        frame = frame * [-1.0, 1.0, 1.0]
        one, other = long.points @ frame, short.points @ frame
    start, end = float(one[:, 0].max()), float(other[:, 0].min())
    if not 0.0 < end - start <= min(np.ptp(other[:, 0]), np.ptp(one[:, 0])):
        return None
    near, far = one[:, 0] >= start - long.width, other[:, 0] <= end + long.width
    flat_near, flat_far = one[near, 1:], other[far, 1:]
    low, high = np.minimum(flat_near.min(axis=0), flat_far.min(axis=0)), np.maximum(flat_near.max(axis=0), flat_far.max(axis=0))
    if not (_lies_on(flat_near, flat_far, reach) and _lies_on(flat_far, flat_near, reach)):
        return None
    box = np.r_[start, low], np.r_[end, high]
    return _Gap(frame=frame, low=box[0], high=box[1], rows=np.concatenate([long.rows[near], short.rows[far]]), reach_m=reach)


def _lies_on(flat: FloatArray, other: FloatArray, reach_m: float) -> bool:
    """Whether the section (m, 2) is part of the other one."""
    flat, other = (np.c_[each, np.zeros(len(each))] for each in (flat, other))
    return bool((k_nearest(other, 1, flat)[0][:, 0] <= reach_m).mean() >= _SAME)


def _holds_points(gap: _Gap, points: FloatArray) -> bool:
    """Whether anything stands in the gap, but for the strays at its borders."""
    at = points @ gap.frame
    inside = (at[:, 0] > gap.low[0]) & (at[:, 0] < gap.high[0]) & ((at > gap.low) & (at < gap.high))[:, 1:].all(axis=1)
    return int(inside.sum()) >= _SEEN_THROUGH


def _is_shadow(gap: _Gap, points: FloatArray, stations: FloatArray, of_station: IntArray) -> bool:
    """Whether all that have seen the ends look at the gap through something in front of it, and nobody has seen through it."""
    told = 0
    for s, station in enumerate(stations):
        mine = np.flatnonzero(of_station == s)
        if _n_through(gap, points[mine], station) >= _SEEN_THROUGH:
            return False
        ends = gap.rows[of_station[gap.rows] == s]
        if len(ends) < _LEAST_SEEN:
            continue
        told += 1
        if _blocked(_filled(gap, points[ends]), points[mine], station, gap.reach_m).mean() < _BLOCKED:
            return False
    return told > 0


def _filled(gap: _Gap, ends: FloatArray) -> FloatArray:
    """Points (k, 3) where the section of the ends (m, 3) would be in the gap."""
    flat = (ends @ gap.frame)[sampled_rows(len(ends), _ASKED, 0)]
    slices = gap.low[0] + np.array(_SLICES) * (gap.high[0] - gap.low[0])
    at = np.concatenate([np.c_[np.full(len(flat), z), flat[:, 1:]] for z in slices])
    asked: FloatArray = at @ gap.frame.T
    return asked


def _blocked(asked: FloatArray, seen: FloatArray, station: FloatArray, reach_m: float) -> BoolArray:
    """(k,) which of the asked places (k, 3) lie behind something that the station has seen (n, 3)."""
    way, depth = _directions(seen, station)
    to, distance = _directions(asked, station)
    own = float(np.median(k_nearest(way, 2, way[sampled_rows(len(way), _DRAWN, 0)])[0][:, 1]))
    angle, near = k_nearest(way, min(8, len(way)), to)
    in_front = (angle <= _APART * own) & (depth[near] < (distance - reach_m)[:, None])
    return np.asarray(in_front.any(axis=1))


def _directions(points: FloatArray, station: FloatArray) -> tuple[FloatArray, FloatArray]:
    away = points - station
    depth = np.maximum(np.linalg.norm(away, axis=1), 1e-12)
    return away / depth[:, None], depth


def _n_through(gap: _Gap, seen: FloatArray, station: FloatArray) -> int:
    """How many rays from a station to what it has seen (n, 3) pass the middle half of the gap's box."""
    quarter = (gap.high - gap.low) / 4
    low, high = np.r_[gap.low[0] + quarter[0], gap.low[1:]], np.r_[gap.high[0] - quarter[0], gap.high[1:]]
    start, way = station @ gap.frame, (seen - station) @ gap.frame
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (low - start) / way, (high - start) / way
    enters, leaves = np.fmax.reduce(np.fmin(one, two), axis=1), np.fmin.reduce(np.fmax(one, two), axis=1)
    return int(((enters < leaves) & (enters > 0) & (leaves < 1)).sum())
