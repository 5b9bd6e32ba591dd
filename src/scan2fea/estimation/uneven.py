"""How much more uneven than chance points lie along a member."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.types import FloatArray


def unevenness(z: FloatArray, low: float, high: float) -> float:
    """Variance over mean of the counts in some 50 equal stretches, slow changes of density taken out; 1 where chance explains it."""
    n_bins = int(np.clip(len(z) // 20, 1, 50))
    if n_bins < 8:
        return 1.0
    counts = np.histogram(z, n_bins, (low, high))[0]
    wiggle = (counts[1:-1] - 0.5 * (counts[:-2] + counts[2:])) / math.sqrt(1.5)
    ratio = float((wiggle**2).mean() / max(counts.mean(), 1e-9))
    return ratio if ratio > 1 + 4 * math.sqrt(2 / n_bins) else 1.0
