import numpy as np
import pytest

from predicates import sphere
from scan2fea.kernel.distances import sample_surface
from scan2fea.reconstruction import reconstruct
from scan2fea.reconstruction.thin import distinct, thinned
from scan2fea.types import PointCloud, Rays, Scan


def sheet(n):
    rng = np.random.default_rng(2)
    points = np.c_[rng.random((n, 2)), np.where(rng.random(n) < 0.5, 0.0, 0.004)]  # two faces of a wall
    rays = Rays(origin=np.tile([0.0, 0, 9], (n, 1)), direction=np.tile([0.0, 0, -1], (n, 1)), range_m=np.full(n, 9.0))
    return Scan(cloud=PointCloud.of(points, ray=np.arange(n)), rays=rays)


def test_on_the_threshold_nothing_is_done():
    scan = sheet(500)
    assert thinned(scan, 500) is scan


def test_of_points_in_one_place_the_first_stays():
    scan = sheet(500)
    assert distinct(scan) is scan
    rows = np.r_[np.arange(500), 17, np.arange(100), 17]
    once = distinct(Scan(cloud=scan.cloud.take(rows), rays=scan.rays))
    assert np.array_equal(once.cloud.points, scan.cloud.points) and len(once.rays) == 500


def test_points_given_three_times_give_the_surface_of_those_given_once():
    points = sample_surface(sphere(1.0), 900, 0)[0]
    once, thrice = (reconstruct(Scan(cloud=PointCloud.of(cloud))) for cloud in (points, np.tile(points, (3, 1))))
    assert np.array_equal(once.mesh.vertices, thrice.mesh.vertices) and np.array_equal(once.mesh.faces, thrice.mesh.faces)


def test_points_are_picked_never_moved_and_spread_evenly():
    scan = sheet(5000)
    small = thinned(scan, 1000)
    assert 600 <= len(small.cloud) <= 1000
    assert set(map(tuple, small.cloud.points)) <= set(map(tuple, scan.cloud.points))
    assert set(np.unique(small.cloud.points[:, 2])) == {0.0, 0.004}
    quarter = (small.cloud.points[:, 0] < 0.5) & (small.cloud.points[:, 1] < 0.5)
    assert abs(quarter.mean() - 0.25) < 0.05
    assert len(small.rays) == len(small.cloud)


def test_same_points_whatever_the_place():
    scan = sheet(3000)
    again = thinned(scan, 700)
    assert np.array_equal(thinned(scan, 700).cloud.points, again.cloud.points)


def test_the_tails_of_a_blurred_face_are_not_preferred():
    rng = np.random.default_rng(4)
    sigma, n = 0.004, 60_000  # points 4 mm apart
    points = np.c_[rng.random((n, 2)), sigma * rng.normal(size=n)]
    points = points[rng.permutation(n)]
    small = thinned(Scan(cloud=PointCloud.of(points)), 20_000).cloud.points
    assert len(small) == 20_000
    assert abs(small[:, 2].std() / points[:, 2].std() - 1.0) < 4.0 / np.sqrt(2 * 20_000)
    counts = np.histogram2d(small[:, 0], small[:, 1], bins=20, range=[[0, 1], [0, 1]])[0]
    assert counts.std() < 0.8 * np.sqrt(counts.mean())  # more even than the cloud itself


def test_a_face_square_to_the_axes_stays_in_its_place_wherever_it_lies():
    """Cells square to it part one that lies at their border along its middle, and take as many points of the few beyond it."""
    rng = np.random.default_rng(4)
    sigma, n, levels = 0.0005, 4000, 12
    level = rng.permutation(np.repeat(np.arange(levels), n))
    points = np.c_[0.25 * rng.random((levels * n, 2)), 0.0131 * level + sigma * rng.normal(size=levels * n)]
    row = thinned(Scan(cloud=PointCloud.of(points)), levels * n // 2).cloud.raw_index
    off = points[row, 2] - 0.0131 * level[row]
    assert all(abs(off[level[row] == k].mean()) < 0.1 * sigma for k in range(levels))


@pytest.mark.parametrize("sigma", [0.0005, 0.0007, 0.001])
def test_faces_of_a_dense_scan_stay_in_their_places(sigma):
    """Of a dozen points a cell one lies in the tail beyond a face, and would stand there for a whole cell: a wall of 6 mm had grown by 9 %."""
    rng = np.random.default_rng(6)
    n, t = 200_000, 0.006
    side = rng.random(n) < 0.5
    points = np.c_[0.3 * rng.random((n, 2)), np.where(side, t, 0.0) + sigma * rng.normal(size=n)]
    row = thinned(Scan(cloud=PointCloud.of(points)), n // 15).cloud.raw_index
    outward = np.where(side[row], points[row, 2] - t, -points[row, 2])
    assert abs(outward.mean()) < 0.05 * sigma
    assert outward.std() == pytest.approx(sigma, rel=0.1)
