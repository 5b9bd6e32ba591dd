"""Curves and surfaces given by their points become single Bezier pieces of the lowest degree that keeps a tolerance (Chebyshev collocation).

For smooth curves the error falls with the degree as a power, so that one piece of moderate degree is exact to rounding and has no inner joints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from scan2fea.errors import CadError, require
from scan2fea.types import FloatArray

DEGREES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 17, 20, 24)  # Open Cascade ends at 25
_LINES = np.array([0.0, 0.13, 0.38, 0.5, 0.71, 1.0])  # shares at which the degree along the other direction is chosen
_TESTED = 41  # places of a curve, and of either direction of a patch, at which the fit is measured


def bernstein(share: FloatArray, degree: int) -> FloatArray:
    """(m, degree + 1) values of the Bernstein polynomials."""
    k = np.arange(degree + 1)
    ways = np.array([math.comb(degree, i) for i in k], float)
    return np.asarray(ways * share[:, None] ** k * (1 - share[:, None]) ** (degree - k))


def nodes(degree: int) -> FloatArray:
    """(degree + 1,) Chebyshev places from 0 to 1, both included: neighbours that share a border share its curve."""
    return np.asarray((1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2)


def curve(at: Callable[[FloatArray], FloatArray], tolerance: float, least: int = 1) -> FloatArray:
    """(degree + 1, 3) control points, degree `least` or more. at : (m,) shares -> (m, 3).

    Raises CadError where the largest degree leaves the tolerance.
    """
    test = np.linspace(0, 1, _TESTED)
    true = at(test)
    for degree in (degree for degree in DEGREES if degree >= least):
        control = _controls(at(nodes(degree)), degree)
        if np.abs(bernstein(test, degree) @ (control - control[0]) + control[0] - true).max() <= tolerance:
            return control
    raise CadError(f"a curve bends too much for one Bezier piece within {tolerance:.3g} mm")


def patch(at: Callable[[FloatArray, FloatArray], FloatArray], tolerance: float) -> FloatArray:
    """(p + 1, q + 1, 3) control points. at : (m,) and (m,) shares along u and v -> (m, 3). Raises CadError as `curve`."""
    p = _degree([lambda s, w=w: at(s, np.full(len(s), w)) for w in _LINES], tolerance)  # type: ignore[misc]
    q = _degree([lambda s, w=w: at(np.full(len(s), w), s) for w in _LINES], tolerance)  # type: ignore[misc]
    u, v = (g.ravel() for g in np.meshgrid(nodes(p), nodes(q), indexing="ij"))
    values = at(u, v).reshape(p + 1, q + 1, 3)
    middle = values.mean(axis=(0, 1))  # coordinates far from the origin would lose digits in the fit
    control = np.linalg.solve(bernstein(nodes(p), p), (values - middle).reshape(p + 1, -1)).reshape(p + 1, q + 1, 3)
    control = np.linalg.solve(bernstein(nodes(q), q), control.transpose(1, 0, 2).reshape(q + 1, -1)).reshape(q + 1, p + 1, 3).transpose(1, 0, 2)
    test = np.linspace(0, 1, 17)
    u, v = (g.ravel() for g in np.meshgrid(test, test, indexing="ij"))
    made = np.einsum("mi,mj,ijc->mc", bernstein(u, p), bernstein(v, q), control) + middle
    off = float(np.abs(made - at(u, v)).max())
    require(off <= 4 * tolerance, CadError, f"a surface bends too much for one Bezier piece: {off:.3g} mm, {tolerance:.3g} mm is allowed")
    control += middle
    for i, j in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        control[i, j] = values[i, j]
    return np.asarray(control)


def _degree(lines: Sequence[Callable[[FloatArray], FloatArray]], tolerance: float) -> int:
    degree = 1
    for line in lines:
        degree = len(curve(line, tolerance, degree)) - 1
    return degree


def _controls(values: FloatArray, degree: int) -> FloatArray:
    middle = values.mean(axis=0)
    control = np.linalg.solve(bernstein(nodes(degree), degree), values - middle) + middle
    control[[0, -1]] = values[[0, -1]]
    return np.asarray(control)
