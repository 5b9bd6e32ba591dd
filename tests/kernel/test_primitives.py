import numpy as np
import pytest

from predicates import rotation
from scan2fea.kernel.primitives import Plane, fit_plane, meeting_point


def test_fit_recovers_a_plane_far_from_the_origin():
    R = rotation(4)
    flat = np.random.default_rng(0).uniform(-1, 1, (500, 3)) * [1, 1, 0]
    points = flat @ R.T + [1e3, -2e3, 5e2]
    plane = fit_plane(points, towards=R[:, 2])
    np.testing.assert_allclose(plane.normal, R[:, 2], atol=1e-9)
    assert np.abs(plane.distance(points)).max() < 1e-10
    assert fit_plane(points, towards=-R[:, 2]).normal @ R[:, 2] < 0


def test_noise_falls_with_the_square_root_of_the_count():
    rng = np.random.default_rng(1)
    error = []
    for n in (100, 10_000):
        offsets = []
        for _ in range(20):
            points = rng.uniform(-1, 1, (n, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (n, 3)) * [0, 0, 1]
            offsets.append(fit_plane(points, towards=np.array([0, 0, 1.0])).offset)
        error.append(np.std(offsets))
    assert error[0] / error[1] == pytest.approx(10, rel=0.5)


def test_weights_leave_points_out():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 0.5, 9]], float)
    assert fit_plane(points, np.array([1, 1, 1, 1, 0.0])).rms_m == pytest.approx(0, abs=1e-12)


def test_meeting_of_three_two_and_one():
    x, y, z = (Plane(normal=axis, offset=k + 1.0) for k, axis in enumerate(np.eye(3)))
    near = np.array([5.0, 6, 7])
    np.testing.assert_allclose(meeting_point([x, y, z], near), [1, 2, 3], atol=1e-12)
    np.testing.assert_allclose(meeting_point([x, y], near), [1, 2, 7], atol=1e-12)
    np.testing.assert_allclose(meeting_point([x], near), [1, 6, 7], atol=1e-12)


def test_nearly_parallel_planes_do_not_send_the_point_away():
    a = Plane(normal=np.array([0, 0, 1.0]), offset=0.0)
    b = Plane(normal=np.array([0, 0.01, 1]) / np.hypot(1, 0.01), offset=0.1)
    assert np.linalg.norm(meeting_point([a, b], np.zeros(3))) < 0.2


def test_axes_are_right_handed():
    for seed in range(5):
        plane = Plane(normal=rotation(seed)[:, 0], offset=0.0)
        u, v = plane.axes()
        np.testing.assert_allclose(np.cross(u, v), plane.normal, atol=1e-12)
