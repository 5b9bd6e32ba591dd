"""The Kalman filter and its smoother: batch least squares, consistency, gates, starts."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fusion.flights import errors_of, flight, inertial_of, nees, positions_of
from scan2fea.errors import FusionError, InputError
from scan2fea.fusion import FusionOptions, kalman
from scan2fea.fusion.kalman_kernels import N_ERROR, N_STATE, POSITION, filtered, smoothed
from scan2fea.kernel.geodesy import world_of
from scan2fea.simulation.motion import path_through
from scan2fea.simulation.sensor_logs import LogOptions, sensor_logs
from scan2fea.types import InertialLog, PositionLog, Trajectory

OPTIONS = FusionOptions(odometry_m=0.005, odometry_scale=0.005, gyro_walk=1e-5, acceleration_walk=1e-4, rate_hz=20.0)  # of the simulation


def test_without_turning_it_is_linear_least_squares():
    """One axis, attitude and biases known: the smoothed states are those of one large least-squares problem over all of them."""
    rng = np.random.default_rng(0)
    dt, n, q, sigma = 0.05, 120, 0.04, 0.3
    time = dt * np.arange(n + 1)
    force = np.c_[np.sin(time), 0 * time, 0 * time + 9.80665]
    fix_row = np.arange(10, n + 1, 10)
    fix = np.c_[rng.normal(size=len(fix_row)), np.zeros((len(fix_row), 2))]
    z, noise = np.zeros((len(fix_row), 7)), np.tile(np.eye(6), (len(fix_row), 1, 1)) * sigma**2
    z[:, :3] = fix
    P0 = np.diag([1e-24] * 3 + [0.5**2] * 3 + [2.0**2] * 3 + [1e-24] * 7)
    x0 = np.zeros(N_STATE)
    x0[3], x0[4], x0[7] = 1.0, 0.2, -0.4
    m = len(fix_row)
    before = (np.empty((m, N_STATE)), np.empty((m, N_ERROR, N_ERROR)), np.empty((m, N_ERROR, N_ERROR)))
    after = (np.empty((m, N_STATE)), np.empty((m, N_ERROR, N_ERROR)))
    told = (np.empty(m), np.empty(m), np.empty(m, np.bool_))
    log = (time, np.zeros((n + 1, 3)), force, np.zeros(n + 1, np.bool_))
    gates = np.full(4, np.inf)
    density = np.array([0.0, q, 0.0, 0.0])
    kinds = np.full(m, POSITION, np.int64)
    filtered(log, 0, 0.0, time[fix_row], kinds, z, noise, gates, world_of(None), density, np.zeros(3), x0.copy(), P0.copy(), before, after, told)
    last = after[0][-1].copy(), after[1][-1].copy()
    smoothed(before, after, *last)
    # unknowns: (v, p) at every row; v1 = v0 + a dt + w, p1 = p0 + v0 dt + a dt^2 / 2
    rows, right, weight = [], [], []

    def equation(columns, value, s):
        row = np.zeros(2 * (n + 1))
        for column, factor in columns:
            row[column] += factor
        rows.append(row)
        right.append(value)
        weight.append(1 / s)

    equation([(0, 1)], 0.2, 0.5)
    equation([(1, 1)], -0.4, 2.0)
    for k in range(n):
        a = 0.5 * (force[k, 0] + force[k + 1, 0])
        equation([(2 * k + 2, 1), (2 * k, -1)], a * dt, np.sqrt(q * dt))
        equation([(2 * k + 3, 1), (2 * k + 1, -1), (2 * k, -dt)], 0.5 * a * dt**2, 1e-5)  # as good as exact
    for k, row in enumerate(fix_row):
        equation([(2 * row + 1, 1)], fix[k, 0], sigma)
    A, b = np.array(rows) * np.array(weight)[:, None], np.array(right) * np.array(weight)
    best, *_ = np.linalg.lstsq(A, b, rcond=None)
    covariance = np.linalg.inv(A.T @ A)
    for k, row in enumerate(fix_row):
        assert after[0][k, 4] == pytest.approx(best[2 * row], abs=1e-6)
        assert after[0][k, 7] == pytest.approx(best[2 * row + 1], abs=1e-6)
        assert after[1][k, 6, 6] == pytest.approx(covariance[2 * row + 1, 2 * row + 1], rel=1e-4)
        assert after[1][k, 3, 3] == pytest.approx(covariance[2 * row, 2 * row], rel=1e-4)
    assert told[2].all()


def test_the_stated_covariance_is_that_of_the_errors_and_smoothing_never_widens_it():
    inside, place, turn, mean, smooth, plain = [], [], [], [], [], []
    for seed in range(10):
        logs = flight(seed)
        found = kalman(inertial_of(logs), positions_of(logs), logs.odometry if seed % 2 else None, options=OPTIONS)
        assert found.is_heading_told
        error, P = errors_of(found.trajectory, logs.truth), found.trajectory.covariance
        square = nees(error, P)
        inside.append((square < chi2.ppf(0.95, 6)).mean())
        place.append((nees(error[:, :3], P[:, :3, :3]) < chi2.ppf(0.95, 3)).mean())
        turn.append((nees(error[:, 3:], P[:, 3:, 3:]) < chi2.ppf(0.95, 3)).mean())
        mean.append(square.mean() / 6)
        smooth.append((error**2).mean(axis=0))
        plain.append((errors_of(found.filtered, logs.truth) ** 2).mean(axis=0))
        shrunk = np.linalg.eigvalsh(found.filtered.covariance - P)
        assert (shrunk[:, 0] > -1e-6 * np.linalg.eigvalsh(found.filtered.covariance)[:, 0]).all()
        assert found.taken["positions"].n_gated <= 1
        assert 0.8 < found.taken["positions"].nis < 1.2
    assert 0.90 <= np.mean(inside) <= 0.98
    assert 0.90 <= np.mean(place) <= 0.98 and np.mean(turn) >= 0.90
    assert 0.75 < np.mean(mean) < 1.25
    assert (np.mean(smooth, axis=0) < np.mean(plain, axis=0)).all()


def test_jumps_of_100_m_are_left_out_and_counted():
    logs = flight(3)
    gps = positions_of(logs)
    jumped = gps.position.copy()
    rows = np.array([0, 40, 41, 42, 120])
    jumped[rows] += (100.0, 0.0, 0.0)
    clean = kalman(inertial_of(logs), gps, options=OPTIONS)
    found = kalman(inertial_of(logs), PositionLog(time_s=gps.time_s, position=jumped, sigma_m=gps.sigma_m), options=OPTIONS)
    np.testing.assert_array_equal(found.gated, gps.time_s[rows])
    assert found.taken["positions"].n_gated == 5
    assert np.abs(found.trajectory.T_world_frame[:, :3, 3] - clean.trajectory.T_world_frame[:, :3, 3]).max() < 0.3


def test_the_world_may_be_turned_and_moved():
    logs = flight(5, 20.0)
    gps = positions_of(logs)
    R, shift = Rotation.from_euler("z", 2.1).as_matrix(), np.array([500.0, -300.0, 20.0])
    level = FusionOptions(rate_hz=20.0, gps_m=0.02)
    one = kalman(inertial_of(logs), gps, options=level).trajectory
    moved = PositionLog(time_s=gps.time_s, position=gps.position @ R.T + shift)
    other = kalman(inertial_of(logs), moved, options=level).trajectory
    np.testing.assert_allclose(other.T_world_frame[:, :3, 3], one.T_world_frame[:, :3, 3] @ R.T + shift, atol=2e-3)
    np.testing.assert_allclose(other.T_world_frame[:, :3, :3], R @ one.T_world_frame[:, :3, :3], atol=3e-3)


def test_a_gap_widens_the_covariance_and_is_bridged():
    logs = flight(6)
    log = inertial_of(logs)
    kept = (log.time_s < 15.0) | (log.time_s > 15.5)
    gap = np.zeros(int(kept.sum()), bool)
    gap[int((log.time_s < 15.0).sum())] = True
    cut = InertialLog(time_s=log.time_s[kept], rate=log.rate[kept], force=log.force[kept], is_gap=gap)
    found = kalman(cut, positions_of(logs), options=OPTIONS).trajectory
    error = errors_of(found, logs.truth)
    assert (nees(error, found.covariance) < chi2.ppf(0.9999, 6)).mean() > 0.95
    std = np.sqrt(found.covariance[:, 0, 0])
    middle = np.abs(found.time_s - 15.25) < 0.3
    assert std[middle].max() > 1.5 * np.median(std)


def test_odometry_alone_begins_at_the_origin():
    logs = flight(7, 20.0, odometry_scale=0.0)
    found = kalman(inertial_of(logs), odometry=logs.odometry, options=OPTIONS)
    way = np.linalg.norm(np.diff(logs.truth.T_world_frame[:, :3, 3], axis=0), axis=1).sum()
    begun = found.trajectory.time_s[0]
    R = Rotation.from_matrix(logs.truth.T_world_frame[np.searchsorted(logs.truth.time_s, begun), :3, :3])
    heading = Rotation.from_euler("z", -R.as_euler("ZYX")[0])
    there = heading.apply(logs.truth.T_world_frame[-1, :3, 3] - logs.truth.T_world_frame[0, :3, 3])
    assert np.linalg.norm(found.trajectory.T_world_frame[-1, :3, 3] - there) < 0.03 * way
    assert np.linalg.norm(found.trajectory.T_world_frame[0, :3, 3]) < 1e-3


def test_poses_are_believed_in_full():
    logs = flight(8, 20.0)
    some = Trajectory(T_world_frame=logs.truth.T_world_frame[::50], placed=logs.truth.placed[::50], time_s=logs.truth.time_s[::50])
    found = kalman(inertial_of(logs), poses=some, options=FusionOptions(rate_hz=20.0, pose_m=0.005, pose_deg=0.05))
    error = errors_of(found.trajectory, logs.truth)
    assert np.abs(error[:, :3]).max() < 0.01 and np.abs(error[:, 3:]).max() < np.radians(0.2)


def test_a_straight_even_way_does_not_tell_the_heading():
    path = path_through([0.0, 40.0], [[0, 0, 0], [40, 0, 0]], [[0, 0, 30], [0, 0, 30]])
    logs = sensor_logs(path, LogOptions(acceleration_bias=0.0, gyro_bias=0.0), 0)
    found = kalman(inertial_of(logs), positions_of(logs), options=OPTIONS)
    assert not found.is_heading_told


def test_what_cannot_be_used_is_refused():
    logs = flight(9, 20.0)
    log, gps = inertial_of(logs), positions_of(logs)
    with pytest.raises(InputError, match="complementary"):
        kalman(log)
    with pytest.raises(InputError, match="another time or clock"):
        kalman(log, PositionLog(time_s=gps.time_s + 1e6, position=gps.position))
    wrong = PositionLog(time_s=gps.time_s, position=np.random.default_rng(0).normal(0, 50.0, gps.position.shape), sigma_m=gps.sigma_m)
    with pytest.raises(FusionError, match="contradict"):
        kalman(log, wrong, options=OPTIONS)
