"""Points counted by cells of a grid are those that a look at every distance counts; places outside and reaches beyond the box too."""

from __future__ import annotations

import numpy as np
import pytest

from scan2fea.kernel.planar_grid import PlanarGrid

RNG = np.random.default_rng(3)
SETS = {
    "random": RNG.random((500, 2)) * [3.0, 0.4],
    "rows": np.c_[RNG.random(500), np.repeat(np.arange(10) / 10, 50)],
    "grid": np.stack(np.meshgrid(np.arange(20.0), np.arange(9.0)), -1).reshape(-1, 2),
    "far": RNG.random((300, 2)) ** 2 + [4e3, -2e3],
    "two": np.array([[0.0, 1.0], [2.0, 3.0]]),
}


@pytest.mark.parametrize("name", SETS)
def test_counts_are_those_of_all_distances(name) -> None:
    points = SETS[name]
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    at = np.r_[points[:40], low + size * RNG.uniform(-0.5, 1.5, (60, 2))]
    reach = np.r_[np.zeros(20), RNG.uniform(0, 1.2, len(at) - 20)[: len(at) - 20] * size.max()]
    distance = np.linalg.norm(points[None] - at[:, None], axis=2)
    expected = (distance <= reach[:, None]).sum(axis=1)
    clear = (np.abs(distance - reach[:, None]) > 1e-9).all(axis=1) | (reach == 0) & (name != "far")
    assert clear.sum() > len(at) / 2
    assert np.array_equal(PlanarGrid.of(points).n_within(at, reach)[clear], expected[clear])


def test_every_point_stands_in_its_cell() -> None:
    points = SETS["random"].copy()
    grid = PlanarGrid.of(points)
    assert np.array_equal(points, SETS["random"]) and grid.first[0] == 0 and grid.first[-1] == len(points)
    row = grid.cell[:, 0] * grid.shape[1] + grid.cell[:, 1]
    assert (np.diff(row) >= 0).all() and np.array_equal(np.searchsorted(row, np.arange(len(grid.first))), grid.first)
    assert np.allclose(np.sort(grid.points + grid.low, axis=0), np.sort(points, axis=0))
