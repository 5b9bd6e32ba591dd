import numpy as np
import pytest

from predicates import box, extruded, l_beam
from scan2fea.kernel.coverage import area_shares, deviation, face_origin, largest_left_out
from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import face_areas
from scan2fea.types import INTERPOLATED, INVENTED, MEASURED

BOX = box(pitch=0.1)
MIDDLE = BOX.vertices[BOX.faces].mean(1)


def scanned(mesh, n=20_000, keep=None, sigma=0.0, seed=0):
    points, _ = sample_surface(mesh, n, seed)
    points = points if keep is None else points[keep(points)]
    return points + np.random.default_rng(seed).normal(0, sigma, points.shape)


def test_seen_all_round_is_measured():
    points = scanned(BOX)
    assert (face_origin(BOX, points, None, 0.018, 0.0) == MEASURED).all()
    assert deviation(BOX, points, 0.018, 0.0).measured_area_fraction == pytest.approx(1, abs=0.01)


def test_an_unseen_side_is_invented_away_from_its_rim():
    points = scanned(BOX, keep=lambda p: p[:, 2] < 0.999)
    origin = face_origin(BOX, points, None, 0.018, 0.0)
    top = MIDDLE[:, 2] > 0.999
    inner = top & (np.abs(MIDDLE[:, :2] - 0.5).max(1) < 0.3)
    assert (origin[inner] == INVENTED).all() and (origin[~top] == MEASURED).all()
    assert deviation(BOX, points, 0.018, 0.0).measured_area_fraction == pytest.approx(5 / 6, abs=0.02)
    shares = area_shares(BOX, origin)
    assert sum(shares.values()) == pytest.approx(1) and shares["invented"] > 0.1


def test_a_hole_smaller_than_five_spacings_is_interpolated():
    h = 0.02
    points = scanned(BOX, keep=lambda p: np.linalg.norm(p - [0.5, 0.5, 1], axis=1) > 4 * h)
    near = np.linalg.norm(MIDDLE - [0.5, 0.5, 1], axis=1) < 1.5 * h + 0.04
    origin = face_origin(BOX, points, None, h, 0.0)
    assert (origin[near] == INTERPOLATED).any() and not (origin == INVENTED).any()


def test_the_far_side_of_a_thin_wall_is_no_measurement():
    plate = box((1, 1, 0.01), pitch=0.1)
    points = scanned(plate, keep=lambda p: p[:, 2] > 0.0099)
    origin = face_origin(plate, points, None, 0.02, 0.0)
    below = plate.vertices[plate.faces].mean(1)[:, 2] < 1e-6
    assert (origin[below] != MEASURED).mean() > 0.95


def test_inferred_points_do_not_count():
    points = scanned(BOX)
    is_inferred = points[:, 2] > 0.999
    assert deviation(BOX, points, 0.018, 0.0, is_inferred).measured_area_fraction == pytest.approx(5 / 6, abs=0.02)


@pytest.mark.parametrize("sigma", [0.001, 0.004])
def test_deviation_gives_the_noise_back(sigma):
    mesh = l_beam(a=1, b=1, t=0.2, length=1, pitch=0.1)
    points, _ = sample_surface(mesh, 30_000, 1)
    points = points + np.random.default_rng(1).normal(0, sigma, points.shape)
    found = deviation(mesh, points, 0.015, sigma)
    assert found.rms_m == pytest.approx(sigma, rel=0.05)
    assert found.p95_m == pytest.approx(1.96 * sigma, rel=0.05)
    assert abs(found.mean_m) < 0.05 * sigma
    assert np.nanstd(found.per_vertex_m) < sigma


def test_strays_are_the_farthest_points():
    points = scanned(BOX, sigma=0.001)
    strays = np.random.default_rng(4).uniform(1.2, 2.0, (2_000, 3))
    found = deviation(BOX, np.concatenate([points, strays]), 0.018, 0.001, strays=2_000 / 22_000)
    assert found.own_p95_m == pytest.approx(deviation(BOX, points, 0.018, 0.001).p95_m, rel=0.02)
    assert found.p95_m > 0.2  # all points: what is told does not hide them


def test_signed_mean_shows_a_shift_and_vertices_without_points_are_nan():
    points = scanned(BOX, keep=lambda p: p[:, 2] < 0.5)
    grown = 0.5 + (points - 0.5) * 1.02
    found = deviation(BOX, grown, 0.02, 0.0)
    assert found.mean_m > 0.005
    assert np.isnan(found.per_vertex_m[BOX.vertices[:, 2] > 0.7]).all()


def test_areas_add_up():
    origin = np.arange(len(BOX.faces)) % 3
    shares = area_shares(BOX, origin)
    assert shares["measured"] == pytest.approx(face_areas(BOX)[origin == MEASURED].sum() / 6)


def test_the_most_points_side_by_side_that_were_left_out_are_told_and_strays_are_not():
    step = np.array([(0, 0), (1, 0), (1, 0.5), (0.6, 0.5), (0.6, 0.7), (0, 0.7)])
    whole, plain = extruded(step, 1.0), box((1.0, 0.5, 1.0))
    up = np.array([[x, 0.7, z] for x in (0.1, 0.2, 0.3) for z in (0.3, 0.4)])
    points = np.concatenate([[[0.5, 0.5, 0.9]], up, [[0.3, 1.5, 0.5]], up[:2] + [0.0, 0.0, 0.4]])  # on both, the step, a stray, two more of the step
    off = PointToMesh(plain).nearest(points).distance
    assert largest_left_out(points, off, whole, 0.1, 0.15).tolist() == [1, 2, 3, 4, 5, 6]
    assert largest_left_out(points, off, whole, 0.1, 0.35).tolist() == [1, 2, 3, 4, 5, 6, 8, 9]
    assert not len(largest_left_out(points, off, whole, 0.25, 0.15))  # the step is 0.2 high
