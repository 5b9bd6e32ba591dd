import math

import numpy as np
import pytest

from scan2fea.errors import InternalError
from scan2fea.kernel import transforms as tf


def test_quaternion_of_a_quarter_turn():
    half = math.sqrt(0.5)
    np.testing.assert_allclose(tf.quaternion_to_matrix([0, 0, half, half]), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(tf.rotation_about((0, 0, 2), math.pi / 2), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


@pytest.mark.parametrize("seed", range(20))
def test_round_trip(seed):
    R = tf.random_rotation(seed)
    assert np.linalg.det(R) == pytest.approx(1)
    q = tf.matrix_to_quaternion(R)
    assert np.linalg.norm(q) == pytest.approx(1)
    np.testing.assert_allclose(tf.quaternion_to_matrix(q), R, atol=1e-14)
    np.testing.assert_allclose(tf.quaternion_to_matrix(-3 * q), R, atol=1e-14)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
def test_half_turns_have_quaternions(axis):
    R = tf.rotation_about(axis, math.pi)
    np.testing.assert_allclose(tf.quaternion_to_matrix(tf.matrix_to_quaternion(R)), R, atol=1e-12)


def test_compose_inverse_apply():
    a, b = tf.rigid(tf.random_rotation(1), [1, 2, 3]), tf.rigid(tf.random_rotation(2), [-4, 0, 1])
    points = np.random.default_rng(0).random((10, 3))
    np.testing.assert_allclose(tf.applied(tf.compose(a, b), points), tf.applied(a, tf.applied(b, points)), atol=1e-14)
    np.testing.assert_allclose(tf.compose(a, tf.inverse(a)), np.eye(4), atol=1e-14)
    np.testing.assert_allclose(tf.rotated(a, points), tf.applied(a, points) - [1, 2, 3], atol=1e-14)
    assert tf.compose().tolist() == np.eye(4).tolist()


def test_refusals():
    for q in ([0, 0, 0, 0], [np.nan, 0, 0, 1]):
        with pytest.raises(InternalError, match="quaternion"):
            tf.quaternion_to_matrix(q)
    with pytest.raises(InternalError, match="axis"):
        tf.rotation_about((0, 0, 0), 1.0)
    assert tf.is_rigid(np.eye(4))
    assert not tf.is_rigid(np.diag([1, 1, -1, 1.0]))
    assert not tf.is_rigid(2 * np.eye(4))
    assert not tf.is_rigid(np.full((4, 4), np.nan))
    assert not tf.is_rigid(np.eye(3))
