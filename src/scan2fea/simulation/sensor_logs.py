"""What else a carrier records while it scans: inertial unit, satellite positions, odometry, beside the true trajectory.

Models (the usual ones of inertial navigation; Woodman 2007): an inertial unit measures specific force and angular rate in its own axes,
each with a constant bias, a bias that walks, and white noise; positions of satellites have white noise, worse upwards, and gaps; odometry
adds up steps that are each off a little, in scale and at random, so that its error grows with the way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.transforms import compose, inverse, rigid, rotation_about
from scan2fea.options import option
from scan2fea.simulation.motion import SensorPath, kinematics, trajectory_at
from scan2fea.types import BoolArray, FloatArray, Trajectory, Value

GRAVITY_M_S2 = np.array([0.0, 0.0, -9.80665])  # standard gravity, ISO 80000-3
_MOST_ROWS = 20_000_000


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """The instruments of a carrier, of the class of a small MEMS unit and a differential satellite receiver."""

    truth_hz: float = option(100.0, "Rows of the true trajectory per second", unit="Hz", minimum=0.001)
    imu_hz: float = option(200.0, "Rows of the inertial unit per second", unit="Hz", minimum=0.001)
    gyro_noise: float = option(1e-4, "White noise of the angular rate", unit="rad/s/sqrt(Hz)", minimum=0.0)
    gyro_bias: float = option(1e-3, "Standard deviation of the constant bias of the angular rate", unit="rad/s", minimum=0.0)
    gyro_walk: float = option(1e-5, "Random walk of that bias", unit="rad/s^2/sqrt(Hz)", minimum=0.0)
    acceleration_noise: float = option(1e-3, "White noise of the specific force", unit="m/s^2/sqrt(Hz)", minimum=0.0)
    acceleration_bias: float = option(2e-2, "Standard deviation of the constant bias of the specific force", unit="m/s^2", minimum=0.0)
    acceleration_walk: float = option(1e-4, "Random walk of that bias", unit="m/s^3/sqrt(Hz)", minimum=0.0)
    gps_hz: float = option(5.0, "Satellite positions per second", unit="Hz", minimum=0.001)
    gps_m: float = option(0.02, "Standard deviation of a satellite position east and north; twice that upwards", unit="m", minimum=0.0)
    gps_lost_share: float = option(0.0, "Share of the satellite positions that are missing", minimum=0.0, maximum=1.0)
    odometry_hz: float = option(20.0, "Rows of the odometry per second", unit="Hz", minimum=0.001)
    odometry_scale: float = option(0.005, "Standard deviation of the scale of the odometry", minimum=0.0)
    odometry_m: float = option(0.005, "Random error of the odometry after one metre; grows with the root of the way", unit="m/sqrt(m)", minimum=0.0)
    odometry_deg: float = option(0.2, "Random error of its heading after one metre", unit="deg/sqrt(m)", minimum=0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Inertial(Value):
    """k rows. time_s : (k,).   force : (k, 3) specific force, m/s^2.   rate : (k, 3) rad/s, both in the sensor's axes.

    force_bias, rate_bias : (k, 3) what of them is bias: truth, not written to the log.
    """

    time_s: FloatArray
    force: FloatArray
    rate: FloatArray
    force_bias: FloatArray
    rate_bias: FloatArray

    _ROWS = (("time_s", "force", "rate", "force_bias", "rate_bias"),)


@dataclass(frozen=True, eq=False, kw_only=True)
class Positions(Value):
    """k rows. time_s : (k,).   position : (k, 3) metres in the world, nan where lost.   sigma_m : (k, 3)."""

    time_s: FloatArray
    position: FloatArray
    sigma_m: FloatArray

    _ROWS = (("time_s", "position", "sigma_m"),)


@dataclass(frozen=True, eq=False, kw_only=True)
class SensorLogs(Value):
    """truth : the exact poses.   odometry : poses from where it began, T_begin_sensor."""

    truth: Trajectory
    imu: Inertial
    gps: Positions
    odometry: Trajectory


def sensor_logs(path: SensorPath, options: LogOptions = LogOptions(), seed: int = 0) -> SensorLogs:
    """All logs along a path. The same path, options and seed give the same bytes. Raises InputError where a log would be endless."""
    for key in ("truth_hz", "imu_hz", "gps_hz", "odometry_hz"):
        rows = path.duration_s * getattr(options, key)
        require(rows <= _MOST_ROWS, InputError, f"{key} = {getattr(options, key)}: {rows:.3g} rows, at most {_MOST_ROWS:,}: lower it")
    return SensorLogs(
        truth=trajectory_at(path, _times(path, options.truth_hz)),
        imu=inertial(path, options, np.random.default_rng([seed, 1])),
        gps=positions(path, options, np.random.default_rng([seed, 2])),
        odometry=odometry(path, options, np.random.default_rng([seed, 3])),
    )


def _times(path: SensorPath, rate_hz: float) -> FloatArray:
    times: FloatArray = path.time_s[0] + np.arange(math.floor(path.duration_s * rate_hz + 1e-6) + 1) / rate_hz
    return times


def inertial(path: SensorPath, options: LogOptions, rng: np.random.Generator) -> Inertial:
    """Specific force R^T (a - g) and angular rate, with bias, walk and noise. White noise of density n has the deviation n sqrt(rate) per row."""
    time = _times(path, options.imu_hz)
    state = kinematics(path, time)
    force = np.einsum("kij,ki->kj", state.rotation, state.acceleration - GRAVITY_M_S2)
    force_bias = _bias(len(time), options.acceleration_bias, options.acceleration_walk, options.imu_hz, rng)
    rate_bias = _bias(len(time), options.gyro_bias, options.gyro_walk, options.imu_hz, rng)
    root = math.sqrt(options.imu_hz)
    return Inertial(
        time_s=time,
        force=force + force_bias + rng.standard_normal(force.shape) * options.acceleration_noise * root,
        rate=state.rate + rate_bias + rng.standard_normal(force.shape) * options.gyro_noise * root,
        force_bias=force_bias,
        rate_bias=rate_bias,
    )


def _bias(n: int, constant: float, walk: float, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """(n, 3) a constant drawn once and a random walk from zero."""
    steps = rng.standard_normal((n, 3)) * walk / math.sqrt(rate_hz)
    steps[0] = 0.0
    bias: FloatArray = constant * rng.standard_normal(3) + np.cumsum(steps, axis=0)
    return bias


def positions(path: SensorPath, options: LogOptions, rng: np.random.Generator) -> Positions:
    """Satellite positions in the world's axes, x east, y north, z up."""
    time = _times(path, options.gps_hz)
    sigma = np.tile(options.gps_m * np.array([1.0, 1.0, 2.0]), (len(time), 1))
    measured = kinematics(path, time).position + sigma * rng.standard_normal(sigma.shape)
    lost: BoolArray = rng.random(len(time)) < options.gps_lost_share
    measured[lost] = np.nan
    return Positions(time_s=time, position=measured, sigma_m=sigma)


def odometry(path: SensorPath, options: LogOptions, rng: np.random.Generator) -> Trajectory:
    """Poses from the first one on, each true step disturbed and multiplied to the last."""
    time = _times(path, options.odometry_hz)
    true = trajectory_at(path, time).T_world_frame
    scale = 1.0 + options.odometry_scale * rng.standard_normal()
    draws = rng.standard_normal((len(time), 4))
    poses = [np.eye(4)]
    for k in range(1, len(time)):
        step = compose(inverse(true[k - 1]), true[k])
        way = math.sqrt(float(np.linalg.norm(step[:3, 3])))
        turn = rotation_about((0, 0, 1), math.radians(options.odometry_deg) * way * draws[k, 3])
        poses.append(compose(poses[-1], rigid(turn @ step[:3, :3], scale * step[:3, 3] + options.odometry_m * way * draws[k, :3])))
    return Trajectory(T_world_frame=np.stack(poses), placed=np.ones(len(time), bool), time_s=time)


def imu_csv(log: Inertial) -> str:
    """The inertial log as text: time, specific force, angular rate; SI."""
    return _csv("time_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s", np.column_stack([log.time_s, log.force, log.rate]))


def gps_csv(log: Positions) -> str:
    """The satellite log as text; lost positions are left out, as a receiver leaves them out."""
    kept = np.isfinite(log.position).all(axis=1)
    return _csv("time_s,x_m,y_m,z_m,sx_m,sy_m,sz_m", np.column_stack([log.time_s, log.position, log.sigma_m])[kept])


def _csv(head: str, rows: FloatArray) -> str:
    return "\n".join([head, *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n"
