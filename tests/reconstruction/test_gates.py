import dataclasses

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, box, extruded, l_beam, sphere
from scan2fea.kernel.distances import distance_to_mesh, sample_surface
from scan2fea.kernel.measures import area, face_normals, volume
from scan2fea.reconstruction import visibility
from scan2fea.reconstruction.evidence import Evidence, at_least, at_most, scatter_m, wall_m
from scan2fea.reconstruction.flat_gaps import hidden_volume_flat
from scan2fea.reconstruction.gates import failed, gates_seen
from scan2fea.reconstruction.gates_outside import CUT_AGREES
from scan2fea.reconstruction.gates_surface import (
    RIM_LOSS,
    SCANS_OPEN,
    SHEET,
    coverage,
    left_out,
    mean_curvature,
    merged,
    mixed,
    patch_moments,
    resolution,
    rims,
    scans,
    sheet,
)
from scan2fea.reconstruction.hidden_volume import REACH, REACH_UNSEEN, hidden_volume
from scan2fea.types import PointCloud, Scan
from scanned import DENSITY

T = 0.006


def sampled(mesh, spacing, seed=0):
    points, face = sample_surface(mesh, int(DENSITY * area(mesh) / spacing**2), seed)
    return points, face_normals(mesh)[face]


def evidence_of(mesh, points, normals, **fields):
    n = len(points)
    base = {"thickness_m": np.full(n, T), "gap_m": np.full(n, np.nan), "spacing_m": 0.004, "sigma_m": 0.0}
    return Evidence(points=points, mesh=mesh, smoothed=points, normals=normals, **{**base, **fields})


def unseen(points):
    return visibility(Scan(cloud=PointCloud.of(points)))


def names(found):
    return {check.name for check in failed(found.checks)}


@pytest.fixture(scope="module")
def plate():
    mesh = box((0.2, 0.15, T))
    return mesh, *sampled(mesh, 0.004)


def test_limits_are_inclusive():
    assert at_most("x", 0.35, 0.35, "").passed and not at_most("x", np.nextafter(0.35, 1), 0.35, "").passed
    assert at_least("x", 0.9, 0.9, "").passed and not at_least("x", np.nextafter(0.9, 0), 0.9, "").passed
    assert not at_most("x", float("nan"), 1.0, "").passed and not at_least("x", float("nan"), 0.0, "").passed


@pytest.mark.parametrize("limit", [0.35, 0.2])
@pytest.mark.parametrize(("more", "spacing", "bad"), [(0.0, 1.1, []), (1e-4, 1.1, ["noise against wall"]), (0.0, 1.101, ["spacing against wall"])])
def test_noise_and_spacing_on_the_limit(plate, limit, more, spacing, bad):
    mesh, points, normals = plate
    wall = 2.0**-7
    sensors = points + normals if limit == 0.35 else None
    thickness = np.full(len(points), wall)
    case = evidence_of(mesh, points, normals, thickness_m=thickness, sigma_m=(limit + more) * wall, spacing_m=spacing * wall, sensors=sensors)
    found = failed(resolution(case))
    assert [check.name for check in found] == bad
    assert all(("sensor position" in check.says) == (limit == 0.2) for check in found if check.name.startswith("noise"))
    for check in found:
        assert "limit" in check.says and "fit the member" in check.says and "7.81 mm" in check.says


def test_wall_is_known_from_a_tenth_of_the_points(plate):
    mesh, points, normals = plate
    points, normals = points[:1000], normals[:1000]
    for known, expected in ((100, T), (99, np.nan)):
        thickness = np.where(np.arange(1000) < known, T, np.nan)
        case = evidence_of(mesh, points, normals, thickness_m=thickness, sigma_m=1.0)
        assert wall_m(case) == pytest.approx(expected, nan_ok=True)
        assert len(resolution(case)) == (2 if known == 100 else 0)


def test_unmeasured_area_of_a_plate_seen_from_above(plate):
    mesh, points, normals = plate
    top = normals[:, 2] > 0.5
    share = lambda rows, inferred=None: coverage(evidence_of(mesh, points[rows], normals[rows], is_inferred=inferred), 0.1, 0.0)  # noqa: E731
    (all_round,) = share(np.ones(len(points), bool))
    assert all_round.value == 0.0 and all_round.passed
    (above,) = share(top)
    assert above.value == pytest.approx(0.46, abs=0.05) and not above.passed
    assert "a side was not seen" in above.says
    backed, inferred = share(np.ones(len(points), bool), ~top)
    assert backed.passed and inferred.passed and inferred.value == pytest.approx(above.value, abs=0.01)


def test_a_noise_guessed_high_excuses_nothing(plate):
    mesh, points, normals = plate
    distance = np.abs(np.random.default_rng(0).normal(size=5000))
    case = evidence_of(mesh, points, normals, sigma_m=10.0)
    assert scatter_m(case, distance) == pytest.approx(1.2, rel=0.05)
    assert scatter_m(dataclasses.replace(case, sigma_m=1.0), distance) == 1.0
    assert scatter_m(case, np.zeros(0)) == 0.0


def test_mean_curvature_closed_forms():
    assert mean_curvature(box((0.3, 0.2, 0.1))) == pytest.approx(0.5 * (np.pi / 2) * 4 * 0.6, rel=1e-9)
    assert mean_curvature(sphere(2.0, rounds=5)) == pytest.approx(4 * np.pi * 2.0, rel=0.01)
    corner = extruded(np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], float), 1.0)  # one concave edge of length 1
    assert mean_curvature(corner) == pytest.approx(0.5 * (np.pi / 2) * (2 * 8 + 5 - 1), rel=1e-9)


def test_rims_foretell_both_ways():
    mesh = box((0.02, 0.02, 0.003))
    points, normals = sampled(mesh, 0.0015)
    case = evidence_of(mesh, points, normals, thickness_m=np.full(len(points), 0.003), spacing_m=0.0015, sigma_m=0.001)
    cut, grown = rims(case)
    assert cut.value == pytest.approx(RIM_LOSS * 0.0015**2 * mean_curvature(mesh) / volume(mesh)) and not cut.passed
    assert grown.value == pytest.approx(2 / np.pi * mean_curvature(mesh) * 0.003 * 0.001 / volume(mesh)) and not grown.passed


def test_places_of_scans_leave_volume_open_however_many_points_there_are():
    mesh = box((0.2, 0.15, T))
    points, normals = sampled(mesh, 0.004)
    sides = (normals.sum(axis=1) > 0).astype(np.int64)  # two scans, half of the area each
    between = SCANS_OPEN * volume(mesh) * np.sqrt(2) / area(mesh)
    (check,) = scans(evidence_of(mesh, points, normals, frame=sides, between_m=between))
    assert check.value == pytest.approx(SCANS_OPEN, rel=0.02)
    (more,) = scans(evidence_of(mesh, points, normals, frame=sides, between_m=1.05 * between))
    assert not more.passed and "mm off each other" in more.says
    many = np.arange(len(points)) % 50  # fifty that share every face
    (shared,) = scans(evidence_of(mesh, points, normals, frame=many, between_m=between))
    assert shared.value == pytest.approx(SCANS_OPEN / 5, rel=0.1)
    assert scans(evidence_of(mesh, points, normals, frame=sides)) == scans(evidence_of(mesh, points, normals, between_m=between)) == ()


def test_two_sheets_in_one_are_noticed(plate):
    _, points, normals = plate
    rng = np.random.default_rng(0)
    one, two = rng.normal(size=len(points)) * 1e-3, rng.choice([-1.0, 1.0], len(points)) * 1e-3
    assert merged(*patch_moments(points, normals, one), 1e-5).passed
    assert not merged(*patch_moments(points, normals, two), 1e-5).passed
    assert merged(*patch_moments(points, normals, 1e-6 * two), 1e-5).passed  # too little to say


def test_seen_checks_pass_on_the_truth(plate):
    mesh, points, normals = plate
    assert not failed(gates_seen(evidence_of(mesh, points, normals), CUT_AGREES))
    (lost,) = failed(gates_seen(evidence_of(mesh, points, normals), np.nextafter(CUT_AGREES, 0)))  # the cut emptied walls that were seen
    assert lost.name == "cut agrees with normals"


def test_noise_past_the_middle_of_a_wall(plate):
    """Points of both faces, each told by the side of the middle it lies on, keep this much less between their means; at a tenth nothing."""
    mesh, points, normals = plate
    rng = np.random.default_rng(0)
    for noise in (0.1, 0.2, 0.3):
        (found,) = mixed(evidence_of(mesh, points, normals, sigma_m=noise * T))
        depth = noise * rng.normal(size=400_000)  # of one face, inward, in thicknesses
        lost = 2 * np.mean(depth * (depth > 0.5))
        assert found.value == pytest.approx(lost, abs=0.002) and found.passed == (found.value <= 0.05)
    assert mixed(evidence_of(mesh, points, normals, sigma_m=0.1 * T))[0].value < 1e-6
    assert mixed(evidence_of(mesh, points, normals, thickness_m=np.full(len(points), np.nan), sigma_m=T)) == ()


def test_a_gap_counts_where_no_sight_line_tells_it_from_a_hole():
    ball = sphere(1.0, rounds=5)
    points, _ = sampled(ball, 0.06)
    assert hidden_volume(ball, distance_to_mesh(points, ball), 0.06, REACH_UNSEEN).value < 1e-4  # random points leave that little bare
    gap = points[np.linalg.norm(points - [0.0, 0.0, 1.0], axis=1) > 2.9 * 0.06]
    assert hidden_volume(ball, distance_to_mesh(gap, ball), 0.06, REACH).value == 0.0
    bare = (2.9 - REACH_UNSEEN) * 0.06  # radius of what is bare, if points stood on the very border of the gap; they stand half a spacing off
    least, most = (0.5 * np.pi * radius**3 / volume(ball) for radius in (bare, bare + 0.03))
    assert least < hidden_volume(ball, distance_to_mesh(gap, ball), 0.06, REACH_UNSEEN).value < most


def test_a_gap_with_places_that_were_not_measured_counts_up_to_the_points_round_it():
    """A pocket nine spacings wide along a lipped Z was filled, taken for three wide, and passed at 1.07."""
    ball = sphere(1.0, rounds=5)
    points, _ = sampled(ball, 0.06)
    gap = points[np.linalg.norm(points - [0.0, 0.0, 1.0], axis=1) > 4.5 * 0.06]
    near, bare = distance_to_mesh(gap, ball), (4.5 - REACH_UNSEEN) * 0.06
    least, most = (0.5 * np.pi * radius**3 / volume(ball) for radius in (bare, bare + 0.03))
    assert least < hidden_volume(ball, near, 0.06).value < most
    assert 0.0 < hidden_volume(ball, near, 0.06, border=REACH).value < 0.5 * least


def test_a_gap_inside_one_face_of_a_flat_solid_counts():
    """Twelve triangles have no middle near it: a boss that nobody saw was lost."""
    slab, h = dataclasses.replace(box((1.0, 0.8, 0.3)), face_region=np.arange(12) // 2), 0.02
    points, normals = sampled(slab, h)
    assert hidden_volume_flat(slab, points, h).value == 0.0
    under = (normals[:, 2] > 0.5) & (np.abs(points[:, :2] - [0.25, 0.3]).max(axis=1) < 0.15)
    assert hidden_volume(slab, distance_to_mesh(points[~under], slab), h).value == 0.0
    least, most = ((side**2) ** 2 / (4 * side) / volume(slab) for side in (0.3 - 2 * REACH * h, 0.3))
    assert 0.8 * least < hidden_volume_flat(slab, points[~under], h).value < most
    small = np.linalg.norm(points - [0.25, 0.3, 0.3], axis=1) < 2.5 * h  # what REACH does not tell from chance
    assert hidden_volume_flat(slab, points[~small], h).value == 0.0
    corner = np.abs(points - [0.0, 0.0, 0.3]).max(axis=1) < 0.15  # three bare squares, which end only where they meet no other
    side = 0.15 - REACH * h
    assert hidden_volume_flat(slab, points[~corner], h).value > 0.8 * 3 * side**4 / (2 * side) / volume(slab)


@pytest.mark.parametrize("sigma", [0.0, 0.15])
def test_a_whole_scan_passes(sigma):
    mesh = l_beam(0.08, 0.06, T, 0.15)
    points, _ = sampled(mesh, 0.003)
    found = unseen(points + sigma * T * np.random.default_rng(2).normal(size=points.shape))  # of 24 draws 20 pass: an end may stay bare by chance
    assert not failed(found.checks), failed(found.checks)
    assert_closed_manifold_oriented(found.mesh)
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=0.04)


def test_half_a_ball_is_refused():
    points, _ = sampled(sphere(1.0, rounds=5), 0.06)
    found = unseen(points[points[:, 2] > 0])
    assert {"open on both sides", "winding agrees with surface"} <= names(found)
    assert "the other face of what they lie on was not scanned, around (" in failed(found.checks)[0].says


def test_a_plane_is_refused():
    rng = np.random.default_rng(0)
    found = unseen(np.column_stack([rng.random((3000, 2)), 0.002 * rng.normal(size=3000)]))
    assert "open on both sides" in names(found)


def test_an_open_sheet_is_told_and_a_wall_is_not():
    """2 V / A of a plate of thickness t is t (1 - t) for a square of 1 beside it, nearly: on both sides of a tenth of the spacing."""
    for thickness, told in ((0.0039, True), (0.0042, False)):
        mesh = box((1.0, 1.0, thickness))
        checks = sheet(evidence_of(mesh, *sampled(mesh, 0.04), spacing_m=0.04))
        assert [check.name for check in checks] == [SHEET] * told
        assert all("one open sheet" in check.says and "other side was not seen" in check.says for check in checks)


def test_five_sides_of_a_box_are_refused():
    points, normals = sampled(box((1.0, 0.8, 0.6)), 0.04)
    assert failed(unseen(points[normals[:, 2] < 0.5]).checks)


def test_a_beam_without_one_face_is_refused():
    points, normals = sampled(l_beam(0.08, 0.06, T, 0.15), 0.004)
    hidden = (normals[:, 1] < -0.5) & (points[:, 1] < 1e-6)
    assert failed(unseen(points[~hidden]).checks)


def test_noise_over_the_wall_is_refused():
    points, _ = sampled(l_beam(0.08, 0.06, T, 0.15), 0.004)
    assert failed(unseen(points + 0.6 * T * np.random.default_rng(1).normal(size=points.shape)).checks)


def test_a_rib_that_flat_faces_leave_out_is_told_however_few_points_it_has():
    """The short leg of an angle; as many points anywhere are strays, and not on the surface that the solid came from."""
    spacing, sigma = 0.004, 0.0004
    whole, solid = extruded(np.array([[0, 0], [0.4, 0], [0.4, 0.01], [0.01, 0.01], [0.01, 0.03], [0, 0.03]]), 0.05), box((0.4, 0.01, 0.05))
    places = sample_surface(whole, int(area(whole) / spacing**2), 1)[0]
    points = places + np.random.default_rng(1).normal(0.0, sigma, places.shape)
    far = 3.0 * sigma + 0.5 * spacing
    check = left_out(points, distance_to_mesh(points, solid).distance, whole, far, spacing)
    on_leg = int(np.sum(points[:, 1] > 0.01 + far))
    assert not check.passed and 0.8 * on_leg <= check.value <= on_leg + 3
    assert left_out(points, distance_to_mesh(points, whole).distance, whole, far, spacing).value == 0.0
    flat = points[points[:, 1] < 0.011]
    strays = np.random.default_rng(2).uniform((0.0, 0.0, 0.0), (0.4, 0.03, 0.05), (100, 3))
    flat = np.concatenate([flat, strays])
    assert left_out(flat, distance_to_mesh(flat, solid).distance, solid, far, spacing).value == 0.0
