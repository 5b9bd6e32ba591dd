"""Where the Kalman filter begins: level from the accelerometer; of all headings, the one under which the first half minute is likeliest.

A linearised filter started with a wrong heading does not come back; so eight are tried, each is smoothed and begun again from what that says of its
start, and the likelihoods of their innovations are compared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.fusion.kalman_kernels import KNOT, N_ERROR, N_STATE, POSE, POSITION, SPEED, filtered, smoothed
from scan2fea.fusion.measurements import Events
from scan2fea.fusion.options import FusionOptions
from scan2fea.kernel.transforms import matrix_to_quaternion, quaternion_to_matrix, rotation_about
from scan2fea.types import FloatArray, InertialLog, Value

WINDOW_S = 30.0
HEADINGS, ROUNDS = 8, 4
NARROW, LINEAR = 3.0, math.radians(2.0)  # of the deviation of the attitude; below this all is linear
TIE, APART = 6.0, math.radians(30.0)  # of log-likelihood; of heading
_MOVING_TILT, _RESTING_TILT, _HEADING, _FIELD = 0.25, 0.05, 0.5, 0.35  # rad, standard deviations
_LEVEL_S, _REST_RATE, _REST_FORCE = 0.5, 0.1, 0.3
_SPEED, _FIXES = 3.0, 5  # m/s, of the velocity at the start

Arrays = tuple[Any, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Model(Value):
    """What does not change while the filter runs. world : (5,) see `kernel.geodesy`.   density, gates : (4,).   antenna : (3,)."""

    log: InertialLog
    world: FloatArray
    density: FloatArray
    gates: FloatArray
    antenna: FloatArray

    def run(self, events: Events, x: FloatArray, P: FloatArray, row: int, at: float) -> tuple[Arrays, Arrays, Arrays, int]:
        """Through the events from moment `at` in row `row` of the log: before, after and told of each (see `filtered`), and the row reached."""
        n = len(events)
        before = (np.empty((n, N_STATE)), np.empty((n, N_ERROR, N_ERROR)), np.empty((n, N_ERROR, N_ERROR)))
        after = (np.empty((n, N_STATE)), np.empty((n, N_ERROR, N_ERROR)))
        told = (np.empty(n), np.empty(n), np.empty(n, np.bool_))
        log = (self.log.time_s, self.log.rate, self.log.force, self.log.is_gap)
        data = (events.time_s, events.kind, events.z, events.noise)
        row = filtered(log, row, at, *data, self.gates, self.world, self.density, self.antenna, x.copy(), P.copy(), before, after, told)
        return before, after, told, int(row)

    def row_at(self, time_s: float) -> int:
        """The last row at or before a moment."""
        return max(int(np.searchsorted(self.log.time_s, time_s, side="right")) - 1, 0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Begun(Value):
    """x : (17,), P : (16, 16) at the first event.   is_heading_told : False where another heading explains the start as well."""

    x: FloatArray
    P: FloatArray
    is_heading_told: bool


def begin(model: Model, events: Events, options: FusionOptions) -> Begun:
    """The state at the first event and how unsure it is; the start that is looked at is doubled until it tells the heading, or is the whole."""
    at, seconds = float(events.time_s[0]), WINDOW_S
    while True:
        window = _window(events, at + seconds)
        begun = _begun(model, window, at, options)
        if begun.is_heading_told or at + seconds >= events.time_s[-1]:
            return begun
        seconds *= 2.0


def _window(events: Events, until_s: float) -> Events:
    """What is measured up to a moment: positions or poses, and speeds only where there are neither, for with a heading that is far off a close
    speed misleads a linear filter.
    """
    inside = (events.kind != KNOT) & (events.time_s <= until_s)
    places = inside & (events.kind != SPEED)
    return events.take(np.flatnonzero(places if int(places.sum()) > 2 else inside))


def _begun(model: Model, window: Events, at: float, options: FusionOptions) -> Begun:
    """The likeliest start as the window has it."""
    level, tilt = _level(model.log, model.row_at(at))
    if POSE in window.kind:
        first = window.z[int(np.argmax(window.kind == POSE))]
        starts, heading = [quaternion_to_matrix(first[3:])], 0.1
        tilt = max(3 * math.radians(options.pose_deg), 0.1)
    elif POSITION not in window.kind:
        starts, heading = [level], 1e-4  # the world is where it begins
    else:
        starts = [rotation_about((0, 0, 1), 2 * math.pi * k / HEADINGS) @ level for k in range(HEADINGS)]
        heading = _HEADING
    spread = _spread(window, at, tilt, heading, options)
    found = [_tried(model, window, at, R, spread) for R in starts]
    score, x, P = max(found, key=lambda row: row[0])
    told = all(score - s > TIE or _apart(x, other) < APART for s, other, _ in found)
    if not told and model.log.magnetic is not None:
        north = _north(model.log, model.row_at(at)) @ level
        _, x, P = _tried(model, window, at, north, _spread(window, at, tilt, _FIELD, options))
        told = True
    return Begun(x=x, P=P, is_heading_told=told)


def _level(log: InertialLog, row: int) -> tuple[FloatArray, float]:
    """(3, 3) the turn of least angle that brings the mean specific force up, and the standard deviation of that."""
    stop = int(np.searchsorted(log.time_s, log.time_s[row] + _LEVEL_S)) + 1
    force, rate = log.force[row:stop], log.rate[row:stop]
    up = force.mean(axis=0) / np.linalg.norm(force.mean(axis=0))
    axis = np.cross(up, (0.0, 0.0, 1.0))
    angle = math.atan2(float(np.linalg.norm(axis)), float(up[2]))
    R = rotation_about(axis if angle > 1e-9 and np.linalg.norm(axis) > 1e-12 else (1.0, 0.0, 0.0), angle)
    rests = bool((np.abs(rate.mean(axis=0)) < _REST_RATE).all() and (force.std(axis=0) < _REST_FORCE).all())
    # an even acceleration is not seen here: only a size that is gravity's speaks for rest
    rests = rests and abs(float(np.linalg.norm(force.mean(axis=0))) - 9.81) < 0.5 * _REST_FORCE
    return R, _RESTING_TILT if rests else _MOVING_TILT


def _north(log: InertialLog, row: int) -> FloatArray:
    """(3, 3) turn about the vertical that brings the levelled magnetic field to the north."""
    level, _ = _level(log, row)
    field = level @ (np.zeros(3) if log.magnetic is None else log.magnetic[row])
    return rotation_about((0, 0, 1), math.atan2(field[0], field[1]))


def _spread(window: Events, at: float, tilt: float, heading: float, options: FusionOptions) -> tuple[FloatArray, FloatArray]:
    """Place and velocity (6,) at the first event with unknown attitude, and P (16, 16)."""
    state, P = np.zeros(6), np.zeros((N_ERROR, N_ERROR))
    bias = (options.gyro_bias, options.acceleration_bias)
    sigma = np.array([tilt, tilt, heading, *[_SPEED] * 3, *[1e-4] * 3, *[bias[0]] * 3, *[bias[1]] * 3, options.odometry_scale])
    for kind in (POSITION, POSE):
        rows = np.flatnonzero(window.kind == kind)[:_FIXES]
        if len(rows) > 1:
            time, place = window.time_s[rows] - at, window.z[rows, :3]
            v = np.median(np.diff(place, axis=0) / np.maximum(np.diff(time), 1e-6)[:, None], axis=0)
            begun = place - time[:, None] * v
            state[:3], state[3:] = np.median(begun, axis=0), v
            noise = np.sqrt(np.array([np.diag(N)[:3] for N in window.noise[rows]])).mean(axis=0)
            sigma[6:9] = noise + 3.0 * np.median(np.abs(begun - state[:3]), axis=0)
            sigma[3:6] = _SPEED + 2.0 * noise / max(float(np.median(np.diff(time))), 1e-3)
            sigma[6:9] += _SPEED * float(time[0])
    P[np.arange(N_ERROR), np.arange(N_ERROR)] = sigma**2
    return state, P


def _tried(model: Model, window: Events, at: float, R: FloatArray, spread: tuple[FloatArray, FloatArray]) -> tuple[float, FloatArray, FloatArray]:
    """Log-likelihood of the window from an attitude, and the start that its smoothing leads to."""
    (place, v), P = (spread[0][:3], spread[0][3:]), spread[1]
    first_speed = np.flatnonzero(window.kind == SPEED)
    if len(first_speed) and not np.isin(window.kind, (POSITION, POSE)).any():
        v = R @ window.z[first_speed[0], :3]
    x = np.concatenate([matrix_to_quaternion(R), v, place, np.zeros(7)])
    row, score = model.row_at(at), -np.inf
    events, wide = _with_start(window, at), P
    for _ in range(ROUNDS):
        before, after, told, _ = model.run(events, x, P, row, at)
        score = -0.5 * float((np.minimum(told[0], model.gates[events.kind]) + told[1])[1:].sum())
        smoothed((before[0], before[1], before[2]), (after[0], after[1]), after[0][-1].copy(), after[1][-1].copy())
        x, P = after[0][0].copy(), _narrowed(wide, after[1][0])
    return score, x, P


def _with_start(window: Events, at: float) -> Events:
    """The events after a knot at the start itself."""
    z, noise = np.concatenate([np.zeros((1, 7)), window.z]), np.concatenate([np.eye(6)[None], window.noise])
    return Events(time_s=np.concatenate([[at], window.time_s]), kind=np.concatenate([[KNOT], window.kind]).astype(np.int64), z=z, noise=noise)


def _narrowed(P: FloatArray, found: FloatArray) -> FloatArray:
    """P with the deviations of the attitude brought down to what was found, taken threefold so that the data hardly count twice: about an attitude
    that is far off, steps are not linear and what they seem to tell is not so.
    """
    narrow = P.copy()
    sigma = np.maximum(NARROW * np.sqrt(np.diag(found)[:3]), LINEAR)
    narrow[[0, 1, 2], [0, 1, 2]] = np.minimum(np.diag(P)[:3], sigma**2)
    return narrow


def _apart(a: FloatArray, b: FloatArray) -> float:
    """Angle between the attitudes of two states."""
    return 2.0 * math.acos(min(1.0, abs(float(a[:4] @ b[:4]))))
