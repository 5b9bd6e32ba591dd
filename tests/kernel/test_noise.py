import numpy as np
import pytest

from scan2fea.kernel.noise import noise_sigma, noise_there, spacing
from scan2fea.kernel.transforms import random_rotation

N = 8000


def sheet(sigma, seed=0):
    rng = np.random.default_rng(seed)
    return np.c_[rng.random((N, 2)), sigma * rng.standard_normal(N)]


def sphere(sigma):
    rng = np.random.default_rng(1)
    p = rng.standard_normal((N, 3))
    return p / np.linalg.norm(p, axis=1, keepdims=True) * (1 + sigma * rng.standard_normal((N, 1)))


def test_spacing_of_a_grid_and_of_a_random_sheet():
    grid = np.c_[np.stack(np.meshgrid(np.arange(30.0), np.arange(30.0)), -1).reshape(-1, 2), np.zeros(900)]
    assert spacing(grid) == pytest.approx((4 + 2 * 2**0.5) / 6)
    assert spacing(sheet(0.0)) == pytest.approx(0.978 / N**0.5, rel=0.03)  # mean of Gamma(k + 1/2) / (Gamma(k) sqrt(pi)), k = 1..6
    assert spacing(np.zeros((5, 3))) == 0
    assert np.isnan(spacing(np.zeros((1, 3))))


@pytest.mark.parametrize("sigma", [0.0005, 0.002, 0.006])
@pytest.mark.parametrize("make", [sheet, sphere])
def test_sigma_of_sheets_and_spheres(make, sigma):
    assert noise_sigma(make(sigma)) == pytest.approx(sigma, rel=0.15)


def test_the_noise_of_a_place_is_its_own():
    points = sheet(0.001)
    points[:, 2] *= np.where(points[:, 0] > np.median(points[:, 0]), 3.0, 1.0)
    rows = np.flatnonzero(np.abs(points[:, 0] - np.median(points[:, 0])) > 0.3 * np.ptp(points[:, 0]))
    found = noise_there(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), rows)
    high = points[rows, 0] > np.median(points[:, 0])
    assert np.sqrt(found[high].mean()) == pytest.approx(0.003, rel=0.1) and np.sqrt(found[~high].mean()) == pytest.approx(0.001, rel=0.1)


def test_sigma_is_zero_without_noise_and_curvature_is_no_noise():
    assert noise_sigma(sheet(0.0)) < 1e-12
    assert noise_sigma(sphere(0.0)) < 1e-5


def test_a_thin_wall_is_no_noise():
    wall = np.concatenate([sheet(0.001, 1), sheet(0.001, 2) + np.array([0, 0, 0.012])])
    assert noise_sigma(wall) == pytest.approx(0.001, rel=0.25)
    normals = np.repeat([[0, 0, -1.0], [0, 0, 1.0]], N, axis=0)
    closer = np.concatenate([sheet(0.001, 1), sheet(0.001, 2) + np.array([0, 0, 0.003])])
    assert noise_sigma(closer, normals) == pytest.approx(0.001, rel=0.15)


def test_sigma_follows_scale_and_ignores_motion_and_order():
    points = sheet(0.002)
    moved = (points @ random_rotation(3).T)[np.random.default_rng(0).permutation(N)] + 7.0
    assert noise_sigma(moved) == pytest.approx(noise_sigma(points), rel=0.05)
    assert noise_sigma(points * 1000) == pytest.approx(1000 * noise_sigma(points), rel=1e-6)


def test_too_few_points_tell_nothing():
    assert np.isnan(noise_sigma(np.zeros((10, 3))))
    assert np.isnan(noise_sigma(np.random.default_rng(0).random((1000, 3))))  # a full block has no surface


def test_patches_without_noise_are_told_beside_edges_that_bend_the_others():
    """A small cube, normals blended at its edges: a fifth of the patches are of one face alone, and those are flat to the last digits."""
    rng = np.random.default_rng(0)
    places = rng.uniform(-0.01, 0.01, (6, 100, 3))
    for k in range(6):
        places[k, :, k // 2] = 0.01 * (-1) ** k
    points = places.reshape(-1, 3)
    normals = points / np.linalg.norm(points, axis=1)[:, None]
    everywhere = np.ones(len(points), bool)
    blind = noise_sigma(points, normals)
    assert blind > 1e-4
    assert noise_sigma(points, normals, is_measured=everywhere) < 1e-12
    assert noise_sigma(points, normals, is_measured=~everywhere) == blind  # points put on a plane say nothing of noise
    noisy = points + 2e-5 * rng.standard_normal(points.shape)
    assert noise_sigma(noisy, normals, is_measured=everywhere) == noise_sigma(noisy, normals)
