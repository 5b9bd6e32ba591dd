"""Directions of rays that brought nothing back, from the grid a scanner sweeps: rows are elevations, columns azimuths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.types import BoolArray, FloatArray, IntArray, Value

_MOST_STEPS = 2.0  # a hit may lie so many steps of the grid beside its place: mirrors and tilt compensation move it by less than one
_SHARE = 0.95
_ONE_WAY = 0.9
_SAMPLE = 100_000  # hits of a piece that the grid is judged by
_FEWEST_LINES = 3  # rows and columns with returns that a direction between them is told from


def grid_directions(local: FloatArray, is_hit: BoolArray, row: IntArray, column: IntArray) -> FloatArray | None:
    """(n, 3) unit directions of all rays in the frame of the scanner, or None where the hits do not lie on such a grid.

    local : (n, 3) points in the frame of the scanner, which sweeps about z.   row, column : (n,) from 0.
    """
    sweep = GridSweep(len(row))
    sweep.add(local, is_hit, row, column)
    angles = sweep.angles()
    return None if angles is None else angles.directions(row, column)


@dataclass(frozen=True, eq=False, kw_only=True)
class GridAngles(Value):
    """elevation : (rows,).   azimuth : (columns,). Radians, in the frame of the scanner."""

    elevation: FloatArray
    azimuth: FloatArray

    def directions(self, row: IntArray, column: IntArray) -> FloatArray:
        """(n, 3) unit directions of rays of the grid."""
        e, a = self.elevation[row], self.azimuth[column]
        return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)


class GridSweep:
    """Learns the angles of a grid from its hits, piece by piece. n : rays of the whole grid."""

    def __init__(self, n: int) -> None:
        self._most_lines = 4 * n + 16  # beyond it row and column are numbers that are no grid
        self._is_grid = True
        self._sums = [np.zeros((0, width)) for width in (2, 3)]  # per row: elevation, hits; per column: east, north, hits
        self._sample: list[tuple[FloatArray, IntArray, IntArray]] = []

    def add(self, local: FloatArray, is_hit: BoolArray, row: IntArray, column: IntArray) -> None:
        """Rays of the grid; local (n, 3) in the frame of the scanner."""
        lines = (row, column)
        self._is_grid &= len(row) == 0 or all(int(k.min()) >= 0 and int(k.max()) < self._most_lines for k in lines)
        if not self._is_grid or len(row) == 0:
            return
        hit = local[is_hit]
        unit = hit / np.sqrt((hit**2).sum(axis=1, keepdims=True))
        values = ([np.arcsin(np.clip(unit[:, 2], -1, 1))], [unit[:, 0], unit[:, 1]])
        for k, (line, columns) in enumerate(zip(lines, values, strict=True)):
            n = max(int(line.max()) + 1, len(self._sums[k]))
            grown = np.zeros((n, self._sums[k].shape[1]))
            grown[: len(self._sums[k])] = self._sums[k]
            for j, weights in enumerate([*columns, None]):
                grown[:, j] += np.bincount(line[is_hit], weights, n)
            self._sums[k] = grown
        step = 1 + len(unit) // _SAMPLE
        self._sample.append((unit[::step], row[is_hit][::step], column[is_hit][::step]))

    def angles(self) -> GridAngles | None:
        """What was learnt, or None where the hits do not lie on a grid that a scanner sweeps."""
        if not self._is_grid or not sum(len(unit) for unit, _, _ in self._sample):
            return None
        elevation = _filled(_mean(self._sums[0], 0))
        east, north = _mean(self._sums[1], 0), _mean(self._sums[1], 1)
        has_azimuth = np.hypot(east, north) > 0
        turned = np.full(len(east), np.nan)
        turned[has_azimuth] = np.unwrap(np.arctan2(north[has_azimuth], east[has_azimuth]))
        azimuth = _filled(turned)
        if elevation is None or azimuth is None or not (_is_swept(elevation) and _is_swept(azimuth)):
            return None
        found = GridAngles(elevation=elevation, azimuth=azimuth)
        unit, row, column = (np.concatenate(parts) for parts in zip(*self._sample, strict=True))
        off = np.sqrt(((found.directions(row, column) - unit) ** 2).sum(axis=1))
        return found if float(np.quantile(off, _SHARE)) <= _MOST_STEPS * max(_step(elevation), _step(azimuth)) else None


def _mean(sums: FloatArray, k: int) -> FloatArray:
    """Mean of column k over the hits (the last column) of each line, nan where a line has none."""
    mean: FloatArray = np.divide(sums[:, k], sums[:, -1], out=np.full(len(sums), np.nan), where=sums[:, -1] > 0)
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
