import numpy as np
import pytest

from photographed import photographed
from predicates import box, l_beam, rotation, sphere
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.reconstruction.raster import images_of

PLATE = box((1.0, 0.7, 0.08))


@pytest.fixture(scope="module")
def plate():
    mesh, points, places = photographed(PLATE, 6, 0.03, seed=4)
    return mesh, points, places, images_of(points, np.arange(len(points)))


def test_every_point_finds_its_camera(plate):
    _, points, places, images = plate
    hit = images.is_hit
    assert images.n_images == 6
    assert np.array_equal(np.sort(images.point[hit]), np.arange(len(points)))
    assert np.linalg.norm(images.origin[hit] - places[images.point[hit]], axis=1).max() < 2e-3  # of 3 to 5: from single precision alone
    assert images.pitch_rad == pytest.approx(0.0044 * 1.05, rel=1e-3)
    end = images.origin[hit] + images.range_m[hit, None] * images.direction[hit]
    assert np.allclose(end, points[images.point[hit]], atol=1e-9)
    assert (images.point[~hit] == -1).all()


def test_empty_pixels_are_empty(plate):
    mesh, _, _, images = plate
    face = first_hits(scene_of(mesh), images.origin, images.direction)[1]
    empty = ~images.is_hit
    assert empty.sum() > 1000
    assert (face[empty] >= 0).sum() <= 2  # rays that touch an edge
    assert (face[images.is_hit] < 0).sum() <= 2


def test_a_pixel_is_used_once(plate):
    images = plate[3]
    keys = np.column_stack([images.image, images.pixel])
    assert len(np.unique(keys, axis=0)) == len(keys)


def test_turned_moved_scaled_and_run_backwards(plate):
    _, points, places, _ = plate
    turn = rotation(3)
    for change in (lambda p: 1e3 * p @ turn.T + 5e3, lambda p: 1e-3 * p, lambda p: p[::-1]):
        now = change(points)
        images = images_of(now, np.arange(len(now)))
        assert images is not None and images.n_images == 6
        hit = images.is_hit
        size = np.ptp(now, axis=0).max()
        assert np.linalg.norm(images.origin[hit] - change(places)[images.point[hit]], axis=1).max() < 5e-3 * size


def test_an_off_centre_grid():
    """The view axis need not go through a pixel."""
    mesh, points, _ = photographed(sphere(0.5, rounds=4), 3, 0.01, seed=1, aspect=0.8)
    images = images_of(points, np.arange(len(points)))
    assert images is not None and images.n_images == 3
    face = first_hits(scene_of(mesh), images.origin, images.direction)[1]
    assert (face[~images.is_hit] >= 0).sum() <= 2


def test_pixels_beside_removed_points_are_not_empty(plate):
    mesh, points, _, whole = plate
    keep = np.ones(len(points), bool)
    keep[200:700] = False  # as if another stage had taken them
    images = images_of(points[keep], np.flatnonzero(keep))
    face = first_hits(scene_of(mesh), images.origin, images.direction)[1]
    assert (face[~images.is_hit] >= 0).sum() <= 2
    assert (~images.is_hit).sum() < (~whole.is_hit).sum()


def test_what_has_no_images():
    _, points, _ = photographed(PLATE, 3, 0.03, seed=4)
    mixed = np.random.default_rng(0).permutation(points)
    assert images_of(mixed, np.arange(len(mixed))) is None
    assert images_of(points[:100], np.arange(100)) is None
    assert images_of(np.zeros((1000, 3)), np.arange(1000)) is None
    exact = sample_surface(l_beam(length=0.3), 5000, 0)[0]  # every point of a face on one plane, in any order
    assert images_of(exact, np.arange(len(exact))) is None
    face = np.argsort(sample_surface(box((1.0, 1.0, 1.0)), 5000, 0)[1], kind="stable")
    by_face = sample_surface(box((1.0, 1.0, 1.0)), 5000, 0)[0][face]  # whole faces in a row
    assert images_of(by_face, np.arange(len(by_face))) is None
    grid = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0), [0.0, 5.0], indexing="ij"), -1).reshape(-1, 3)
    assert images_of(grid, np.arange(len(grid))) is None


def test_rounded_rows_are_not_trusted():
    """Coordinates written with few digits leave the planes: no answer rather than a wrong one."""
    _, points, _ = photographed(PLATE, 3, 0.03, seed=4)
    assert images_of(np.round(points, 3), np.arange(len(points))) is None
