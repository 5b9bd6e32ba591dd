import numpy as np
import pytest

from scan2fea.errors import InputError
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.simulation.lidar import Hdl32eOptions, scan_lidar
from scan2fea.simulation.motion import PathOptions, as_measured, kinematics, mounted, path_of, path_through, rotation_rpy, trajectory_at
from scan2fea.types import Scan
from sensed import block, scene


def test_angles_turn_the_way_they_say():
    forward = np.array([1.0, 0, 0])
    np.testing.assert_allclose(rotation_rpy(0, 0, 90) @ forward, [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(rotation_rpy(0, 90, 0) @ forward, [0, 0, -1], atol=1e-15)  # looks down
    np.testing.assert_allclose(rotation_rpy(90, 0, 0) @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(rotation_rpy(0, 90, 90) @ forward, [0, 0, -1], atol=1e-15)  # pitch first, then yaw
    np.testing.assert_allclose(rotation_rpy(0, 45, 90) @ forward, [0, np.sqrt(0.5), -np.sqrt(0.5)], atol=1e-15)


def test_two_poses_make_a_straight_even_way_and_it_rests_outside():
    path = path_through([1.0, 3.0], [[0, 0, 1], [4, 0, 1]], [[0, 0, 0], [0, 0, 90]])
    state = kinematics(path, np.array([0.0, 1.0, 2.0, 3.0, 9.0]))
    np.testing.assert_allclose(state.position[:, 0], [0, 0, 2, 4, 4], atol=1e-12)
    np.testing.assert_allclose(state.velocity[1:4], [[2, 0, 0]] * 3, atol=1e-12)
    np.testing.assert_allclose(state.rate[1:4, 2], np.radians(45), atol=1e-12)
    assert (state.velocity[[0, 4]] == 0).all()
    assert (state.rate[[0, 4]] == 0).all()
    np.testing.assert_allclose(state.rotation[2], rotation_rpy(0, 0, 45), atol=1e-12)


def test_poses_are_passed_exactly():
    rng = np.random.default_rng(0)
    time, place, angle = np.cumsum(rng.uniform(0.1, 1, 9)), rng.normal(size=(9, 3)), rng.uniform(-80, 80, (9, 3))
    path = path_through(time, place, angle)
    state = kinematics(path, time)
    np.testing.assert_allclose(state.position, place, atol=1e-12)
    np.testing.assert_allclose(state.rotation, path.T_world_sensor[:, :3, :3], atol=1e-12)


def test_velocity_acceleration_and_rate_are_the_derivatives_of_the_poses():
    rng = np.random.default_rng(1)
    path = path_through(np.arange(8.0), rng.normal(size=(8, 3)), rng.uniform(-30, 30, (8, 3)))
    t, h = rng.uniform(0.5, 6.5, 40), 1e-5
    before, now, after = (kinematics(path, t + s) for s in (-h, 0.0, h))
    np.testing.assert_allclose(now.velocity, (after.position - before.position) / (2 * h), rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(now.acceleration, (after.velocity - before.velocity) / (2 * h), rtol=1e-5, atol=1e-5)
    turn = np.einsum("nji,njk->nik", before.rotation, after.rotation)  # R^T R' = I + 2 h [rate]
    np.testing.assert_allclose(now.rate, np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], 1) / (2 * h), rtol=1e-4, atol=1e-6)


def test_a_circle_has_its_centripetal_acceleration():
    angle = np.linspace(0, 2 * np.pi, 121)
    path = path_through(angle / 0.5, 2 * np.c_[np.cos(angle), np.sin(angle), 0 * angle], np.c_[0 * angle, 0 * angle, np.degrees(angle)])
    state = kinematics(path, np.linspace(3, 9, 50))
    np.testing.assert_allclose(np.linalg.norm(state.acceleration, axis=1), 0.5**2 * 2, rtol=1e-3)
    np.testing.assert_allclose(state.rate, np.tile([0, 0, 0.5], (50, 1)), atol=1e-6)


def test_trajectory_and_mount():
    path = path_through([0.0, 1.0], [[0, 0, 0], [1, 0, 0]])
    T = trajectory_at(path, 0.5)
    np.testing.assert_allclose(T.T_world_frame[0], rigid(np.eye(3), (0.5, 0, 0)), atol=1e-15)
    arm = mounted(path, rigid(rotation_about((0, 0, 1), np.pi / 2), (0, 0, 2)))
    np.testing.assert_allclose(arm.T_world_sensor[1, :3, 3], [1, 0, 2])


def test_options_name_the_sensor_and_the_key():
    with pytest.raises(InputError, match="sensor hdl: positions_m is empty"):
        path_of(PathOptions(), "hdl")
    with pytest.raises(InputError, match="sensor hdl: times_s has 1 entries, positions_m has 2"):
        path_of(PathOptions(positions_m=((0, 0, 0), (1, 0, 0)), times_s=(0.0,)), "hdl")
    with pytest.raises(InputError, match="sensor hdl: the times of a sensor's path must increase"):
        path_of(PathOptions(positions_m=((0, 0, 0), (1, 0, 0)), times_s=(1.0, 1.0)), "hdl")
    with pytest.raises(InputError, match="not finite"):
        path_through([0.0], [[np.nan, 0, 0]])
    assert len(path_of(PathOptions(positions_m=((0, 0, 0), (1, 0, 0))), "hdl")) == 2


def test_what_the_sensor_tells_is_in_its_own_frame_at_each_shot():
    wall = scene(block((4, -9, -9), (5, 9, 9)))
    way = {"positions_m": ((0, 0, 0), (0.5, 0.3, 0.1)), "orientations_deg": ((0, 0, 0), (0, 0, 40)), "times_s": (0.0, 0.1)}
    options = Hdl32eOptions(rate_hz=10.0, noise_m=0.0, quantum_m=0.0, **way)
    (scan,) = scan_lidar(wall, options)
    told = as_measured(scan, path_of(options, "x"))
    np.testing.assert_allclose(np.degrees(np.arcsin(told.rays.direction[:32, 2])), options.elevations_deg, atol=1e-9)
    assert np.abs(told.rays.origin[:, :2]).max() < 6.0 * 36e-6  # on the axis, but for the way within one firing: 6 m/s for 36 us
    on = told.rays.origin[told.cloud.ray] + told.rays.range_m[told.cloud.ray, None] * told.rays.direction[told.cloud.ray]
    np.testing.assert_allclose(told.cloud.points, on, atol=1e-12)
    state = kinematics(path_of(options, "x"), scan.rays.time_s[scan.cloud.ray])
    back = np.einsum("nij,nj->ni", state.rotation, told.cloud.points) + state.position
    np.testing.assert_allclose(back, scan.cloud.points, atol=1e-12)
    assert np.ptp(scan.cloud.points[:, 0]) < 1e-9 < 0.2 < np.ptp(told.cloud.points[:, 0])
    with pytest.raises(InputError, match="no times"):
        as_measured(Scan(cloud=scan.cloud), path_of(options, "x"))
