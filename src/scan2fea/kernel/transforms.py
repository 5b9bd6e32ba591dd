"""Rigid motions as 4 x 4 matrices. `T_target_source` takes source coordinates to target coordinates; quaternions are (x, y, z, w)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InternalError, require
from scan2fea.types import FloatArray


def rigid(R: npt.ArrayLike, t: npt.ArrayLike) -> FloatArray:
    """(4, 4) matrix of x -> R x + t.   R : (3, 3).   t : (3,)."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = t
    return T


def applied(T_target_source: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 3) points moved."""
    moved: FloatArray = points @ T_target_source[:3, :3].T + T_target_source[:3, 3]
    return moved


def rotated(T_target_source: FloatArray, directions: FloatArray) -> FloatArray:
    """(n, 3) directions turned (no translation)."""
    turned: FloatArray = directions @ T_target_source[:3, :3].T
    return turned


def inverse(T_target_source: FloatArray) -> FloatArray:
    """T_source_target of a rigid motion."""
    R = T_target_source[:3, :3]
    return rigid(R.T, -R.T @ T_target_source[:3, 3])


def compose(*T: FloatArray) -> FloatArray:
    """T_c_b, T_b_a, ... -> T_c_a: poses are multiplied, last one applied first; the identity for none."""
    product = np.eye(4)
    for each in T:
        product = product @ each
    return product


def quaternion_to_matrix(quaternion: npt.ArrayLike) -> FloatArray:
    """(3, 3) rotation of the quaternion (x, y, z, w), of any length but zero. Raises InternalError for zero or non-finite."""
    q = np.asarray(quaternion, float)
    length = float(np.linalg.norm(q))
    require(math.isfinite(length) and length > 0, InternalError, f"no rotation has the quaternion {q.tolist()}")
    x, y, z, w = q / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def matrix_to_quaternion(R: FloatArray) -> FloatArray:
    """(4,) unit quaternion (x, y, z, w) of a rotation, w >= 0. Built from its largest component, so never by dividing by a small one."""
    xx, yy, zz = float(R[0, 0]), float(R[1, 1]), float(R[2, 2])
    four = np.array([1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz])  # 4 x^2, 4 y^2, 4 z^2, 4 w^2
    xy, xz, yz = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    wx, wy, wz = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    rows = np.array([[four[0], xy, xz, wx], [xy, four[1], yz, wy], [xz, yz, four[2], wz], [wx, wy, wz, four[3]]])  # row i is 4 q_i q
    q = rows[int(np.argmax(four))]
    q = q / np.linalg.norm(q)
    signed: FloatArray = -q if q[3] < 0 else q
    return signed


def rotation_about(axis: npt.ArrayLike, angle_rad: float) -> FloatArray:
    """(3, 3) rotation about an axis through the origin, right-handed (Rodrigues). Raises InternalError for a zero axis."""
    a = np.asarray(axis, float)
    length = float(np.linalg.norm(a))
    require(length > 0, InternalError, "a rotation needs an axis that is not zero")
    x, y, z = a / length
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    R: FloatArray = np.eye(3) + math.sin(angle_rad) * K + (1.0 - math.cos(angle_rad)) * (K @ K)
    return R


def random_rotation(seed: int) -> FloatArray:
    """(3, 3) rotation drawn uniformly: four normal deviates are a uniform unit quaternion once scaled."""
    return quaternion_to_matrix(np.random.default_rng(seed).standard_normal(4))


def is_rigid(T: FloatArray, tolerance: float = 1e-3) -> bool:
    """True for a (4, 4) matrix whose upper left block is a proper rotation within `tolerance` and whose last row is 0 0 0 1."""
    if T.shape != (4, 4) or not np.isfinite(T).all():
        return False
    R = T[:3, :3]
    orthogonal = np.abs(R @ R.T - np.eye(3)).max() <= tolerance and np.linalg.det(R) > 0
    return bool(orthogonal and np.abs(T[3] - [0.0, 0.0, 0.0, 1.0]).max() <= tolerance)
