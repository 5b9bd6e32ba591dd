import numpy as np
import pytest

from predicates import box, l_beam, sphere
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals
from scan2fea.reconstruction.winding import fitted, plain_areas, polish, sheet_areas
from scanned import DENSITY


def sampled(mesh, spacing, seed=0):
    points, face = sample_surface(mesh, int(DENSITY * area(mesh) / spacing**2), seed)
    return points, face_normals(mesh)[face]


def agreement(found, normals):
    return float(np.mean(np.einsum("ij,ij->i", found, normals) > 0))


@pytest.mark.parametrize("wrong", [0.1, 0.25])
def test_wrong_signs_are_turned(wrong):
    points, normals = sampled(l_beam(length=0.2), 0.004)
    start = normals * np.where(np.random.default_rng(77).random(len(points)) < wrong, -1.0, 1.0)[:, None]
    found = polish(points, start, 0.004)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=1e-12)
    assert agreement(found, normals) > 0.99


def test_points_that_do_not_know_are_told():
    points, normals = sampled(sphere(1.0, rounds=4), 0.1)
    start = np.where(np.arange(len(points))[:, None] % 3 == 0, 0.0, normals)
    assert agreement(polish(points, start, 0.1), normals) == 1.0


def test_all_inside_out_stays_so():
    points, normals = sampled(sphere(1.0, rounds=4), 0.1)
    assert agreement(polish(points, -normals, 0.1), normals) == 0.0  # the gradient cannot know: the flood must be right


def test_areas_add_up():
    mesh = sphere(1.0, rounds=5)
    points, normals = sampled(mesh, 0.05)
    assert plain_areas(points).sum() == pytest.approx(area(mesh), rel=0.1)
    assert sheet_areas(points, normals).sum() == pytest.approx(area(mesh), rel=0.1)


def test_sheets_nearer_than_their_points_do_not_share_area():
    mesh = box((1.0, 1.0, 0.02))
    points, normals = sampled(mesh, 0.03)
    assert sheet_areas(points, normals).sum() == pytest.approx(area(mesh), rel=0.15)
    assert plain_areas(points).sum() < 0.7 * area(mesh)


def test_planes_and_noise():
    points, normals = sampled(box((1.0, 0.8, 0.1)), 0.02)
    noisy = points + 0.006 * np.random.default_rng(3).normal(size=points.shape)
    found, sigma, _ = fitted(noisy, normals, 0.02)
    assert sigma == pytest.approx(0.006, rel=0.15)
    assert np.median(np.einsum("ij,ij->i", found, normals)) > 0.98


def test_fit_ends_where_noise_cannot_be_told():
    points = np.random.default_rng(0).random((400, 3))
    normals, sigma, _ = fitted(points, np.tile([0.0, 0.0, 1.0], (400, 1)), 0.1)
    assert np.isfinite(normals).all() and 0.0 < sigma <= 0.25 * 6.0 * 0.1 * 1.001
