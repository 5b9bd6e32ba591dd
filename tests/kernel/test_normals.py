import numpy as np
import pytest

from scan2fea.kernel.normals import least_axis, normals_at, oriented_to, pca_normals
from scan2fea.kernel.transforms import random_rotation


def test_least_axis_equals_the_eigenvector():
    rng = np.random.default_rng(0)
    for scale in (1e-12, 1.0, 1e12):
        for _ in range(50):
            a = rng.standard_normal((3, 3))
            c = scale * a @ np.diag([1, 0.1, 0.001]) @ a.T
            axis = np.array(least_axis(c[0, 0], c[0, 1], c[0, 2], c[1, 1], c[1, 2], c[2, 2]))
            assert np.linalg.norm(axis) == pytest.approx(1)
            assert abs(axis @ np.linalg.eigh(c)[1][:, 0]) == pytest.approx(1, abs=1e-9)


def test_least_axis_of_degenerate_matrices():
    assert least_axis(0.0, 0.0, 0.0, 0.0, 0.0, 0.0) == (0.0, 0.0, 1.0)
    for direction in (np.eye(3)[0], np.eye(3)[1], np.array([0.6, 0.0, 0.8]), random_rotation(1)[0]):  # points on a line
        c = np.outer(direction, direction)
        axis = np.array(least_axis(c[0, 0], c[0, 1], c[0, 2], c[1, 1], c[1, 2], c[2, 2]))
        assert np.linalg.norm(axis) == pytest.approx(1)
        assert abs(axis @ direction) < 1e-6
    assert np.linalg.norm(least_axis(1.0, 0.0, 0.0, 1.0, 0.0, 1.0)) == pytest.approx(1)


def test_normals_of_a_turned_plane_are_exact():
    R = random_rotation(5)
    plane = np.c_[np.random.default_rng(0).random((500, 2)), np.zeros(500)] @ R.T + 100.0
    normals = pca_normals(plane, 12)
    np.testing.assert_allclose(np.abs(normals @ R[:, 2]), 1, atol=1e-9)


def test_orientation_by_sensor():
    points = np.zeros((3, 3))
    normals = np.array([[0, 0, 1.0]] * 3)
    sensors = np.array([[0, 0, 5.0], [0, 0, -5.0], [np.nan] * 3])
    assert oriented_to(normals, points, sensors)[:, 2].tolist() == [1, -1, 1]
    assert normals[1, 2] == 1


def test_few_points():
    assert pca_normals(np.zeros((0, 3))).shape == (0, 3)
    assert pca_normals(np.ones((4, 3))).tolist() == [[0, 0, 1]] * 4


def test_normals_at_places_are_those_of_the_points_there():
    rng = np.random.default_rng(5)
    points = np.c_[rng.random((400, 2)), 1e-3 * rng.standard_normal(400)] @ random_rotation(3).T
    there = normals_at(points[:50], points, 12)
    same = np.abs(np.einsum("nc,nc->n", there, pca_normals(points, 12)[:50]))
    assert same.min() > 1 - 1e-9
