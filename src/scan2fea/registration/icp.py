"""Iterative closest point: point to plane, the plane between the two normals (generalised), trimmed and robust.

Linearisation about the centre of the matched points keeps the system well scaled in any unit; the motion found is that of the left increment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.kernel.near_tree import NearTree
from scan2fea.kernel.transforms import quaternion_to_matrix, rigid
from scan2fea.options import option
from scan2fea.registration.pairing import Pairs, Partners
from scan2fea.registration.surface import Surface
from scan2fea.types import BoolArray, FloatArray, Value

LEAST_PAIRS = 20
_COARSE = 1_500  # points of the source until the first reach has settled
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
    converged: float = option(1e-3, "Stop when a step moves the points by less.", unit="edges", minimum=0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class IcpResult(Value):
    """T_target_source : (4, 4).   scale_m : robust standard deviation of the distances across.   n_pairs : matched at the end."""

    T_target_source: FloatArray
    converged: bool
    iterations: int
    scale_m: float
    n_pairs: int


def icp(source: Surface, target: Surface, tree: NearTree, T_start: FloatArray, options: IcpOptions = IcpOptions()) -> IcpResult:
    """Refine a motion that brings the source within a few edges of the target.

    Few pairs end it as not converged, never an error: what does not overlap cannot be registered, and the caller judges by the result.
    """
    edge = max(source.edge_m, target.edge_m)
    T, reach, widest = np.array(T_start, float), options.first_reach * edge, options.first_scale * edge
    scale, n, step, ending = math.nan, 0, math.inf, False
    few = source.few(np.arange(0, len(source), max(1, len(source) // _COARSE)))
    partners, is_coarse = Partners(few, target, tree), len(few) < len(source)
    for iteration in range(1, options.iterations + 1):
        _, found, across = partners.under(T, reach)
        n = len(across)
        if n < LEAST_PAIRS:
            return IcpResult(T_target_source=T, converged=False, iterations=iteration, scale_m=math.nan, n_pairs=n)
        scale = max(robust_scale(across), 1e-6 * edge)
        # the few points that tell a slide lie far off at first: a scale from the many that do not would give them no weight
        increment, step = solved(found, across, max(scale, widest))
        T = increment @ T
        ending = widest <= scale and reach <= options.last_reach * edge
        if step < options.converged * edge and ending:
            break
        if step < 0.1 * max(widest, options.settled * edge):
            if is_coarse:
                partners, is_coarse = Partners(source, target, tree), False
                continue
            reach, widest = max(options.last_reach * edge, 0.7 * reach), 0.6 * widest
    done = step < options.settled * edge and ending
    return IcpResult(T_target_source=orthonormal(T), converged=bool(done), iterations=iteration, scale_m=scale, n_pairs=n)


def robust_scale(residual: FloatArray) -> float:
    """Standard deviation of a Gaussian of the same median absolute residual."""
    size, half = np.abs(residual), (len(residual) - 1) // 2
    return float(_MAD * np.partition(size, [half, len(size) // 2])[[half, len(size) // 2]].mean())


def tukey(residual: FloatArray, scale: float | FloatArray) -> FloatArray:
    """Weights of Tukey's biweight: 0 beyond 4.685 standard deviations, one for all or one each."""
    u = np.clip(residual / (_TUKEY * scale), -1.0, 1.0)
    return np.asarray((1.0 - u * u) ** 2)


def jacobian(points: FloatArray, normals: FloatArray, centre: FloatArray) -> FloatArray:
    """(n, 6) derivative of the distance across by (rotation vector about the centre, translation)."""
    return np.concatenate([np.cross(points - centre, normals), normals], axis=1)


def solved(found: FloatArray, across: FloatArray, scale: float) -> tuple[FloatArray, float]:
    """The motion of one step, and the rms distance by which it moves the matched points.

    found : (n, 6) moved points and the directions of their distances `across` (n,), which Tukey's biweight of `scale` weighs.
    """
    centre = found[:, :3].mean(axis=0)
    rows, spread = _weighted(found, across, centre, _TUKEY * scale)
    size = max(math.sqrt(float(np.trace(spread))), 1e-300)
    unit = np.array([1 / size] * 3 + [1.0] * 3)  # rotations in units of size: one scale for all six
    A = rows.T @ rows
    # directions without information (a plane slides) are not moved along: eigenvalues below rounding of the largest are dropped
    values, axes = np.linalg.eigh(A[:6, :6] * unit * unit[:, None])
    usable = values > 1e-9 * max(float(values[-1]), 1e-300)
    x = axes[:, usable] @ ((axes[:, usable].T @ (-A[:6, 6] * unit)) / values[usable])
    R = quaternion_to_matrix([*(0.5 * x[:3] / size), 1.0])  # Cayley: a proper rotation whatever the size of the step
    bent = R - np.eye(3)
    step = math.sqrt(max(float(np.trace(bent @ spread @ bent.T) + x[3:] @ x[3:]), 0.0))
    return rigid(R, centre + x[3:] - R @ centre), step


@jit_ieee
def _weighted(found: FloatArray, across: FloatArray, centre: FloatArray, reach: float) -> tuple[FloatArray, FloatArray]:
    """(n, 7) derivatives of the distances by (rotation vector about the centre, translation) and these, each times the root of its weight.

    Beside them the second moments (3, 3) of the points.
    """
    n, rows, spread = len(across), np.zeros((len(across), 7)), np.zeros((3, 3))
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        x, y, z = found[i, 0] - centre[0], found[i, 1] - centre[1], found[i, 2] - centre[2]
        xx, xy, xz, yy, yz, zz = xx + x * x, xy + x * y, xz + x * z, yy + y * y, yz + y * z, zz + z * z
        root = max(1.0 - (across[i] / reach) ** 2, 0.0)
        a, b, c = root * found[i, 3], root * found[i, 4], root * found[i, 5]
        rows[i, 0], rows[i, 1], rows[i, 2] = y * c - z * b, z * a - x * c, x * b - y * a
        rows[i, 3], rows[i, 4], rows[i, 5], rows[i, 6] = a, b, c, root * across[i]
    spread[0, 0], spread[1, 1], spread[2, 2] = xx / n, yy / n, zz / n
    spread[0, 1], spread[0, 2], spread[1, 2] = xy / n, xz / n, yz / n
    spread[1, 0], spread[2, 0], spread[2, 1] = spread[0, 1], spread[0, 2], spread[1, 2]
    return rows, spread


def orthonormal(T: FloatArray) -> FloatArray:
    """The rigid motion nearest to one that rounding has bent."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    return rigid(U @ Vt, T[:3, 3])


def is_facing(pairs: Pairs) -> BoolArray:
    """Rows whose normals agree within 18 degrees."""
    return np.asarray(np.einsum("nc,nc->n", pairs.normal_source, pairs.normal_target) > 0.95)
