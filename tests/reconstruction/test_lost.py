"""Bores that were scanned and the solid closes."""

import numpy as np
import pytest

from predicates import moved, rotation
from scan2fea.reconstruction.lost_bores import closed_bores, facing_axis, told_bores
from scan2fea.simulation.shapes import bracket
from scanned import scanned

H, NOISE = 0.0045, 0.0012  # points of a plate, m
HOLES = [("a", 0.05, 0.04, 0.009), ("a", 0.09, 0.04, 0.009)]
POSE, AT = rotation(3), np.array([1.2, -0.4, 0.7])
WIDER = moved(bracket(0.2, 0.15, 0.0135, 0.12, [("a", 0.07, 0.04, 0.009), ("a", 0.12, 0.08, 0.009)], 0.0002), POSE, AT)
PART, WHOLE = (moved(bracket(0.14, 0.09, 0.0135, 0.08, holes, 0.0002), POSE, AT) for holes in (HOLES, []))


@pytest.mark.parametrize("seed", [0, 1])
def test_bores_of_two_spacings_are_told_by_their_points_and_a_solid_that_lacks_them_is_refused(seed):
    scan, _, normals = scanned(PART, H, NOISE, seed=seed)
    bores = told_bores(scan.cloud.points, normals, H, NOISE)
    assert sorted(bore.surface.radius for bore in bores) == pytest.approx([0.009, 0.009], rel=0.1)
    assert closed_bores(bores, PART).passed
    refused = closed_bores(bores, WHOLE)
    assert not refused.passed and refused.value == 2.0 and "bores" in refused.says


@pytest.mark.parametrize("seed", [0, 1])
def test_a_bore_into_whose_empty_circle_noise_has_carried_points_of_the_rim_is_told(seed):
    scan, _, normals = scanned(WIDER, H, NOISE, seed=seed)
    bores = told_bores(scan.cloud.points, normals, H, NOISE)  # empty to 6.8 mm at one of the two: the radius of it was held to 1.3 times that
    assert sorted(bore.surface.radius for bore in bores) == pytest.approx([0.009, 0.009], rel=0.1)


@pytest.mark.parametrize("noise", [0.0, NOISE, 2 * NOISE])
def test_a_whole_wall_tells_no_bore(noise):
    scan, _, normals = scanned(WHOLE, H, noise, seed=4)
    assert told_bores(scan.cloud.points, normals, H, noise) == []
    assert closed_bores([], WHOLE).passed


def test_normals_on_the_wall_of_a_bore_face_its_axis_and_the_others_stay():
    scan, _, normals = scanned(PART, H, NOISE, seed=2)
    bores = told_bores(scan.cloud.points, normals, H, NOISE)
    given = normals.copy()
    turned = facing_axis(bores[0], scan.cloud.points, -normals, H, NOISE)
    assert np.array_equal(normals, given)
    own = (turned != -normals).any(axis=1)
    assert own.sum() >= len(bores[0].wall)
    true = np.einsum("ij,ij->i", turned[own], normals[own])
    assert np.median(true) > 0.8  # the exact normals face the axis


@pytest.mark.parametrize(("share", "told"), [(0.1, 1), (0.6, 2)])
def test_points_round_an_empty_circle_that_lie_in_a_band_across_it_are_of_another_face(share, told):
    scan, _, normals = scanned(PART, H, NOISE, seed=0)
    points = scan.cloud.points.copy()
    bore = told_bores(points, normals, H, NOISE)[0]
    axis = bore.surface.axis
    own = (points[:, None] == bore.wall).all(axis=2).any(axis=1)
    along = points[own] @ axis
    points[own] += (share - 1.0) * (along - along.mean())[:, None] * axis
    assert len(told_bores(points, normals, H, NOISE)) == told
