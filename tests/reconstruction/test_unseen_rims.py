"""Holes that no point and no sight line of their rims tells."""

import numpy as np
import pytest

from predicates import box, moved, sphere, torus
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction.unseen_rims import UNSEEN_RIMS, handles, unseen_rims
from scan2fea.reconstruction.wall_ends import Stretch
from scan2fea.simulation.shapes import bracket

RADIUS = 0.016
PART = bracket(0.14, 0.12, 0.012, 0.1, [("a", 0.08, 0.05, RADIUS), ("b", 0.07, 0.05, 0.014)], 0.0002)


def rim(share=1.0):
    """Faces on the wall of the hole in leg a, a share of its round."""
    middle = PART.vertices[PART.faces].mean(axis=1)
    across = middle[:, 1:] - [0.08, 0.05]
    on = (np.abs(np.linalg.norm(across, axis=1) - RADIUS) < 0.05 * RADIUS) & (middle[:, 0] < 0.012)
    return np.flatnonzero(on & (np.arctan2(across[:, 1], across[:, 0]) / np.pi < 2 * share - 1))


def stretch(faces, unproved):
    slack = np.where(np.arange(len(faces)) < unproved * len(faces), np.inf, 0.01)
    return Stretch(faces=faces, wall_m=0.012, length_m=0.1, due=10.0, slack_m=slack)


@pytest.mark.parametrize("mesh", [box(np.ones(3)), sphere(1.0, rounds=2), torus(1.0, 0.3, 24, 12), PART])
def test_handles_of_a_closed_surface_are_its_holes(mesh):
    assert handles(mesh.faces) == surface_topology(mesh).n_handles


def test_borders_are_closed_by_discs():
    assert handles(sphere(1.0, rounds=2).faces[5:]) == 0
    assert handles(np.delete(PART.faces, rim(), axis=0)) == 1  # the other hole
    assert handles(PART.faces[:0]) == 0


@pytest.mark.parametrize(("unproved", "n"), [(1.0, [1.0]), (0.6, [1.0]), (0.4, []), (0.0, [])])
def test_a_hole_counts_where_most_of_its_rim_was_not_seen(unproved, n):
    before = PART.faces.copy()
    checks = unseen_rims(PART, [stretch(rim(), unproved)])
    assert [check.value for check in checks] == n
    assert all(check.name == UNSEEN_RIMS and not check.passed and "1 holes" in check.says for check in checks)
    assert np.array_equal(PART.faces, before)


def test_half_a_rim_is_no_hole_and_a_solid_without_holes_is_not_asked():
    half = unseen_rims(PART, [stretch(rim(0.5), 1.0)])
    assert [check.passed for check in half] == [True] and half[0].value == 0.0
    assert unseen_rims(box(np.ones(3)), [stretch(np.arange(4), 1.0)]) == ()
    assert unseen_rims(PART, []) == ()


@pytest.mark.parametrize(("due", "n"), [(3.0, 1.0), (1.0, 0.0)])
def test_wide_faces_close_a_rim_that_lies_beside_another_wall(due, n):
    """A hole in a plate of a cross, on the line where it meets the other, had passed: that wall had no points there either."""
    others = np.setdiff1d(rim(), rim(0.7))
    assert unseen_rims(PART, [stretch(rim(0.7), 1.0)], np.where(np.isin(np.arange(len(PART.faces)), others), due, 0.5))[0].value == n


def test_pose_and_scale_do_not_matter():
    turned = moved(PART, 7.0 * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([3.0, -2.0, 5.0]))
    assert unseen_rims(turned, [stretch(rim(), 1.0)])[0].value == 1.0
