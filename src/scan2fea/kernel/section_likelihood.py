"""The density of noisy points around a cross-section, its exact score and its Fisher information.

A point is a place on the outline, uniform along it, plus noise of standard deviation sigma. For straight edges the density is (shape-estimation.md,
"Limit"; P is the perimeter, d and s the normal and tangential coordinates to edge k, l_k its length)

    p(u) = 1/P  sum_k  k_sigma(d_k) [K(s_k / sigma) - K((s_k - l_k) / sigma)]

Every edge of `kernel.sections` lies along x or y, so a point needs the kernel only at its distance to each line of edges (at most 4 + 4), not at each
edge. A circle under isotropic Gaussian noise has the density exp(-(r - R)^2 / 2 sigma^2) I0e(r R / sigma^2) / (2 pi sigma^2): Rice's law
over 2 pi r.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import i0e, i1e

from scan2fea.errors import UsageError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.noise_kernels import kernel_at, kernel_parts, mass_between
from scan2fea.kernel.sections import PARAMETERS, ROUND, corner_factors, edge_names
from scan2fea.types import FloatArray, IntArray, Value

_TINY = 1e-300  # below it the density has no digits left (about 37 sigma from every face): log of this, and a score of zero


@dataclass(frozen=True, eq=False, kw_only=True)
class Density(Value):
    """log p of n points and its exact derivatives.

    logp : (n,), p per square metre.   d_point : (n, 2) by the point.   d_values : (n, p) by the dimensions of the section.
    d_log_sigma : (n,).   d_log_weight : (n, f) by the log of each face's weight; (n, 0) where no weights were given.
    """

    logp: FloatArray
    d_point: FloatArray
    d_values: FloatArray
    d_log_sigma: FloatArray
    d_log_weight: FloatArray


@dataclass(frozen=True, eq=False)
class _Outline:
    """Edges of a straight family as lines. x, y : (k, p) factors of the line's coordinate. edges : (e, 4) axis (0: a line of x), line, from, to."""

    x: FloatArray
    y: FloatArray
    edges: IntArray


def faces(family: str) -> tuple[str, ...]:
    """The named faces of a family, in the order that `face_weight` uses."""
    return tuple(name for loop in edge_names(family) for name in loop)


@functools.cache
def _outline(family: str) -> _Outline:
    lines: tuple[list[tuple[float, ...]], list[tuple[float, ...]]] = ([], [])

    def line(axis: int, factors: FloatArray) -> int:
        key = tuple(factors.tolist())
        if key not in lines[axis]:
            lines[axis].append(key)
        return lines[axis].index(key)

    typical = _typical(family)
    edges = []
    for loop in corner_factors(family):
        for here, after in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            axis = 0 if np.array_equal(here[0], after[0]) else 1
            ends = sorted((here[1 - axis], after[1 - axis]), key=lambda f: float(f @ typical))
            edges.append((axis, line(axis, here[axis]), line(1 - axis, ends[0]), line(1 - axis, ends[1])))
    return _Outline(x=np.array(lines[0]), y=np.array(lines[1]), edges=np.array(edges, np.int64))


def _typical(family: str) -> FloatArray:
    """Dimensions of some valid section, to tell the lower end of an edge from the upper."""
    return np.array([0.1 if name.startswith("t") else 1.0 for name in PARAMETERS[family]])


def edges_of(family: str) -> tuple[FloatArray, FloatArray, IntArray]:
    """(k, p) factors of the lines of x, those of the lines of y, and (e, 4) per edge: axis (0: a line of x), line, from, to."""
    outline = _outline(family)
    return outline.x, outline.y, outline.edges


def lines_of(family: str) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Per face of a straight family: the axis (0: the face lies on a line of x), and the factors (f, p) of the line and of the face's two ends."""
    outline = _outline(family)
    axis, line, low, high = outline.edges.T
    on, across = (outline.x, outline.y), (outline.y, outline.x)
    columns = [np.array([side[a][i] for a, i in zip(axis, rows, strict=True)]) for side, rows in ((on, line), (across, low), (across, high))]
    return axis, columns[0], columns[1], columns[2]


def face_lengths(family: str, values: FloatArray) -> FloatArray:
    """(f,) length of each face of `faces(family)`, metres; negative where the dimensions make no section."""
    return _length_factors(family) @ values


@functools.cache
def _length_factors(family: str) -> FloatArray:
    """(f, p): the lengths of the faces are linear in the dimensions."""
    if family in ROUND:
        return 2 * math.pi * radius_factors(family)
    outline = _outline(family)
    across = (outline.y, outline.x)
    return np.array([across[axis][high] - across[axis][low] for axis, _, low, high in outline.edges])


@functools.cache
def radius_factors(family: str) -> FloatArray:
    """(circles, p) of a ROUND family: radii by the dimensions."""
    n = len(PARAMETERS[family])
    return np.array([[0.5, 0.0], [0.5, -1.0]])[:n, :n].copy()


def log_density(
    points: FloatArray,
    family: str,
    values: FloatArray,
    sigma_m: float,
    noise: str = "gaussian",
    face_weight: FloatArray | None = None,
) -> Density:
    """Log density of points around a section, with its exact score.

    points : (n, 2) metres in the section's frame (kernel.sections).   values : (p,) dimensions in the order of PARAMETERS[family].
    noise : a name of kernel.noise_kernels.   face_weight : (f,) points per metre of each face of `faces(family)`, relative; None: all alike.
    Circles are exact for mixtures of Gaussians; for boxes the radial form is right up to (sigma / radius)^4.
    Raises UsageError for an unknown family or kernel, a wrong number of values or weights, a sigma that is not positive, dimensions that make no
    section.
    """
    values = _checked(family, values, sigma_m)
    weight = _checked_weight(family, face_weight)
    points = np.ascontiguousarray(points, float)
    parts = kernel_parts(noise)
    lengths = face_lengths(family, values)
    share = weight / float(weight @ lengths)
    slots = len(weight) if face_weight is not None else 0
    if family in ROUND:
        p, d_point, d_values, by_face = _round_terms(points, family, values, sigma_m, parts, share, slots)
    else:
        outline = _outline(family)
        p, d_point, d_values, by_face = _straight_terms(
            points, outline.x, outline.y, outline.x @ values, outline.y @ values, outline.edges, share, parts, sigma_m, slots
        )
    d_values -= share @ _length_factors(family)  # by the normalisation, sum of weight x length
    # p has the degree -2 in (points, dimensions, sigma) together, so the score by log sigma follows from the others (Euler)
    d_log_sigma = -2.0 - np.einsum("ij,ij->i", points, d_point) - d_values @ values
    lost = p < _TINY
    if lost.any():
        p[lost] = _TINY
        for score in (d_point, d_values, d_log_sigma, by_face):
            score[lost] = 0
    if slots:
        by_face[~lost] -= share * lengths
    return Density(logp=np.log(p), d_point=d_point, d_values=d_values, d_log_sigma=d_log_sigma, d_log_weight=by_face)


def _checked(family: str, values: FloatArray, sigma_m: float) -> FloatArray:
    require(family in PARAMETERS, UsageError, f"section family {family!r} is unknown; choose one of {', '.join(PARAMETERS)}")
    values = np.asarray(values, float)
    names = PARAMETERS[family]
    require(values.shape == (len(names),), UsageError, f"section {family}: {values.shape} values; it has {len(names)}: {', '.join(names)}")
    require(math.isfinite(sigma_m) and sigma_m > 0, UsageError, f"sigma is {sigma_m} m; it must be positive")
    require(is_section(family, values), UsageError, f"section {family}: {dict(zip(names, values.tolist(), strict=True))} m make no section")
    return values


def is_section(family: str, values: FloatArray) -> bool:
    """Whether the dimensions are finite and every face has a positive length."""
    return bool(np.isfinite(values).all() and (values > 0).all() and (face_lengths(family, values) > 0).all())


def _checked_weight(family: str, face_weight: FloatArray | None) -> FloatArray:
    names = faces(family)
    if face_weight is None:
        return np.ones(len(names))
    weight = np.asarray(face_weight, float)
    require(weight.shape == (len(names),), UsageError, f"section {family}: {weight.shape} face weights; it has {len(names)} faces")
    require(bool((weight >= 0).all() and weight.any()), UsageError, f"section {family}: face weights must be >= 0 and not all zero")
    return weight


@jit
def _straight_terms(
    points: FloatArray,
    x_factors: FloatArray,
    y_factors: FloatArray,
    x_lines: FloatArray,
    y_lines: FloatArray,
    edges: IntArray,
    share: FloatArray,
    parts: FloatArray,
    sigma: float,
    slots: int,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """p, and the derivatives of log p by the point, by the dimensions (at fixed normalisation) and by the log weight of each face."""
    n, n_values, n_x = len(points), x_factors.shape[1], len(x_lines)
    n_lines = n_x + len(y_lines)
    p, d_point = np.zeros(n), np.zeros((n, 2))
    d_values, by_face = np.zeros((n, n_values)), np.zeros((n, slots))
    z, density, slope, tail, by_line = np.zeros(n_lines), np.zeros(n_lines), np.zeros(n_lines), np.zeros(n_lines), np.zeros(n_lines)
    for i in range(n):
        by_line[:] = 0
        total = 0.0
        for j in range(len(parts)):
            for k in range(n_lines):
                z[k] = ((points[i, 0] - x_lines[k]) if k < n_x else (points[i, 1] - y_lines[k - n_x])) / sigma
                density[k], slope[k], tail[k] = kernel_at(z[k], parts[j, 1], parts[j, 2])
            for e in range(len(edges)):
                own = n_x if edges[e, 0] == 1 else 0
                across = n_x - own
                line, low, high = own + edges[e, 1], across + edges[e, 2], across + edges[e, 3]
                if density[line] == 0.0 and slope[line] == 0.0:
                    continue
                weight = parts[j, 0] * share[e] / sigma
                # the low end has the larger coordinate to go: z falls from the low end to the high one
                mass = mass_between(z[high], tail[high], z[low], tail[low])
                term = weight * density[line] * mass
                total += term
                if slots:
                    by_face[i, e] += term
                by_line[line] -= weight * slope[line] * mass / sigma
                by_line[low] -= weight * density[line] * density[low] / sigma
                by_line[high] += weight * density[line] * density[high] / sigma
        p[i] = total
        if total <= 0.0:
            continue
        for k in range(n_lines):
            g = by_line[k] / total
            axis = 0 if k < n_x else 1
            d_point[i, axis] -= g  # moving every line one way is moving the point the other
            for m in range(n_values):
                d_values[i, m] += g * (x_factors[k, m] if axis == 0 else y_factors[k - n_x, m])
        for e in range(slots):
            by_face[i, e] /= total
    return p, d_point, d_values, by_face


def _round_terms(
    points: FloatArray, family: str, values: FloatArray, sigma: float, parts: FloatArray, share: FloatArray, slots: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """As `_straight_terms`, for one or two circles."""
    n, circles = len(points), len(share)
    radii = radius_factors(family)
    r = np.hypot(points[:, 0], points[:, 1])
    p, by_r, by_radius, by_face = np.zeros(n), np.zeros(n), np.zeros((n, circles)), np.zeros((n, circles))
    for c, radius in enumerate(radii @ values):
        for w, h, s in parts:
            spread = sigma * math.sqrt(s * s + h * h / 3)
            x = r * radius / spread**2
            bessel = i0e(x)
            log_slope = i1e(x) / bessel - 1.0  # of i0e
            density, slope = _kernel_array((r - radius) / sigma, h, s)
            # share x length of the circle x Rice's factor; with a Gaussian kernel_at this is the exact density
            factor = w * share[c] * 2 * math.pi * radius * bessel / (math.sqrt(2 * math.pi) * spread) / sigma
            term = factor * density
            p += term
            by_face[:, c] += term
            by_r += factor * (slope / sigma + density * log_slope * radius / spread**2)
            by_radius[:, c] += factor * (-slope / sigma + density * (log_slope * r / spread**2 + 1 / radius))
    safe = np.where(p > 0, p, 1.0)
    direction = points / np.where(r > 0, r, 1.0)[:, None]
    d_point = (by_r / safe)[:, None] * direction
    return p, d_point, (by_radius / safe[:, None]) @ radii, (by_face / safe[:, None])[:, :slots]


@jit
def _kernel_array(z: FloatArray, h: float, s: float) -> tuple[FloatArray, FloatArray]:
    density, slope = np.empty(len(z)), np.empty(len(z))
    for i in range(len(z)):
        density[i], slope[i], _ = kernel_at(z[i], h, s)
    return density, slope


# ------------------------------------------------------------------ expected information


@dataclass(frozen=True, eq=False, kw_only=True)
class Information(Value):
    """Expected Fisher information of ONE point. names : of the rows: the dimensions, roll (rad), cx, cy (m), log_sigma, then log_weight of faces."""

    names: tuple[str, ...]
    matrix: FloatArray

    def sd(self, n_points: int, known: tuple[str, ...] = ()) -> Mapping[str, float]:
        """Cramer-Rao bound on the standard deviation of every unknown from n points, the `known` ones fixed; inf where the data do not tell."""
        rows = [i for i, name in enumerate(self.names) if name not in known]
        scale = np.sqrt(np.maximum(np.diag(self.matrix)[rows], _TINY))
        value, vector = np.linalg.eigh(self.matrix[np.ix_(rows, rows)] / np.outer(scale, scale))
        blind = value < 1e-10
        inverse = np.where(blind, 0, 1 / np.where(blind, 1, value))
        variance = (vector**2) @ inverse / scale**2 / n_points
        variance[((vector[:, blind] ** 2) > 1e-6).any(1)] = np.inf
        return {self.names[row]: float(math.sqrt(v)) for row, v in zip(rows, variance, strict=True)}


def information(
    family: str, values: FloatArray, sigma_m: float, noise: str = "gaussian", face_weight: FloatArray | None = None, *, free_weights: bool = False
) -> Information:
    """Expected Fisher information of one point of a section, by quadrature over the plane; with `free_weights` the weights are unknowns too.

    Raises UsageError as `log_density`.
    """
    values = _checked(family, values, sigma_m)
    weight = _checked_weight(family, face_weight)
    points, area = _quadrature(family, values, sigma_m)
    density = log_density(points, family, values, sigma_m, noise, weight)
    x, y = points.T
    roll = density.d_point[:, 0] * y - density.d_point[:, 1] * x  # turning the section by +roll turns the point by -roll in its frame
    columns = [density.d_values, roll[:, None], -density.d_point, density.d_log_sigma[:, None]]
    names = (*PARAMETERS[family], "roll", "cx", "cy", "log_sigma")
    if free_weights:
        used = np.flatnonzero(weight > 0)[1:]  # only ratios count: the first is the unit
        columns.append(density.d_log_weight[:, used])
        names += tuple(f"log_weight_{faces(family)[i]}" for i in used)
    scores = np.concatenate(columns, 1)
    mass = np.exp(density.logp) * area
    return Information(names=names, matrix=(scores * mass[:, None]).T @ scores)


def _quadrature(family: str, values: FloatArray, sigma: float) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights that resolve the density: Gauss-Legendre panels of half a sigma around every line (or circle), one panel between."""
    if family in ROUND:
        radii = face_lengths(family, values) / (2 * math.pi)
        r, w = _panels(radii, sigma, lowest=0.0)
        angle = 2 * math.pi * np.arange(16) / 16  # the scores hold harmonics up to 1, their products up to 2
        points = np.stack([np.multiply.outer(r, np.cos(angle)), np.multiply.outer(r, np.sin(angle))], -1)
        return points.reshape(-1, 2), np.repeat(w * r * 2 * math.pi / 16, 16)
    outline = _outline(family)
    x, wx = _panels(outline.x @ values, sigma)
    y, wy = _panels(outline.y @ values, sigma)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    return points, np.multiply.outer(wx, wy).ravel()


def _panels(lines: FloatArray, sigma: float, lowest: float = -math.inf) -> tuple[FloatArray, FloatArray]:
    near = np.arange(-8, 8.01, 0.5) * sigma
    breaks = np.unique(np.maximum(np.add.outer(np.sort(lines), near).ravel(), lowest))
    breaks = np.concatenate([breaks[:1], breaks[1:][np.diff(breaks) > 1e-9 * sigma]])
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half = np.diff(breaks) / 2
    middle = (breaks[1:] + breaks[:-1]) / 2
    return (middle[:, None] + half[:, None] * nodes).ravel(), (half[:, None] * weights).ravel()
