from dataclasses import replace

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, box, moved, rotation
from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import volume
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.reconstruction import reconstruct, visibility
from scan2fea.reconstruction.empty_places import discs_of
from scan2fea.reconstruction.flat_gaps import REACH, flat_ends, half_seen_ends, hidden_volume_flat, over_walls
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.planar import flattened
from scan2fea.reconstruction.sight import Sight, blocked_lines
from scan2fea.simulation.girder import girder_mesh
from scan2fea.simulation.shapes import bracket
from scanned import scan_of, scanned

H = 0.009
GIRDER = moved(girder_mesh(0.3, 0.2, 0.012, 0.018, 0.4, 0.012, 0.07, 1), rotation(2), np.array([1.0, 0.0, -2.0]))
WAY = rotation(2)  # columns: the girder's x across the web, y from flange to flange, z along


def _shadowed(seed):
    """A girder of which one panel of the web, and what a look at it sees round about, lies in a shadow."""
    scan, places, normals = scanned(GIRDER, H, seed=seed)
    middle = np.array([1.0, 0.0, -2.0]) + WAY @ [0.006, 0.0, 0.1]
    look = WAY @ (np.array([0.7, 0.3, -0.5]) / np.linalg.norm([0.7, 0.3, -0.5]))
    off = places - middle
    off = np.linalg.norm(off - (off @ look)[:, None] * look, axis=1)
    sees = (normals @ look > 0) & (first_hits(scene_of(GIRDER), places + 1e-9 * normals, np.tile(look, (len(places), 1)))[1] < 0)
    gone = sees & (off < 0.13)
    assert 0.06 < gone.mean() < 0.25
    return scan_of(scan.cloud.points[~gone], scan.sensors()[~gone])


def test_planes_and_sight_lines_carry_a_part_over_a_shadow_that_misleads_the_first_surface():
    """Of three draws one at least, of which the first surface is told to be wrong: of one, on one processor, a sight line in a hundred is blocked."""
    for seed in (1, 2, 3):
        scan = _shadowed(seed)
        found = reconstruct(scan)
        assert failed(found.checks) or found.how["method"] == "planar"
        if not failed(found.checks):
            break
    assert not failed(found.checks)
    first = visibility(scan)
    assert failed(first.checks) and abs(volume(first.mesh) / volume(GIRDER) - 1) > 0.005
    assert_closed_manifold_oriented(found.mesh)
    assert volume(found.mesh) == pytest.approx(volume(GIRDER), rel=1e-6)
    assert len(found.carried) == found.how["n_carried"] > 0  # told as inferred
    assert PointToMesh(GIRDER).nearest(found.carried).distance.max() < 1e-6


def test_where_nothing_is_hidden_sight_lines_say_what_the_first_surface_does():
    scan, _, _ = scanned(GIRDER, H, seed=3)
    first = visibility(scan)
    one, other = (flattened(scan, first, 0, by_lines) for by_lines in (False, True))
    assert volume(one.mesh) == pytest.approx(volume(GIRDER), rel=1e-9)
    assert volume(other.mesh) == pytest.approx(volume(GIRDER), rel=1e-9)
    assert not len(other.carried)


def test_what_points_and_lines_tell_of_a_place():
    slab = box((1.0, 0.8, 0.2))
    scan, _, _ = scanned(slab, 0.04, seed=1)
    first = visibility(scan)
    sight = Sight.of(scan, first)
    rng = np.random.default_rng(0)
    inside = rng.uniform([0.1, 0.1, 0.0], [0.9, 0.7, 0.2], (500, 3))
    outside = rng.uniform([0.1, 0.1, 0.21], [0.9, 0.7, 0.3], (500, 3))
    full, empty = sight.told(inside)
    assert full.mean() > 0.7 and empty.mean() < 0.01
    full, empty = sight.told(outside)
    assert empty.mean() > 0.3 and not full.any()
    assert not np.any(sight.told(np.full((1, 3), 500.0)))  # of a far place nothing is known


def test_a_gap_is_carried_over_where_the_other_face_of_the_wall_was_seen():
    slab, h = replace(box((1.0, 0.8, 0.1)), face_region=np.arange(12) // 2), 0.02
    _, points, normals = scanned(slab, h, seed=0)
    hidden = (normals[:, 2] > 0.5) & (np.linalg.norm(points[:, :2] - [0.5, 0.4], axis=1) < 0.25)
    assert hidden_volume_flat(slab, points[~hidden], h).value > 0.05
    put = over_walls(slab, points[~hidden], h)
    assert np.allclose(put[:, 2], 0.1) and (np.linalg.norm(put[:, :2] - [0.5, 0.4], axis=1) < 0.25).all()
    assert hidden_volume_flat(slab, np.concatenate([points[~hidden], put]), h).value == 0.0
    both = np.linalg.norm(points[:, :2] - [0.5, 0.4], axis=1) < 0.25
    put = over_walls(slab, points[~both], h)  # gone on both faces: nothing within the border of either
    assert hidden_volume_flat(slab, np.concatenate([points[~both], put]), h).value > 0.05
    most = (normals[:, 2] > 0.5) & (points[:, 0] < 0.7)
    put = over_walls(slab, points[~most], h)  # of a face less was measured than is missing
    assert not np.isclose(put[:, 2], 0.1).any()


def test_gaps_in_most_of_a_face_are_carried_over_where_none_is_wider_than_what_was_seen_of_it():
    slab, h = replace(box((1.0, 0.5, 0.1)), face_region=np.arange(12) // 2), 0.015
    _, points, normals = scanned(slab, h, seed=0)
    x, top = points[:, 0], normals[:, 2] > 0.5
    one, other = (x > 0.02) & (x < 0.32), (x > 0.66) & (x < 0.96)
    put = over_walls(slab, points[~(top & (one | other))], h)
    assert np.allclose(put[:, 2], 0.1) and (put[:, 0] < 0.32).any() and (put[:, 0] > 0.66).any()
    side = (normals[:, 1] > 0.5) & one  # one gap goes on round an edge
    put = over_walls(slab, points[~(top & (one | other) | side)], h)
    put = put[np.isclose(put[:, 2], 0.1)]
    assert (put[:, 0] > 0.64).all() and len(put)
    wider = (x > 0.02) & (x < 0.42)
    put = over_walls(slab, points[~(top & (wider | other))], h)
    assert (put[np.isclose(put[:, 2], 0.1), 0] > 0.42).all()


def test_places_far_from_all_points_may_be_ends_that_nobody_saw():
    slab, h = replace(box((1.0, 0.8, 0.1)), face_region=np.arange(12) // 2), 0.02
    _, points, normals = scanned(slab, h, seed=0)
    assert flat_ends(slab, points, h).value == 0.0
    one = (normals[:, 2] > 0.5) & (points[:, 0] > 0.7)
    assert flat_ends(slab, points[~one | (points[:, 2] < 0.05)], h * 2).value == 0.0  # the other face goes up to the edge
    end = points[:, 0] > 0.8  # the end, and both faces beside it
    deep = 0.2 - REACH * h
    least = 2 * 0.8 * deep * np.hypot(0.8, deep) / np.pi / volume(slab)
    assert 0.8 * least < flat_ends(slab, points[~end], h).value <= 1.0


def test_a_hole_and_a_boss_at_one_place_exclude_each_other_and_the_larger_counts_once():
    slab, h = replace(box((1.0, 0.8, 0.1)), face_region=np.arange(12) // 2), 0.02
    _, points, _ = scanned(slab, h, seed=0)
    left = points[np.linalg.norm(points[:, :2] - [0.5, 0.4], axis=1) > 0.2]  # gone on both faces: the wall goes on there, or not
    walls = discs_of(slab, left)
    hole, boss = walls.volume_m3 / volume(slab), hidden_volume_flat(slab, left, h).value
    assert 0.5 * hole < flat_ends(slab, left, h).value < hole  # it is no end: at most what is under the place
    assert flat_ends(slab, left, h, walls=walls).value == 0.0  # counted as a wall that nobody saw
    assert hole + hidden_volume_flat(slab, left, h, walls=walls).value == pytest.approx(max(hole, boss))
    one = points[(points[:, 2] < 0.05) | (np.linalg.norm(points[:, :2] - [0.5, 0.4], axis=1) > 0.2)]  # of one face: no hole
    assert hidden_volume_flat(slab, one, h, walls=discs_of(slab, one)).value == hidden_volume_flat(slab, one, h).value > 0.0


@pytest.mark.parametrize(("is_open", "passed"), [(True, False), (False, True)])
def test_lines_that_run_through_a_bore_tell_that_planes_have_closed_it(is_open, passed):
    holes = [("a", 0.08, 0.05, 0.016), ("b", 0.07, 0.05, 0.014)] if is_open else []
    truth, closed = (bracket(0.14, 0.12, 0.012, 0.1, own, 0.0005) for own in (holes, []))
    scan = scanned(truth, 0.0084, 0.0012, seed=0)[0]
    check = blocked_lines(scan, closed, 0.0084, 0.0012)
    assert check.passed is passed
    assert blocked_lines(scan, truth, 0.0084, 0.0012).passed


def lines(points, targets, spacing=0.02):
    """Sight lines and nothing else."""
    none = np.zeros((0, 3))
    return Sight(points=none, normals=none, wall_m=np.zeros(0), origin=points, target=targets, spacing_m=spacing, skin_m=0.0)


def with_regions(mesh):
    """face_region: one of each direction (of a convex solid, or a bar with flat ends: the ends are one each)."""
    normals = np.cross(*[mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    level = np.einsum("ij,ij->i", normals, mesh.vertices[mesh.faces[:, 0]])
    return replace(mesh, face_region=2 * np.unique(np.round(np.column_stack([normals, level]), 6), axis=0, return_inverse=True)[1].ravel())


@pytest.mark.parametrize(("seen", "passed"), [(0.3, False), (0.6, True)])
def test_an_end_of_the_part_is_one_where_half_of_it_was_measured(seen, passed):
    """Of a bar the end at x = 0, and all beside it; a place within REACH spacings of a point counts as measured."""
    spacing = 0.02
    bar = with_regions(box((2.0, 1.0, 1.0)))
    points, _ = sample_surface(bar, 20_000, seed=0)
    gone = (points[:, 0] < 1e-9) & (points[:, 1] > seen - REACH * spacing)
    for turn in (np.eye(3), rotation(7)):
        turned = replace(moved(bar, turn, np.array([5.0, 1.0, -3.0])), face_region=bar.face_region)
        check = half_seen_ends(turned, points[~gone] @ turn.T + [5.0, 1.0, -3.0], lines(points[:0], points[:0]), spacing)
        assert check.passed is passed and check.value == (0.0 if passed else 1.0)
    assert half_seen_ends(bar, points, lines(points[:0], points[:0]), spacing).passed


@pytest.mark.parametrize(("crossed", "passed"), [(0.0, False), (0.3, False), (1.0, True)])
def test_an_end_with_openings_that_sight_lines_pass_needs_fewer_points(crossed, passed):
    """An I whose end at z = 0 has no points in four fifths of its height: the flanges' notches are open as far as lines pass them."""
    truth = with_regions(girder_mesh(0.3, 0.15, 0.008, 0.012, 0.6, 0.008, 0.06, 0))
    spacing = 0.0056
    points, _ = sample_surface(truth, 40_000, seed=0)
    points = points[~((points[:, 2] < 1e-9) & (points[:, 1] > -0.09))]
    at = np.random.default_rng(0).uniform([-0.075, -0.135, 0.0], [0.075, 0.135, 0.0], (2000, 3))
    at = at[(np.abs(at[:, 0]) > 0.006) & (at[:, 1] < -0.135 + 0.27 * crossed)]
    way = [0.02, 0.01, 0.1]
    assert half_seen_ends(truth, points, lines(at - way, at + way), spacing).passed is passed
    assert not half_seen_ends(truth, points, lines(at - way, at - np.multiply(way, 0.02)), spacing).passed  # they end before it
