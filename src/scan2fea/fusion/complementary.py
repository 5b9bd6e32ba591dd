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
from scan2fea.kernel.quaternions import between_samples, matrices_of, product, scaled_to_one, turned, turned_back
from scan2fea.types import BoolArray, FloatArray, InertialLog, Trajectory, Value

REST_RATE, REST_FORCE = math.radians(2.0), 0.5  # rad/s, m/s^2: a unit that lies still leaves its own mean by less
REST_AFTER_S, REST_MEAN_S = 1.5, 0.5
REST_BIAS_S = 5.0  # time constant of the bias at rest
MAGNETIC_SHARE, MAGNETIC_DIP = 0.1, math.radians(10.0)  # a field that differs by more from its mean is disturbed
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
    bx = by = bz = 0.0
    ux = uy = uz = vx = vy = vz = 0.0  # specific force averaged once and twice
    since, heading = 0.0, 0.0
    rows, n_field, n_disturbed, disturbed_s = 0, 0, 0, 0.0
    field_size = field_dip = 0.0
    rest = np.zeros(6)
    rest_s, rest_rows = 0.0, 0
    for k in range(len(time)):
        dt = time[k] - time[k - 1] if k > 0 else 0.0
        now = (rate[k, 0] - bx, rate[k, 1] - by, rate[k, 2] - bz)
        if is_gap[k]:
            rows, n_field, since, rest_s = 0, 0, 0.0, 0.0  # what happened is not known: begin to average anew
        elif k > 0:
            before = (rate[k - 1, 0] - bx, rate[k - 1, 1] - by, rate[k - 1, 2] - bz)
            gyro = scaled_to_one(product(gyro, between_samples(before, now, dt)))
        rows += 1
        since += dt
        ax, ay, az = turned(gyro, (force[k, 0], force[k, 1], force[k, 2]))
        gain = max(dt / (half + dt), 1.0 / rows)  # 1 - al
        ux, uy, uz = ux + gain * (ax - ux), uy + gain * (ay - uy), uz + gain * (az - uz)
        vx, vy, vz = vx + gain * (ux - vx), vy + gain * (uy - vy), vz + gain * (uz - vz)
        ex, ey, ez = turned(level, (vx, vy, vz))
        size = math.sqrt(ex * ex + ey * ey + ez * ez)
        cx = cy = 0.0
        if size > 0.0:
            step = scaled_to_one((ey, -ex, 0.0, size + ez)) if size + ez > 1e-9 * size else (1.0, 0.0, 0.0, 0.0)
            level = scaled_to_one(product(step, level))
            cx, cy = 2.0 * step[0], 2.0 * step[1]
        tilted = product(level, gyro)

        turn = 0.0
        if len(magnetic) > 0:
            mx, my, mz = turned(tilted, (magnetic[k, 0], magnetic[k, 1], magnetic[k, 2]))
            flat = math.sqrt(mx * mx + my * my)
            strength, dip = math.sqrt(flat * flat + mz * mz), math.atan2(-mz, flat)
            odd = n_field > 0 and (abs(strength - field_size) > MAGNETIC_SHARE * field_size or abs(dip - field_dip) > MAGNETIC_DIP)
            odd = odd and since > magnetic_tau
            if odd and disturbed_s < MAGNETIC_MOST_S:
                n_disturbed += 1
                disturbed_s += dt
            else:
                if odd:  # it has been so for a minute: this is the field
                    n_field = 0
                disturbed_s = 0.0
                n_field += 1
                mean = max(dt / (MAGNETIC_MEAN_S + dt), 1.0 / n_field)
                field_size, field_dip = field_size + mean * (strength - field_size), field_dip + mean * (dip - field_dip)
                away = math.atan2(mx, my) - heading
                away -= 2.0 * math.pi * math.floor(away / (2.0 * math.pi) + 0.5)
                turn = max(dt / (magnetic_tau + dt), 1.0 / n_field) * away
                heading += turn

        still = True
        mean = dt / (REST_MEAN_S + dt) if k > 0 else 1.0
        for i in range(3):
            rest[i] += mean * (rate[k, i] - rest[i])
            rest[3 + i] += mean * (force[k, i] - rest[3 + i])
            still = still and abs(rate[k, i] - rest[i]) < REST_RATE and abs(force[k, i] - rest[3 + i]) < REST_FORCE and abs(rest[i]) < REST_RATE
        rest_s = rest_s + dt if still else 0.0
        if rest_s > REST_AFTER_S:
            is_rest[k] = True
            rest_rows += 1
            mean = max(dt / REST_BIAS_S, 1.0 / rest_rows)
            bx, by, bz = bx + mean * (rest[0] - bx), by + mean * (rest[1] - by), bz + mean * (rest[2] - bz)
        elif since > 2.0 * tau:  # the corrections go against the bias that is left
            share = 1.0 / min(max(since, 4.0 * tau), bias_tau)
            gx, gy, gz = turned_back(tilted, (cx, cy, turn if since > 2.0 * magnetic_tau else 0.0))
            bx, by, bz = bx - share * gx, by - share * gy, bz - share * gz

        out = product((0.0, 0.0, math.sin(0.5 * heading), math.cos(0.5 * heading)), tilted)
        q_out[k, 0], q_out[k, 1], q_out[k, 2], q_out[k, 3] = out
        bias_out[k, 0], bias_out[k, 1], bias_out[k, 2] = bx, by, bz
    return n_disturbed
