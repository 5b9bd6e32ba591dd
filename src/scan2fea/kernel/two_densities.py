"""The stretch of counts that two densities, one inside and one outside of it, explain best."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray


@jit_ieee
def densest_stretch(counts: FloatArray) -> tuple[int, int]:
    """First cell of the stretch, at least two long and no thinner than the rest, of greatest likelihood, and the cell after its last; (0, 0): none.

    counts : (n,) points in cells of one length.
    """
    n = len(counts)
    total = np.zeros(n + 1)
    for k in range(n):
        total[k + 1] = total[k] + counts[k]
    best, first, last = -np.inf, 0, 0
    for i in range(n + 1):
        for j in range(i + 2, n + 1):
            inside, width = total[j] - total[i], float(j - i)
            outside, rest = total[n] - inside, n - width
            if inside * rest < outside * width:
                continue
            gain = inside * math.log(inside / width) if inside > 0 else 0.0
            gain += outside * math.log(outside / rest) if outside > 0 else 0.0
            if gain > best:
                best, first, last = gain, i, j
    return first, last
