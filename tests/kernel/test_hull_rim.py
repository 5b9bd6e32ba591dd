"""Points left out are no corners of the convex hull."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from scan2fea.kernel.hull_rim import hull_rim

RNG = np.random.default_rng(2)
GRID = np.stack(np.meshgrid(np.arange(9.0), np.arange(5.0)), -1).reshape(-1, 2)


ROUND, SLIM, FEW = RNG.normal(size=(3000, 2)), RNG.uniform(size=(3000, 2)) @ [[1.0, 0.9], [0.0, 0.1]], RNG.normal(size=(3, 2))


@pytest.mark.parametrize("points", [ROUND, SLIM, GRID, FEW])
def test_the_hull_is_the_same(points):
    rim = hull_rim(points)
    assert {tuple(p) for p in rim} <= {tuple(p) for p in points}
    whole, own = ConvexHull(points), ConvexHull(rim)
    assert own.volume == pytest.approx(whole.volume, rel=1e-12)
    assert {tuple(points[k]) for k in whole.vertices} == {tuple(rim[k]) for k in own.vertices}


def test_points_on_a_line_stay():
    line = np.c_[np.arange(20.0), 2 * np.arange(20.0)]
    assert len(hull_rim(line)) == 20


def test_most_are_left_out():
    assert len(hull_rim(RNG.normal(size=(20_000, 2)))) < 200
