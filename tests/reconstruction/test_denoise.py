import numpy as np
import pytest

from predicates import l_beam, rotation, sphere
from scan2fea.kernel.noise import spacing
from scan2fea.reconstruction.denoise import denoise, first_normals
from scan2fea.reconstruction.sensors import outer_side
from scanned import scanned


@pytest.fixture(scope="module")
def beam():
    t = 0.00635
    scan, places, normals = scanned(l_beam(length=0.3), 0.004, 0.15 * t, seed=1)
    points = scan.cloud.points
    return points, outer_side(points, scan.sensors(), None), places, normals, spacing(points), 0.15 * t


def test_normals_keep_to_their_side(beam):
    points, toward, _, normals, h, sigma = beam
    found, noise = first_normals(points, toward, h)
    assert np.einsum("ij,ij->i", found, normals).mean() > 0.93
    assert (np.einsum("ij,ij->i", found, normals) < 0).mean() < 0.01
    assert noise == pytest.approx(sigma, rel=0.1)


def test_noise_goes_and_the_thickness_stays(beam):
    points, toward, places, normals, h, sigma = beam
    found, noise = first_normals(points, toward, h)
    clean = denoise(points, found, h, noise)
    flat = np.einsum("ij,ij->i", clean.normals, normals) > 0.95
    before, after = (np.einsum("ij,ij->i", x - places, normals)[flat] for x in (points, clean.points))
    assert after.std() < 0.6 * before.std()
    assert abs(after.mean()) < 0.1 * sigma  # neither thinner nor thicker
    assert clean.residual_m < sigma


def test_a_sphere_does_not_shrink():
    scan, places, _ = scanned(sphere(1.0, rounds=5), 0.06, 0.01, seed=2)
    toward = outer_side(scan.cloud.points, scan.sensors(), None)
    h = spacing(scan.cloud.points)
    found, noise = first_normals(scan.cloud.points, toward, h)
    clean = denoise(scan.cloud.points, found, h, noise)
    assert np.linalg.norm(clean.points, axis=1).mean() == pytest.approx(np.linalg.norm(places, axis=1).mean(), abs=1e-3)


def test_exact_points_do_not_move(beam):
    _, _, places, normals, h, _ = beam
    clean = denoise(places, normals, h, 0.0)
    assert (clean.points == places).all()


def test_motion_scale_and_order_change_nothing(beam):
    points, toward, _, _, h, _ = beam
    found, noise = first_normals(points, toward, h)
    turn, scale, order = rotation(5), 25.0, np.random.default_rng(0).permutation(len(points))
    other, other_noise = first_normals((points @ turn.T * scale + 3.0)[order], (toward @ turn.T)[order], h * scale)
    assert other_noise == pytest.approx(noise * scale, rel=0.02)  # a draw of other points
    same = np.einsum("ij,ij->i", other @ turn, found[order])
    assert (same > 0.99).mean() > 0.97
