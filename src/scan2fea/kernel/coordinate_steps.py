"""The step to which the coordinates of a cloud were rounded: what no number of points averages away on faces square to the axes."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.types import FloatArray

WHOLE = 0.01  # of a step: how far from whole steps values may lie
SAME = 8.0  # of the distance between floating numbers there: values nearer than this are one
SAMPLED = 0.5  # spacings: points that lie on a wider lattice were drawn on it, not rounded to it
FEWEST = 3  # values along an axis that tell a step


def coordinate_step(points: FloatArray, spacing_m: float) -> float:
    """The widest step of the three coordinates of (n, 3) points, m; 0 where one of them has none that is narrower than SAMPLED spacings."""
    steps = [_step(column) for column in points.T]
    told = [step for step in steps if math.isfinite(step)]
    return max(told) if told and min(told) > 0.0 and max(told) <= SAMPLED * spacing_m else 0.0


def rounding_std(step_m: float, sigma_m: float) -> float:
    """Standard deviation of the place of a face square to an axis, m, whose points have noise `sigma_m` and were rounded to whole steps.

    The mean of rounded normal draws is periodic in the true place: uniform in a step without noise (step / sqrt 12), its first harmonic damped by
    exp(-2 pi^2 sigma^2 / step^2) with it (Widrow, Kollar 2008, Quantization noise).
    """
    return step_m / math.sqrt(12.0) * math.exp(-2.0 * (math.pi * sigma_m / step_m) ** 2) if step_m > 0.0 else 0.0


def _step(values: FloatArray) -> float:
    """The least distance between values if all others are whole multiples of it, else 0; nan where too few values differ."""
    apart = np.diff(np.unique(values))
    apart = apart[apart > SAME * float(np.spacing(np.abs(values).max()))]
    if len(apart) < FEWEST - 1:
        return math.nan
    share = apart / apart.min()
    return float(apart.min()) if np.abs(share - np.round(share)).max() <= WHOLE else 0.0
