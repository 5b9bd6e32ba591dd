"""Scores of a log density across a member by what bends and turns its axis, summed over all points in one compiled pass."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray


@jit_ieee
def axis_scores(u: FloatArray, slope: FloatArray, basis: FloatArray, twist: FloatArray, degree: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(q,) sum of the scores by bow x, bow y (degree 1 .. `degree` each) and twist, (q, q) sum of their products, (q,) of the squares of what the
    points move by.

    u, slope : (n, 2) points across, straightened, and the slope of the log density there.   basis : (n, k) Legendre polynomials from degree 1 on.
    twist : (m + 1,) radians, from degree 0 on.
    """
    m = len(twist) - 1
    q = 2 * degree + m
    total, products, moved, row = np.zeros(q), np.zeros((q, q)), np.zeros(q), np.zeros(q)
    for i in range(len(u)):
        angle = 0.0
        for k in range(m):
            angle += basis[i, k] * twist[k + 1]
        c, s = math.cos(angle), math.sin(angle)
        # moving the axis by +1 moves the straightened point by -1, turned with the twist
        by_x, by_y = -(c * slope[i, 0] - s * slope[i, 1]), -(s * slope[i, 0] + c * slope[i, 1])
        turn = slope[i, 0] * u[i, 1] - slope[i, 1] * u[i, 0]
        reach = u[i, 0] * u[i, 0] + u[i, 1] * u[i, 1]
        for k in range(degree):
            row[k], row[degree + k] = by_x * basis[i, k], by_y * basis[i, k]
            moved[k] += basis[i, k] * basis[i, k]
        for k in range(m):
            row[2 * degree + k] = turn * basis[i, k]
            moved[2 * degree + k] += basis[i, k] * basis[i, k] * reach
        for a in range(q):
            total[a] += row[a]
            for b in range(a + 1):
                products[a, b] += row[a] * row[b]
    for a in range(q):
        for b in range(a):
            products[b, a] = products[a, b]
    for k in range(degree):
        moved[degree + k] = moved[k]
    return total, products, moved
