"""The source thesis's own informed shape estimation (section 3.3.9, eq 3.1-3.3, as corrected): a known section fitted to closest points.

It is the baseline of every table. On walls as thin as the noise it is biased: a point belongs to the face nearest to it, not to the one it came
from, so that walls come out thick and legs long; and it says nothing of how far to trust a dimension. A leg that starts too long stays too long,
for no point is nearest to its toe: start short.

    3.1   C = sum_i rho(|p_i - proj_i|)                 rho: Huber's, the thesis says "robust"
    3.2   proj_i = argmin |p_i - q|, q on the section with n_i . n_q >= tau     where normals are known, else over all of it
    3.3   step -(J^T J + lambda D)^-1 J^T r             Newton on the gradient of C, damped (Levenberg, Marquardt); not on C = 0

Iterated along the long axis: the section is fitted to all points first, then to each of some slabs, and the slabs' median is the result.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, UsageError, require
from scan2fea.kernel.section_likelihood import is_section
from scan2fea.kernel.sections import PARAMETERS, ROUND, corner_factors
from scan2fea.options import option
from scan2fea.types import FloatArray, Value

_HUBER = 1.345  # scales of the residuals: 95 % efficient for Gaussian noise
_MIN_SLAB = 50


@dataclass(frozen=True, kw_only=True)
class ClosestPointOptions:
    max_iterations: int = option(60, "Steps of eq 3.3 at most", minimum=1)
    tolerance: float = option(1e-9, "Ends when a step is below this part of the section", minimum=0.0)
    slabs: int = option(8, "Stretches along the axis that are fitted one by one", minimum=1, maximum=100)
    tau: float = option(0.5, "Least cosine between the normal of a point and of the face it may belong to", minimum=-1.0, maximum=1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class ClosestPointFit(Value):
    """values : dimension -> metres, median of the slabs.   pose : (3,) x, y (m) and roll (rad) of the section in the plane of the points.

    slabs : (k, p) dimensions of each slab.   rms_m : of the distances of all points.   converged, n_iterations : of the fit to all points.
    """

    family: str
    values: Mapping[str, float]
    pose: FloatArray
    slabs: FloatArray
    rms_m: float
    converged: bool
    n_iterations: int


def closest_point(
    points: FloatArray,
    family: str,
    start: Mapping[str, float],
    pose: FloatArray | None = None,
    normals: FloatArray | None = None,
    options: ClosestPointOptions = ClosestPointOptions(),
) -> ClosestPointFit:
    """Fit a section of known family to points (n, 3) of a member whose axis is z.

    start : dimensions to begin with, m.   pose : (3,) x, y, roll of the section's frame to begin with.   normals : (n, 3) outward, or None.
    Raises UsageError for an unknown family or an impossible start, InputError for fewer than 50 points.
    """
    require(family in PARAMETERS, UsageError, f"section family {family!r} is unknown; choose one of {', '.join(PARAMETERS)}")
    require(len(points) >= _MIN_SLAB, InputError, f"{len(points)} points are too few for a section: at least {_MIN_SLAB}")
    theta = np.array([*(float(start[name]) for name in PARAMETERS[family]), *(np.zeros(3) if pose is None else pose)])
    require(is_section(family, theta[:-3]), UsageError, f"section {family}: {dict(start)} m make no section to start from")
    flat = None if normals is None else normals[:, :2]
    theta, n_iterations, converged = _fitted(points[:, :2], flat, family, theta, options)
    order = np.argsort(points[:, 2], kind="stable")
    n_slabs = max(1, min(options.slabs, len(points) // _MIN_SLAB))
    found = []
    for rows in np.array_split(order, n_slabs):
        found.append(_fitted(points[rows, :2], None if flat is None else flat[rows], family, theta, options)[0][:-3])
    slabs = np.array(found)
    distance = _residuals(points[:, :2], flat, family, theta, options.tau)[0]
    return ClosestPointFit(
        family=family,
        values=dict(zip(PARAMETERS[family], np.median(slabs, axis=0).tolist(), strict=True)),
        pose=theta[-3:],
        slabs=slabs,
        rms_m=float(np.sqrt(np.mean(distance**2))),
        converged=converged,
        n_iterations=n_iterations,
    )


def _fitted(xy: FloatArray, normals: FloatArray | None, family: str, theta: FloatArray, options: ClosestPointOptions) -> tuple[FloatArray, int, bool]:
    """Plain least squares first (a robust cost alone would take the points of a misplaced toe for strays and leave it there), then Huber's."""
    theta, before, _ = _descended(xy, normals, family, theta, options, math.inf)
    scale = 1.4826 * float(np.median(np.abs(_residuals(xy, normals, family, theta, options.tau)[0])))
    theta, n_iterations, converged = _descended(xy, normals, family, theta, options, scale)
    return theta, before + n_iterations, converged


def _descended(
    xy: FloatArray, normals: FloatArray | None, family: str, theta: FloatArray, options: ClosestPointOptions, scale_m: float
) -> tuple[FloatArray, int, bool]:
    """Eq 3.3 until the step is nothing against the section."""
    size, damping = float(theta[:-3].max()), 1e-3
    residual, slope = _residuals(xy, normals, family, theta, options.tau)
    cost, weight = _huber(residual, scale_m)
    for iteration in range(options.max_iterations):
        gradient, curvature = slope.T @ (weight * residual), (slope * weight[:, None]).T @ slope
        scale = np.maximum(np.diag(curvature), 1e-12 * max(float(np.diag(curvature).max()), 1e-300))
        for _ in range(12):
            trial = theta - np.linalg.solve(curvature + damping * np.diag(scale), gradient)
            if is_section(family, trial[:-3]):
                there, there_slope = _residuals(xy, normals, family, trial, options.tau)
                if _huber(there, scale_m)[0] <= cost:
                    break
            damping *= 10
        else:
            return theta, iteration, True
        moved = float(np.abs(np.r_[trial[:-1] - theta[:-1], size * (trial[-1] - theta[-1])]).max())
        theta, residual, slope, damping = trial, there, there_slope, max(damping * 0.2, 1e-12)
        cost, weight = _huber(residual, scale_m)
        if moved < options.tolerance * size or cost == 0:
            return theta, iteration + 1, True
    return theta, options.max_iterations, False


def _huber(residual: FloatArray, scale: float) -> tuple[float, FloatArray]:
    """Cost and weights of eq 3.1; an infinite scale gives plain squares."""
    if math.isinf(scale):
        return 0.5 * float(residual @ residual), np.ones(len(residual))
    limit = max(_HUBER * scale, 1e-300)
    away = np.abs(residual)
    cost = np.where(away <= limit, 0.5 * away**2, limit * (away - 0.5 * limit))
    return float(cost.sum()), np.where(away <= limit, 1.0, limit / np.maximum(away, 1e-300))


def _residuals(xy: FloatArray, normals: FloatArray | None, family: str, theta: FloatArray, tau: float) -> tuple[FloatArray, FloatArray]:
    """Signed distances (n,) to the closest allowed place on the outline (eq 3.2) and their derivatives (n, p + 3)."""
    values, (x, y, roll) = theta[:-3], theta[-3:]
    c, s = math.cos(roll), math.sin(roll)
    R = np.array([[c, s], [-s, c]])
    u = (xy - np.array([x, y])) @ R.T
    facing = None if normals is None else normals @ R.T
    if family in ROUND:
        distance, out, by_values = _round(u, facing, family, values, tau)
    else:
        distance, out, by_values = _straight(u, facing, family, values, tau)
    by_roll = out[:, 0] * u[:, 1] - out[:, 1] * u[:, 0]
    return distance, np.column_stack([by_values, -(out @ R), by_roll])


def _straight(u: FloatArray, facing: FloatArray | None, family: str, values: FloatArray, tau: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    best = np.full(len(u), np.inf)
    distance, out, by_values = np.zeros(len(u)), np.zeros((len(u), 2)), np.zeros((len(u), len(values)))
    for factors in corner_factors(family):
        corners = factors @ values
        for i in range(len(corners)):
            j = (i + 1) % len(corners)
            way = corners[j] - corners[i]
            outward = np.array([way[1], -way[0]]) / np.linalg.norm(way)
            t = np.clip((u - corners[i]) @ way / (way @ way), 0.0, 1.0)
            away = u - corners[i] - t[:, None] * way
            length = np.linalg.norm(away, axis=1)
            closer = length < best if facing is None else (length < best) & (facing @ outward >= tau)
            side = np.where(away @ outward >= 0, 1.0, -1.0)
            square = (t > 0) & (t < 1)
            direction = np.where((square | (length < 1e-15))[:, None], outward, side[:, None] * away / np.maximum(length, 1e-300)[:, None])
            moved = (1 - t)[:, None, None] * factors[i] + t[:, None, None] * factors[j]
            best[closer] = length[closer]
            distance[closer], out[closer] = (side * length)[closer], direction[closer]
            by_values[closer] = -np.einsum("na,nap->np", direction, moved)[closer]
    return distance, out, by_values


def _round(u: FloatArray, facing: FloatArray | None, family: str, values: FloatArray, tau: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    r = np.linalg.norm(u, axis=1)
    radial = u / np.maximum(r, 1e-300)[:, None]
    outer = r - values[0] / 2
    by_values = np.zeros((len(u), len(values)))
    by_values[:, 0] = -0.5
    if family == "round":
        return outer, radial, by_values
    inner = values[0] / 2 - values[1] - r
    near_inner = np.abs(inner) < np.abs(outer)
    if facing is not None:
        cosine = np.einsum("ij,ij->i", facing, radial)
        near_inner = np.where(cosine >= tau, False, np.where(cosine <= -tau, True, near_inner))
    by_values[near_inner] = [0.5, -1.0]
    return np.where(near_inner, inner, outer), np.where(near_inner[:, None], -radial, radial), by_values
