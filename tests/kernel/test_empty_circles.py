"""Circles that hold no point: those that a look at every three points gives, on points in general place, in rows, on a grid and twice the same."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from scan2fea.kernel.empty_circles import empty_circles

RNG = np.random.default_rng(5)
GRID = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), -1).reshape(-1, 2)
SETS = {
    "random": RNG.random((40, 2)) * [3.0, 0.5],
    "rows": np.c_[RNG.random(40), np.repeat(np.arange(8) / 8, 5)],
    "grid": GRID,
    "twice": np.repeat(RNG.random((20, 2)), 2, axis=0),
    "uneven": RNG.random((40, 2)) ** 3,
    "far": RNG.random((40, 2)) + [4e3, -2e3],
}


def by_definition(points):
    """Middles and radii of all circles through three points without one inside, the middle in the points' box; each once."""
    found = []
    for i, j, k in itertools.combinations(range(len(points)), 3):
        u, v = points[j] - points[i], points[k] - points[i]
        twice = 2 * (u[0] * v[1] - u[1] * v[0])
        if abs(twice) < 1e-9:
            continue
        off = np.array([v[1] * (u @ u) - u[1] * (v @ v), u[0] * (v @ v) - v[0] * (u @ u)]) / twice
        middle, radius = points[i] + off, float(np.hypot(*off))
        inside = (middle >= points.min(axis=0)).all() and (middle <= points.max(axis=0)).all()
        if inside and (np.hypot(*(points - middle).T) > radius * (1 - 1e-9) - 1e-9).all():
            found.append([*middle, radius])
    return np.unique(np.round(found, 6), axis=0)


@pytest.mark.parametrize("name", SETS)
def test_they_are_those_of_the_definition(name) -> None:
    middle, radius = empty_circles(SETS[name])
    expected = by_definition(SETS[name])
    found = np.c_[middle, radius]
    assert len(found) >= len(expected) > 0
    assert cKDTree(found).query(expected)[0].max() < 3e-6 and cKDTree(expected).query(found)[0].max() < 3e-6
    if name in ("random", "rows", "twice", "far"):
        assert len(found) == len(expected)


def test_many_points_hold_as_many_as_euler_says_and_none_is_inside() -> None:
    points = RNG.random((20_000, 2)) * [2.0, 0.3]
    points = points[np.hypot(points[:, 0] - 1.0, points[:, 1] - 0.15) > 0.1]
    middle, radius = empty_circles(points)
    nearest = cKDTree(points).query(middle, k=3)[0]
    assert np.abs(nearest - radius[:, None]).max() < 1e-9
    assert 1.95 * len(points) < len(radius) < 2 * len(points)  # 2 n less the hull's, some of which have their middle outside
    assert 0.1 <= radius.max() < 0.12


def test_input_is_left_and_few_points_or_a_line_have_none() -> None:
    points = SETS["random"].copy()
    empty_circles(points)
    assert np.array_equal(points, SETS["random"])
    for few in (np.zeros((0, 2)), np.array([[0.0, 1.0], [2.0, 3.0]]), np.c_[np.arange(9.0), np.zeros(9)], np.ones((5, 2))):
        assert len(empty_circles(few)[0]) == len(empty_circles(few)[1]) == 0


def test_it_moves_and_grows_with_the_points() -> None:
    middle, radius = empty_circles(SETS["random"])
    moved, grown = empty_circles(3.0 * SETS["random"] + [5.0, -1.0])
    assert np.allclose(moved, 3.0 * middle + [5.0, -1.0], atol=1e-9) and np.allclose(grown, 3.0 * radius, atol=1e-9)
