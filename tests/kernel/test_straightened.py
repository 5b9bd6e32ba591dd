"""Points along a curved, twisted axis against numpy's Legendre series."""

import numpy as np
import pytest
from numpy.polynomial import legendre

from scan2fea.kernel.straightened import straightened
from scan2fea.kernel.transforms import rigid, rotation_about


@pytest.mark.parametrize("degree", [0, 1, 4])
@pytest.mark.parametrize("turned", [False, True])
def test_it_is_the_series_taken_off(degree, turned):
    rng = np.random.default_rng(degree)
    T = rigid(rotation_about((1, 2, 3), 0.7), (0.3, -1.0, 2.0))
    points, axis = 0.2 * rng.normal(size=(200, 3)) + T[:3, 3], rng.normal(size=(2, degree + 1)) * (degree > 0)
    roll = rng.normal(size=degree + 1) if turned else np.zeros(1)
    local = (points - T[:3, 3]) @ T[:3, :3]
    zeta = (2 * local[:, 2] - 0.5) / 1.5
    away = local[:, :2] - legendre.legval(zeta, axis.T).T
    turn = legendre.legval(zeta, roll)
    c, s = np.cos(turn), np.sin(turn)
    expected = np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0], local[:, 2]], 1)
    assert np.abs(straightened(points, T, -0.5, 1.0, axis, roll) - expected).max() < 1e-10
