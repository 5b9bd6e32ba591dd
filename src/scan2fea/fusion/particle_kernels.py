"""The inner loops of the particle filter."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray


@jit
def likeness(
    state: FloatArray, angle: FloatArray, distance: FloatArray, log: FloatArray, low: FloatArray, edge_m: float, least: float
) -> FloatArray:
    """(n,) sum over the rays of the log-likelihood of their ends, seen from each particle (n, 3) x, y, heading."""
    height, width = log.shape
    total = np.zeros(len(state))
    x, y = distance * np.cos(angle), distance * np.sin(angle)
    for i in range(len(state)):
        c, s = math.cos(state[i, 2]) / edge_m, math.sin(state[i, 2]) / edge_m
        px, py = (state[i, 0] - low[0]) / edge_m, (state[i, 1] - low[1]) / edge_m
        sum_i = 0.0
        for k in range(len(x)):
            u, v = px + c * x[k] - s * y[k], py + s * x[k] + c * y[k]
            if 0.0 <= u < width and 0.0 <= v < height:
                sum_i += log[int(v), int(u)]
            else:
                sum_i += least
        total[i] = sum_i
    return total


@jit
def moved_on(state: FloatArray, step: FloatArray, sigma: FloatArray, normal: FloatArray) -> FloatArray:
    """The particles after a step in their own frames (3,), each disturbed by `sigma` (3,) times its `normal` deviates (n, 3)."""
    moved = np.empty_like(state)
    for i in range(len(state)):
        a, b, turn = step[0] + sigma[0] * normal[i, 0], step[1] + sigma[1] * normal[i, 1], step[2] + sigma[2] * normal[i, 2]
        c, s = math.cos(state[i, 2]), math.sin(state[i, 2])
        moved[i, 0], moved[i, 1], moved[i, 2] = state[i, 0] + c * a - s * b, state[i, 1] + s * a + c * b, state[i, 2] + turn
    return moved


@jit
def systematic(weight: FloatArray, offset: float, n: int) -> IntArray:
    """(n,) rows drawn by their weights (which add up to one) with one random offset in [0, 1): row i comes n w_i times, rounded up or down."""
    rows = np.empty(n, np.int64)
    row, reached = 0, weight[0]
    for k in range(n):
        at = (k + offset) / n
        while reached < at and row + 1 < len(weight):
            row += 1
            reached += weight[row]
        rows[k] = row
    return rows


@jit
def bins_of(state: FloatArray, low: FloatArray, edge_m: float, edge_rad: float) -> IntArray:
    """(n,) number of the bin of place and heading that each particle lies in."""
    bins = np.empty(len(state), np.int64)
    for i in range(len(state)):
        turn = state[i, 2] - 2.0 * math.pi * math.floor(state[i, 2] / (2.0 * math.pi))
        x, y = math.floor((state[i, 0] - low[0]) / edge_m), math.floor((state[i, 1] - low[1]) / edge_m)
        bins[i] = ((x + 100_000) * 200_000 + y + 100_000) * 64 + int(turn / edge_rad)
    return bins
