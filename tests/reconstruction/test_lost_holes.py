import numpy as np
import pytest

from predicates import moved, rotation
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction.lost_holes import holes_apart, lost_holes
from scan2fea.simulation.shapes import bracket

WALL, SPACING, SIGMA = 0.012, 0.006, 0.0005
BORES = [("a", 0.08, 0.05, 0.016), ("b", 0.07, 0.05, 0.014)]


def part(*bores):
    return moved(bracket(0.14, 0.12, WALL, 0.1, list(bores), 0.0002), rotation(3), np.array([1.0, 2.0, 3.0]))


@pytest.mark.parametrize("kept", [0, 1, 2])
def test_each_bore_that_the_solid_closes_is_counted(kept):
    check = lost_holes(part(*BORES), part(*BORES[:kept]), WALL, SPACING, SIGMA)
    assert (check.value, check.passed) == (2.0 - kept, kept == 2)


def test_a_hole_no_wider_than_gaps_between_points_is_none_that_was_lost():
    narrow = part(("a", 0.08, 0.05, 0.8 * SPACING))
    assert surface_topology(narrow).n_handles == 1
    assert lost_holes(narrow, part(), WALL, SPACING, SIGMA).passed
    assert holes_apart(narrow, part(), 0).value == 1.0


def test_a_solid_with_a_hole_more_has_lost_none():
    assert lost_holes(part(), part(*BORES), WALL, SPACING, SIGMA).passed
    assert holes_apart(part(*BORES), part(BORES[0]), 1).passed
