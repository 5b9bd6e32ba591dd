"""Polylines: points at even steps along them."""

from __future__ import annotations

import numpy as np

from scan2fea.types import FloatArray


def length_of(line: FloatArray) -> float:
    """Of a polyline (n, d)."""
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def evenly(line: FloatArray, n: int) -> FloatArray:
    """(n, d) points at equal steps along a polyline (k, d), both its ends among them."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    at = np.linspace(0.0, along[-1], n)
    return np.column_stack([np.interp(at, along, column) for column in line.T])
