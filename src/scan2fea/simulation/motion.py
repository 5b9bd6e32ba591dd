"""Where a sensor is at each moment: a smooth path through timed poses.

The frame of every sensor is x forward, y left, z up (the ROS convention); T_world_sensor takes it to the world. Between its poses a
path is a cubic spline in position and a rotation spline of continuous angular acceleration (scipy's RotationSpline), so that velocity,
acceleration and angular rate exist everywhere: what an inertial sensor would feel.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InputError, require
from scan2fea.kernel.transforms import compose, rigid, rotation_about
from scan2fea.options import option
from scan2fea.types import FloatArray, Scan, Trajectory, Value
from scan2fea.units import radians


@dataclass(frozen=True, kw_only=True)
class PathOptions:
    """Where a sensor measures; the base of the options of every sensor."""

    positions_m: tuple[tuple[float, float, float], ...] = option((), "Where the sensor stands in turn, or what it passes on its way", unit="m")
    orientations_deg: tuple[tuple[float, float, float], ...] = option(
        (), "Roll about x, then pitch about y (> 0 looks down), then yaw about z at each position; none: it looks along +x", unit="deg"
    )
    times_s: tuple[float, ...] = option((), "When it is at each position; none: one second apart", unit="s")


@dataclass(frozen=True, eq=False, kw_only=True)
class SensorPath(Value):
    """k timed poses.   time_s : (k,) increasing.   T_world_sensor : (k, 4, 4). A sensor that stands measures at each pose in turn."""

    time_s: FloatArray
    T_world_sensor: FloatArray

    _ROWS = (("time_s", "T_world_sensor"),)

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def duration_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0])


@dataclass(frozen=True, eq=False, kw_only=True)
class Kinematics(Value):
    """The motion at n moments, all in the world's axes but the rate.

    rotation : (n, 3, 3) of T_world_sensor.   position, velocity, acceleration : (n, 3) SI.   rate : (n, 3) rad/s in the sensor's axes.
    """

    rotation: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    rate: FloatArray


def rotation_rpy(roll_deg: float, pitch_deg: float, yaw_deg: float) -> FloatArray:
    """(3, 3) rotation: first roll about x, then pitch about y, then yaw about z, all fixed axes of the world; degrees. Pitch > 0 looks down."""
    turns = (rotation_about(axis, radians(angle)) for axis, angle in (((0, 0, 1), yaw_deg), ((0, 1, 0), pitch_deg), ((1, 0, 0), roll_deg)))
    yaw, pitch, roll = turns
    turned: FloatArray = yaw @ pitch @ roll
    return turned


def path_through(time_s: npt.ArrayLike, position_m: npt.ArrayLike, rpy_deg: npt.ArrayLike | None = None) -> SensorPath:
    """The path through k poses.   time_s : (k,) increasing.   position_m, rpy_deg : (k, 3); without angles the sensor looks along +x.

    Raises InputError for no pose, times that do not increase, and values that are not finite.
    """
    time, position = np.asarray(time_s, float), np.asarray(position_m, float).reshape(-1, 3)
    angle = np.zeros_like(position) if rpy_deg is None else np.asarray(rpy_deg, float).reshape(-1, 3)
    require(len(position) > 0, InputError, "a sensor's path has no pose: give it at least one position")
    require(
        len(time) == len(position) == len(angle),
        InputError,
        f"a sensor's path has {len(time)} times, {len(position)} positions, {len(angle)} orientations: give as many of each",
    )
    finite = bool(np.isfinite(time).all() and np.isfinite(position).all() and np.isfinite(angle).all())
    require(finite, InputError, "a sensor's path holds a number that is not finite: correct the pose")
    require(bool((np.diff(time) > 0).all()), InputError, f"the times of a sensor's path must increase: {time.tolist()}")
    poses = np.stack([rigid(rotation_rpy(*turn), place) for turn, place in zip(angle, position, strict=True)])
    return SensorPath(time_s=time, T_world_sensor=poses)


def path_of(options: PathOptions, sensor: str) -> SensorPath:
    """The path that the options ask for. Raises InputError that names the sensor and the key."""
    k = len(options.positions_m)
    require(k > 0, InputError, f"sensor {sensor}: positions_m is empty: add where the sensor stands")
    for key, values in (("orientations_deg", options.orientations_deg), ("times_s", options.times_s)):
        require(len(values) in (0, k), InputError, f"sensor {sensor}: {key} has {len(values)} entries, positions_m has {k}: give as many, or none")
    time = options.times_s or tuple(float(i) for i in range(k))
    try:
        return path_through(time, options.positions_m, options.orientations_deg or None)
    except InputError as error:
        raise InputError(f"sensor {sensor}: {error}") from error


def kinematics(path: SensorPath, time_s: FloatArray) -> Kinematics:
    """The motion at (n,) moments; before the first and after the last pose the sensor rests there."""
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation, RotationSpline

    n, places, turns = len(time_s), path.T_world_sensor[:, :3, 3], path.T_world_sensor[:, :3, :3]
    zero = np.zeros((n, 3))
    if len(path) == 1:
        return Kinematics(rotation=np.tile(turns[0], (n, 1, 1)), position=zero + places[0], velocity=zero, acceleration=zero, rate=zero)
    at = np.clip(time_s, path.time_s[0], path.time_s[-1])
    moving = (at == time_s)[:, None]
    spline, turning = CubicSpline(path.time_s, places), RotationSpline(path.time_s, Rotation.from_matrix(turns))
    return Kinematics(
        rotation=turning(at).as_matrix(),
        position=spline(at),
        velocity=spline(at, 1) * moving,
        acceleration=spline(at, 2) * moving,
        rate=turning(at, 1) * moving,
    )


def trajectory_at(path: SensorPath, time_s: npt.ArrayLike) -> Trajectory:
    """The true poses at (n,) moments, as written beside a scan."""
    time = np.atleast_1d(np.asarray(time_s, float))
    state = kinematics(path, time)
    poses = np.tile(np.eye(4), (len(time), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = state.rotation, state.position
    return Trajectory(T_world_frame=poses, placed=np.ones(len(time), bool), time_s=time)


def as_measured(scan: Scan, path: SensorPath) -> Scan:
    """The scan as the sensor itself tells it, knowing nothing of its motion: every ray in the sensor's frame at the moment of the shot.

    Registration must put it back together: motion within the scan is in it. Raises InputError for rays without times.
    """
    if scan.rays is None or scan.rays.time_s is None:
        raise InputError("a scan whose rays have no times cannot be taken into the frame of its sensor")
    state = kinematics(path, scan.rays.time_s)
    turned = np.einsum("nij,ni->nj", state.rotation, scan.rays.direction)
    origin = np.einsum("nij,ni->nj", state.rotation, scan.rays.origin - state.position)
    ray = scan.cloud.ray
    points = np.einsum("nij,ni->nj", state.rotation[ray], scan.cloud.points - state.position[ray])
    return Scan(cloud=scan.cloud.replaced(points=points), rays=dataclasses.replace(scan.rays, origin=origin, direction=turned))


def mounted(path: SensorPath, T_carrier_sensor: FloatArray) -> SensorPath:
    """The path of a sensor fixed to a carrier that moves along `path`."""
    return SensorPath(time_s=path.time_s, T_world_sensor=np.stack([compose(T, T_carrier_sensor) for T in path.T_world_sensor]))
