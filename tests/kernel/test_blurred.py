"""The blurred density against scipy's filter and interpolation, and against its definition; its slope against differences."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from scan2fea.kernel.blurred import grid_of, log_density_of


@pytest.fixture
def ring():
    rng = np.random.default_rng(3)
    t = 2 * np.pi * rng.random(3000)
    return np.c_[np.cos(t), 0.6 * np.sin(t)] + rng.normal(0, 0.03, (3000, 2))


def test_it_is_the_histogram_that_scipy_blurs(ring):
    width = 0.1
    grid = grid_of(ring, width)
    at = (ring - grid.low) / grid.cell_m
    count, part = np.zeros(grid.shape), at - np.floor(at)
    for dx in (0, 1):
        for dy in (0, 1):
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            np.add.at(count, (np.floor(at[:, 0]).astype(int) + dx, np.floor(at[:, 1]).astype(int) + dy), share)
    smooth = gaussian_filter(count, 2.0, mode="constant", truncate=3.5)
    floor = 0.03 * smooth[smooth > 0].mean()
    value = map_coordinates(smooth, at.T, order=1, mode="nearest") + floor
    level, slope = log_density_of(ring, grid)
    own = 1 / (2 * np.pi * 4)
    assert np.allclose(level, np.log(np.maximum(value - own, floor) / (len(ring) * grid.cell_m**2)), atol=1e-12)
    for axis, by in enumerate(np.gradient(smooth)):
        assert np.allclose(slope[:, axis], map_coordinates(by, at.T, order=1, mode="nearest") / value / grid.cell_m, rtol=1e-9)


def test_it_is_the_sum_of_the_bells_of_all_points(ring):
    width = 0.2
    level, _ = log_density_of(ring, grid_of(ring, width))
    away = ((ring[:200, None] - ring[None]) ** 2).sum(-1)
    exact = (np.exp(-0.5 * away / width**2).sum(1) - 1) / (2 * np.pi * width**2 * len(ring))
    assert np.allclose(np.exp(level[:200]), exact, rtol=0.1)  # within the floor, which is 3 % of the mean, and the cells


def test_points_beyond_the_grid_have_no_slope(ring):
    far = np.vstack([ring, [[50.0, 0.0]]])
    level, slope = log_density_of(far, grid_of(ring, 0.1))
    assert not slope[-1].any() and level[-1] == level.min() and np.isfinite(level).all()


def test_moving_all_points_changes_nothing(ring):
    a, b = (log_density_of(u, grid_of(u, 0.1)) for u in (ring, ring + [3.0, -7.0]))
    assert np.allclose(a[0], b[0], atol=1e-9) and np.allclose(a[1], b[1], atol=1e-7)
