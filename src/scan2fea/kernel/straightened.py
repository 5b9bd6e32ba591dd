"""Points in the frame of a section that is swept along a curved, twisted axis: one compiled pass, nothing stored between."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray


@jit_ieee
def straightened(points: FloatArray, T: FloatArray, low: float, high: float, axis: FloatArray, roll: FloatArray) -> FloatArray:
    """(n, 3) across, across and along.

    points : (n, 3) metres.   T : (4, 4) the frame to theirs.   axis : (2, k) metres, roll : (m,) radians: factors of the Legendre polynomials of
    degree 0, 1, ... in zeta, -1 at z = low and 1 at z = high.
    """
    n, most = len(points), max(axis.shape[1], len(roll))
    is_bent, is_turned = bool(np.any(axis != 0.0)), bool(np.any(roll != 0.0))
    found, basis = np.empty((n, 3)), np.ones(max(most, 2))
    for i in range(n):
        dx, dy, dz = points[i, 0] - T[0, 3], points[i, 1] - T[1, 3], points[i, 2] - T[2, 3]
        x = dx * T[0, 0] + dy * T[1, 0] + dz * T[2, 0]
        y = dx * T[0, 1] + dy * T[1, 1] + dz * T[2, 1]
        z = dx * T[0, 2] + dy * T[1, 2] + dz * T[2, 2]
        if is_bent or is_turned:
            basis[1] = (2 * z - low - high) / (high - low)
            for k in range(2, most):
                basis[k] = ((2 * k - 1) * basis[1] * basis[k - 1] - (k - 1) * basis[k - 2]) / k
        if is_bent:
            for k in range(axis.shape[1]):
                x -= axis[0, k] * basis[k]
                y -= axis[1, k] * basis[k]
        if is_turned:
            turn = 0.0
            for k in range(len(roll)):
                turn += roll[k] * basis[k]
            c, s = math.cos(turn), math.sin(turn)
            x, y = c * x + s * y, c * y - s * x
        found[i, 0], found[i, 1], found[i, 2] = x, y, z
    return found
