"""Motion within a sweep: every point is moved by where the sensor was when it was measured."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from scan2fea.errors import InputError, require
from scan2fea.kernel.trajectories import between
from scan2fea.kernel.transforms import rigid
from scan2fea.types import FloatArray, IntArray, Trajectory


def moved(points: FloatArray, T_world_knot: FloatArray, first: IntArray, share: FloatArray) -> FloatArray:
    """Points (n, 3), each in the frame of the sensor at its own moment, in the world."""
    R, x = between(T_world_knot, first, share)
    return np.asarray(np.einsum("nij,nj->ni", R, points) + x)


def deskewed(points: FloatArray, share: FloatArray, T_start_end: FloatArray) -> FloatArray:
    """Points of one sweep in the frame of its start: the sensor moved evenly by T_start_end, share (n,) 0..1 of which was done at each point."""
    return moved(points, np.stack([np.eye(4), T_start_end]), np.zeros(len(points), np.int64), share)


def at_times(trajectory: Trajectory, time_s: FloatArray) -> tuple[IntArray, FloatArray]:
    """Knot before each moment (n,) and the share of the way to the next.

    Raises InputError where the trajectory has no times that rise, or moments lie outside of it.
    """
    known = trajectory.time_s
    says = "the trajectory has no times, or they do not rise: motion within a sweep needs a time for every pose"
    if known is None or len(known) < 2 or not bool((np.diff(known) > 0).all()):
        raise InputError(says)
    slack = float(np.median(np.diff(known)))
    low, high = float(time_s.min()), float(time_s.max())
    outside = f"points were measured from {low:.3f} to {high:.3f} s, the poses are of {known[0]:.3f} to {known[-1]:.3f} s: they are of another scan"
    require(low >= known[0] - slack and high <= known[-1] + slack, InputError, outside)
    first = np.clip(np.searchsorted(known, time_s, side="right") - 1, 0, len(known) - 2).astype(np.int64)
    return first, np.asarray((time_s - known[first]) / (known[first + 1] - known[first]))


def deskewed_by(points: FloatArray, time_s: FloatArray, trajectory: Trajectory) -> FloatArray:
    """Points (n, 3), each in the frame of the sensor at its moment, in the world of a timed trajectory. Raises InputError as `at_times`."""
    first, share = at_times(trajectory, time_s)
    return moved(points, trajectory.T_world_frame, first, share)


def stepped(T: FloatArray, step: FloatArray) -> FloatArray:
    """Poses (k, 4, 4) after steps (k, 6): a rotation vector of the world about the sensor, a shift of the sensor."""
    R = Rotation.from_rotvec(step[:, :3]).as_matrix() @ T[:, :3, :3]
    return np.stack([rigid(R[k], T[k, :3, 3] + step[k, 3:]) for k in range(len(T))])
