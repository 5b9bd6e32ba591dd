"""The likelihood of the place of an edge in counts of cells across it: a step and a hump of any shape, even strays profiled out."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray

_LEAST = 1e-12  # of the points, in a cell
_FIRST_SHARE = 0.05  # of strays


@jit_ieee
def counted_levels(step: FloatArray, hump: FloatArray, height: float, counts: FloatArray, n_rounds: int) -> FloatArray:
    """(p,) log likelihood of the counts (m,) for every place of the end, at the likeliest share of strays (EM, so many rounds).

    step, hump : (p, m) points expected in each cell of the one and of the other, the hump's times `height`; only their shares count.
    """
    n_places, m = step.shape
    found, mass, part, stray = np.empty(n_places), np.empty(m), np.empty(m), 1.0 / m
    n = counts.sum()
    for i in range(n_places):
        total = 0.0
        for k in range(m):
            mass[k] = max(step[i, k] + height * hump[i, k], _LEAST)
            total += mass[k]
        for k in range(m):
            mass[k] /= total
        share = _FIRST_SHARE
        for _ in range(n_rounds):
            strays, level = 0.0, share * stray
            for k in range(m):  # apart from their sum, which waits for each: so the divisions need not
                part[k] = level / (level + (1 - share) * mass[k]) * counts[k]
            for k in range(m):
                strays += part[k]
            share = strays / n
        found[i] = 0.0
        for k in range(m):
            found[i] += math.log(share * stray + (1 - share) * mass[k]) * counts[k]
    return found
