"""The range image of one station: rows are rings (or even steps of elevation), columns even steps of azimuth, values ranges (thesis 2.3.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.types import FloatArray, IntArray, Value

_MOST_RINGS = 256  # of one unit; more distinct elevations are a grid
_TIGHT = 0.2  # of the step between rings: elevations of one ring spread less
_MOST_CELLS = 40_000_000
_MAD = 1.4826


@dataclass(frozen=True, eq=False, kw_only=True)
class RangeImage(Value):
    """What one station saw.

    range_m : (rows, columns), nan where nothing came back. row_of_point : (rows, columns) int64, the point in each cell (the nearest where
    several fall into one), -1 none. elevation : (rows,) rising, azimuth : (columns,) rising, radians, about z of the station's frame; columns go
    all the way round where `is_closed`. measured_azimuth : (rows, columns) of the point in each cell, nan none. cell : (n,) flat cell of every
    point. station : (3,).
    """

    range_m: FloatArray
    row_of_point: IntArray
    elevation: FloatArray
    azimuth: FloatArray
    measured_azimuth: FloatArray
    cell: IntArray
    station: FloatArray
    is_closed: bool

    def azimuths(self, row: int, columns: IntArray) -> FloatArray:
        """(k,) azimuth of what was measured in cells of a row; the middle of the column where nothing was."""
        return np.asarray(np.where(np.isfinite(self.measured_azimuth[row, columns]), self.measured_azimuth[row, columns], self.azimuth[columns]))

    @property
    def step_rad(self) -> float:
        """From column to column."""
        return float(self.azimuth[1] - self.azimuth[0])

    def directions(self, row: IntArray, column: IntArray) -> FloatArray:
        """(k, 3) unit directions of cells."""
        e, a = self.elevation[row], self.azimuth[column]
        return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)


def range_image(points: FloatArray, station: FloatArray, ring: IntArray | None = None) -> RangeImage:
    """Sort points (n, 3), in the frame of a station whose axis is z, into rows and columns.

    ring : (n,) number of the beam of each point where it is known; else rings are told from the elevations where these come in few values, and
    elevation is cut into the steps of the azimuth where they do not. Raises InternalError without points off the axis.
    """
    ray = points - station
    flat = np.hypot(ray[:, 0], ray[:, 1])
    distance = np.hypot(flat, ray[:, 2])
    require(len(points) > 1 and bool((flat > 0).any()), InternalError, "a range image needs points off the axis of its station")
    e, a = np.arctan2(ray[:, 2], flat), np.arctan2(ray[:, 1], ray[:, 0])
    row, elevation = _rows_of_rings(e, ring) if ring is not None else _rows(e, a)
    azimuth, column, is_closed = _columns(a, row)
    cell = row * len(azimuth) + column
    image = np.full(len(elevation) * len(azimuth), np.inf)
    np.minimum.at(image, cell, distance)
    owner = np.full(len(image), -1, np.int64)
    nearest = np.flatnonzero(distance == image[cell])[::-1]
    owner[cell[nearest]] = nearest
    image[np.isinf(image)] = np.nan
    shape = (len(elevation), len(azimuth))
    return RangeImage(
        range_m=image.reshape(shape),
        row_of_point=owner.reshape(shape),
        elevation=elevation,
        azimuth=azimuth,
        measured_azimuth=np.where(owner >= 0, a[owner], np.nan).reshape(shape),
        cell=cell,
        station=np.asarray(station, float),
        is_closed=is_closed,
    )


def range_noise(image: RangeImage) -> float:
    """Standard deviation of a range, m, from second differences along the rows (sqrt(6) sigma each), by their median; 0 where there are none."""
    r = image.range_m
    second = np.abs(r[:, 2:] - 2.0 * r[:, 1:-1] + r[:, :-2])
    known = second[np.isfinite(second)]
    return float(_MAD * np.median(known) / math.sqrt(6.0)) if len(known) else 0.0


def _rows_of_rings(elevation: FloatArray, ring: IntArray) -> tuple[IntArray, FloatArray]:
    """Row of each point, by the mean elevation of its ring."""
    used, packed = np.unique(ring, return_inverse=True)
    mean = np.bincount(packed, elevation) / np.bincount(packed)
    order = np.argsort(mean, kind="stable")
    rank = np.empty(len(used), np.int64)
    rank[order] = np.arange(len(used))
    return rank[packed], mean[order]


def _rows(elevation: FloatArray, azimuth: FloatArray) -> tuple[IntArray, FloatArray]:
    """Rings where the elevations come in few tight groups, else even steps."""
    ordered = np.sort(elevation)
    gap = np.diff(ordered)
    limit = _between(gap)
    cuts = np.flatnonzero(gap > limit) + 1
    groups = np.split(ordered, cuts)
    spread = np.array([group[-1] - group[0] for group in groups])
    if 1 < len(groups) <= _MOST_RINGS and float(np.median(spread)) <= _TIGHT * float(np.median(np.diff([g.mean() for g in groups]))):
        ring = np.searchsorted(ordered[cuts], elevation, side="right")
        return _rows_of_rings(elevation, ring)
    step = _step(elevation, azimuth)
    low = float(elevation.min())
    n = int((float(elevation.max()) - low) / step) + 1
    row: IntArray = np.minimum(((elevation - low) / step).astype(np.int64), n - 1)
    middle = np.asarray(low + step * (np.arange(n) + 0.5), np.float64)
    return row, middle


def _between(gap: FloatArray) -> float:
    """A gap that parts rings: the geometric middle of the widest jump in the ordered gaps."""
    positive = np.sort(gap[gap > 0])[-_MOST_RINGS:]
    if len(positive) < 2:
        return math.inf
    k = int(np.argmax(positive[1:] / positive[:-1]))
    return float(np.sqrt(positive[k] * positive[k + 1]))


def _step(elevation: FloatArray, azimuth: FloatArray) -> float:
    """Even step of a grid that the directions fill about once: sqrt(area on the sphere / points), from the cells of a coarse grid that hold some."""
    coarse = math.radians(2.0)
    key = np.floor(elevation / coarse).astype(np.int64) * 1000 + np.floor(azimuth / coarse).astype(np.int64)
    used, count = np.unique(key, return_counts=True)
    centre = (np.floor_divide(used + 500, 1000) + 0.5) * coarse
    per_area = count / (coarse**2 * np.maximum(np.cos(centre), 1e-3))
    return float(max(1.0 / math.sqrt(float(np.median(per_area))), 1e-5))


def _columns(azimuth: FloatArray, row: IntArray) -> tuple[FloatArray, IntArray, bool]:
    """Middles of the columns, the column of each point, and whether they close: the step is what lies between neighbours within a row."""
    order = np.lexsort((azimuth, row))
    gap = np.diff(azimuth[order])
    same = (np.diff(row[order]) == 0) & (gap > 0)
    step = float(np.median(gap[same])) if same.any() else math.radians(1.0)
    step = max(step, 2 * math.pi * (int(row.max()) + 1) / _MOST_CELLS)
    whole = np.sort(azimuth)
    around = np.concatenate([np.diff(whole), [whole[0] + 2 * math.pi - whole[-1]]])
    k = int(np.argmax(around))
    is_closed = bool(around[k] < math.radians(5.0))
    if is_closed:
        n = max(round(2 * math.pi / step), 8)
        step = 2 * math.pi / n
        phase = float(np.angle(np.exp(1j * n * azimuth).sum())) / n  # firings lie in the middles of their columns, not on the borders
        middle = np.asarray(phase + step * np.arange(n), np.float64)
        column = np.rint((azimuth - phase) / step).astype(np.int64) % n
        return middle, column, True
    start = whole[(k + 1) % len(whole)]  # the widest gap is where the image begins
    column = np.rint(np.mod(azimuth - start, 2 * math.pi) / step).astype(np.int64)
    n = max(int(column.max()) + 1, 2)
    return np.asarray(start + step * np.arange(n), np.float64), column, False
