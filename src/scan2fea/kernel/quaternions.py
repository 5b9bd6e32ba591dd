"""Unit quaternions (x, y, z, w) one at a time, compiled: what filters do at every sample. Arrays of them: `matrices_of`."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray

Quaternion = tuple[float, float, float, float]
Triple = tuple[float, float, float]


@jit_ieee
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The turn b, then a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


@jit_ieee
def scaled_to_one(q: Quaternion) -> Quaternion:
    """The unit quaternion along q, which is not zero."""
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * s, q[1] * s, q[2] * s, q[3] * s


@jit_ieee
def turned(q: Quaternion, v: Triple) -> Triple:
    """R(q) v."""
    x, y, z, w = q
    tx, ty, tz = 2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])
    return v[0] + w * tx + y * tz - z * ty, v[1] + w * ty + z * tx - x * tz, v[2] + w * tz + x * ty - y * tx


@jit_ieee
def turned_back(q: Quaternion, v: Triple) -> Triple:
    """R(q)^T v."""
    return turned((-q[0], -q[1], -q[2], q[3]), v)


@jit_ieee
def of_vector(v: Triple) -> Quaternion:
    """exp of a rotation vector, radians; exact at zero by the series sin(a/2)/a = 1/2 - a^2/48 + a^4/3840."""
    square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    if square < 1e-4:
        s, c = 0.5 - square / 48.0 + square * square / 3840.0, 1.0 - square / 8.0 + square * square / 384.0
    else:
        angle = math.sqrt(square)
        s, c = math.sin(0.5 * angle) / angle, math.cos(0.5 * angle)
    return v[0] * s, v[1] * s, v[2] * s, c


@jit_ieee
def vector_of(q: Quaternion) -> Triple:
    """The rotation vector of the shorter turn, radians: the inverse of `of_vector`."""
    sign = 1.0 if q[3] >= 0.0 else -1.0
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    s = 2.0 * sign if length < 1e-9 else sign * 2.0 * math.atan2(length, abs(q[3])) / length
    return q[0] * s, q[1] * s, q[2] * s


@jit_ieee
def between_samples(w0: Triple, w1: Triple, dt: float) -> Quaternion:
    """The turn within dt of a body whose rate (rad/s, its own axes) goes evenly from w0 to w1.

    With the second term of the Magnus series, dt^2/12 w0 x w1, which halves the drift of a coning motion; the error goes with dt^2.
    """
    h, c = 0.5 * dt, dt * dt / 12.0
    return of_vector(
        (
            h * (w0[0] + w1[0]) + c * (w0[1] * w1[2] - w0[2] * w1[1]),
            h * (w0[1] + w1[1]) + c * (w0[2] * w1[0] - w0[0] * w1[2]),
            h * (w0[2] + w1[2]) + c * (w0[0] * w1[1] - w0[1] * w1[0]),
        )
    )


def matrices_of(q: FloatArray) -> FloatArray:
    """(k, 3, 3) rotations of (k, 4) unit quaternions."""
    x, y, z, w = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)
