"""All poses of a moving sensor at once, against planes and patches that are free themselves (as in Zhou et al. 2020, planes eliminated).

How evenly the sensor moves is learned: accelerations are Gaussian, and their standard deviation is that of largest likelihood given the sweeps
(expectation-maximisation: mean of their squares and variances). One sweep tells its place to millimetres; that the next hundred move on evenly
tells it to a fraction of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, csr_array
from scipy.spatial.transform import Rotation

from scan2fea.kernel.trajectories import between
from scan2fea.registration.borders import Ends, borders
from scan2fea.registration.icp import tukey
from scan2fea.registration.map_patches import blocks_of, map_surfaces, plane_terms
from scan2fea.registration.motion import stepped
from scan2fea.types import FloatArray, IntArray, Value

_LEARNED = 20  # steps of expectation-maximisation
_LEAST_FREEDOM = 1e-3  # of what a carrier can do: no motion is more even than this
_RIDGE = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class JointResult(Value):
    """T_world_knot : (k, 4, 4).   covariance : (6 k - 6, 6 k - 6) of turn (rad) and place (m) of all knots but the first.   used : of the points.
    freedom : standard deviation of the change of a step (rad, m).   slide_m, slide : standard deviation of the last place along the direction (3,)
    in which the surfaces alone, without an even motion, hold a drift least.
    """

    T_world_knot: FloatArray
    covariance: FloatArray
    used: float
    freedom: tuple[float, float]
    slide_m: float
    slide: FloatArray


def joint(
    points: FloatArray, first: IntArray, share: FloatArray, T_world_knot: FloatArray, edge_m: float, spread_m: float, sigma_m: float,
    freedom: tuple[float, float], *, most: tuple[float, float] | None = None, ends: Ends | None = None,
) -> JointResult:  # fmt: skip
    """One Gauss-Newton step of all knots but the first.

    points : (n, 3) in the frame of the sensor at their moments, `share` of the way from knot `first` to the next.   spread_m : how far points may lie
    off their plane while it grows.   freedom : standard deviation of the change of a step (rad, m), from which it is learned.   most : what a
    carrier can do; `freedom` where not given.   ends : of surfaces along the rings, which are held against straight borders of the planes.
    """
    R, x = between(T_world_knot, first, share)
    arm = np.einsum("nij,nj->ni", R, points)
    world = arm + x
    ray = arm / np.maximum(np.linalg.norm(arm, axis=1, keepdims=True), 1e-300)
    planes, deviation = map_surfaces(world, ray, edge_m, spread_m, sigma_m)
    on = np.flatnonzero(planes.label >= 0)
    k = len(T_world_knot)
    H, g = np.zeros((6 * k, 6 * k)), np.zeros(6 * k)
    if len(on):
        label = planes.label[on]
        across, terms, met = plane_terms(planes, label, world[on], ray[on])
        weight = tukey(across, deviation[on]) / deviation[on] ** 2
        normal = planes.normal[label]
        own = np.concatenate([np.cross(met - x[on], normal), normal], axis=1)
        H, g = _of_surfaces(own, across, terms, weight, label, len(planes), first[on], share[on], k)
    edges = None if ends is None else borders(ends, T_world_knot, planes, world, edge_m, sigma_m)
    if edges is not None:
        weight = tukey(edges.across, edges.deviation) / edges.deviation**2
        more = _of_surfaces(edges.own, edges.across, edges.terms, weight, edges.label, edges.n, edges.first, edges.share, k)
        H, g = H + more[0], g + more[1]
    step, covariance, learned = _learned(H, g, T_world_knot, freedom, freedom if most is None else most)
    slide_m, slide = _slide(H, k)
    used, T = len(on) / max(len(points), 1), stepped(T_world_knot, step)
    return JointResult(T_world_knot=T, covariance=covariance, used=used, freedom=learned, slide_m=slide_m, slide=slide)


def _of_surfaces(
    own: FloatArray, across: FloatArray, terms: FloatArray, weight: FloatArray, label: IntArray, p: int, first: IntArray, share: FloatArray,
    n_knots: int,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Hessian and gradient of the knots with planes or borders eliminated (Schur complement: each has a block of its own)."""
    n = len(own)
    knots = (6 * first[:, None] + np.arange(12)).ravel()
    values = np.concatenate([own * (1 - share)[:, None], own * share[:, None]], axis=1).ravel()
    J = csr_array((values, knots, 12 * np.arange(n + 1)), (n, 6 * n_knots))
    G = csr_array((terms.ravel(), (3 * label[:, None] + np.arange(3)).ravel(), 3 * np.arange(n + 1)), (n, 3 * p))
    WJ = csr_array((values * np.repeat(weight, 12), knots, 12 * np.arange(n + 1)), J.shape)
    inverse = np.linalg.inv(blocks_of(terms, weight, label, p))
    D = bsr_array((inverse, np.arange(p), np.arange(p + 1)), shape=(3 * p, 3 * p))
    cross = WJ.T @ G
    eliminated = cross @ D
    H = np.asarray((J.T @ WJ - eliminated @ cross.T).todense())
    return H, np.asarray(WJ.T @ across - eliminated @ (G.T @ (weight * across)))


def _learned(
    H: FloatArray, g: FloatArray, T_world_knot: FloatArray, freedom: tuple[float, float], most: tuple[float, float]
) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
    """Step (k, 6) of the knots, covariance of all but the first, and the standard deviation of accelerations that makes the sweeps likeliest."""
    k = len(T_world_knot)
    D = np.diff(np.eye(k), n=2, axis=0)
    R = Rotation.from_matrix(T_world_knot[:, :3, :3])
    turn = np.diff((R[1:] * R[:-1].inv()).as_rotvec(), axis=0)
    change = np.concatenate([turn, D @ T_world_knot[:, :3, 3]], axis=1)  # (k - 2, 6) of the poses as they are
    tied = D[:, 1:]
    for _ in range(_LEARNED):
        sd = np.repeat(freedom, 3)
        A, b = H.copy(), g.copy()
        for c in range(6):
            A[c::6, c::6] += D.T @ D / sd[c] ** 2
            b[c::6] += D.T @ change[:, c] / sd[c] ** 2
        A = A[6:, 6:]
        covariance = np.linalg.inv(A + _RIDGE * np.diag(np.diag(A)))
        step = np.concatenate([np.zeros(6), -covariance @ b[6:]]).reshape(-1, 6)
        after = change + D @ step
        chance = np.stack([((tied @ covariance[c::6, c::6]) * tied).sum(axis=1) for c in range(6)], axis=1)
        square = (after**2 + chance).mean(axis=0) if k > 2 else sd**2
        found = [math.sqrt(float(square[:3].mean())), math.sqrt(float(square[3:].mean()))]
        new = (float(np.clip(found[0], _LEAST_FREEDOM * most[0], most[0])), float(np.clip(found[1], _LEAST_FREEDOM * most[1], most[1])))
        settled = abs(new[0] / freedom[0] - 1) + abs(new[1] / freedom[1] - 1) < 0.02
        freedom = new
        if settled:
            break
    return np.asarray(step, np.float64), np.asarray(covariance, np.float64), freedom


def _slide(H: FloatArray, k: int) -> tuple[float, FloatArray]:
    """Standard deviation of the last place under a drift that grows evenly, and the direction of it, from the surfaces alone."""
    ramp = np.arange(k) / (k - 1)
    B = np.zeros((6 * k, 6))
    for c in range(6):
        B[c::6, c] = ramp
    A = B.T @ H @ B
    free = A[3:, 3:] - A[3:, :3] @ np.linalg.pinv(A[:3, :3], hermitian=True) @ A[:3, 3:]
    values, axes = np.linalg.eigh(0.5 * (free + free.T))
    return (1.0 / math.sqrt(values[0]) if values[0] > 0 else math.inf), axes[:, 0]
