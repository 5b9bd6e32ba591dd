"""Points of the plane that may be corners of their convex hull: those outside a polygon of extreme points (Akl and Toussaint 1978)."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray

_DIRECTIONS = 24


@jit_ieee
def hull_rim(xy: FloatArray) -> FloatArray:
    """(m, 2) those of the points (n, 2), in their order, that do not lie strictly within the polygon of the farthest ones in 24 directions."""
    far, at = np.full(_DIRECTIONS, -np.inf), np.zeros(_DIRECTIONS, np.int64)
    c, s = np.empty(_DIRECTIONS), np.empty(_DIRECTIONS)
    for k in range(_DIRECTIONS):
        c[k], s[k] = math.cos(2 * math.pi * k / _DIRECTIONS), math.sin(2 * math.pi * k / _DIRECTIONS)
    for i in range(len(xy)):
        for k in range(_DIRECTIONS):
            reach = xy[i, 0] * c[k] + xy[i, 1] * s[k]
            if reach > far[k]:
                far[k], at[k] = reach, i
    x, y, nx, ny, n = np.empty(_DIRECTIONS), np.empty(_DIRECTIONS), np.empty(_DIRECTIONS), np.empty(_DIRECTIONS), 0
    for k in range(_DIRECTIONS):  # the farthest ones in turn are a convex polygon; its sides with their normals inwards
        one, other = at[k], at[(k + 1) % _DIRECTIONS]
        dx, dy = xy[other, 0] - xy[one, 0], xy[other, 1] - xy[one, 1]
        if dx != 0.0 or dy != 0.0:
            x[n], y[n], nx[n], ny[n] = xy[one, 0], xy[one, 1], -dy, dx
            n += 1
    kept, m = np.empty(xy.shape), 0
    for i in range(len(xy)):
        is_within = n > 2
        for k in range(n):
            if (xy[i, 0] - x[k]) * nx[k] + (xy[i, 1] - y[k]) * ny[k] <= 0.0:
                is_within = False
                break
        if not is_within:
            kept[m, 0], kept[m, 1] = xy[i, 0], xy[i, 1]
            m += 1
    return kept[:m].copy()
