"""Iterative closest point: point to plane, the plane between the two normals (generalised), trimmed and robust.

Linearisation about the centre of the matched points keeps the system well scaled in any unit; the motion found is that of the left increment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.transforms import applied, quaternion_to_matrix, rigid, rotated
from scan2fea.options import option
from scan2fea.registration.surface import Surface, nearest
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

LEAST_PAIRS = 20
_FACING = 0.6  # cosine between matched normals: 53 degrees
_MAD = 1.4826
_TUKEY = 4.685  # 95 % efficiency for Gaussian residuals


@dataclass(frozen=True, kw_only=True)
class IcpOptions:
    """Lengths in edges of the voxels."""

    iterations: int = option(80, "At most so many steps.", minimum=1)
    first_reach: float = option(4.0, "Points farther apart than this are not matched at first.", unit="edges", minimum=0.5)
    last_reach: float = option(1.5, "The same at the end.", unit="edges", minimum=0.5)
    first_scale: float = option(
        0.5, "Standard deviation that the robust weight starts from; it closes to that of the residuals", unit="edges", minimum=0.0
    )
    settled: float = option(
        0.02, "A step below this lets the scale close further; above it at the end, nothing has settled", unit="edges", minimum=0.0
    )
    converged: float = option(1e-4, "Stop when a step moves the points by less.", unit="edges", minimum=0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Pairs(Value):
    """Matched rows: point of the moved source, its point of the target, the signed distance across and the direction of that."""

    source: IntArray
    target: IntArray
    moved: FloatArray
    normal: FloatArray
    normal_source: FloatArray
    normal_target: FloatArray
    across_m: FloatArray

    _ROWS = (("source", "target", "moved", "normal", "normal_source", "normal_target", "across_m"),)


@dataclass(frozen=True, eq=False, kw_only=True)
class IcpResult(Value):
    """T_target_source : (4, 4).   scale_m : robust standard deviation of the distances across.   n_pairs : matched at the end."""

    T_target_source: FloatArray
    converged: bool
    iterations: int
    scale_m: float
    n_pairs: int


def pairs_of(source: Surface, target: Surface, tree: cKDTree, T_target_source: FloatArray, reach_m: float) -> Pairs:
    """Each source point with its nearest target point within reach, where both were seen from the same side and their normals agree."""
    moved = applied(T_target_source, source.points)
    distance, near = nearest(tree, moved, reach_m)
    rows = np.flatnonzero(np.isfinite(distance))
    near = near[rows]
    own, other = rotated(T_target_source, source.normals[rows]), target.normals[near]
    cosine = np.einsum("nc,nc->n", own, other)
    both = source.is_seen[rows] & target.is_seen[near]
    own = np.where(((cosine < 0) & ~both)[:, None], -own, own)
    cosine = np.where(both, cosine, np.abs(cosine))
    keep = cosine > _FACING
    rows, near, own, other = rows[keep], near[keep], own[keep], other[keep]
    normal = own + other
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    across = np.einsum("nc,nc->n", moved[rows] - target.points[near], normal)
    return Pairs(source=rows, target=near, moved=moved[rows], normal=normal, normal_source=own, normal_target=other, across_m=across)


def icp(source: Surface, target: Surface, tree: cKDTree, T_start: FloatArray, options: IcpOptions = IcpOptions()) -> IcpResult:
    """Refine a motion that brings the source within a few edges of the target.

    Few pairs end it as not converged, never an error: what does not overlap cannot be registered, and the caller judges by the result.
    """
    edge = max(source.edge_m, target.edge_m)
    T, reach, widest = np.array(T_start, float), options.first_reach * edge, options.first_scale * edge
    scale, n, step, ending = math.nan, 0, math.inf, False
    for iteration in range(1, options.iterations + 1):
        pairs = pairs_of(source, target, tree, T, reach)
        n = len(pairs.across_m)
        if n < LEAST_PAIRS:
            return IcpResult(T_target_source=T, converged=False, iterations=iteration, scale_m=math.nan, n_pairs=n)
        scale = max(robust_scale(pairs.across_m), 1e-6 * edge)
        # the few points that tell a slide lie far off at first: a scale from the many that do not would give them no weight
        increment, step = solve(pairs, tukey(pairs.across_m, max(scale, widest)))
        T = increment @ T
        ending = widest <= scale and reach <= options.last_reach * edge
        if step < options.converged * edge and ending:
            break
        if step < 0.1 * max(widest, options.settled * edge):
            reach, widest = max(options.last_reach * edge, 0.7 * reach), 0.6 * widest
    done = step < options.settled * edge and ending
    return IcpResult(T_target_source=orthonormal(T), converged=bool(done), iterations=iteration, scale_m=scale, n_pairs=n)


def robust_scale(residual: FloatArray) -> float:
    """Standard deviation of a Gaussian of the same median absolute residual."""
    return float(_MAD * np.median(np.abs(residual)))


def tukey(residual: FloatArray, scale: float | FloatArray) -> FloatArray:
    """Weights of Tukey's biweight: 0 beyond 4.685 standard deviations, one for all or one each."""
    u = np.clip(residual / (_TUKEY * scale), -1.0, 1.0)
    return np.asarray((1.0 - u * u) ** 2)


def jacobian(points: FloatArray, normals: FloatArray, centre: FloatArray) -> FloatArray:
    """(n, 6) derivative of the distance across by (rotation vector about the centre, translation)."""
    return np.concatenate([np.cross(points - centre, normals), normals], axis=1)


def solve(pairs: Pairs, weight: FloatArray) -> tuple[FloatArray, float]:
    """The motion of one step, and the rms distance by which it moves the matched points."""
    centre = pairs.moved.mean(axis=0)
    size = max(float(np.sqrt(((pairs.moved - centre) ** 2).sum(axis=1).mean())), 1e-300)
    J = jacobian((pairs.moved - centre) / size, pairs.normal, np.zeros(3))  # rotations in units of size: one scale for all six
    A = J.T @ (J * weight[:, None])
    b = -J.T @ (weight * pairs.across_m)
    # directions without information (a plane slides) are not moved along: eigenvalues below rounding of the largest are dropped
    values, axes = np.linalg.eigh(A)
    usable = values > 1e-9 * max(float(values[-1]), 1e-300)
    x = axes[:, usable] @ ((axes[:, usable].T @ b) / values[usable])
    turn = x[:3] / size
    R = quaternion_to_matrix([*(0.5 * turn), 1.0])  # Cayley: a proper rotation whatever the size of the step
    T = rigid(R, centre + x[3:] - R @ centre)
    moved_by = applied(T, pairs.moved) - pairs.moved
    return T, float(np.sqrt((moved_by**2).sum(axis=1).mean()))


def orthonormal(T: FloatArray) -> FloatArray:
    """The rigid motion nearest to one that rounding has bent."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    return rigid(U @ Vt, T[:3, 3])


def is_facing(pairs: Pairs) -> BoolArray:
    """Rows whose normals agree within 18 degrees."""
    return np.asarray(np.einsum("nc,nc->n", pairs.normal_source, pairs.normal_target) > 0.95)
