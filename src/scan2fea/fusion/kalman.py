"""The Kalman filter (Kalman 1960) on the error of the state, with a smoother: inertial log, positions, odometry and poses to one trajectory.

The thesis names it and leaves it empty (2.2). Forwards the state is kept only at the start of each part of the log; backwards each part is gone
through again and smoothed, so that memory does not grow with the log.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import gammainccinv

from scan2fea.errors import FusionError, InputError, require
from scan2fea.fusion.kalman_kernels import KNOT, N_STATE, POSE, POSITION, SPEED, smoothed
from scan2fea.fusion.measurements import Events, densities, events_of
from scan2fea.fusion.options import FusionOptions
from scan2fea.fusion.start import Begun, Model, begin
from scan2fea.kernel.geodesy import world_of
from scan2fea.kernel.quaternions import matrices_of
from scan2fea.types import BoolArray, FloatArray, InertialLog, IntArray, PositionLog, Trajectory, Value

PART = 2000  # events
MOST_GATED = 0.5
NAMES = {POSITION: "positions", SPEED: "odometry", POSE: "poses"}
_DIMENSIONS = {KNOT: 1, POSITION: 3, SPEED: 3, POSE: 6}


@dataclass(frozen=True, kw_only=True)
class Taken(Value):
    """What became of one kind of measurement. nis : mean squared normalised innovation of those used over their degrees of freedom, 1 where the noise
    that was stated is the true one.
    """

    n: int
    n_gated: int
    nis: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion(Value):
    """trajectory : smoothed, with covariance.   filtered : as it was known at each moment.   velocity, gyro_bias, force_bias : (k, 3) smoothed.
    scale : of the odometry, and its standard deviation, or None.   taken : by kind of measurement.   gated : (g,) times of what was left out.
    is_heading_told : False where starts with another heading explain the logs as well.   density : (4,) of the inertial noise.
    """

    trajectory: Trajectory
    filtered: Trajectory
    velocity: FloatArray
    gyro_bias: FloatArray
    force_bias: FloatArray
    scale: tuple[float, float] | None
    taken: Mapping[str, Taken]
    gated: FloatArray
    is_heading_told: bool
    density: FloatArray


def kalman(
    log: InertialLog,
    gps: PositionLog | None = None,
    odometry: Trajectory | None = None,
    poses: Trajectory | None = None,
    options: FusionOptions = FusionOptions(),
) -> Motion:
    """The trajectory of the inertial unit, x east, y north, z up; without positions or poses it begins at the origin with heading zero.

    odometry : poses of which only the steps count.   poses : in the world. Raises InputError where nothing but the inertial log is given or the logs
    are not of one time, FusionError where more than half of a kind of measurement contradicts the rest.
    """
    given = gps is not None or odometry is not None or poses is not None
    require(len(log) > 2 and given, InputError, "a place needs positions, odometry or poses beside the inertial log; or use `complementary`")
    events = events_of(log, gps, odometry, poses, options)
    # the chi-square quantile of _DIMENSIONS degrees of freedom
    gates = np.array([2.0 * gammainccinv(_DIMENSIONS[k] / 2, options.gate) if options.gate > 0 else np.inf for k in sorted(_DIMENSIONS)])
    world = world_of(None if gps is None else gps.origin)
    model = Model(log=log, world=world, density=densities(log, options), gates=gates, antenna=np.array(options.antenna_m, float))
    begun = begin(model, events, options)
    return _motion(model, events, begun)


def _motion(model: Model, events: Events, begun: Begun) -> Motion:
    n = len(events)
    at = float(events.time_s[0])
    x, P, row = begun.x, begun.P, model.row_at(at)
    squares, believed = np.zeros(n), np.ones(n, bool)
    x_f, P_f = np.empty((n, N_STATE)), np.empty((n, 6, 6))
    kept = []
    for a in range(0, n, PART):
        b = min(a + PART, n)
        kept.append((x, P, row, at))
        part = events.take(slice(a, b))
        _, after, told, row = model.run(part, x, P, row, at)
        squares[a:b], believed[a:b] = told[0], told[2]
        x_f[a:b], P_f[a:b] = after[0], pose_blocks(after[1])
        x, P, at = after[0][-1], after[1][-1], float(part.time_s[-1])
    taken = _taken(events, squares, believed)
    x_s, P_s = np.empty((n, N_STATE)), np.empty((n, 6, 6))
    for a in range((n - 1) // PART * PART, -1, -PART):  # each part with the first event of the next
        b = min(a + PART + 1, n)
        x0, P0, row, at = kept[a // PART]
        before, after, _, _ = model.run(events.take(slice(a, b)), x0, P0, row, at)
        if b == n:
            x, P = after[0][-1].copy(), after[1][-1].copy()
            scale = (1.0 + float(x[16]), float(np.sqrt(P[15, 15])))
        smoothed((before[0], before[1], before[2]), (after[0], after[1]), x, P)
        x, P = after[0][0].copy(), after[1][0].copy()
        x_s[a:b], P_s[a:b] = after[0], pose_blocks(after[1])
    last = np.flatnonzero(np.append(np.diff(events.time_s) > 0, True))  # of events at one moment
    return Motion(
        trajectory=_trajectory(events.time_s[last], x_s[last], P_s[last]),
        filtered=_trajectory(events.time_s[last], x_f[last], P_f[last]),
        velocity=x_s[last, 4:7],
        gyro_bias=x_s[last, 10:13],
        force_bias=x_s[last, 13:16],
        scale=scale if SPEED in events.kind else None,
        taken=taken,
        gated=events.time_s[~believed],
        is_heading_told=begun.is_heading_told,
        density=model.density,
    )


def _taken(events: Events, squares: FloatArray, believed: BoolArray) -> dict[str, Taken]:
    found = {}
    for kind, name in NAMES.items():
        mine = events.kind == kind
        if not mine.any():
            continue
        used = mine & believed
        n, n_gated = int(mine.sum()), int((mine & ~believed).sum())
        says = f"{n_gated} of {n} {name} contradict the inertial log and the rest: check axes, units and clocks of the logs, and their noise"
        require(n_gated <= MOST_GATED * n, FusionError, says)
        found[name] = Taken(n=n, n_gated=n_gated, nis=float(squares[used].mean() / _DIMENSIONS[kind]))
    return found


def pose_blocks(P: FloatArray) -> FloatArray:
    """(k, 6, 6) covariance of place and turn out of that of the whole error (k, 16, 16)."""
    rows: IntArray = np.array([6, 7, 8, 0, 1, 2])
    return np.asarray(P[:, rows[:, None], rows])


def _trajectory(time_s: FloatArray, x: FloatArray, P: FloatArray) -> Trajectory:
    T = np.tile(np.eye(4), (len(x), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = matrices_of(x[:, :4]), x[:, 7:10]
    return Trajectory(T_world_frame=T, placed=np.ones(len(x), bool), time_s=time_s, covariance=P)

