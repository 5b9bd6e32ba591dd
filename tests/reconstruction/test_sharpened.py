from dataclasses import replace

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, moved, rotation, sphere
from scan2fea.kernel.measures import volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import visibility
from scan2fea.reconstruction.sharpened import _split, served_sharp
from scan2fea.simulation.shapes import bracket
from scanned import scanned

HOLES = [("a", 0.08, 0.05, 0.016), ("b", 0.07, 0.05, 0.014)]


@pytest.mark.parametrize(("spacing", "sigma", "seed"), [(0.0042, 0.0, 1), (0.006, 0.0, 2), (0.0042, 0.0006, 3)])
def test_edges_between_faces_of_a_bracket_are_led_out_to_where_these_meet(spacing, sigma, seed):
    truth = moved(bracket(0.14, 0.12, 0.012, 0.1, HOLES, 0.0002), rotation(seed), np.array([1.0, -2.0, 3.0]))
    scan = scanned(truth, spacing, sigma, seed=seed)[0]
    first = visibility(scan)
    found = served_sharp(scan, first)
    assert found.how["n_sharpened"] > 50
    assert_closed_manifold_oriented(found.mesh)
    assert not len(self_intersections(found.mesh))
    assert surface_topology(found.mesh).n_handles == surface_topology(first.mesh).n_handles
    assert volume(found.mesh) == pytest.approx(volume(truth), rel=0.015)
    cut = [next(c.value for c in x.checks if c.name == "edges between points") for x in (first, found)]
    assert cut[1] < 0.7 * cut[0]


def test_a_round_part_stays_as_it_is():
    scan = scanned(moved(sphere(0.1, 5), rotation(0), np.zeros(3)), 0.01, 0.0, seed=0)[0]
    first = visibility(scan)
    assert served_sharp(scan, first) is first
    ranged = replace(first, source="ranges")
    assert served_sharp(scan, ranged) is ranged


@pytest.mark.parametrize("middle", [(-1, -1, -1), (3, -1, -1), (-1, 4, -1), (3, 4, -1), (-1, 4, 5), (3, -1, 5), (3, 4, 5)])
@pytest.mark.parametrize("corner", [-1, 6])
def test_pieces_of_a_face_cover_it_and_turn_as_it_does(middle, corner):
    places = np.array([[0, 0], [2, 0], [0, 2], [1, 0], [1, 1], [0, 1], [0.6, 0.6]], float)
    pieces = _split(np.array([0, 1, 2]), np.array(middle), corner if min(middle) >= 0 else -1)
    a, b, c = (places[pieces[:, k]] for k in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (turn > 0).all()
    assert turn.sum() == pytest.approx(4.0)
    assert set(np.unique(pieces)) == {0, 1, 2} | {v for v in (*middle, corner if min(middle) >= 0 else -1) if v >= 0}
