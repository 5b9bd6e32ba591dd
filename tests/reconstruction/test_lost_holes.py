import numpy as np
import pytest

from predicates import moved, rotation
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction.lost_holes import holes_apart, lost_holes
from scan2fea.simulation.shapes import bracket
from scanned import scanned

WALL, SPACING, SIGMA = 0.012, 0.006, 0.0005
AT = np.array([1.0, 2.0, 3.0])
BORES = [("a", 0.08, 0.05, 0.016), ("b", 0.07, 0.05, 0.014)]


def part(*bores):
    return moved(bracket(0.14, 0.12, WALL, 0.1, list(bores), 0.0002), rotation(3), AT)


def points_of(mesh, seed=1):
    return scanned(mesh, SPACING, SIGMA, seed=seed)[0].cloud.points


@pytest.mark.parametrize("kept", [0, 1, 2])
def test_each_bore_that_the_solid_closes_is_counted(kept):
    check = lost_holes(part(*BORES), part(*BORES[:kept]), points_of(part(*BORES)), WALL, SPACING, SIGMA)
    assert (check.value, check.passed) == (2.0 - kept, kept == 2)


def test_a_hole_no_wider_than_gaps_between_points_is_none_that_was_lost():
    narrow = part(("a", 0.08, 0.05, 0.8 * SPACING))
    assert surface_topology(narrow).n_handles == 1
    assert lost_holes(narrow, part(), points_of(part()), WALL, SPACING, SIGMA).passed
    assert holes_apart(narrow, part(), 0).value == 1.0


def test_a_solid_with_a_hole_more_has_lost_none():
    assert lost_holes(part(), part(*BORES), points_of(part(*BORES)), WALL, SPACING, SIGMA).passed
    assert holes_apart(part(*BORES), part(BORES[0]), 1).passed


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_hole_of_the_first_surface_where_no_point_lies_between_the_faces_is_a_gap(seed):
    """The same hole, of 1.7 spacings: scanned, and a gap that chance leaves in both faces."""
    radius = 1.7 * SPACING
    bored = part(("a", 0.08, 0.05, radius))
    points = points_of(bored, seed)
    assert not lost_holes(bored, part(), points, WALL, SPACING, SIGMA).passed
    whole = points_of(part(), seed)
    turn = rotation(3)
    off = np.linalg.norm(np.cross(whole - (turn @ np.array([0.0, 0.08, 0.05]) + AT), turn[:, 0]), axis=1)
    assert lost_holes(bored, part(), whole[off > 1.2 * SPACING], WALL, SPACING, SIGMA).passed
