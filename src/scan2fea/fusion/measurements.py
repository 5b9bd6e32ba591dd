"""What is measured beside the inertial log, as one list of events in time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.fusion.kalman_kernels import KNOT, POSE, POSITION, SPEED
from scan2fea.fusion.options import FusionOptions
from scan2fea.kernel.transforms import matrix_to_quaternion
from scan2fea.types import FloatArray, InertialLog, IntArray, PositionLog, Trajectory, Value

GPS_M = 3.0  # an ordinary receiver without corrections, where neither the log nor the user says anything
_STEP_M = 1e-3  # what an odometry does not resolve
_MAD, _SECOND = 1.4826, math.sqrt(6.0)  # second differences of white noise have the deviation sqrt(6)
_LEAST_GYRO, _LEAST_FORCE = 1e-5, 1e-4  # rad/s/sqrt(Hz), m/s^2/sqrt(Hz): no log is better than a navigation unit


@dataclass(frozen=True, eq=False, kw_only=True)
class Events(Value):
    """m moments, rising.   kind : (m,) KNOT, POSITION, SPEED or POSE.   z : (m, 7), unused ones 0.   noise : (m, 6, 6) covariance of z."""

    time_s: FloatArray
    kind: IntArray
    z: FloatArray
    noise: FloatArray

    _ROWS = (("time_s", "kind", "z", "noise"),)

    def __len__(self) -> int:
        return len(self.time_s)

    def take(self, rows: IntArray | slice) -> Events:
        return Events(time_s=self.time_s[rows], kind=self.kind[rows], z=self.z[rows], noise=self.noise[rows])


def position_sigma(gps: PositionLog, options: FusionOptions) -> FloatArray:
    """(k, 3) standard deviations: the user's, else the log's, else `GPS_M` east and north and twice that upwards."""
    if options.gps_m is None and gps.sigma_m is not None:
        return gps.sigma_m
    return np.tile((options.gps_m or GPS_M) * np.array([1.0, 1.0, 2.0]), (len(gps), 1))


def events_of(
    log: InertialLog, gps: PositionLog | None, odometry: Trajectory | None, poses: Trajectory | None, options: FusionOptions
) -> Events:
    """All measurements within the time of the inertial log, and knots from the first of them on.

    Raises InputError where nothing measures within that time.
    """
    parts = []
    if gps is not None:
        parts.append(_positions(gps, options))
    if odometry is not None:
        parts.append(_speeds(odometry, options))
    if poses is not None:
        parts.append(_poses(poses, options))
    low, high = float(log.time_s[0]), float(log.time_s[-1])
    spans = "; ".join(f"{part.time_s[0]:.3f} to {part.time_s[-1]:.3f} s" for part in parts if len(part))
    inside = [part.take(np.flatnonzero((part.time_s >= low) & (part.time_s <= high))) for part in parts]
    says = f"the inertial log is of {low:.3f} to {high:.3f} s, the other logs of {spans or 'no moment'}: they are of another time or clock"
    require(any(len(part) for part in inside), InputError, says)
    low = min(float(part.time_s[0]) for part in inside if len(part))  # before it nothing is known of the place
    n = math.floor((high - low) * min(options.rate_hz, 1e5 / max(high - low, 1.0)))
    knots = np.asarray(low + np.arange(n + 1) * ((high - low) / max(n, 1)), np.float64)
    inside.append(_empty(knots, KNOT))
    time = np.concatenate([part.time_s for part in inside])
    order = np.argsort(time, kind="stable")
    joined = (np.concatenate([getattr(part, name) for part in inside])[order] for name in ("kind", "z", "noise"))
    kind, z, noise = joined
    return Events(time_s=time[order], kind=kind, z=z, noise=noise)


def _empty(time_s: FloatArray, kind: int) -> Events:
    m = len(time_s)
    return Events(time_s=time_s, kind=np.full(m, kind, np.int64), z=np.zeros((m, 7)), noise=np.tile(np.eye(6), (m, 1, 1)))


def _positions(gps: PositionLog, options: FusionOptions) -> Events:
    made = _empty(gps.time_s, POSITION)
    z, noise = made.z.copy(), made.noise.copy()
    z[:, :3] = gps.position
    noise[:, [0, 1, 2], [0, 1, 2]] = position_sigma(gps, options) ** 2
    return Events(time_s=made.time_s, kind=made.kind, z=z, noise=noise)


def _speeds(odometry: Trajectory, options: FusionOptions) -> Events:
    """Each step from one pose to the next is the mean velocity in the axes of the carrier half way; the drift of the poses does not matter then."""
    time, T = _timed(odometry)
    span = np.diff(time)
    half = 0.5 * (_vectors(T[:-1], T[1:]))
    made = _empty(time[:-1] + 0.5 * span, SPEED)
    z, noise = made.z.copy(), made.noise.copy()
    shift = np.einsum("kij,ki->kj", T[:-1, :3, :3], T[1:, :3, 3] - T[:-1, :3, 3])
    z[:, :3] = (shift - np.cross(half, shift)) / span[:, None]  # into the axes half way, to first order of a small turn
    way = np.linalg.norm(shift, axis=1)
    sigma = np.sqrt(options.odometry_m**2 * way + _STEP_M**2) / span
    noise[:, [0, 1, 2], [0, 1, 2]] = (sigma**2)[:, None]
    return Events(time_s=made.time_s, kind=made.kind, z=z, noise=noise)


def _poses(poses: Trajectory, options: FusionOptions) -> Events:
    time, T = _timed(poses)
    made = _empty(time, POSE)
    noise = made.noise.copy()
    if poses.covariance is not None and bool(np.isfinite(poses.covariance[poses.placed]).all()):
        noise[:] = poses.covariance[poses.placed]
    else:
        noise[:, [0, 1, 2], [0, 1, 2]] = options.pose_m**2
        noise[:, [3, 4, 5], [3, 4, 5]] = math.radians(options.pose_deg) ** 2
    z = np.concatenate([T[:, :3, 3], np.array([matrix_to_quaternion(R) for R in T[:, :3, :3]])], axis=1)
    return Events(time_s=made.time_s, kind=made.kind, z=z, noise=noise)


def _timed(trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    if trajectory.time_s is None or int(trajectory.placed.sum()) < 2:
        raise InputError("a log of poses needs times and two poses or more")
    return trajectory.time_s[trajectory.placed], trajectory.T_world_frame[trajectory.placed]


def _vectors(T0: FloatArray, T1: FloatArray) -> FloatArray:
    """(k, 3) rotation vectors from T0 to T1 in the axes of T0."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(np.einsum("kji,kjl->kil", T0[:, :3, :3], T1[:, :3, :3])).as_rotvec())


def densities(log: InertialLog, options: FusionOptions) -> FloatArray:
    """(4,) spectral densities of the errors: turn (rad^2/s), velocity (m^2/s^3), bias of the rates, bias of the force.

    What options do not say of the white noise is told by the scatter of second differences, the axis where it is largest.
    """
    dt = float(np.median(np.diff(log.time_s)))
    gyro = options.gyro_noise if options.gyro_noise is not None else max(_scatter(log.rate) * math.sqrt(dt), _LEAST_GYRO)
    force = options.acceleration_noise if options.acceleration_noise is not None else max(_scatter(log.force) * math.sqrt(dt), _LEAST_FORCE)
    return np.array([gyro**2, force**2, options.gyro_walk**2, options.acceleration_walk**2])


def _scatter(values: FloatArray) -> float:
    """Standard deviation of white noise of rows (k, 3), of the worst axis; where most rows repeat the one before, from all of them."""
    second = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
    if not len(second):
        return 0.0
    median = _MAD * np.median(second, axis=0) / _SECOND
    return float(np.where(median > 0, median, np.sqrt((second**2).mean(axis=0)) / _SECOND).max())
