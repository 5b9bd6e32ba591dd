"""The log likelihood of circles (tubes, round bars) over all points, its slope and the sum of the scores' outer products, in one pass.

What `section_likelihood.log_density` gives point by point, summed as it arises; see `section_sums`, whose order of unknowns and arguments these are:

    d (and t), cx, cy, log_sigma, logit_outliers, then tilt (x, y), bow (x, y of degree 2, 3, ...), log weights of faces

A circle of radius R under isotropic Gaussian noise has Rice's law over 2 pi r. Its Bessel functions come from a table: i0e(x) sqrt(1 + x) and
(1 - i1e / i0e)(1 + x) are smooth and bounded over t = 4 / (4 + x) in (0, 1].
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import i0e, i1e

from scan2fea.kernel.jit import jit_ieee, jit_inline
from scan2fea.kernel.noise_kernels import FAR, NARROW, kernel_at
from scan2fea.kernel.section_sums import VALUE, add_products
from scan2fea.types import FloatArray, IntArray

_TINY = 1e-300
_STEPS, _DEGREE = 96, 9
_LARGE = 1e3  # beyond it the asymptotic series of 1 - i1e / i0e takes over: differences of the functions would have no digits left


def _bessel_table(n: int, degree: int) -> FloatArray:
    """(2, n, degree + 1) coefficients of i0e(x) sqrt(1 + x) and of (1 - i1e(x) / i0e(x)) (1 + x) over n equal steps of t = 4 / (4 + x)."""
    node = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    x = 4 * n / (np.arange(n)[:, None] + 0.5 + 0.5 * node) - 4
    x8 = 8 * np.maximum(x, 1.0)
    series = 4 / x8 * (1 + 2 / x8 * (1 + 8 / x8 * (1 + 12.5 / x8)))  # of DLMF 10.40.1: 1/(2x) + 1/(8x^2) + 1/(8x^3) + 25/(128x^4)
    fall = np.where(x > _LARGE, series, 1 - i1e(x) / i0e(x))
    values = np.stack([i0e(x) * np.sqrt(1 + x), fall * (1 + x)])
    return np.ascontiguousarray(np.linalg.solve(np.vander(node, increasing=True), values.transpose(0, 2, 1)).transpose(0, 2, 1))


_BESSEL = _bessel_table(_STEPS, _DEGREE)
_INV_ROOT_2PI = 1 / math.sqrt(2 * math.pi)


@jit_inline
def bessel_at(x: float) -> tuple[float, float]:
    """i0e(x) and 1 - i1e(x) / i0e(x) of x >= 0, relative to exact values within 2e-12."""
    t = 4.0 * _STEPS / (4.0 + x)
    step = min(int(t), _STEPS - 1)
    at = 2.0 * (t - step) - 1.0
    return _series(0, step, at) / math.sqrt(1.0 + x), _series(1, step, at) / (1.0 + x)


@jit_inline
def _series(which: int, step: int, at: float) -> float:
    """The polynomial of one step of the table, in pairs (Estrin 1960): its terms need not wait for one another."""
    square = at * at
    low = _BESSEL[which, step, 0] + _BESSEL[which, step, 1] * at + (_BESSEL[which, step, 2] + _BESSEL[which, step, 3] * at) * square
    middle = _BESSEL[which, step, 4] + _BESSEL[which, step, 5] * at + (_BESSEL[which, step, 6] + _BESSEL[which, step, 7] * at) * square
    high = _BESSEL[which, step, 8] + _BESSEL[which, step, 9] * at
    return float(low + (middle + high * (square * square)) * (square * square))


@jit_ieee
def round_sums(
    xy: FloatArray,
    basis: FloatArray,
    theta: FloatArray,
    n_curve: tuple[int, int, int],
    base_weight: FloatArray,
    free_rows: IntArray,
    radius_factors: FloatArray,
    parts: FloatArray,
    area: float,
    asked: int,
) -> tuple[float, FloatArray, FloatArray]:
    """Log likelihood, its gradient (q,) and the outer products (q, q) of its scores; what was not asked for is zero.

    radius_factors : (circles, p), the radii by the dimensions.   Other arguments as of `section_sums.straight_sums`; twist has no place here.
    """
    circles, n_values = radius_factors.shape
    q = len(theta)
    gradient, information = np.zeros(q), np.zeros((q, q))
    radius, share, is_whole = _shares(theta, base_weight, free_rows, radius_factors)
    if not is_whole:
        return -np.inf, gradient, information
    sigma = math.exp(theta[n_values + 2])
    eps = 1.0 / (1.0 + math.exp(-theta[n_values + 3]))
    stray = eps / area
    row, by_radius, by_circle = np.zeros(q), np.zeros(circles), np.zeros(circles)
    by_length = 2 * math.pi * np.dot(share, radius_factors)
    total = 0.0
    for i in range(len(xy)):
        x, y = _from_axis(xy, basis, theta, n_values, n_curve, i)
        r = math.sqrt(x * x + y * y)
        by_radius[:] = 0.0
        by_circle[:] = 0.0
        p, by_r = 0.0, 0.0
        for j in range(len(parts)):
            dp, dr = _circles_at(r, sigma, radius, share, parts[j, 0], parts[j, 1], parts[j, 2], by_radius, by_circle)
            p += dp
            by_r += dr
        level = (1 - eps) * p + stray
        total += math.log(level)
        if asked == VALUE:
            continue
        own = (1 - eps) * p / level
        scale = own / p if p > _TINY else 0.0
        slope = scale * by_r / r if r > 0 else 0.0
        gx, gy = slope * x, slope * y
        rest = -2.0 * own - x * gx - y * gy  # p has the degree -2 in point, dimensions and sigma together (Euler)
        for m in range(n_values):
            row[m] = -own * by_length[m]
            for c in range(circles):
                row[m] += scale * by_radius[c] * radius_factors[c, m]
            rest -= row[m] * theta[m]
        row[n_values + 2], row[n_values + 3] = rest, (1 - eps) - own
        _by_place(row, basis, n_values, n_curve, i, gx, gy)
        for m in range(len(free_rows)):
            c = free_rows[m]
            row[q - len(free_rows) + m] = scale * by_circle[c] - own * share[c] * 2 * math.pi * radius[c]
        add_products(row, gradient, information, asked)
    for a in range(q):
        for b in range(a):
            information[b, a] = information[a, b]
    return total, gradient, information


@jit_inline
def _from_axis(xy: FloatArray, basis: FloatArray, theta: FloatArray, n_values: int, n_curve: tuple[int, int, int], i: int) -> tuple[float, float]:
    """Point i from the middle of the circles at its place along the member."""
    tilt, n_bow = n_curve[0], n_curve[1]
    x, y = xy[i, 0] - theta[n_values], xy[i, 1] - theta[n_values + 1]
    first = n_values + 4
    if tilt:
        x -= theta[first] * basis[i, 1]
        y -= theta[first + 1] * basis[i, 1]
    first += 2 * tilt
    for k in range(n_bow):
        x -= theta[first + 2 * k] * basis[i, k + 2]
        y -= theta[first + 2 * k + 1] * basis[i, k + 2]
    return x, y


@jit_inline
def _by_place(row: FloatArray, basis: FloatArray, n_values: int, n_curve: tuple[int, int, int], i: int, gx: float, gy: float) -> None:
    """Fills the scores by place, tilt and bow."""
    tilt, n_bow = n_curve[0], n_curve[1]
    row[n_values], row[n_values + 1] = -gx, -gy
    first = n_values + 4
    if tilt:
        row[first], row[first + 1] = -gx * basis[i, 1], -gy * basis[i, 1]
    first += 2 * tilt
    for k in range(n_bow):
        row[first + 2 * k], row[first + 2 * k + 1] = -gx * basis[i, k + 2], -gy * basis[i, k + 2]


@jit_ieee
def round_levels(xy: FloatArray, thetas: FloatArray, radius_factors: FloatArray, parts: FloatArray, area: float) -> FloatArray:
    """(g,) log likelihoods at each of `thetas` (g, q), the member straight and all circles alike."""
    basis, whole, none = np.ones((len(xy), 1)), np.ones(len(radius_factors)), np.zeros(0, np.int64)
    zero = len(none)  # numba would compile all of it once more for the constants 0 and VALUE
    found = np.empty(len(thetas))
    for g in range(len(thetas)):
        found[g] = round_sums(xy, basis, thetas[g], (zero, zero, zero), whole, none, radius_factors, parts, area, VALUE + zero)[0]
    return found


@jit_ieee
def _shares(theta: FloatArray, base_weight: FloatArray, free_rows: IntArray, radius_factors: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
    """Radii, points per metre of each circle as a share of all, and whether the dimensions make a section."""
    circles, n_values = radius_factors.shape
    share, radius = base_weight.copy(), np.zeros(circles)
    is_whole = True
    for m in range(n_values):
        is_whole = is_whole and math.isfinite(theta[m]) and theta[m] > 0
    for m in range(len(free_rows)):
        share[free_rows[m]] = math.exp(theta[len(theta) - len(free_rows) + m])
    length = 0.0
    for c in range(circles):
        for m in range(n_values):
            radius[c] += radius_factors[c, m] * theta[m]
        is_whole = is_whole and radius[c] > 0
        length += share[c] * 2 * math.pi * radius[c]
    return radius, share / length, is_whole


@jit_inline
def _circles_at(
    r: float,
    sigma: float,
    radius: FloatArray,
    share: FloatArray,
    weight: float,
    h: float,
    s: float,
    by_radius: FloatArray,
    by_circle: FloatArray,
) -> tuple[float, float]:
    """p and its slope by r of one point and one part of the kernel; adds the slopes by the radii, and the part of every circle."""
    p, by_r = 0.0, 0.0
    spread, sharp = sigma * math.sqrt(s * s + h * h / 3), 1.0 / sigma
    tight, narrow = 1.0 / (spread * spread), 1.0 / s
    for c in range(len(radius)):
        z = (r - radius[c]) * sharp
        if abs(z) - h > FAR * s:
            continue
        if h <= NARROW:
            v = z * narrow
            density = _INV_ROOT_2PI * math.exp(-0.5 * v * v) * narrow
            slope = -v * narrow * density
        else:
            density, slope, _ = kernel_at(z, h, s)
        bessel, fall = bessel_at(r * radius[c] * tight)
        # share x length of the circle x Rice's factor; for a Gaussian this is the exact density
        factor = weight * share[c] * 2 * math.pi * radius[c] * bessel * _INV_ROOT_2PI / (spread * sigma)
        p += factor * density
        by_circle[c] += factor * density
        by_r += factor * (slope * sharp - density * fall * radius[c] * tight)
        by_radius[c] += factor * (-slope * sharp + density * (1 / radius[c] - fall * r * tight))
    return p, by_r
