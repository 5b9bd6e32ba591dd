"""Bores that were scanned and the solid closes."""

from dataclasses import replace

import numpy as np
import pytest

from predicates import moved, rotation
from scan2fea.kernel.measures import volume
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import reconstruct
from scan2fea.reconstruction.bores import LEAST_POINTS, distinct_bores, distinct_cylinders
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.lost_bores import (
    BORES_CLOSED,
    CIRCLE_CHANCE,
    FREE,
    HELD,
    LEAST_TOLD,
    LIKE_CHANCE,
    LIKE_FREE,
    LIKE_HELD,
    _is_like,
    _is_told,
    closed_bores,
    facing_axis,
    told_by,
)
from scan2fea.simulation.shapes import bracket
from scanned import scanned

H, NOISE = 0.0045, 0.0012  # points of a plate, m
HOLES = [("a", 0.05, 0.04, 0.009), ("a", 0.09, 0.04, 0.009)]
POSE, AT = rotation(3), np.array([1.2, -0.4, 0.7])
WIDER = moved(bracket(0.2, 0.15, 0.0135, 0.12, [("a", 0.07, 0.04, 0.009), ("a", 0.12, 0.08, 0.009)], 0.0002), POSE, AT)
PART, WHOLE = (moved(bracket(0.14, 0.09, 0.0135, 0.08, holes, 0.0002), POSE, AT) for holes in (HOLES, []))


def bores_of(points, normals, spacing_m, sigma_m):
    return list(told_by(points, normals, spacing_m, sigma_m).bores)


@pytest.mark.parametrize("seed", [0, 1])
def test_bores_of_two_spacings_are_told_by_their_points_and_a_solid_that_lacks_them_is_refused(seed):
    scan, _, normals = scanned(PART, H, NOISE, seed=seed)
    bores = bores_of(scan.cloud.points, normals, H, NOISE)
    assert sorted(bore.surface.radius for bore in bores) == pytest.approx([0.009, 0.009], rel=0.1)
    assert closed_bores(bores, PART).passed
    refused = closed_bores(bores, WHOLE)
    assert not refused.passed and refused.value == 2.0 and "bores" in refused.says


@pytest.mark.parametrize("seed", [0, 1])
def test_a_bore_into_whose_empty_circle_noise_has_carried_points_of_the_rim_is_told(seed):
    scan, _, normals = scanned(WIDER, H, NOISE, seed=seed)
    bores = bores_of(scan.cloud.points, normals, H, NOISE)  # empty to 6.8 mm at one of the two: the radius of it was held to 1.3 times that
    assert sorted(bore.surface.radius for bore in bores) == pytest.approx([0.009, 0.009], rel=0.1)


@pytest.mark.parametrize("noise", [0.0, NOISE, 2 * NOISE])
def test_a_whole_wall_tells_no_bore(noise):
    scan, _, normals = scanned(WHOLE, H, noise, seed=4)
    assert bores_of(scan.cloud.points, normals, H, noise) == []
    assert closed_bores([], WHOLE).passed


@pytest.mark.parametrize("seed, n_points", [(1, 7), (9, 5), (11, 5)])
def test_without_noise_five_points_on_a_circle_tell_a_bore(seed, n_points):
    """A hole of 0.9 spacings; chance puts no five points on a circle exactly. A tenth of a millimetre off they tell none."""
    small = bracket(0.1, 0.08, 0.0099, 0.055, [("a", 0.055, 0.0275, 0.0045)], 2e-6)
    scan, _, normals = scanned(small, 0.005, seed=seed)
    bores = bores_of(scan.cloud.points, normals, 0.005, 0.0)
    assert [len(bore.wall) for bore in bores] == [n_points] and bores[0].surface.radius == pytest.approx(0.0045, rel=1e-3)
    noisy = scan.cloud.points + 1e-4 * np.random.default_rng(0).normal(size=normals.shape)
    assert bores_of(noisy, normals, 0.005, 1e-4) == []


def test_normals_on_the_wall_of_a_bore_face_its_axis_and_the_others_stay():
    scan, _, normals = scanned(PART, H, NOISE, seed=2)
    bores = bores_of(scan.cloud.points, normals, H, NOISE)
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
    bore = bores_of(points, normals, H, NOISE)[0]
    axis = bore.surface.axis
    own = (points[:, None] == bore.wall).all(axis=2).any(axis=1)
    along = points[own] @ axis
    points[own] += (share - 1.0) * (along - along.mean())[:, None] * axis
    assert len(bores_of(points, normals, H, NOISE)) == told


@pytest.mark.parametrize(("share", "told"), [(0.1, False), (0.6, True)])
def test_a_circle_whose_points_deep_in_the_wall_lie_on_one_side_is_none(share, told):
    """Beside the end of a rib its end face, and noise of its sides all round, were told as a bore; the right solid was refused."""
    scan, _, normals = scanned(PART, H, NOISE, seed=0)
    bore = bores_of(scan.cloud.points, normals, H, NOISE)[0]
    surface, middle = bore.surface, bore.wall.mean(axis=0)
    aside = (bore.wall - middle) @ surface.frame().T
    turn = np.arctan2(*aside.T[::-1]) * np.where(bore.deep, share, 1.0)
    ring = surface.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    wall = surface.point + ring @ surface.frame() + np.outer((bore.wall - surface.point) @ surface.axis, surface.axis)
    assert 3 <= bore.deep.sum() < len(wall)
    assert _is_told(replace(bore, wall=wall), wall, H, NOISE, LEAST_TOLD, CIRCLE_CHANCE, HELD, FREE) == told


FOUR = [("a", x, y, 0.0055) for x in (0.03, 0.075) for y in (0.014, 0.046)]  # 2.3 spacings wide, of which a plate's edge is 1.5 away
PLATE = moved(bracket(0.09, 0.06, 0.012, 0.06, FOUR, 2e-5), POSE, AT)


@pytest.mark.parametrize(("seed", "passes"), [(0, True), (7, False)])
def test_bolt_holes_beside_an_edge_are_told_and_opened_in_a_surface_by_sensors_or_it_is_refused(seed, passes):
    scan, _, normals = scanned(PLATE, 0.0048, 0.00025, seed=seed)
    bores = bores_of(scan.cloud.points, normals, 0.0048, 0.00025)
    assert [bore.surface.radius for bore in bores] == pytest.approx([0.0055] * 4, rel=0.1)
    found = reconstruct(scan)  # had none to two of the four, and passed in five scans of eight
    if passes:
        assert not failed(found.checks) and surface_topology(found.mesh).n_handles == 4
        assert volume(found.mesh) == pytest.approx(volume(PLATE), rel=0.006)
    else:
        assert BORES_CLOSED in [check.name for check in failed(found.checks)]


def test_a_bore_behind_whose_wall_there_is_no_solid_or_that_is_no_handle_is_none():
    scan, _, normals = scanned(PART, H, NOISE, seed=0)
    bores = bores_of(scan.cloud.points, normals, H, NOISE)
    assert closed_bores(bores, moved(PART, np.eye(3), np.array([1.0, 0.0, 0.0]))).value == 2.0
    assert closed_bores(bores[:1], PART).passed and not closed_bores([*bores, *_aside(bores)], PART).passed


def _aside(bores):
    """The bores once more, in the open."""
    away = [replace(bore.surface, point=bore.surface.point + np.array([0.0, 0.0, 9.0])) for bore in bores]
    return [replace(bore, surface=surface, wall=bore.wall + np.array([0.0, 0.0, 9.0])) for bore, surface in zip(bores, away, strict=True)]


def test_two_skins_of_a_wall_are_no_circle():
    """Both skins of a wall of 1.7 spacings, 60 mm long between two ends that hold points: a circle as wide as the wall touches both."""
    slab = moved(bracket(0.12, 0.05, 0.0075, 0.06, [], 2e-5), POSE, AT)
    scan, _, normals = scanned(slab, H, 0.0003, seed=1)
    assert bores_of(scan.cloud.points, normals, H, 0.0003) == []


def test_one_more_bore_as_wide_and_deep_needs_less_proof_in_whatever_wall_it_is():
    """Both legs of an angle are drilled alike."""
    scan, _, normals = scanned(PART, H, NOISE, seed=0)
    bore = bores_of(scan.cloud.points, normals, H, NOISE)[0]
    across = replace(bore, surface=replace(bore.surface, axis=bore.surface.frame()[0]))
    wider = replace(bore, surface=replace(bore.surface, radius=1.2 * bore.surface.radius))
    assert _is_like(across, bore) and not _is_like(wider, bore) and not _is_like(replace(bore, depth_m=1.2 * bore.depth_m), bore)


def test_bores_on_one_axis_through_two_walls_are_two_and_of_one_cylinder_where_that_holds_both():
    """Of an I with holes in both flanges one of each pair had been asked after, and the other was lost."""
    scan, _, normals = scanned(PART, H, NOISE, seed=0)
    bore = bores_of(scan.cloud.points, normals, H, NOISE)[0]
    beyond, beside = (replace(bore, wall=bore.wall + by) for by in (0.1 * bore.surface.axis, 0.003 * bore.surface.frame()[0]))
    assert len(distinct_bores([bore, beside])) == 1
    assert len(distinct_bores([bore, beyond])) == 2 and len(distinct_cylinders([bore, beyond], 0.002)) == 1
    shift = 0.003 * bore.surface.frame()[0]
    aside = replace(bore, surface=replace(bore.surface, point=bore.surface.point + shift), wall=beyond.wall + shift)
    assert len(distinct_cylinders([bore, aside], 0.001)) == 2


def test_where_the_faces_round_a_bore_have_few_points_its_wall_may_have_few():
    """An I had been converted with 10 holes of 11, a channel with 4 of 5: theirs were seen from few places."""
    scan, _, normals = scanned(PART, H, 0.0003, seed=0)
    points = scan.cloud.points
    bore = bores_of(points, normals, H, 0.0003)[0]
    assert 0.8 < bore.beside <= 1.0
    u, v = ((bore.wall - bore.surface.point) @ bore.surface.frame().T).T
    order = np.argsort(np.arctan2(v, u))
    wall, deep = bore.wall[order], bore.deep[order]
    few = replace(bore, wall=wall[::4], deep=deep[::4])
    least = LEAST_TOLD, CIRCLE_CHANCE, HELD, FREE
    assert not _is_told(few, points, H, 0.0003, *least) and _is_told(replace(few, beside=0.4), points, H, 0.0003, *least)
    fewer = replace(bore, wall=wall[::6], deep=deep[::6], beside=0.4)
    assert not _is_told(fewer, points, H, 0.0003, *least)
    assert _is_told(fewer, points, H, 0.0003, LEAST_POINTS, LIKE_CHANCE, LIKE_HELD, LIKE_FREE)
