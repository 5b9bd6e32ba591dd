"""Poses between poses: interpolation on SE(3), with its covariance."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from scan2fea.errors import InputError, require
from scan2fea.types import FloatArray, IntArray, Trajectory


def between(T_world_knot: FloatArray, first: IntArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (n, 3, 3) and positions (n, 3) of the sensor a `share` (n,) of the way from knot `first` (n,) to the next.

    T_world_knot : (k, 4, 4). The position moves evenly on a line, the rotation evenly about one axis.
    """
    R = Rotation.from_matrix(T_world_knot[:, :3, :3])
    turn = (R[:-1].inv() * R[1:]).as_rotvec()
    rotation = (R[first] * Rotation.from_rotvec(turn[first] * share[:, None])).as_matrix()
    x = T_world_knot[:, :3, 3]
    return np.asarray(rotation), np.asarray(x[first] * (1.0 - share)[:, None] + x[first + 1] * share[:, None])


def interpolated(trajectory: Trajectory, time_s: FloatArray) -> Trajectory:
    """The poses at moments (n,) within the time of the trajectory. Between two poses the motion is even; where one of them is left out, so is what
    lies between. The covariance goes linearly from one to the next: the errors of neighbours go together, so theirs is not less than the mean's.

    Raises InputError for a trajectory without times, with times that do not rise, and for moments outside of it.
    """
    known = trajectory.time_s
    says = "a pose between poses needs a trajectory of two poses or more whose times rise"
    if known is None or len(known) < 2 or not bool((np.diff(known) > 0).all()):
        raise InputError(says)
    outside = f"poses are wanted from {time_s.min():.3f} to {time_s.max():.3f} s, the trajectory is of {known[0]:.3f} to {known[-1]:.3f} s"
    require(bool((time_s >= known[0]).all() and (time_s <= known[-1]).all()), InputError, outside)
    first = np.clip(np.searchsorted(known, time_s, side="right") - 1, 0, len(known) - 2).astype(np.int64)
    share = np.asarray((time_s - known[first]) / (known[first + 1] - known[first]))
    placed = (trajectory.placed[first] | (share == 1.0)) & (trajectory.placed[first + 1] | (share == 0.0))
    T = np.where(trajectory.placed[:, None, None], trajectory.T_world_frame, np.eye(4))
    poses = np.tile(np.eye(4), (len(time_s), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = between(T, first, share)
    P = trajectory.covariance
    covariance = None if P is None else P[first] * (1.0 - share)[:, None, None] + P[first + 1] * share[:, None, None]
    return Trajectory(T_world_frame=poses, placed=placed, time_s=time_s, covariance=covariance)
