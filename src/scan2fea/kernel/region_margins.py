"""How dense points lie around the regions of a grid of cells: all regions in one compiled pass."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import BoolArray, FloatArray, IntArray


@jit_ieee
def region_margins(label: IntArray, n_regions: int, one: IntArray, other: IntArray, own: BoolArray, reach: int) -> tuple[IntArray, FloatArray]:
    """(k,) cells of each region, and the mean of `one` plus that of `other` over the cells beside it; 0 where there are none.

    label : (m, n) 1 .. n_regions, 0 of none.   one, other : (m, n) counts.   own : (m, n) cells that are asked.   reach : steps from side to side
    within which a cell lies beside a region.
    """
    m, n = label.shape
    first, place = _by_region(label, n_regions)
    beside, sums, told = np.zeros(n_regions + 1, np.int64), np.zeros((2, n_regions + 1), np.int64), np.zeros((m, n), np.int64)
    for region in range(1, n_regions + 1):
        for p in range(first[region], first[region + 1]):
            a, b = place[p] // n, place[p] % n
            for c in range(max(a - reach, 0), min(a + reach, m - 1) + 1):
                left = reach - abs(c - a)
                for d in range(max(b - left, 0), min(b + left, n - 1) + 1):
                    if label[c, d] != region and told[c, d] != region and own[c, d]:
                        told[c, d] = region
                        beside[region] += 1
                        sums[0, region] += one[c, d]
                        sums[1, region] += other[c, d]
    density = np.zeros(n_regions)
    for k in range(n_regions):
        if beside[k + 1] > 0:
            density[k] = sums[0, k + 1] / beside[k + 1] + sums[1, k + 1] / beside[k + 1]
    return first[2:] - first[1:-1], density


@jit_ieee
def _by_region(label: IntArray, n_regions: int) -> tuple[IntArray, IntArray]:
    """Where the cells of each region begin, 0 (none) first, in the list of all cells (m n,), row by row, that is the second."""
    first = np.zeros(n_regions + 2, np.int64)
    for region in label.flat:
        first[region + 1] += 1
    for k in range(n_regions + 1):
        first[k + 1] += first[k]
    filled, place = first[:-1].copy(), np.empty(label.size, np.int64)
    for at, region in enumerate(label.flat):
        place[filled[region]] = at
        filled[region] += 1
    return first, place
