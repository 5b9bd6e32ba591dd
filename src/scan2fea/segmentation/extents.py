"""The box of a piece of a member: its frame, its length, the larger side of its section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.segmentation.sweeps import across, refined_axis
from scan2fea.types import BoolArray, FloatArray, Value

_TAIL = 0.01  # of the points may lie outside a member's box at each side
PARALLEL = 0.97  # cosine of 14 degrees


@dataclass(frozen=True, eq=False, kw_only=True)
class Extent(Value):
    """The box of a group. frame : (3, 3) rows, two across and the axis.   middle : (3,).   low, high : (3,) in the frame about the middle."""

    frame: FloatArray
    middle: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def axis(self) -> FloatArray:
        return np.asarray(self.frame[2])

    @property
    def length(self) -> float:
        return float(self.high[2] - self.low[2])

    @property
    def width(self) -> float:
        """The larger side of the section."""
        return float(max((self.high - self.low)[:2].max(), 1e-12))

    @property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Where the axis begins and ends."""
        return self.middle + self.low[2] * self.axis, self.middle + self.high[2] * self.axis

    def ends_with(self, other: Extent) -> bool:
        """Whether both run side by side from end to end: neither goes on beyond the other by more than the larger section."""
        if abs(float(self.axis @ other.axis)) < PARALLEL:
            return False
        own, its = (np.sort([float(end @ self.axis) for end in extent.ends]) for extent in (self, other))
        return bool((np.abs(own - its) <= max(self.width, other.width)).all())

    def holds(self, points: FloatArray, margin: float, *, to_ends: bool = False) -> BoolArray:
        """(n,) which points are in the box, widened by the margin; to_ends : along the axis also by the tails that the box leaves out."""
        local = (points - self.middle) @ self.frame.T
        wider = np.full(3, margin)
        wider[2] += _TAIL / (1 - 2 * _TAIL) * self.length if to_ends else 0.0
        return np.asarray(((local >= self.low - wider) & (local <= self.high + wider)).all(axis=1))


def principal(points: FloatArray) -> tuple[FloatArray, float, float]:
    """Principal axes of points (m, 3), the longest first in columns, and the length and width of their box along them, m."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1][:, ::-1]
    low, high = np.quantile(centred @ axes, [_TAIL, 1.0 - _TAIL], axis=0)
    return np.asarray(axes), float(high[0] - low[0]), float((high - low)[1:].max())


def extent_of(points: FloatArray, normals: FloatArray) -> Extent:
    middle = points.mean(axis=0)
    centred = points - middle
    axis = refined_axis(points, normals, np.linalg.eigh(centred.T @ centred)[1][:, 2])
    u, v = across(axis)
    flat = np.stack([centred @ u, centred @ v], 1)
    turn = np.linalg.eigh(flat.T @ flat)[1]
    frame = np.stack([turn[0, 0] * u + turn[1, 0] * v, turn[0, 1] * u + turn[1, 1] * v, axis])
    low, high = np.quantile(centred @ frame.T, [_TAIL, 1.0 - _TAIL], axis=0)
    return Extent(frame=frame, middle=middle, low=low, high=high)


def extent_on_faces(points: FloatArray, normals: FloatArray, axis: FloatArray) -> Extent:
    """The box of points (m, 3) along the axis (3,) with sides as most normals (m, 3) are: of a tube seen at one corner it holds the others too."""
    middle = points.mean(axis=0)
    u, v = across(axis)
    angle = 0.25 * np.angle(((normals @ u + 1j * (normals @ v)) ** 4).sum())  # four ways are one: the sides are square to each other
    frame = np.stack([np.cos(angle) * u + np.sin(angle) * v, np.cos(angle) * v - np.sin(angle) * u, axis])
    low, high = np.quantile((points - middle) @ frame.T, [_TAIL, 1.0 - _TAIL], axis=0)
    return Extent(frame=frame, middle=middle, low=low, high=high)
