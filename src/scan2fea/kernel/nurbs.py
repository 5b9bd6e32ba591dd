"""Rational B-splines: curves and tensor-product surfaces, and the interpolation that gives neighbours the same border.

Thesis eq 2.16 to 2.18 as corrected (degree p, n + 1 control points, n + p + 2 knots; Piegl and Tiller, The NURBS Book, 1997, ch. 2 to 4):

    N_i,p(u)   Cox and de Boor's recursion                                          (2.16)
    R_i,p(u) = w_i N_i,p(u) / sum_j w_j N_j,p(u)                                    (2.17)
    C(u)     = sum_i R_i,p(u) P_i,   S(u, v) = sum_i sum_j R_i,j(u, v) P_i,j        (2.18)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.types import FloatArray, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class NurbsSurface(Value):
    """points : (n, m, 3) control points.   weights : (n, m) positive.   knots_u : (n + degree_u + 1,), knots_v : (m + degree_v + 1,) ascending."""

    points: FloatArray
    weights: FloatArray
    knots_u: FloatArray
    knots_v: FloatArray

    @property
    def degrees(self) -> tuple[int, int]:
        return len(self.knots_u) - self.points.shape[0] - 1, len(self.knots_v) - self.points.shape[1] - 1

    def at(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """(k, 3) points at parameters u, v (k,) inside the domain."""
        p, q = self.degrees
        a, b = basis(self.knots_u, p, u), basis(self.knots_v, q, v)
        weight = np.einsum("ki,ij,kj->k", a, self.weights, b)
        return np.asarray(np.einsum("ki,ij,ijc,kj->kc", a, self.weights, self.points, b) / weight[:, None])

    def normals(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """(k, 3) unit normals du x dv; nan where the surface has none."""
        p, q = self.degrees
        a, b = basis(self.knots_u, p, u), basis(self.knots_v, q, v)
        da, db = basis_slopes(self.knots_u, p, u), basis_slopes(self.knots_v, q, v)
        # quotient rule up to a positive factor: A' w - A w'
        top, weight = np.einsum("ki,ij,ijc,kj->kc", a, self.weights, self.points, b), np.einsum("ki,ij,kj->k", a, self.weights, b)
        tangent = [
            np.einsum("ki,ij,ijc,kj->kc", x, self.weights, self.points, y) * weight[:, None]
            - top * np.einsum("ki,ij,kj->k", x, self.weights, y)[:, None]
            for x, y in ((da, b), (a, db))
        ]
        cross = np.cross(tangent[0], tangent[1])
        return np.asarray(cross / np.linalg.norm(cross, axis=1, keepdims=True))


def basis(knots: FloatArray, degree: int, u: FloatArray) -> FloatArray:
    """(k, n) values of the n = len(knots) - degree - 1 basis functions at u (k,); the last interval is closed (eq 2.16).

    Raises InternalError for knots that fall, or u outside their domain.
    """
    n = len(knots) - degree - 1
    require(degree >= 0 and n > degree and bool((np.diff(knots) >= 0).all()), InternalError, f"{len(knots)} knots are none of degree {degree}")
    at = np.atleast_1d(np.asarray(u, float))
    low, high = float(knots[degree]), float(knots[n])
    require(bool(((at >= low) & (at <= high)).all()), InternalError, f"a parameter lies outside of [{low:g}, {high:g}]")
    span = np.clip(np.searchsorted(knots, at, side="right") - 1, degree, n - 1)
    # the interval of the upper end: the last one that is not empty
    span = np.where(at >= high, np.searchsorted(knots, high, side="left") - 1, span)
    values = np.zeros((len(at), len(knots) - 1))
    values[np.arange(len(at)), span] = 1.0
    for p in range(1, degree + 1):
        values = _raised(knots, p, at, values)
    return np.ascontiguousarray(values[:, :n])


def _raised(knots: FloatArray, p: int, at: FloatArray, lower: FloatArray) -> FloatArray:
    """Basis functions of degree p from those of degree p - 1; 0 / 0 counts as 0."""
    n = len(knots) - p - 1
    left, right = knots[p : p + n] - knots[:n], knots[p + 1 : p + 1 + n] - knots[1 : 1 + n]
    up = np.where(left > 0, (at[:, None] - knots[:n]) / np.where(left > 0, left, 1.0), 0.0)
    down = np.where(right > 0, (knots[p + 1 : p + 1 + n] - at[:, None]) / np.where(right > 0, right, 1.0), 0.0)
    return np.asarray(up * lower[:, :n] + down * lower[:, 1 : n + 1])


def basis_slopes(knots: FloatArray, degree: int, u: FloatArray) -> FloatArray:
    """(k, n) first derivatives of the basis functions."""
    n = len(knots) - degree - 1
    if degree == 0:
        return np.zeros((len(np.atleast_1d(u)), n))
    # functions of one degree less over the same knots; those of empty support at the ends are zero
    lower = np.zeros((len(np.atleast_1d(u)), n + 1))
    inner = basis(knots[1:-1], degree - 1, u) if knots[0] == knots[1] and knots[-1] == knots[-2] else None
    if inner is not None:
        lower[:, 1:n] = inner
    else:
        lower = basis(knots, degree - 1, u)[:, : n + 1]
    left, right = knots[degree : degree + n] - knots[:n], knots[degree + 1 : degree + 1 + n] - knots[1 : 1 + n]
    a = np.where(left > 0, degree / np.where(left > 0, left, 1.0), 0.0)
    b = np.where(right > 0, degree / np.where(right > 0, right, 1.0), 0.0)
    return np.asarray(a * lower[:, :n] - b * lower[:, 1 : n + 1])


def uniform_knots(n_points: int, degree: int) -> FloatArray:
    """Clamped knots over [0, 1] for interpolation at uniform parameters k / (n - 1), averaged (Piegl and Tiller eq 9.8)."""
    require(n_points > degree, InternalError, f"{n_points} points are too few for degree {degree}")
    at = np.linspace(0.0, 1.0, n_points)
    inner = [float(at[j : j + degree].mean()) for j in range(1, n_points - degree)]
    return np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


def interpolated(grid: FloatArray, degree: int = 3) -> NurbsSurface:
    """The surface through a grid (n, m, 3) of points, at uniform parameters in both directions.

    Its border curves depend on the border points alone: two patches that share these share the border to the last digits.
    """
    n, m = grid.shape[:2]
    knots_u, knots_v = uniform_knots(n, degree), uniform_knots(m, degree)
    a = np.linalg.inv(basis(knots_u, degree, np.linspace(0, 1, n)))
    b = np.linalg.inv(basis(knots_v, degree, np.linspace(0, 1, m)))
    points = np.einsum("in,nmc,jm->ijc", a, grid, b)
    points[[0, 0, -1, -1], [0, -1, 0, -1]] = grid[[0, 0, -1, -1], [0, -1, 0, -1]]
    return NurbsSurface(points=points, weights=np.ones((n, m)), knots_u=knots_u, knots_v=knots_v)
