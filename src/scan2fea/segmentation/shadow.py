"""One section whose parts a scanner saw apart: the flange on the far side of a girder, its joint with the web in the shadow of another flange.

Two parts are one member where

1. both are prismatic and parallel, and begin and end together;
2. one is a plane sheet, and a face of the other stands square to it and points at its middle half, as a web at its flange: the legs of two angles
   that lie side by side point at an edge, two plates at nothing;
3. the gap is no wider than the part of the web that is seen, and no ray has passed through it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.spanning_tree import tree_parts
from scan2fea.segmentation.extents import principal
from scan2fea.segmentation.planes import Plane, large_planes
from scan2fea.types import FloatArray, IntArray, Value

_DRAWN = 4_000
_SLENDER = 3.0  # length over width: EN 1992-1-1, 5.3.1, as in `members`
_PARALLEL = 0.9962  # cosine of 5 degrees
_TOGETHER = 0.8  # of the longer length
_SHEET = 0.9  # of the points of a sheet lie on its plane
_SHEET_DEPTH = 0.25  # and its thickness is this share of its width at the utmost: its plane's band follows the noise of a bent one too
_WEB = 0.1  # share of the points that a face has at least
_SQUARE = 0.2
_MIDDLE = 0.5
_TAIL = 0.01
_SEEN_THROUGH = 3  # rays that pass a gap: one or two may be strays


@dataclass(frozen=True, eq=False, kw_only=True)
class _Part(Value):
    """Points (m, 3) drawn from a part, its long axis, and its ends along that (from the origin)."""

    points: FloatArray
    axis: FloatArray
    ends: FloatArray
    width: float


def one_section(points: FloatArray, parts: Sequence[IntArray], sensors: FloatArray, seed: int = 0) -> IntArray:
    """(p,) number from 0 of the object that each part (rows of the points (n, 3)) belongs to.

    sensors : (n, 3) from where each point was seen, nan where that is not known; then only 1 and 2 and the width of the gap decide.
    """
    found = [(k, _part(points[rows[sampled_rows(len(rows), _DRAWN, seed)]])) for k, rows in enumerate(parts) if len(rows) >= 3]
    prismatic = [(k, part) for k, part in found if part is not None]
    edges = []
    for i, (p, one) in enumerate(prismatic):
        for q, other in prismatic[i + 1 :]:
            if _run_together(one, other) and (_is_flange(one, other, points, sensors, seed) or _is_flange(other, one, points, sensors, seed)):
                edges.append((p, q))
    return tree_parts(np.array(edges, np.int64).reshape(-1, 2), len(parts)) if edges else np.arange(len(parts))


def _part(points: FloatArray) -> _Part | None:
    """None where it is not slender."""
    axes, length, width = principal(points)
    if not 0 < _SLENDER * width <= length:
        return None
    ends = np.quantile(points @ axes[:, 0], [_TAIL, 1.0 - _TAIL])
    return _Part(points=points, axis=axes[:, 0], ends=ends, width=width)


def _run_together(one: _Part, other: _Part) -> bool:
    if abs(float(one.axis @ other.axis)) < _PARALLEL:
        return False
    low, high = np.quantile(other.points @ one.axis, [_TAIL, 1.0 - _TAIL])
    both = min(one.ends[1], high) - max(one.ends[0], low)
    return bool(both >= _TOGETHER * max(one.ends[1] - one.ends[0], high - low))


def _is_flange(sheet: _Part, rest: _Part, points: FloatArray, sensors: FloatArray, seed: int) -> bool:
    """Whether the sheet is the far flange of a web of the rest."""
    planes = large_planes(sheet.points, 1, _SHEET, seed)
    if not planes:
        return False
    flange = planes[0] if planes[0].height(rest.points).mean() > 0 else planes[0].flipped()
    if np.ptp(np.quantile(flange.height(sheet.points), [_TAIL, 1.0 - _TAIL])) > _SHEET_DEPTH * sheet.width:
        return False
    for web in large_planes(rest.points, 4, _WEB, seed):
        if max(abs(float(web.normal @ flange.normal)), abs(float(web.normal @ sheet.axis))) > _SQUARE:
            continue
        gap = _gap(sheet, rest, flange, web)
        if gap is not None and not _is_seen_through(gap, points, sensors):
            return True
    return False


@dataclass(frozen=True, eq=False, kw_only=True)
class _Gap(Value):
    """What no one saw of a web: its plane, and in that the ranges along `along` and `up`, (2,) each (from the origin)."""

    web: Plane
    along: FloatArray
    up: FloatArray
    along_range: FloatArray
    up_range: FloatArray


def _gap(sheet: _Part, rest: _Part, flange: Plane, web: Plane) -> _Gap | None:
    """Between the edge of the web and the flange; None where the web does not point at the flange's middle or is too far."""
    across = web.height(sheet.points)
    low, high = np.quantile(across, [_TAIL, 1.0 - _TAIL])
    if abs(low + high) > _MIDDLE * (high - low):
        return None
    on = rest.points[np.abs(web.height(rest.points)) <= max(web.band_m, 1e-12)]
    if not len(on):
        return None
    near, far = np.quantile(flange.height(on), [_TAIL, 1.0 - _TAIL])
    if not -flange.band_m <= near <= far - near:
        return None
    up = flange.normal - (flange.normal @ web.normal) * web.normal
    up = up / np.linalg.norm(up)
    along = np.cross(up, web.normal)
    reach = np.quantile(on @ along, [_TAIL, 1.0 - _TAIL])
    edge = float(np.quantile(on @ up, _TAIL))
    return _Gap(web=web, along=along, up=up, along_range=reach, up_range=np.array([edge - max(near, 0.0), edge]))


def _is_seen_through(gap: _Gap, points: FloatArray, sensors: FloatArray) -> bool:
    """Whether rays have passed through the middle half of the gap, over the middle of its length: its borders are uncertain by the noise."""
    a, b = gap.web.height(sensors), gap.web.height(points)
    crossing = np.flatnonzero((a * b < 0) & np.isfinite(a) & (np.abs(b) > 2.0 * gap.web.band_m))
    if not len(crossing):
        return False
    t = a[crossing] / (a[crossing] - b[crossing])
    at = sensors[crossing] + t[:, None] * (points[crossing] - sensors[crossing])
    inside = np.ones(len(at), bool)
    for axis, (low, high) in ((gap.along, gap.along_range), (gap.up, gap.up_range)):
        inside &= np.abs(at @ axis - (low + high) / 2) <= (high - low) / 4
    return int(inside.sum()) >= _SEEN_THROUGH
