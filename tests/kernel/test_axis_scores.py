"""Sums over points against the slope of a density that is known: differences of it when the axis is bent or turned."""

import numpy as np
import pytest

from scan2fea.kernel.axis_scores import axis_scores


def log_density(u):
    return -0.5 * (u[:, 0] / 0.3) ** 2 - 0.5 * ((u[:, 1] - 0.2 * u[:, 0]) / 0.1) ** 2


def slope_at(u):
    off = (u[:, 1] - 0.2 * u[:, 0]) / 0.1**2
    return np.stack([-u[:, 0] / 0.3**2 + 0.2 * off, -off], 1)


def straightened(xy, basis, bow, twist):
    away = xy - basis[:, : bow.shape[1]] @ bow.T
    angle = basis[:, : len(twist)] @ twist
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], 1)


@pytest.mark.parametrize(("degree", "turns"), [(1, 0), (3, 1), (2, 2)])
def test_they_are_the_differences_of_the_density(degree, turns) -> None:
    rng = np.random.default_rng(3)
    xy, zeta = rng.normal(0, 0.2, (50, 2)), rng.uniform(-1, 1, 50)
    basis = np.polynomial.legendre.legvander(zeta, max(degree, turns))[:, 1:]
    bow, twist = rng.normal(0, 0.05, (2, degree)), rng.normal(0, 0.2, turns)
    u = straightened(xy, basis, bow, twist)
    total, products, moved = axis_scores(u, slope_at(u), basis, np.r_[0.0, twist], degree)
    scores = []
    for k in range(2 * degree + turns):
        each = []
        for way in (1e-6, -1e-6):
            more = np.zeros(2 * degree + turns)
            more[k] = way
            each.append(log_density(straightened(xy, basis, bow + more[: 2 * degree].reshape(2, degree), twist + more[2 * degree :])))
        scores.append((each[0] - each[1]) / 2e-6)
    scores = np.array(scores).T
    assert np.allclose(total, scores.sum(axis=0), rtol=1e-6, atol=1e-5)
    assert np.allclose(products, scores.T @ scores, rtol=1e-6, atol=1e-4)
    around = (basis[:, :turns] ** 2 * (u**2).sum(axis=1)[:, None]).sum(axis=0)
    assert np.allclose(moved, np.r_[np.tile((basis[:, :degree] ** 2).sum(axis=0), 2), around], rtol=1e-12)
