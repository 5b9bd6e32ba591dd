import numpy as np
import pytest
from scipy import stats

from scan2fea.errors import InputError
from scan2fea.kernel.transforms import compose, inverse
from scan2fea.simulation.motion import path_through
from scan2fea.simulation.sensor_logs import GRAVITY_M_S2, LogOptions, gps_csv, imu_csv, inertial, odometry, sensor_logs

CLEAN = {
    "gyro_noise": 0.0, "gyro_bias": 0.0, "gyro_walk": 0.0, "acceleration_noise": 0.0, "acceleration_bias": 0.0, "acceleration_walk": 0.0,
    "gps_m": 0.0, "odometry_scale": 0.0, "odometry_m": 0.0, "odometry_deg": 0.0,
}  # fmt: skip
RNG = np.random.default_rng(0)
WAY = path_through(np.arange(11.0), np.cumsum(RNG.normal(size=(11, 3)), 0), np.c_[RNG.uniform(-20, 20, (11, 2)), np.arange(11) * 20.0])
STILL = path_through([0.0, 100.0], [[1, 2, 3], [1, 2, 3]], [[0, 30, 0], [0, 30, 0]])


def test_at_rest_it_feels_the_floor():
    log = sensor_logs(STILL, LogOptions(**CLEAN)).imu
    expected = STILL.T_world_sensor[0, :3, :3].T @ -GRAVITY_M_S2
    np.testing.assert_allclose(log.force, np.tile(expected, (len(log.force), 1)), atol=1e-12)
    assert log.force[0] @ log.force[0] == pytest.approx(9.80665**2)
    assert (log.rate == 0).all()
    assert len(log.time_s) == 20_001


def test_dead_reckoning_with_a_clean_unit_finds_the_way():
    options = LogOptions(imu_hz=2000.0, **CLEAN)
    logs = sensor_logs(WAY, options)
    truth = sensor_logs(WAY, LogOptions(truth_hz=2000.0, **CLEAN)).truth.T_world_frame
    dt = 1 / 2000.0
    R, v, p = truth[0, :3, :3], (truth[1, :3, 3] - truth[0, :3, 3]) / dt, truth[0, :3, 3].copy()
    force, rate = logs.imu.force, logs.imu.rate
    from scipy.spatial.transform import Rotation

    v = v - dt / 2 * (R @ force[0] + GRAVITY_M_S2)
    for k in range(len(force) - 1):
        turned = R @ Rotation.from_rotvec(dt * (rate[k] + rate[k + 1]) / 2).as_matrix()
        a = (R @ force[k] + turned @ force[k + 1]) / 2 + GRAVITY_M_S2
        p, v, R = p + dt * v + dt**2 / 2 * a, v + dt * a, turned
    assert np.linalg.norm(p - truth[-1, :3, 3]) < 2e-3
    np.testing.assert_allclose(R, truth[-1, :3, :3], atol=1e-4)


def test_white_noise_and_bias_have_their_size():
    options = LogOptions(**{**CLEAN, "gyro_noise": 1e-3, "acceleration_noise": 2e-2})
    log = sensor_logs(STILL, options, 1).imu
    root = np.sqrt(200.0)
    for axis in range(3):
        assert stats.kstest(log.rate[:, axis] / (1e-3 * root), "norm").pvalue > 0.01
        force = log.force[:, axis] - (STILL.T_world_sensor[0, :3, :3].T @ -GRAVITY_M_S2)[axis]
        assert stats.kstest(force / (2e-2 * root), "norm").pvalue > 0.01
    bias = np.array([inertial(STILL, LogOptions(**{**CLEAN, "gyro_bias": 0.1}, imu_hz=0.01), np.random.default_rng(s)).rate[0] for s in range(400)])
    assert stats.kstest(bias.ravel() / 0.1, "norm").pvalue > 0.01


def test_the_bias_walks_with_the_root_of_time():
    options = LogOptions(**{**CLEAN, "acceleration_walk": 0.01}, imu_hz=1.0)
    walks = np.array([inertial(STILL, options, np.random.default_rng(s)).force_bias for s in range(300)])
    assert (walks[:, 0] == 0).all()
    for k in (4, 25, 100):
        assert walks[:, k].std() == pytest.approx(0.01 * np.sqrt(k), rel=0.08)


def test_satellites_scatter_more_upwards_and_get_lost():
    log = sensor_logs(STILL, LogOptions(gps_m=0.05, gps_hz=50.0, gps_lost_share=0.25), 2).gps
    lost = np.isnan(log.position[:, 0])
    assert stats.binomtest(int(lost.sum()), len(lost), 0.25).pvalue > 0.01
    for axis, sigma in enumerate((0.05, 0.05, 0.1)):
        assert stats.kstest((log.position[~lost, axis] - (1, 2, 3)[axis]) / sigma, "norm").pvalue > 0.01
        assert (log.sigma_m[:, axis] == sigma).all()


def test_odometry_adds_up_the_true_steps_and_drifts_with_the_way():
    clean = sensor_logs(WAY, LogOptions(odometry_hz=20.0, truth_hz=20.0, **CLEAN))
    begun = [compose(inverse(clean.truth.T_world_frame[0]), T) for T in clean.truth.T_world_frame]
    np.testing.assert_allclose(clean.odometry.T_world_frame, begun, atol=1e-12)
    line = path_through([0.0, 100.0], [[0, 0, 0], [100, 0, 0]])
    ends = np.array([
        odometry(line, LogOptions(**{**CLEAN, "odometry_m": 0.01}, odometry_hz=1.0), np.random.default_rng(s)).T_world_frame[[25, 100], :3, 3]
        for s in range(300)
    ])  # fmt: skip
    assert (ends[:, 0] - [25, 0, 0]).std() == pytest.approx(0.05, rel=0.1)
    assert (ends[:, 1] - [100, 0, 0]).std() == pytest.approx(0.1, rel=0.1)


def test_text_reads_back_exactly():
    logs = sensor_logs(WAY, LogOptions(gps_lost_share=0.5), 3)
    head, *rows = imu_csv(logs.imu).splitlines()
    assert head.split(",")[:4] == ["time_s", "ax_m_s2", "ay_m_s2", "az_m_s2"]
    np.testing.assert_array_equal(np.array([row.split(",") for row in rows], float)[:, 1:4], logs.imu.force)
    _, *rows = gps_csv(logs.gps).splitlines()
    kept = np.isfinite(logs.gps.position[:, 0])
    np.testing.assert_array_equal(np.array([row.split(",") for row in rows], float)[:, 1:4], logs.gps.position[kept])


def test_same_seed_same_bytes_and_bad_rates():
    a, b, c = (sensor_logs(WAY, seed=s) for s in (4, 4, 5))
    assert imu_csv(a.imu) == imu_csv(b.imu) != imu_csv(c.imu)
    assert a.odometry.T_world_frame.tobytes() == b.odometry.T_world_frame.tobytes() != c.odometry.T_world_frame.tobytes()
    with pytest.raises(InputError, match="imu_hz"):
        sensor_logs(WAY, LogOptions(imu_hz=1e9))
