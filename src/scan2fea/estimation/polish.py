"""Where the noise is small against the walls: every point belongs to one face, and the faces follow by weighted least squares.

Points that belong to no face within Tukey's biweight (fillets, weld beads, stray points) do not count. The reach shrinks from the noise of the
likelihood to that of the residuals, so exact data end at an exact section, where the likelihood itself has no maximum (sigma -> 0).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.likelihood import SectionModel, bounds
from scan2fea.estimation.uncertainty import covariance_of
from scan2fea.kernel.section_likelihood import is_section, lines_of
from scan2fea.kernel.sections import ROUND
from scan2fea.types import FloatArray, IntArray, Value

_TUKEY = 4.685  # 95 % efficient for Gaussian noise
_EFFICIENCY = 0.95
_MAD_TO_SIGMA = 1.4826
_ROUNDS = 60
_SHRINK = 0.5  # of the reach from round to round at most
_FLOOR = 1e-10  # of the section's size: no coordinate is better than that


@dataclass(frozen=True, eq=False, kw_only=True)
class Polished(Value):
    """theta : the layout's unknowns (log_sigma is that of the residuals).   covariance : (q, q), zero where the faces do not tell.

    n_used : points with weight.   per_face : (f,) points of each face.
    """

    theta: FloatArray
    covariance: FloatArray
    n_used: int
    per_face: IntArray
    converged: bool


def polished(model: SectionModel, theta: FloatArray, size_m: float, held: Mapping[str, float] | None = None) -> Polished:
    """Weighted least squares of the distances to the faces from a theta that is right within a few sigma.

    Dimensions whose faces hold no points keep their value. Does not converge (and says so) where a step would make no section, or one that is out of
    all proportion to the points.
    """
    layout = model.layout
    lower, upper = (limit[: layout.n_values] for limit in bounds(layout, size_m))
    moving = [i for i, name in enumerate(layout.names) if not name.startswith(("log", "weight")) and name not in (held or {})]
    reach = _TUKEY * layout.sigma(theta)
    floor = _FLOOR * size_m
    here = theta.copy()
    face: IntArray = np.full(len(model.xy), -1, np.int64)
    for _ in range(_ROUNDS):
        residual, face, rows = _residuals(model, here, reach)
        used = np.flatnonzero(face >= 0)
        if len(used) < 2 * len(moving):
            return _failed(model, theta, face)
        weight = np.square(1 - np.square(residual[used] / reach))
        jacobian = rows[used][:, moving]
        step = _solved(jacobian * weight[:, None], jacobian, residual[used])
        trial = here.copy()
        trial[moving] -= step
        values = layout.values(trial)
        if not is_section(layout.family, values) or (values < lower).any() or (values > upper).any():
            return _failed(model, theta, face)
        here = trial
        spread = _MAD_TO_SIGMA * float(np.median(np.abs(residual[used])))
        new_reach = max(_TUKEY * spread, _SHRINK * reach, _TUKEY * floor)
        still = float(np.abs(step).max()) < 1e-13 * size_m + 1e-4 * spread / math.sqrt(len(used))
        if still and new_reach >= 0.999 * reach:
            break
        reach = min(reach, new_reach)
    sigma = max(reach / _TUKEY, floor)
    at = layout.place["log_sigma"]
    here[at] = math.log(sigma)
    residual, face, rows = _residuals(model, here, reach)
    hit = face >= 0
    covariance = np.zeros((len(theta), len(theta)))
    covariance[np.ix_(moving, moving)] = _inverse(rows[hit][:, moving]) * sigma**2 / _EFFICIENCY
    covariance[at, at] = 1 / (2 * max(int(hit.sum()), 1))
    return Polished(theta=here, covariance=covariance, n_used=int(hit.sum()), per_face=_count(face, model), converged=True)


def _failed(model: SectionModel, theta: FloatArray, face: IntArray) -> Polished:
    nothing = np.zeros((len(theta), len(theta)))
    return Polished(theta=theta, covariance=nothing, n_used=int((face >= 0).sum()), per_face=_count(face, model), converged=False)


def _inverse(jacobian: FloatArray) -> FloatArray:
    """Inverse of J'J; zero for unknowns that it does not tell."""
    covariance, _, _ = covariance_of(jacobian.T @ jacobian, np.ones(jacobian.shape[1], bool))
    return covariance


def _count(face: IntArray, model: SectionModel) -> IntArray:
    n_faces = len(lines_of(model.layout.family)[0]) if model.layout.family not in ROUND else model.layout.n_values
    return np.bincount(face[face >= 0], minlength=n_faces).astype(np.int64)


def _solved(weighted: FloatArray, jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    """Least squares by the normal equations in units of the columns; directions without information stay put."""
    matrix = weighted.T @ jacobian
    unit = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    value, vector = np.linalg.eigh(matrix * np.outer(unit, unit))
    told = value > 1e-10 * max(value.max(), 1e-300)
    inverse = np.where(told, 1 / np.where(told, value, 1), 0)
    return np.asarray(unit * (vector @ (inverse * (vector.T @ (unit * (weighted.T @ residual))))))


def _residuals(model: SectionModel, theta: FloatArray, reach: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Distance of each point to its face, the face (-1: none within reach), and the derivatives of the distance by the unknowns."""
    layout = model.layout
    u = model.in_section(theta)
    values = layout.values(theta)
    distance, face, normal, by_values = (_to_circles if layout.family in ROUND else _to_edges)(layout.family, u, values, reach)
    rows = np.zeros((len(u), len(layout.names)))
    model.placement_scores(rows, theta, u, normal)
    rows[:, : layout.n_values] = by_values
    return distance, face, rows


def _to_edges(family: str, u: FloatArray, values: FloatArray, reach: float) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    axes, lines, low, high = lines_of(family)
    best, face = np.full(len(u), np.inf), np.full(len(u), -1)
    signed = np.zeros(len(u))
    for e, axis in enumerate(axes):
        d = u[:, axis] - lines[e] @ values
        along = u[:, 1 - axis]
        inside = (along > low[e] @ values - reach) & (along < high[e] @ values + reach)
        nearer = inside & (np.abs(d) < np.minimum(best, reach))
        best[nearer], face[nearer], signed[nearer] = np.abs(d[nearer]), e, d[nearer]
    normal = np.zeros((len(u), 2))
    hit = face >= 0
    normal[hit, axes[face[hit]]] = 1.0
    by_values = np.where(hit[:, None], -lines[face], 0.0)
    return signed, face, normal, by_values


def _to_circles(family: str, u: FloatArray, values: FloatArray, reach: float) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    factors = np.array([[0.5, 0.0], [0.5, -1.0]])[: len(values), : len(values)]
    r = np.maximum(np.hypot(*u.T), 1e-300)
    radii = factors @ values
    d = r[:, None] - radii - (reach / _TUKEY) ** 2 / (2 * radii)  # noise along a circle moves points outward: their mean radius, to second order
    nearest = np.abs(d).argmin(1)
    signed = d[np.arange(len(u)), nearest]
    face = np.where(np.abs(signed) < reach, nearest, -1)
    return signed, face, u / r[:, None], -factors[nearest]
