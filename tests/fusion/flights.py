"""Simulated logs of a carrier on its way, and what a trajectory is worth beside the truth."""

import numpy as np
from scipy.spatial.transform import Rotation

from scan2fea.kernel.trajectories import interpolated
from scan2fea.simulation.motion import path_through
from scan2fea.simulation.sensor_logs import LogOptions, sensor_logs
from scan2fea.types import InertialLog, PositionLog


def flight(seed, seconds=40.0, **options):
    """Logs along a random way, its heading anything."""
    rng = np.random.default_rng(seed)
    n = int(seconds / 2) + 1
    place = np.cumsum(rng.normal(size=(n, 3)) * [2.0, 2.0, 0.3], axis=0)
    turn = np.c_[rng.uniform(-15, 15, (n, 2)), np.cumsum(rng.uniform(-30, 40, n)) + rng.uniform(0, 360)]
    return sensor_logs(path_through(np.linspace(0.0, seconds, n), place, turn), LogOptions(**{"odometry_m": 0.005, **options}), seed)


def inertial_of(logs):
    return InertialLog(time_s=logs.imu.time_s, rate=logs.imu.rate, force=logs.imu.force, is_gap=np.zeros(len(logs.imu.time_s), bool))


def positions_of(logs):
    kept = np.isfinite(logs.gps.position).all(axis=1)
    return PositionLog(time_s=logs.gps.time_s[kept], position=logs.gps.position[kept], sigma_m=logs.gps.sigma_m[kept])


def errors_of(trajectory, truth):
    """(k, 6) place and rotation vector, truth less estimate in the world's axes."""
    right = interpolated(truth, np.clip(trajectory.time_s, truth.time_s[0], truth.time_s[-1])).T_world_frame
    found = trajectory.T_world_frame
    turn = (Rotation.from_matrix(right[:, :3, :3]) * Rotation.from_matrix(found[:, :3, :3]).inv()).as_rotvec()
    return np.c_[right[:, :3, 3] - found[:, :3, 3], turn]


def nees(error, P):
    """(k,) squared errors in units of the stated covariance."""
    return np.einsum("ki,ki->k", error, np.linalg.solve(P, error[:, :, None])[:, :, 0])
