"""All poses of a moving sensor at once, against planes that are free themselves (as in Zhou et al. 2020, planes eliminated)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, csr_array
from scipy.spatial.transform import Rotation

from scan2fea.kernel.trajectories import between
from scan2fea.registration.icp import tukey
from scan2fea.registration.map_planes import MapPlanes, map_planes
from scan2fea.registration.motion import stepped
from scan2fea.types import FloatArray, IntArray, Value

_FREE = 3  # of a plane: its height and two tilts


@dataclass(frozen=True, eq=False, kw_only=True)
class JointResult(Value):
    """T_world_knot : (k, 4, 4).   std : (k, 2) of rotation (rad) and place (m) against the first knot.   used : share of points on planes."""

    T_world_knot: FloatArray
    std: FloatArray
    used: float


def joint(
    points: FloatArray, first: IntArray, share: FloatArray, T_world_knot: FloatArray, edge_m: float, spread_m: float, sigma_m: float,
    freedom: tuple[float, float],
) -> JointResult:  # fmt: skip
    """One Gauss-Newton step of all knots but the first.

    points : (n, 3) in the frame of the sensor at their moments, `share` of the way from knot `first` to the next.   spread_m : how far points may lie
    off their plane while it grows.   freedom : standard deviation of the change of a step (rad, m), a Gaussian prior on accelerations.
    """
    R, x = between(T_world_knot, first, share)
    world = np.einsum("nij,nj->ni", R, points) + x
    planes = map_planes(world, edge_m, spread_m)
    on = np.flatnonzero(planes.label >= 0)
    H, g = _of_prior(T_world_knot, freedom)
    if len(on):
        own_H, own_g = _of_planes(world[on], world[on] - x[on], planes, planes.label[on], first[on], share[on], len(T_world_knot), sigma_m)
        H, g = H + own_H, g + own_g
    A = H[6:, 6:] + 1e-9 * np.diag(np.diag(H[6:, 6:]))
    covariance = np.linalg.inv(A)
    step = np.concatenate([np.zeros(6), -covariance @ g[6:]]).reshape(-1, 6)
    variance = np.concatenate([np.zeros(6), np.diag(covariance)]).reshape(-1, 6)
    std = np.sqrt(np.stack([variance[:, :3].sum(axis=1), variance[:, 3:].sum(axis=1)], axis=1))
    return JointResult(T_world_knot=stepped(T_world_knot, step), std=std, used=len(on) / max(len(points), 1))


def _of_planes(
    world: FloatArray, arm: FloatArray, planes: MapPlanes, label: IntArray, first: IntArray, share: FloatArray, n_knots: int, sigma_m: float
) -> tuple[FloatArray, FloatArray]:
    """Hessian and gradient of the knots with the planes eliminated (Schur complement: each plane has a block of its own)."""
    n, p = len(world), len(planes)
    normal = planes.normal[label]
    off = world - planes.centre[label]
    across = np.einsum("nc,nc->n", normal, off)
    weight = tukey(across, sigma_m) / sigma_m**2
    own = np.concatenate([np.cross(arm, normal), normal], axis=1)
    knots = (6 * first[:, None] + np.arange(12)).ravel()
    values = np.concatenate([own * (1 - share)[:, None], own * share[:, None]], axis=1).ravel()
    J = csr_array((values, knots, 12 * np.arange(n + 1)), (n, 6 * n_knots))
    B = np.concatenate([np.ones((n, 1)), np.einsum("nac,nc->na", planes.axes[label], off)], axis=1)
    G = csr_array((B.ravel(), (_FREE * label[:, None] + np.arange(_FREE)).ravel(), _FREE * np.arange(n + 1)), (n, _FREE * p))
    WJ = J.multiply(weight[:, None]).tocsr()
    blocks = np.zeros((p, _FREE, _FREE))
    for i in range(_FREE):
        for j in range(_FREE):
            blocks[:, i, j] = np.bincount(label, weight * B[:, i] * B[:, j], p)
    trace = np.trace(blocks, axis1=1, axis2=2)
    inverse = np.linalg.inv(blocks + (1e-9 * trace + 1e-300)[:, None, None] * np.eye(_FREE))
    D = bsr_array((inverse, np.arange(p), np.arange(p + 1)), shape=(_FREE * p, _FREE * p))
    cross = WJ.T @ G
    eliminated = cross @ D
    H = np.asarray((J.T @ WJ - eliminated @ cross.T).todense())
    return H, np.asarray(J.T @ (weight * across) - eliminated @ (G.T @ (weight * across)))


def _of_prior(T_world_knot: FloatArray, freedom: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Hessian and gradient of accelerations that are Gaussian."""
    k = len(T_world_knot)
    D = np.diff(np.eye(k), n=2, axis=0)
    R = Rotation.from_matrix(T_world_knot[:, :3, :3])
    turn = np.diff((R[1:] * R[:-1].inv()).as_rotvec(), axis=0)
    shift = D @ T_world_knot[:, :3, 3]
    H, g = np.zeros((6 * k, 6 * k)), np.zeros(6 * k)
    for c in range(3):
        for at, change, sd in ((c, turn[:, c], freedom[0]), (c + 3, shift[:, c], freedom[1])):
            H[at::6, at::6] += D.T @ D / sd**2
            g[at::6] += D.T @ change / sd**2
    return H, g
