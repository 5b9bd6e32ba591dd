"""The compiled half of the Kalman filter: inertial propagation, measurements, and the smoother.

State x (17): quaternion of the attitude 0-3, velocity 4-6, place 7-9, biases of rates 10-12 and of specific force 13-15, scale of the odometry
minus 1 16. Its error (16), all along the world's axes but the biases: turn 0-2, velocity 3-5, place 6-8, biases 9-14, scale 15; the true attitude is
exp(turn) R. (Error-state filter: Sola, Quaternion kinematics for the error-state Kalman filter, 2017; smoother: Rauch, Tung, Striebel 1965.)
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.kernel.quaternions import Triple, between_samples, of_vector, product, scaled_to_one, turned, turned_back, vector_of
from scan2fea.types import BoolArray, FloatArray, IntArray

KNOT, POSITION, SPEED, POSE = 0, 1, 2, 3  # kinds of events; a knot measures nothing
N_STATE, N_ERROR = 17, 16
_GAP_RATE, _GAP_FORCE = 1.0, 9.0  # rad^2/s, m^2/s^3: what a carrier may do while nothing is recorded


@jit_ieee
def _matrix(q: tuple[float, float, float, float], R: FloatArray) -> None:
    for j in range(3):
        column = turned(q, (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0))
        R[0, j], R[1, j], R[2, j] = column


@jit_ieee
def _turned_errors(M: FloatArray, R: FloatArray, c: Triple, dt: float) -> None:
    """M <- F M for the transition F of an inertial step: place by velocity, velocity by turn and force bias, turn by rate bias."""
    for j in range(M.shape[1]):
        tx, ty, tz = M[0, j], M[1, j], M[2, j]
        for i in range(3):
            M[6 + i, j] += dt * M[3 + i, j]
        M[3, j] -= dt * (c[1] * tz - c[2] * ty)
        M[4, j] -= dt * (c[2] * tx - c[0] * tz)
        M[5, j] -= dt * (c[0] * ty - c[1] * tx)
        for i in range(3):
            M[3 + i, j] -= dt * (R[i, 0] * M[12, j] + R[i, 1] * M[13, j] + R[i, 2] * M[14, j])
            M[i, j] -= dt * (R[i, 0] * M[9, j] + R[i, 1] * M[10, j] + R[i, 2] * M[11, j])


@jit_ieee
def _transposed(M: FloatArray) -> None:
    for i in range(M.shape[0]):
        for j in range(i):
            M[i, j], M[j, i] = M[j, i], M[i, j]


@jit_ieee
def _advance(
    x: FloatArray, P: FloatArray, phi: FloatArray, R: FloatArray, w0: Triple, w1: Triple, f: Triple, dt: float, world: FloatArray, noise: FloatArray
) -> None:
    """One inertial step, in place. w0, w1 : rates at its ends.   f : mean specific force.   world : gravity, radius of the Earth, its rate (3).
    noise : spectral densities of turn, velocity and both biases.   R : (3, 3) to write into.
    """
    q = (x[0], x[1], x[2], x[3])
    earth = turned_back(q, (world[2], world[3], world[4]))
    bx, by, bz = x[10] + earth[0], x[11] + earth[1], x[12] + earth[2]
    a, b = (w0[0] - bx, w0[1] - by, w0[2] - bz), (w1[0] - bx, w1[1] - by, w1[2] - bz)
    middle = product(q, between_samples(a, (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])), 0.5 * dt))
    c = turned(middle, (f[0] - x[13], f[1] - x[14], f[2] - x[15]))
    vx, vy, vz = x[4], x[5], x[6]
    down = world[0] / world[1]
    ax = c[0] - down * x[7] - 2.0 * (world[3] * vz - world[4] * vy)
    ay = c[1] - down * x[8] - 2.0 * (world[4] * vx - world[2] * vz)
    az = c[2] - world[0] + 2.0 * down * x[9] - 2.0 * (world[2] * vy - world[3] * vx)
    x[0], x[1], x[2], x[3] = scaled_to_one(product(q, between_samples(a, b, dt)))
    x[7], x[8], x[9] = x[7] + dt * (vx + 0.5 * dt * ax), x[8] + dt * (vy + 0.5 * dt * ay), x[9] + dt * (vz + 0.5 * dt * az)
    x[4], x[5], x[6] = vx + dt * ax, vy + dt * ay, vz + dt * az
    _matrix(middle, R)
    _turned_errors(P, R, c, dt)
    _transposed(P)  # P is symmetric: F (F P)^T = F P F^T
    _turned_errors(P, R, c, dt)
    _turned_errors(phi, R, c, dt)
    for i in range(3):
        P[i, i] += dt * noise[0]
        P[3 + i, 3 + i] += dt * noise[1]
        P[9 + i, 9 + i] += dt * noise[2]
        P[12 + i, 12 + i] += dt * noise[3]


@jit_ieee
def _expected(kind: int, x: FloatArray, z: FloatArray, antenna: FloatArray, H: FloatArray, r: FloatArray) -> int:
    """Residual and its derivative by the error; returns how many numbers were measured."""
    q = (x[0], x[1], x[2], x[3])
    H[:] = 0.0
    if kind == POSITION:
        arm = turned(q, (antenna[0], antenna[1], antenna[2]))
        for i in range(3):
            r[i] = z[i] - x[7 + i] - arm[i]
            H[i, 6 + i] = 1.0
        H[0, 1], H[0, 2], H[1, 0], H[1, 2], H[2, 0], H[2, 1] = arm[2], -arm[1], -arm[2], arm[0], arm[1], -arm[0]
        return 3
    if kind == SPEED:
        v = (x[4], x[5], x[6])
        own = turned_back(q, v)
        scale = 1.0 + x[16]
        for j in range(3):
            e = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
            column = turned_back(q, e)
            crossed = turned_back(q, (v[1] * e[2] - v[2] * e[1], v[2] * e[0] - v[0] * e[2], v[0] * e[1] - v[1] * e[0]))
            for i in range(3):
                H[i, 3 + j] = scale * column[i]
                H[i, j] = scale * crossed[i]
        for i in range(3):
            r[i] = z[i] - scale * own[i]
            H[i, 15] = own[i]
        return 3
    turn = vector_of(product((z[3], z[4], z[5], z[6]), (-q[0], -q[1], -q[2], q[3])))
    for i in range(3):
        r[i], r[3 + i] = z[i] - x[7 + i], turn[i]
        H[i, 6 + i] = H[3 + i, i] = 1.0
    return 6


@jit_ieee
def _times(A: FloatArray, B: FloatArray, C: FloatArray) -> None:
    """C <- A B."""
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            C[i, j] = 0.0
        for k in range(A.shape[1]):
            a = A[i, k]
            if a != 0.0:
                for j in range(B.shape[1]):
                    C[i, j] += a * B[k, j]


@jit_ieee
def _times_transposed(A: FloatArray, B: FloatArray, C: FloatArray) -> None:
    """C <- A B^T."""
    for i in range(A.shape[0]):
        for j in range(B.shape[0]):
            total = 0.0
            for k in range(A.shape[1]):
                total += A[i, k] * B[j, k]
            C[i, j] = total


@jit_ieee
def _solved(S: FloatArray, m: int, B: FloatArray) -> float:
    """B <- S^-1 B for the symmetric positive S (m, m), which becomes its Cholesky factor; returns log det S."""
    log = 0.0
    for j in range(m):
        for k in range(j):
            S[j, j] -= S[j, k] * S[j, k]
        S[j, j] = math.sqrt(S[j, j])
        log += 2.0 * math.log(S[j, j])
        for i in range(j + 1, m):
            for k in range(j):
                S[i, j] -= S[i, k] * S[j, k]
            S[i, j] /= S[j, j]
    for c in range(B.shape[1]):
        for i in range(m):
            for k in range(i):
                B[i, c] -= S[i, k] * B[k, c]
            B[i, c] /= S[i, i]
        for i in range(m - 1, -1, -1):
            for k in range(i + 1, m):
                B[i, c] -= S[k, i] * B[k, c]
            B[i, c] /= S[i, i]
    return log


@jit_ieee
def moved_by(x: FloatArray, error: FloatArray) -> None:
    """The state with its error put in, in place."""
    q = scaled_to_one(product(of_vector((error[0], error[1], error[2])), (x[0], x[1], x[2], x[3])))
    x[0], x[1], x[2], x[3] = q
    for i in range(3, N_ERROR):
        x[1 + i] += error[i]


@jit_ieee
def _measured(
    kind: int, x: FloatArray, P: FloatArray, z: FloatArray, noise: FloatArray, antenna: FloatArray, gates: FloatArray
) -> tuple[float, float, bool]:
    """Take one measurement into x and P, in place. Returns the squared normalised innovation, log det S, and whether it was believed."""
    H, r = np.zeros((6, N_ERROR)), np.zeros(6)
    m = _expected(kind, x, z, antenna, H, r)
    S, HP, rows = np.empty((m, m)), np.empty((m, N_ERROR)), np.empty((m, N_ERROR + 1))
    _times(H[:m], P, HP)
    _times_transposed(HP, H[:m], S)
    for i in range(m):
        for j in range(m):
            S[i, j] += noise[i, j]
        for j in range(N_ERROR):
            rows[i, j] = HP[i, j]
        rows[i, N_ERROR] = r[i]
    log = _solved(S, m, rows)
    square = 0.0
    for i in range(m):
        square += r[i] * rows[i, N_ERROR]
    if not square <= gates[kind]:
        return square, log, False
    K, A, AP, KN = np.empty((N_ERROR, m)), np.empty((N_ERROR, N_ERROR)), np.empty((N_ERROR, N_ERROR)), np.empty((N_ERROR, m))
    step = np.zeros(N_ERROR)
    for i in range(N_ERROR):
        for j in range(m):
            K[i, j] = rows[j, i]
            step[i] += K[i, j] * r[j]
    _times(K, H[:m], A)
    for i in range(N_ERROR):
        for j in range(N_ERROR):
            A[i, j] = (1.0 if i == j else 0.0) - A[i, j]
    _times(A, P, AP)
    _times_transposed(AP, A, P)
    _times(K, noise[:m, :m], KN)
    _times_transposed(KN, K, AP)
    for i in range(N_ERROR):
        for j in range(N_ERROR):
            P[i, j] += AP[i, j]  # Joseph: (I - K H) P (I - K H)^T + K N K^T
    moved_by(x, step)
    return square, log, True


@jit_ieee
def filtered(
    log: tuple[FloatArray, FloatArray, FloatArray, BoolArray],
    row: int,
    start_s: float,
    event_s: FloatArray,
    kind: IntArray,
    z: FloatArray,
    noise: FloatArray,
    gates: FloatArray,
    world: FloatArray,
    density: FloatArray,
    antenna: FloatArray,
    x: FloatArray,
    P: FloatArray,
    before: tuple[FloatArray, FloatArray, FloatArray],
    after: tuple[FloatArray, FloatArray],
    told: tuple[FloatArray, FloatArray, BoolArray],
) -> int:
    """From start_s through the events; x and P are changed in place. Returns the row of the log reached.

    log : times, rates, forces, gaps.   row : of the log at or before start_s.   before : of each event x, P before it and the transition from the
    event before; after : x, P after it; told : squared innovation, log det S, believed. All are written into.
    """
    time, rate, force, is_gap = log
    R, phi = np.empty((3, 3)), np.empty((N_ERROR, N_ERROR))
    at = start_s
    wide = np.empty(4)
    for e in range(len(event_s)):
        phi[:] = 0.0
        for i in range(N_ERROR):
            phi[i, i] = 1.0
        while at < event_s[e] and row + 1 < len(time):
            until = min(event_s[e], time[row + 1])
            if until > at:
                span = time[row + 1] - time[row]
                s0, s1 = (at - time[row]) / span, (until - time[row]) / span
                a, b = rate[row], rate[row + 1]
                w0 = (a[0] + s0 * (b[0] - a[0]), a[1] + s0 * (b[1] - a[1]), a[2] + s0 * (b[2] - a[2]))
                w1 = (a[0] + s1 * (b[0] - a[0]), a[1] + s1 * (b[1] - a[1]), a[2] + s1 * (b[2] - a[2]))
                s = 0.5 * (s0 + s1)
                a, b = force[row], force[row + 1]
                f = (a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2]))
                for i in range(4):
                    wide[i] = density[i]
                if is_gap[row + 1]:
                    wide[0], wide[1] = density[0] + _GAP_RATE, density[1] + _GAP_FORCE
                _advance(x, P, phi, R, w0, w1, f, until - at, world, wide)
            at = until
            if until >= time[row + 1]:
                row += 1
        _put(x, P, e, before[0], before[1])
        for i in range(N_ERROR):
            for j in range(N_ERROR):
                before[2][e, i, j] = phi[i, j]
        told[0][e], told[1][e], told[2][e] = 0.0, 0.0, True
        if kind[e] != KNOT:
            told[0][e], told[1][e], told[2][e] = _measured(kind[e], x, P, z[e], noise[e], antenna, gates)
        _put(x, P, e, after[0], after[1])
    return row


@jit_ieee
def _put(x: FloatArray, P: FloatArray, e: int, states: FloatArray, covariances: FloatArray) -> None:
    """State and covariance into row e of those that are kept."""
    for i in range(len(x)):
        states[e, i] = x[i]
    for i in range(N_ERROR):
        for j in range(N_ERROR):
            covariances[e, i, j] = P[i, j]


@jit_ieee
def smoothed(before: tuple[FloatArray, FloatArray, FloatArray], after: tuple[FloatArray, FloatArray], x: FloatArray, P: FloatArray) -> None:
    """Rauch-Tung-Striebel backwards through events, in place of `after`; x, P : smoothed at the last event."""
    n = len(after[0])
    _put(x, P, n - 1, after[0], after[1])
    error, scale, step = np.empty(N_ERROR), np.empty(N_ERROR), np.empty(N_ERROR)
    S, B, gain, D = np.empty((N_ERROR, N_ERROR)), np.empty((N_ERROR, N_ERROR)), np.empty((N_ERROR, N_ERROR)), np.empty((N_ERROR, N_ERROR))
    for k in range(n - 2, -1, -1):
        here, P_here, ahead, P_ahead = after[0][k + 1], after[1][k + 1], before[0][k + 1], before[1][k + 1]
        q = vector_of(product((here[0], here[1], here[2], here[3]), (-ahead[0], -ahead[1], -ahead[2], ahead[3])))
        error[0], error[1], error[2] = q
        for i in range(3, N_ERROR):
            error[i] = here[1 + i] - ahead[1 + i]
        _times(before[2][k + 1], after[1][k], B)
        for i in range(N_ERROR):
            scale[i] = 1.0 / math.sqrt(P_ahead[i, i])  # variances differ by ten orders
        for i in range(N_ERROR):
            for j in range(N_ERROR):
                S[i, j] = P_ahead[i, j] * scale[i] * scale[j]
                B[i, j] *= scale[i]
            S[i, i] += 1e-13
        _solved(S, N_ERROR, B)
        for i in range(N_ERROR):
            step[i] = 0.0
            for j in range(N_ERROR):
                gain[i, j] = B[j, i] * scale[j]
                step[i] += gain[i, j] * error[j]
        moved_by(after[0][k], step)
        for i in range(N_ERROR):
            for j in range(N_ERROR):
                S[i, j] = P_here[i, j] - P_ahead[i, j]
        _times(gain, S, D)
        _times_transposed(D, gain, B)
        for i in range(N_ERROR):
            for j in range(i + 1):
                half = 0.5 * (B[i, j] + B[j, i])
                both = 0.5 * (after[1][k, i, j] + after[1][k, j, i]) + half
                after[1][k, i, j] = both
                after[1][k, j, i] = both
