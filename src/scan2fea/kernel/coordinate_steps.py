"""The step to which the coordinates of a cloud were rounded: what no number of points averages away on faces square to the axes.

Noise below a step puts the points of such a face on one or two planes, exactly: two sheets that are none, and no noise. `spread` gives every
coordinate a place in its step by chance, which is all that is known of it; the faces stay as far off as rounding moved them: `rounding_std`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scan2fea.kernel.noise import noise_sigma, spacing
from scan2fea.types import FloatArray, Scan

WHOLE = 0.01  # of a step: how far from whole steps values may lie
SAME = 8.0  # of the distance between floating numbers there: values nearer than this are one
SAMPLED = 0.8  # spacings: points on a wider lattice were drawn on it, not rounded to it; of a square one a step is 6 / (4 + 2 sqrt 2) = 0.88
FELT = 0.02  # spacings: of walls as thick as that a step of less moves as little as is tolerated of what rounding leaves open of a volume
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


def spread(scan: Scan, seed: int) -> tuple[Scan, float]:
    """The scan with its measured points evenly spread over the steps they were rounded to, where noise does not do so; and the step, m, 0 if none."""
    cloud, rays = scan.cloud, scan.rays
    is_own = np.ones(len(cloud), bool) if cloud.is_inferred is None else ~cloud.is_inferred
    measured = cloud.points[is_own]
    if len(measured) < FEWEST or not np.isfinite(measured).all():
        return scan, 0.0
    apart_m = spacing(measured)
    step = coordinate_step(measured, apart_m)
    if not step > FELT * apart_m or noise_sigma(measured, below_m=step) >= step:
        return scan, step
    points = cloud.points.copy()
    points[is_own] += step * (np.random.default_rng(seed).random(measured.shape) - 0.5)
    if rays is not None:
        rows = cloud.ray[is_own & (cloud.ray >= 0)]
        way = points[is_own & (cloud.ray >= 0)] - rays.origin[rows]
        direction, range_m = rays.direction.copy(), rays.range_m.copy()
        range_m[rows] = np.linalg.norm(way, axis=1)
        direction[rows] = way / range_m[rows, None]
        rays = replace(rays, direction=direction, range_m=range_m)
    return Scan(cloud=cloud.replaced(points=points), rays=rays), step


def noise_before(sigma_m: float, step_m: float) -> float:
    """What rounding and `spread` leave of a noise at least, m: each has added up to step^2 / 12 to its variance."""
    return math.sqrt(max(sigma_m**2 - step_m**2 / 6.0, 0.0))


def _step(values: FloatArray) -> float:
    """The least distance between values if all others are whole multiples of it, else 0; nan where too few values differ."""
    apart = np.diff(np.unique(values))
    apart = apart[apart > SAME * float(np.spacing(np.abs(values).max()))]
    if len(apart) < FEWEST - 1:
        return math.nan
    share = apart / apart.min()
    return float(apart.min()) if np.abs(share - np.round(share)).max() <= WHOLE else 0.0
