"""Directions of rays that brought nothing back, from the grid a scanner sweeps: rows are elevations, columns azimuths."""

from __future__ import annotations

import numpy as np

from scan2fea.types import BoolArray, FloatArray, IntArray

_MOST_STEPS = 2.0  # a hit may lie so many steps of the grid beside its place: mirrors and tilt compensation move it by less than one
_SHARE = 0.95
_ONE_WAY = 0.9
_FEWEST_LINES = 3  # rows and columns with returns that a direction between them is told from


def grid_directions(local: FloatArray, is_hit: BoolArray, row: IntArray, column: IntArray) -> FloatArray | None:
    """(n, 3) unit directions of all rays in the frame of the scanner, or None where the hits do not lie on such a grid.

    local : (n, 3) points in the frame of the scanner, which sweeps about z.   row, column : (n,) from 0.
    """
    hit = local[is_hit]
    if len(hit) == 0:
        return None
    unit = hit / np.sqrt((hit**2).sum(axis=1, keepdims=True))
    n_rows, n_columns = int(row.max()) + 1, int(column.max()) + 1
    if max(n_rows, n_columns) > 4 * len(row) + 16:  # numbers that are no grid
        return None
    elevation = _filled(_means(np.arcsin(np.clip(unit[:, 2], -1, 1)), row[is_hit], n_rows))
    east, north = _means(unit[:, 0], column[is_hit], n_columns), _means(unit[:, 1], column[is_hit], n_columns)
    has_azimuth = np.hypot(east, north) > 0
    turned = np.full(n_columns, np.nan)
    turned[has_azimuth] = np.unwrap(np.arctan2(north[has_azimuth], east[has_azimuth]))
    azimuth = _filled(turned)
    if elevation is None or azimuth is None:
        return None
    e, a = elevation[row], azimuth[column]
    direction = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
    if not (_is_swept(elevation) and _is_swept(azimuth)):
        return None
    step = max(_step(elevation), _step(azimuth))
    off = np.sqrt(((direction[is_hit] - unit) ** 2).sum(axis=1))
    return direction if float(np.quantile(off, _SHARE)) <= _MOST_STEPS * step else None


def _means(values: FloatArray, line: IntArray, n: int) -> FloatArray:
    """Mean of the values of each line, nan where a line has none."""
    count = np.bincount(line, minlength=n)
    mean: FloatArray = np.divide(np.bincount(line, values, n), count, out=np.full(n, np.nan), where=count > 0)
    return mean


def _filled(angles: FloatArray) -> FloatArray | None:
    """Lines without a hit get the angle between their neighbours, or that of the straight line through all at the ends."""
    known = np.flatnonzero(np.isfinite(angles))
    if len(known) < _FEWEST_LINES:
        return None
    every = np.arange(len(angles))
    slope, _ = np.polyfit(known, angles[known], 1)
    filled: FloatArray = np.interp(every, known, angles[known])
    filled[: known[0]] = angles[known[0]] + slope * (every[: known[0]] - known[0])
    filled[known[-1] + 1 :] = angles[known[-1]] + slope * (every[known[-1] + 1 :] - known[-1])
    return filled


def _is_swept(angles: FloatArray) -> bool:
    """A scanner turns one way: the steps add up, where those of unordered points cancel."""
    steps = np.diff(angles)
    return bool(np.abs(steps.sum()) >= _ONE_WAY * np.abs(steps).sum()) and bool((steps != 0).any())


def _step(angles: FloatArray) -> float:
    return float(np.median(np.abs(np.diff(angles)))) if len(angles) > 1 else 0.0
