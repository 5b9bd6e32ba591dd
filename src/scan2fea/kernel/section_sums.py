"""The log likelihood of a straight-edged section over all its points, its slope and the sum of the scores' outer products, in one pass.

What `section_likelihood.log_density` gives point by point, summed as it arises: no score is ever stored, so a million points need no memory and an
evaluation costs little more than the exponentials in it. The unknowns stand in the order of `estimation.likelihood.Layout`:

    dimensions, roll, cx, cy, log_sigma, logit_outliers, then tilt (x, y), bow (x, y of degree 2, 3, ...), twist (1, 2, ...), log weights of faces
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee, jit_inline
from scan2fea.kernel.noise_kernels import FAR, kernel_at, mass_between
from scan2fea.types import FloatArray, IntArray

_TINY = 1e-300
VALUE, SLOPE, INFORMATION = 0, 1, 2  # how much is asked for


@jit_ieee
def straight_sums(
    xy: FloatArray,
    basis: FloatArray,
    theta: FloatArray,
    n_curve: tuple[int, int, int],
    base_weight: FloatArray,
    free_rows: IntArray,
    x_factors: FloatArray,
    y_factors: FloatArray,
    edges: IntArray,
    parts: FloatArray,
    area: float,
    asked: int,
) -> tuple[float, FloatArray, FloatArray]:
    """Log likelihood, its gradient (q,) and the outer products (q, q) of its scores; what was not asked for is zero.

    xy : (n, 2) metres across the member.   basis : (n, k) Legendre polynomials 0 .. k - 1 at the points' places along it.
    n_curve : 1 if the layout has tilt, degrees of bow beyond it, degrees of twist.   base_weight : (f,) points per metre of each face, relative.
    free_rows : the faces whose log weight is an unknown.   x_factors, y_factors, edges : of `section_likelihood`.   parts : of `kernel_parts`.
    area : m2 over which strays are even.   asked : VALUE, SLOPE or INFORMATION. Dimensions that make no section have a log likelihood of -inf.
    """
    n_values, n_x, q = x_factors.shape[1], len(x_factors), len(theta)
    gradient, information = np.zeros(q), np.zeros((q, q))
    values = theta[:n_values]
    lines = np.concatenate((np.dot(x_factors, values), np.dot(y_factors, values)))
    share, length_share, by_length, is_whole = _shares(theta, base_weight, free_rows, x_factors, y_factors, edges, lines)
    if not is_whole:
        return -np.inf, gradient, information
    sigma = math.exp(theta[n_values + 3])
    eps = 1.0 / (1.0 + math.exp(-theta[n_values + 4]))
    stray, sharp = eps / area, 1.0 / sigma
    table = _edge_table(edges, n_x)
    z, density, slope = np.zeros(len(lines)), np.zeros(len(lines)), np.zeros(len(lines))
    tail, by_line, by_face, row = np.zeros(len(lines)), np.zeros(len(lines)), np.zeros(len(edges)), np.zeros(q)
    cos, sin = math.cos(theta[n_values]), math.sin(theta[n_values])
    total = 0.0
    for i in range(len(xy)):
        x, y, c, s = _in_section(xy, basis, theta, n_values, n_curve, i, cos, sin)
        by_line[:] = 0.0
        by_face[:] = 0.0
        p = 0.0
        for j in range(len(parts)):
            h, s_part = parts[j, 1], parts[j, 2]
            for k in range(len(lines)):
                z[k] = ((x if k < n_x else y) - lines[k]) * sharp
                density[k], slope[k], tail[k] = _kernel(z[k], h, s_part)
            p += _edges_at(table, share, parts[j, 0] * sharp, sharp, z, density, slope, tail, by_line, by_face, asked)
        level = (1 - eps) * p + stray
        total += math.log(level)
        if asked == VALUE:
            continue
        own = (1 - eps) * p / level
        gx, gy = _by_dimensions(row, by_line, own / p if p > _TINY else 0.0, own, by_length, x_factors, y_factors)
        row[n_values + 3] = _by_size(row, theta, n_values, -2.0 * own - x * gx - y * gy)
        row[n_values + 4] = (1 - eps) - own
        _by_place(row, basis, n_values, n_curve, i, x, y, c, s, gx, gy)
        for m in range(len(free_rows)):
            row[q - len(free_rows) + m] = (own / p if p > _TINY else 0.0) * by_face[free_rows[m]] - own * length_share[free_rows[m]]
        add_products(row, gradient, information, asked)
    for a in range(q):
        for b in range(a):
            information[b, a] = information[a, b]
    return total, gradient, information


@jit_inline
def add_products(row: FloatArray, gradient: FloatArray, information: FloatArray, asked: int) -> None:
    """Adds one point's scores, and the lower half of their products."""
    for a in range(len(row)):
        gradient[a] += row[a]
        if asked == INFORMATION:
            for b in range(a + 1):
                information[a, b] += row[a] * row[b]


@jit_ieee
def straight_levels(
    xy: FloatArray,
    thetas: FloatArray,
    x_factors: FloatArray,
    y_factors: FloatArray,
    edges: IntArray,
    parts: FloatArray,
    area: float,
) -> FloatArray:
    """(g,) log likelihoods at each of `thetas` (g, q), the member straight and all faces alike; otherwise as `straight_sums`."""
    basis, whole, none = np.ones((len(xy), 1)), np.ones(len(edges)), np.zeros(0, np.int64)
    zero = len(none)  # numba would compile all of it once more for the constants 0 and VALUE
    found = np.empty(len(thetas))
    for g in range(len(thetas)):
        found[g] = straight_sums(xy, basis, thetas[g], (zero, zero, zero), whole, none, x_factors, y_factors, edges, parts, area, VALUE + zero)[0]
    return found


@jit_inline
def _kernel(z: float, h: float, s: float) -> tuple[float, float, float]:
    """`kernel_at`, zero where the exponent is beyond any share of strays."""
    if abs(z) - h > FAR * s:
        return 0.0, 0.0, 0.0
    return kernel_at(z, h, s)


@jit_ieee
def _shares(
    theta: FloatArray, base_weight: FloatArray, free_rows: IntArray, x_factors: FloatArray, y_factors: FloatArray, edges: IntArray, lines: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Per edge: density of its points per metre, share of the points, both at these weights; minus the slope of log p by the dimensions that comes
    of the normalisation; whether the dimensions make a section.
    """
    n_values, n_x, q = x_factors.shape[1], len(x_factors), len(theta)
    share, length = base_weight.copy(), np.zeros(len(edges))
    is_whole = True
    for m in range(n_values):
        is_whole = is_whole and math.isfinite(theta[m]) and theta[m] > 0
    for m in range(len(free_rows)):
        share[free_rows[m]] = math.exp(theta[q - len(free_rows) + m])
    perimeter = 0.0
    for e in range(len(edges)):
        first = n_x if edges[e, 0] == 0 else 0
        length[e] = lines[first + edges[e, 3]] - lines[first + edges[e, 2]]
        is_whole = is_whole and length[e] > 0
        perimeter += share[e] * length[e]
    by_length = np.zeros(n_values)
    for e in range(len(edges)):
        share[e] /= perimeter
        factors = y_factors if edges[e, 0] == 0 else x_factors
        for m in range(n_values):
            by_length[m] += share[e] * (factors[edges[e, 3], m] - factors[edges[e, 2], m])
    return share, share * length, by_length, is_whole


@jit_ieee
def _edge_table(edges: IntArray, n_x: int) -> IntArray:
    """(e, 3) per edge the line it lies on and those of its two ends, in one count over the lines of x and then of y."""
    table = np.empty((len(edges), 3), np.int64)
    for e in range(len(edges)):
        own = n_x if edges[e, 0] == 1 else 0
        table[e, 0], table[e, 1], table[e, 2] = own + edges[e, 1], n_x - own + edges[e, 2], n_x - own + edges[e, 3]
    return table


@jit_inline
def _in_section(
    xy: FloatArray, basis: FloatArray, theta: FloatArray, n_values: int, n_curve: tuple[int, int, int], i: int, c: float, s: float
) -> tuple[float, float, float, float]:
    """Point i in the frame of the section, and the cosine and sine of the roll there; c and s : of the roll at degree 0."""
    tilt, n_bow, n_twist = n_curve
    turn, ax, ay = 0.0, theta[n_values + 1], theta[n_values + 2]
    first = n_values + 5
    if tilt:
        ax += theta[first] * basis[i, 1]
        ay += theta[first + 1] * basis[i, 1]
    first += 2 * tilt
    for k in range(n_bow):
        ax += theta[first + 2 * k] * basis[i, k + 2]
        ay += theta[first + 2 * k + 1] * basis[i, k + 2]
    first += 2 * n_bow
    for k in range(n_twist):
        turn += theta[first + k] * basis[i, k + 1]
    if n_twist > 0:
        turn += theta[n_values]
        c, s = math.cos(turn), math.sin(turn)
    dx, dy = xy[i, 0] - ax, xy[i, 1] - ay
    return c * dx + s * dy, c * dy - s * dx, c, s


@jit_inline
def _edges_at(
    table: IntArray,
    share: FloatArray,
    scale: float,
    sharp: float,
    z: FloatArray,
    density: FloatArray,
    slope: FloatArray,
    tail: FloatArray,
    by_line: FloatArray,
    by_face: FloatArray,
    asked: int,
) -> float:
    """p of one point and one part of the kernel; adds its derivatives by the place of every line, and the part of every face."""
    p = 0.0
    for e in range(len(table)):
        line, low, high = table[e, 0], table[e, 1], table[e, 2]
        if density[line] == 0.0:
            continue
        weight = scale * share[e]
        # the low end has the larger coordinate to go: z falls from the low end to the high one
        mass = mass_between(z[high], tail[high], z[low], tail[low])
        term = weight * density[line] * mass
        p += term
        if asked > VALUE:
            by_face[e] += term
            by_line[line] -= weight * slope[line] * mass * sharp
            by_line[low] -= weight * density[line] * density[low] * sharp
            by_line[high] += weight * density[line] * density[high] * sharp
    return p


@jit_inline
def _by_dimensions(
    row: FloatArray, by_line: FloatArray, scale: float, own: float, by_length: FloatArray, x_factors: FloatArray, y_factors: FloatArray
) -> tuple[float, float]:
    """Fills the scores by the dimensions; gives the score by the point itself: moving every line one way is moving the point the other."""
    n_values, n_x = len(by_length), len(x_factors)
    gx, gy = 0.0, 0.0
    for m in range(n_values):
        row[m] = -own * by_length[m]
    for k in range(len(by_line)):
        if by_line[k] == 0.0:
            continue
        g = by_line[k] * scale
        if k < n_x:
            gx -= g
            for m in range(n_values):
                row[m] += g * x_factors[k, m]
        else:
            gy -= g
            for m in range(n_values):
                row[m] += g * y_factors[k - n_x, m]
    return gx, gy


@jit_inline
def _by_size(row: FloatArray, theta: FloatArray, n_values: int, rest: float) -> float:
    """The score by log sigma: p has the degree -2 in point, dimensions and sigma together (Euler)."""
    for m in range(n_values):
        rest -= row[m] * theta[m]
    return rest


@jit_inline
def _by_place(
    row: FloatArray,
    basis: FloatArray,
    n_values: int,
    n_curve: tuple[int, int, int],
    i: int,
    x: float,
    y: float,
    c: float,
    s: float,
    gx: float,
    gy: float,
) -> None:
    """Fills the scores by roll, place, tilt, bow and twist."""
    tilt, n_bow, n_twist = n_curve
    by_roll = gx * y - gy * x
    by_x, by_y = s * gy - c * gx, -s * gx - c * gy
    row[n_values], row[n_values + 1], row[n_values + 2] = by_roll, by_x, by_y
    first = n_values + 5
    if tilt:
        row[first], row[first + 1] = by_x * basis[i, 1], by_y * basis[i, 1]
    first += 2 * tilt
    for k in range(n_bow):
        row[first + 2 * k], row[first + 2 * k + 1] = by_x * basis[i, k + 2], by_y * basis[i, k + 2]
    first += 2 * n_bow
    for k in range(n_twist):
        row[first + k] = by_roll * basis[i, k + 1]
