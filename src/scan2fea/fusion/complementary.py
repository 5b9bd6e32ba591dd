"""The alpha (complementary) filter: attitude from gyroscope, accelerometer and magnetometer.

The thesis names it and leaves it empty (2.2). Written for angles it is a = al (a + rate dt) + (1 - al) a_acc with al = tau / (tau + dt). Here the
same is done to the vector of specific force: turned along by the gyroscope it is averaged with time constant tau, and what remains is up.
Averaging in a frame that does not turn, twice in a row, is what lets accelerations that swing vanish (as in VQF: Laidig, Seel, Information Fusion
2023, from which the limits of rest and of magnetic disturbance are taken). The heading follows the magnetometer the same way. What both keep
correcting is gyro bias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.fusion.options import FusionOptions
from scan2fea.kernel.jit import jit_ieee
from scan2fea.kernel.quaternions import Quaternion, Triple, between_samples, matrices_of, product, scaled_to_one, turned, turned_back
from scan2fea.types import BoolArray, FloatArray, InertialLog, Trajectory, Value

REST_RATE, REST_FORCE = math.radians(2.0), 0.5  # rad/s, m/s^2: a unit that lies still leaves its own mean by less
REST_AFTER_S, REST_MEAN_S = 1.5, 0.5
REST_BIAS_S = 5.0  # time constant of the bias at rest
MAGNETIC_SHARE, MAGNETIC_DIP = 0.1, math.radians(10.0)  # a field that differs by more from its mean is disturbed
SIZE, DIP, COUNT, ODD_S, HEADING = 0, 1, 2, 3, 4  # state of the field: mean strength and dip, rows in them, how long it has been odd, heading
MAGNETIC_MEAN_S, MAGNETIC_MOST_S = 20.0, 60.0  # of that mean; a field that stays changed so long is the field


@dataclass(frozen=True, eq=False, kw_only=True)
class Attitude(Value):
    """trajectory : attitude of each row; positions are zero, and no covariance is stated: what corrects it knows nothing of its own errors.
    bias : (k, 3) rad/s.   is_rest : (k,).   heading : "magnetic north", or "the start" where the log has no magnetometer.   n_disturbed : rows
    whose field was not believed.
    """

    trajectory: Trajectory
    bias: FloatArray
    is_rest: BoolArray
    heading: str
    n_disturbed: int


def complementary(log: InertialLog, options: FusionOptions = FusionOptions()) -> Attitude:
    """Attitude of every row: x east, y north, z up; without a magnetometer the heading is zero at the start.

    Raises InputError for a log of fewer than two rows.
    """
    require(len(log) > 1, InputError, "an attitude needs two rows of inertial data or more")
    n = len(log)
    magnetic = np.zeros((0, 3)) if log.magnetic is None else np.ascontiguousarray(log.magnetic)
    q, bias, is_rest = np.empty((n, 4)), np.empty((n, 3)), np.zeros(n, np.bool_)
    constants = (options.tau_s, options.magnetic_tau_s, options.bias_tau_s)
    n_disturbed = _filter(log.time_s, log.rate, log.force, magnetic, log.is_gap, constants, q, bias, is_rest)
    T = np.zeros((n, 4, 4))
    T[:, :3, :3], T[:, 3, 3] = matrices_of(q), 1.0
    return Attitude(
        trajectory=Trajectory(T_world_frame=T, placed=np.ones(n, bool), time_s=log.time_s),
        bias=bias,
        is_rest=is_rest,
        heading="the start" if log.magnetic is None else "magnetic north",
        n_disturbed=int(n_disturbed),
    )


@jit_ieee
def _filter(
    time: FloatArray,
    rate: FloatArray,
    force: FloatArray,
    magnetic: FloatArray,
    is_gap: BoolArray,
    constants: tuple[float, float, float],
    q_out: FloatArray,
    bias_out: FloatArray,
    is_rest: BoolArray,
) -> int:
    """One pass over the rows. Returns the number of disturbed rows."""
    tau, magnetic_tau, bias_tau = constants
    half = 0.5 * tau  # two averages in a row, the delay of both is tau
    gyro, level = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)  # to a frame that does not turn; from there to the level
    bias, once, twice = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # of the rates; specific force averaged once and twice
    since, rows, n_disturbed, rest_s, rest_rows = 0.0, 0, 0, 0.0, 0
    field, rest = np.zeros(5), np.zeros(6)
    for k in range(len(time)):
        dt = time[k] - time[k - 1] if k > 0 else 0.0
        if is_gap[k]:
            rows, field[COUNT], since, rest_s = 0, 0.0, 0.0, 0.0  # what happened is not known: begin to average anew
        elif k > 0:
            step = between_samples(_less(rate[k - 1], bias), _less(rate[k], bias), dt)
            gyro = scaled_to_one(product(gyro, step))
        rows += 1
        since += dt
        gain = max(dt / (half + dt), 1.0 / rows)  # 1 - al
        once = _toward(once, turned(gyro, (force[k, 0], force[k, 1], force[k, 2])), gain)
        twice = _toward(twice, once, gain)
        level, cx, cy = _levelled(level, turned(level, twice))
        tilted = product(level, gyro)
        turn = 0.0
        if len(magnetic) > 0:
            turn, odd = _heading_step(field, turned(tilted, (magnetic[k, 0], magnetic[k, 1], magnetic[k, 2])), dt, magnetic_tau, since > magnetic_tau)
            n_disturbed += odd
        rest_s = rest_s + dt if _is_still(rest, rate[k], force[k], dt / (REST_MEAN_S + dt) if k > 0 else 1.0) else 0.0
        if rest_s > REST_AFTER_S:
            is_rest[k] = True
            rest_rows += 1
            bias = _toward(bias, (rest[0], rest[1], rest[2]), max(dt / REST_BIAS_S, 1.0 / rest_rows))
        elif since > 2.0 * tau:  # the corrections go against the bias that is left
            share = 1.0 / min(max(since, 4.0 * tau), bias_tau)
            gx, gy, gz = turned_back(tilted, (cx, cy, turn if since > 2.0 * magnetic_tau else 0.0))
            bias = (bias[0] - share * gx, bias[1] - share * gy, bias[2] - share * gz)
        half_heading = 0.5 * field[HEADING]
        q_out[k, 0], q_out[k, 1], q_out[k, 2], q_out[k, 3] = product((0.0, 0.0, math.sin(half_heading), math.cos(half_heading)), tilted)
        bias_out[k, 0], bias_out[k, 1], bias_out[k, 2] = bias
    return n_disturbed


@jit_ieee
def _less(row: FloatArray, bias: Triple) -> Triple:
    return row[0] - bias[0], row[1] - bias[1], row[2] - bias[2]


@jit_ieee
def _toward(mean: Triple, value: Triple, gain: float) -> Triple:
    """A running mean after one more value."""
    x, y, z = mean
    return x + gain * (value[0] - x), y + gain * (value[1] - y), z + gain * (value[2] - z)


@jit_ieee
def _levelled(level: Quaternion, force: Triple) -> tuple[Quaternion, float, float]:
    """The turn to the level after one that brings `force` (which it has turned) upright, and that turn about x and y, radians."""
    ex, ey, ez = force
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    if not size > 0.0:
        return level, 0.0, 0.0
    step = scaled_to_one((ey, -ex, 0.0, size + ez)) if size + ez > 1e-9 * size else (1.0, 0.0, 0.0, 0.0)
    return scaled_to_one(product(step, level)), 2.0 * step[0], 2.0 * step[1]


@jit_ieee
def _heading_step(field: FloatArray, seen: Triple, dt: float, tau: float, settled: bool) -> tuple[float, int]:
    """Turn of the heading (radians) by which the levelled field `seen` corrects it, and 1 where it is disturbed and was not believed.

    field : state (5,), changed in place.   settled : the means have been built.
    """
    mx, my, mz = seen
    flat = math.sqrt(mx * mx + my * my)
    strength, dip = math.sqrt(flat * flat + mz * mz), math.atan2(-mz, flat)
    odd = field[COUNT] > 0 and (abs(strength - field[SIZE]) > MAGNETIC_SHARE * field[SIZE] or abs(dip - field[DIP]) > MAGNETIC_DIP)
    odd = odd and settled
    if odd and field[ODD_S] < MAGNETIC_MOST_S:
        field[ODD_S] += dt
        return 0.0, 1
    if odd:  # it has been so for a minute: this is the field
        field[COUNT] = 0.0
    field[ODD_S] = 0.0
    field[COUNT] += 1.0
    mean = max(dt / (MAGNETIC_MEAN_S + dt), 1.0 / field[COUNT])
    field[SIZE] += mean * (strength - field[SIZE])
    field[DIP] += mean * (dip - field[DIP])
    away = math.atan2(mx, my) - field[HEADING]
    away -= 2.0 * math.pi * math.floor(away / (2.0 * math.pi) + 0.5)
    turn = max(dt / (tau + dt), 1.0 / field[COUNT]) * away
    field[HEADING] += turn
    return turn, 0


@jit_ieee
def _is_still(mean: FloatArray, rate: FloatArray, force: FloatArray, gain: float) -> bool:
    """Whether a row leaves its own running mean (6,) of rate and force, changed in place, by no more than a unit that lies still."""
    still = True
    for i in range(3):
        mean[i] += gain * (rate[i] - mean[i])
        mean[3 + i] += gain * (force[i] - mean[3 + i])
        still = still and abs(rate[i] - mean[i]) < REST_RATE and abs(force[i] - mean[3 + i]) < REST_FORCE and abs(mean[i]) < REST_RATE
    return still
