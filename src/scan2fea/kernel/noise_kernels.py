"""Shapes of measuring noise across a surface, each a short mixture of boxes smeared by Gaussians: density, tail and slope in closed form.

A kernel of unit variance is k(z) = sum_j w_j (U[-h_j, h_j] * N(0, s_j^2))(z); noise of standard deviation sigma is k(z / sigma) / sigma. In the
plane the components are products over both axes, so a mixture of Gaussians stays isotropic: a point is as noisy along as across the surface.

    gaussian   one Gaussian
    uniform    a box whose edges are smeared by 0.1 of its sd: a box alone has no score at its edges
    rounded    three quarters of the variance in the box: what a cube of uniform noise looks like from a direction oblique to its axes
    laplace    isotropic scale mixture whose marginals have the kurtosis 6 of Laplace's law
    mixture    9 parts in 10 of one Gaussian and 1 part of another three times as wide: a clean sensor with rough returns
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.special import erfcx

from scan2fea.errors import UsageError, require
from scan2fea.kernel.jit import jit_inline
from scan2fea.types import FloatArray

_ROOT_HALF = math.sqrt(0.5)
_INV_ROOT_2PI = 1 / math.sqrt(2 * math.pi)
_HALF_ROOT_2PI = math.sqrt(2 * math.pi) / 2
NARROW = 1e-6  # a box narrower than this (in sd) is a Gaussian
FAR = 12.0  # sd of the Gaussian of a part: beyond, its density is under 1e-31 of the greatest, less than any share of strays


def _box(share: float) -> FloatArray:
    """One component with `share` of its variance in the box."""
    return np.array([[1.0, math.sqrt(3 * share), math.sqrt(1 - share)]])


def _scale_mixture(weights: FloatArray, variances: FloatArray) -> FloatArray:
    """Gaussians of the given shares and variances, scaled to a variance of 1 together."""
    total = float(weights @ variances)
    return np.stack([weights, np.zeros(len(weights)), np.sqrt(variances / total)], 1)


def _laplace(n: int = 5) -> FloatArray:
    """Laplace's law is a Gaussian whose variance is exponentially distributed; Gauss-Laguerre nodes integrate that law's moments exactly."""
    nodes, weights = np.polynomial.laguerre.laggauss(n)
    return _scale_mixture(weights, nodes)


KERNELS: Mapping[str, FloatArray] = {
    "gaussian": np.array([[1.0, 0.0, 1.0]]),
    "uniform": _box(0.99),
    "rounded": _box(0.75),
    "laplace": _laplace(),
    "mixture": _scale_mixture(np.array([0.9, 0.1]), np.array([1.0, 9.0])),
}


def kernel_parts(noise: str) -> FloatArray:
    """(c, 3) weight, half width of the box and sd of the Gaussian of each component, in units of sigma. Raises UsageError for an unknown name."""
    require(noise in KERNELS, UsageError, f"noise kernel {noise!r} is unknown; choose one of {', '.join(KERNELS)}")
    return KERNELS[noise]


def _tail_table(n: int, per_unit: float, degree: int) -> FloatArray:
    """(n, degree + 1) coefficients of the normal law's tail over its bell, beyond x = 0 .. n / per_unit in n equal steps, by interpolation at
    Chebyshev's nodes. In steps of a tenth of degree 7 it is good to 1e-15 of its value.
    """
    node = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    x = (np.arange(n)[:, None] + 0.5 + 0.5 * node) / per_unit
    return np.ascontiguousarray(np.linalg.solve(np.vander(node, increasing=True), _HALF_ROOT_2PI * erfcx(x * _ROOT_HALF).T).T)


_PER_UNIT, _TAIL_STEPS, _TAIL_DEGREE = 10.0, 130, 7  # up to 13, beyond FAR
_TAIL = _tail_table(_TAIL_STEPS, _PER_UNIT, _TAIL_DEGREE)


@jit_inline
def bell_and_tail(x: float) -> tuple[float, float]:
    """exp(-x^2 / 2) / sqrt(2 pi) and the mass of the normal law beyond x, which comes from the first by a table: one exponential for both."""
    bell = _INV_ROOT_2PI * math.exp(-0.5 * x * x)
    t = _PER_UNIT * abs(x)
    step = int(t) if t < _TAIL_STEPS else _TAIL_STEPS
    if step == _TAIL_STEPS:
        tail = 0.5 * math.erfc(abs(x) * _ROOT_HALF)
    else:
        at = 2.0 * (t - step) - 1.0
        square = at * at
        low = _TAIL[step, 0] + _TAIL[step, 1] * at + (_TAIL[step, 2] + _TAIL[step, 3] * at) * square
        high = _TAIL[step, 4] + _TAIL[step, 5] * at + (_TAIL[step, 6] + _TAIL[step, 7] * at) * square
        tail = bell * (low + high * (square * square))  # in pairs (Estrin 1960): the terms need not wait for one another
    return bell, tail if x >= 0 else 1.0 - tail


@jit_inline
def kernel_at(z: float, h: float, s: float) -> tuple[float, float, float]:
    """Density, its slope, and the tail beyond |z| of one component at z (all relative to exact values within 1e-13 where they do not underflow)."""
    a = abs(z)
    if h <= NARROW:
        sharp = 1.0 / s
        bell, tail = bell_and_tail(a * sharp)
        density = bell * sharp
        return density, -z * sharp * sharp * density, tail
    low, high = (a - h) / s, (a + h) / s
    f_low, q_low = bell_and_tail(low)
    f_high, q_high = bell_and_tail(high)
    density = (q_low - q_high) / (2 * h)
    slope = (f_high - f_low) / (2 * h * s)
    # the integral of the Gaussian's tail q from x on is f(x) - x q(x)
    tail = s / (2 * h) * ((f_low - low * q_low) - (f_high - high * q_high))
    return density, slope if z >= 0 else -slope, tail


@jit_inline
def mass_between(z_low: float, tail_low: float, z_high: float, tail_high: float) -> float:
    """Mass of a kernel from z_low to z_high, given the tails beyond |z_low| and |z_high|; small differences keep their digits."""
    if z_low >= 0:
        return tail_low - tail_high
    if z_high <= 0:
        return tail_high - tail_low
    return 1.0 - tail_low - tail_high
