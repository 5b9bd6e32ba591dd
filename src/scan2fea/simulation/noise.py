"""What a sensor does to a true range: noise, false returns, lost returns, rounding.

Order, as in the instrument: a return is lost (too little light comes back) or false (outlier), its range is noisy, and the number that is
written is rounded. Every draw is made for every ray, used or not, so that one option does not move the draws of another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.options import option
from scan2fea.types import BoolArray, FloatArray, Value
from scan2fea.units import radians

_REFERENCE = 0.1  # at which makers state their detection range (VLP-16, HDL-32E and Leica data sheets: "at 10 %")
_POWER_SCATTER = 0.1  # relative standard deviation of the received power over its threshold: speckle and background light


@dataclass(frozen=True, kw_only=True)
class NoiseOptions:
    """How far a sensor is off; the base of the options of every ranging sensor."""

    noise: str = option("gaussian", "Distribution of the noise", choices=("gaussian", "uniform"))
    noise_m: float = option(0.0, "Standard deviation (gaussian) or half width (uniform) of the noise", unit="m", minimum=0.0)
    noise_per_m: float = option(0.0, "Further noise per metre of range, added in quadrature", unit="m/m", minimum=0.0)
    noise_along: str = option("ray", "Noise along the ray, or of the same size along x, y and z", choices=("ray", "isotropic"))
    outlier_share: float = option(0.0, "Share of the returns that are false", minimum=0.0, maximum=1.0)
    outlier_m: float = option(1.0, "False returns lie evenly up to so far before and behind the surface along the ray", unit="m", minimum=0.0)
    quantum_m: float = option(0.0, "Ranges are rounded to multiples of this; 0: not rounded", unit="m", minimum=0.0)
    max_incidence_deg: float = option(90.0, "A surface seen at a flatter angle than this returns nothing", unit="deg", minimum=0.0, maximum=90.0)
    detection_m: float = option(
        0.0, "Range at which half the returns of a 10 % reflective surface, hit squarely, are lost; 0: none are", unit="m", minimum=0.0
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Disturbed(Value):
    """n returns as the sensor gives them. range_m : (n,) nan where nothing comes back.   offset_m : (n, 3) across the ray, zero unless isotropic.

    sigma_along_m, sigma_across_m : (n,) standard deviations of what was added.   is_false : (n,) outliers.
    """

    range_m: FloatArray
    offset_m: FloatArray
    sigma_along_m: FloatArray
    sigma_across_m: FloatArray
    is_false: BoolArray


def noise_size(range_m: FloatArray, options: NoiseOptions, more_m: FloatArray | float = 0.0) -> FloatArray:
    """(n,) standard deviation or half width at each range; `more_m` is added in quadrature."""
    size: FloatArray = np.hypot(np.hypot(options.noise_m, options.noise_per_m * range_m), more_m)
    return size


def received_power(range_m: FloatArray, cosine: FloatArray, reflectance: FloatArray) -> FloatArray:
    """(n,) light that comes back from a diffuse surface wider than the beam, 1 for a white one hit squarely at 1 m: rho cos / r^2."""
    power: FloatArray = reflectance * cosine / np.maximum(range_m, 1e-6) ** 2
    return power


def is_detected(range_m: FloatArray, cosine: FloatArray, reflectance: FloatArray, draw: FloatArray, options: NoiseOptions) -> BoolArray:
    """(n,) True where the surface sends enough light back.   draw : (n,) standard normal."""
    seen: BoolArray = cosine >= math.cos(radians(options.max_incidence_deg)) * (1 - 1e-12)
    if options.detection_m > 0:
        threshold = _REFERENCE / options.detection_m**2
        seen = seen & (received_power(range_m, cosine, reflectance) * (1 + _POWER_SCATTER * draw) >= threshold)
    return seen


def disturbed(
    range_m: FloatArray,
    direction: FloatArray,
    cosine: FloatArray,
    reflectance: FloatArray,
    options: NoiseOptions,
    rng: np.random.Generator,
    more_m: FloatArray | float = 0.0,
) -> Disturbed:
    """The returns of n rays with all that the options ask for.

    range_m : (n,) true, nan for a miss.   direction : (n, 3) unit.   cosine : (n,) of the incidence.   reflectance : (n,) of what was hit.
    more_m : (n,) noise of the sensor's own, standard deviation or half width, beside what the options state.
    """
    n = len(range_m)
    seen = is_detected(range_m, cosine, reflectance, rng.standard_normal(n), options) & np.isfinite(range_m)
    size = noise_size(range_m, options, more_m)
    along, offset = _drawn(n, direction, size, options, rng)
    false = (rng.random(n) < options.outlier_share) & seen
    away = rng.uniform(-options.outlier_m, options.outlier_m, n)
    measured = range_m + np.where(false, away, along)
    offset[false | ~seen] = 0.0
    if options.quantum_m > 0:
        measured = np.rint(measured / options.quantum_m) * options.quantum_m
    seen = seen & (measured > 0)  # what falls behind the lens is never reported
    spread = size / (math.sqrt(3.0) if options.noise == "uniform" else 1.0)
    return Disturbed(
        range_m=np.where(seen, measured, np.nan),
        offset_m=offset,
        sigma_along_m=np.hypot(spread, options.quantum_m / math.sqrt(12.0)),  # a uniform step q has the deviation q / sqrt(12)
        sigma_across_m=spread if options.noise_along == "isotropic" else np.zeros(n),
        is_false=false & seen,
    )


def _drawn(n: int, direction: FloatArray, size: FloatArray, options: NoiseOptions, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Noise along each ray (n,) and across it (n, 3)."""
    columns = 3 if options.noise_along == "isotropic" else 1
    unit = rng.standard_normal((n, columns)) if options.noise == "gaussian" else rng.uniform(-1.0, 1.0, (n, columns))
    noise = unit * size[:, None]
    if columns == 1:
        return noise[:, 0], np.zeros((n, 3))
    along = np.einsum("nc,nc->n", noise, direction)
    return along, noise - along[:, None] * direction
