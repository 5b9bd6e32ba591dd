"""Where poses of sweeps are told, and how far off they are said to be, against draws."""

import numpy as np
from scipy.spatial.transform import Rotation

from scan2fea.kernel.transforms import inverse
from scan2fea.registration.motion import stepped
from scan2fea.registration.told import deviations, from_first, middles, poses_at
from swept import even


def test_the_middle_return_of_each_sweep_half_where_none_came():
    np.testing.assert_array_equal(middles(np.array([0, 0, 0, 2, 2]), np.array([0.1, 0.2, 0.9, 0.4, 0.6])), [0.2, 0.5, 0.5])


def test_poses_lie_between_their_knots_and_the_first_is_the_world():
    T = even(4, [0.2, 0.1, 0.0], 3.0)
    np.testing.assert_allclose(poses_at(T, np.zeros(4)), T[:-1], atol=1e-12)
    np.testing.assert_allclose(poses_at(T, np.ones(4)), T[1:], atol=1e-12)
    told = poses_at(from_first(T, np.full(4, 0.3)), np.full(4, 0.3))
    np.testing.assert_allclose(told[0], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(told[1:], inverse(poses_at(T, np.full(4, 0.3))[0]) @ poses_at(T, np.full(4, 0.3))[1:], atol=1e-12)


def test_deviations_are_those_of_draws():
    """Knots drawn from their covariance, turned and shifted: what the poses differ by from the first scatters as is told."""
    rng = np.random.default_rng(0)
    T, middle = even(3, [2.0, -1.0, 0.5], 5.0), np.array([0.5, 0.4, 0.9])
    root = 1e-3 * rng.standard_normal((18, 18))
    told = deviations(T, root @ root.T, middle)
    exact = from_first(T, middle)
    off = []
    for _ in range(1000):
        drawn = stepped(T, np.concatenate([np.zeros(6), root @ rng.standard_normal(18)]).reshape(-1, 6))
        off.append(np.linalg.inv(poses_at(exact, middle)) @ poses_at(from_first(drawn, middle), middle))
    off = np.array(off)
    place = np.sqrt((off[..., :3, 3] ** 2).sum(axis=2).mean(axis=0))
    turn = np.sqrt((Rotation.from_matrix(off[..., :3, :3].reshape(-1, 3, 3)).magnitude() ** 2).reshape(1000, 3).mean(axis=0))
    np.testing.assert_allclose(told, np.stack([turn, place], axis=1), rtol=0.08, atol=1e-9)
    assert (told[0] == 0).all()


def test_a_swing_that_the_knots_hide_is_known_at_the_returns():
    """Where all returns come in the middle, knots that go to and fro by any size are the same measurement: nothing of it is told."""
    zigzag = np.tile(np.array([0.0, 0, 0, 0, 5.0, 0]), (6, 1)) * np.array([-1.0, 1, -1, 1, -1, 1])[:, None]
    flat = even(5, [0.1, 0, 0], 0)
    half = np.full(5, 0.5)
    np.testing.assert_allclose(poses_at(from_first(stepped(flat, zigzag), half), half), poses_at(from_first(flat, half), half), atol=1e-12)
    one = np.concatenate([zigzag[1:] - zigzag[0]]).ravel()
    np.testing.assert_allclose(deviations(flat, np.outer(one, one), half), 0.0, atol=1e-6)
