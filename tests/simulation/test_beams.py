import numpy as np
import pytest

from scan2fea.simulation.beams import BeamOptions, Shots, echoes, footprint, shoot
from scan2fea.simulation.casting import hits, is_visible, target_of
from sensed import block, clutter, nearest_by_brute_force, scene


def shots(origin, direction):
    direction = np.asarray(direction, float)
    n = len(direction)
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return Shots(origin=np.broadcast_to(np.asarray(origin, float), (n, 3)), direction=unit, time_s=np.arange(float(n)), ring=np.zeros(n, np.int64))


def test_footprint_is_even_over_the_disc_and_never_outside():
    axis = np.array([[1.0, 0, 0], [0.3, -0.8, 0.5], [0, 0, -1]])
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    opening = 0.02
    rays = footprint(axis, opening, 4000)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=2), 1, rtol=1e-12)
    radius = np.tan(np.arccos(np.clip(np.einsum("nmc,nc->nm", rays, axis), -1, 1))) / np.tan(opening / 2)
    assert radius.max() <= 1
    for share in (0.1, 0.25, 0.5, 0.9):
        np.testing.assert_allclose((radius**2 < share).mean(axis=1), share, atol=0.002)
    np.testing.assert_allclose(rays.mean(axis=1) / np.linalg.norm(rays.mean(axis=1), axis=1, keepdims=True), axis, atol=1e-4 * opening)


def test_a_square_wall_is_seen_at_its_distance():
    target = target_of(scene(block((3, -2, -2), (4, 2, 2)), reflectance=0.7))
    narrow = echoes(target, shots((0, 0, 0), [[1, 0, 0]]), BeamOptions())
    wide = echoes(target, shots((0, 0, 0), [[1, 0, 0]]), BeamOptions(divergence_mrad=20.0, footprint_rays=200))
    assert narrow.range_m[0] == 3.0
    # mean of 3 sqrt(1 + tan^2) over the disc: 3 (1 + tan(opening / 2)^2 / 4)
    assert wide.range_m[0] == pytest.approx(3 * (1 + 0.01**2 / 4), abs=1e-6)
    assert wide.shine[0] == pytest.approx(0.7)
    assert wide.thing[0] == 0


def test_pixels_at_an_edge_mix_within_the_pulse_and_not_beyond():
    """Half of the beam on a near plate, half on a far one: powers per ray go with 1 / r^2."""
    near, far = block((2, 0, -1), (2.1, 1, 1)), block((2.5, -2, -2), (2.6, 2, 2))
    target = target_of(scene(near, far))
    options = {"divergence_mrad": 10.0, "footprint_rays": 400}
    mixed = echoes(target, shots((0, 0, 0), [[1, 0, 0]]), BeamOptions(pulse_m=0.75, **options))
    weights = np.array([1 / 2**2, 1 / 2.5**2])
    assert mixed.range_m[0] == pytest.approx(weights @ [2, 2.5] / weights.sum(), abs=0.01)
    assert mixed.thing[0] == 0  # the nearer sends more of the light
    parted = echoes(target, shots((0, 0, 0), [[1, 0, 0]]), BeamOptions(pulse_m=0.3, **options))
    assert parted.range_m[0] == pytest.approx(2.0, abs=1e-3)
    assert parted.shine[0] == pytest.approx(0.25, abs=0.01)  # half of the beam on a surface of 0.5
    black = target_of(scene(near, far, reflectance=[0.05, 0.9]))
    strongest = echoes(black, shots((0, 0, 0), [[1, 0, 0]]), BeamOptions(pulse_m=0.3, **options))
    assert strongest.range_m[0] == pytest.approx(2.5, abs=1e-3)
    assert strongest.thing[0] == 1


def test_reach_is_inclusive_and_misses_are_kept():
    target = target_of(scene(block((3, -2, -2), (4, 2, 2))))
    for low, high, seen in ((3.0, 9.0, True), (3.0001, 9.0, False), (0.0, 3.0, True), (0.0, 2.9999, False)):
        scan = shoot(target, shots((0, 0, 0), [[1, 0, 0], [-1, 0, 0]]), BeamOptions(min_range_m=low, max_range_m=high), np.random.default_rng(0))
        assert len(scan.cloud) == int(seen)
        assert len(scan.rays) == 2
        assert np.isnan(scan.rays.range_m[1])


def test_false_returns_belong_to_no_object():
    target = target_of(scene(block((3, -2, -2), (4, 2, 2))))
    many = shots((0, 0, 0), np.tile([1.0, 0, 0], (2000, 1)))
    scan = shoot(target, many, BeamOptions(outlier_share=0.5, outlier_m=0.1), np.random.default_rng(0))
    np.testing.assert_array_equal(scan.cloud.label == -1, scan.cloud.points[:, 0] != 3.0)
    assert 850 < (scan.cloud.label == -1).sum() < 1150


def test_hits_equal_brute_force_and_incidence_is_that_of_the_face():
    room = clutter()
    target = target_of(room)
    rng = np.random.default_rng(3)
    origin, direction = np.tile([0.0, 0.1, 1.3], (3000, 1)), rng.standard_normal((3000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    got = hits(target, origin, direction)
    expected = nearest_by_brute_force(target.mesh, origin, direction)
    np.testing.assert_allclose(np.nan_to_num(got.range_m, nan=np.inf), expected, rtol=1e-9)
    assert (got.thing[np.isfinite(expected)] >= 0).all()
    floor = got.thing == 0
    np.testing.assert_allclose(got.cosine[floor], np.abs(direction[floor, 2]), rtol=1e-12)


def test_visibility_knows_occluders_and_the_two_sides_of_a_thin_plate():
    target = target_of(scene(block((2, -1, -1), (2.01, 1, 1)), block((1, -0.1, -0.1), (1.1, 0.1, 0.1))))
    front, back, lit = np.array([2.0, 0.5, 0.5]), np.array([2.01, 0.5, 0.5]), np.array([1.0, 0, 0])
    behind = np.array([2.0, 0, 0])
    eyes = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [4, 0, 0], [4, 0, 0]])
    seen = is_visible(target, eyes, np.array([front, back, behind, back, front]), np.array([lit, -lit, lit, -lit, lit]))
    assert seen.tolist() == [True, False, False, True, False]
