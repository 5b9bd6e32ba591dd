"""Element size from walls and budget."""

import numpy as np
import pytest

from predicates import box, l_beam, moved, rotation
from scan2fea.tetmeshing.sizing import MAX_WALLS_PER_EDGE, WALLS_PER_EDGE, edge_for, element_size
from scan2fea.types import TriangleMesh


def test_thin_part_gets_two_walls_where_the_budget_allows():
    size = element_size(box((0.05, 0.05, 0.0005), pitch=0.01), 1e6, 1e6, seed=0)
    assert size.wall_m == pytest.approx(0.0005, rel=1e-6)
    assert size.edge_m == pytest.approx(WALLS_PER_EDGE * size.wall_m)


def test_budget_makes_it_coarser_and_walls_cap_that():
    beam = l_beam(length=3.048)
    few, many = (element_size(beam, np.inf, n, seed=0).edge_m for n in (40_000, 60_000))
    assert few / many == pytest.approx(1.5**0.5, rel=1e-6)
    assert element_size(beam, 100, 100, seed=0).edge_m == pytest.approx(MAX_WALLS_PER_EDGE * 0.00635, rel=1e-3)


def test_compact_part_is_not_one_element():
    assert element_size(box(), 40_000, 58_000, seed=0).edge_m < 0.1


def test_estimate_on_both_branches():
    assert edge_for(1.0, 6.0, 8490, np.inf) == pytest.approx(0.1)
    assert edge_for(1e-9, 6.0, 252_000, np.inf) == pytest.approx(0.01)


@pytest.mark.parametrize("scale", [1e-3, 50.0])
def test_scale_and_motion(scale):
    beam = l_beam(pitch=0.05)
    other = moved(TriangleMesh(vertices=beam.vertices * scale, faces=beam.faces), rotation(2), np.array([1000.0, 0, -1000.0]))
    a, b = element_size(beam, 40_000, 58_000, 0), element_size(other, 40_000, 58_000, 0)
    assert b.edge_m == pytest.approx(a.edge_m * scale, rel=1e-3)
