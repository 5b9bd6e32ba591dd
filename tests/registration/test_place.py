import numpy as np
import pytest

from scan2fea.errors import EmptyScanError
from scan2fea.kernel.transforms import applied, inverse, random_rotation, rigid
from scan2fea.registration import RegistrationOptions, place
from scan2fea.types import PointCloud, Rays, Scan

T = rigid(random_rotation(1), [3.0, -1.0, 2.0])
WITH_POSES = RegistrationOptions(poses="poses.txt")


def sheet(n=2000, seed=0):
    return np.c_[np.random.default_rng(seed).random((n, 2)), np.zeros(n)]


def scan_of(points, sensor=(0.5, 0.5, 3.0), **columns):
    away = points - sensor
    distance = np.linalg.norm(away, axis=1)
    rays = Rays(origin=np.tile(sensor, (len(points), 1)), direction=away / distance[:, None], range_m=distance)
    return Scan(cloud=PointCloud.of(points, ray=np.arange(len(points)), **columns), rays=rays)


def test_rays_move_with_their_points():
    scan = scan_of(sheet(), normals=np.tile([0, 0, 1.0], (2000, 1)))
    placed = place([scan, scan], [T, np.eye(4)], ["a", "b"], WITH_POSES).scan
    assert len(placed.cloud) == len(placed.rays) == 4000
    assert placed.cloud.frame.tolist() == [0] * 2000 + [1] * 2000
    ray = placed.cloud.ray
    np.testing.assert_allclose(placed.rays.origin[ray] + placed.rays.range_m[ray, None] * placed.rays.direction[ray], placed.cloud.points, atol=1e-12)
    np.testing.assert_allclose(placed.sensors()[:2000], np.tile(applied(T, np.array([[0.5, 0.5, 3.0]])), (2000, 1)))
    np.testing.assert_allclose(placed.cloud.normals[0], T[:3, 2])
    np.testing.assert_array_equal(placed.cloud.points[2000:], scan.cloud.points)  # an identity changes no byte
    np.testing.assert_array_equal(placed.cloud.raw_index, np.tile(np.arange(2000), 2))


def test_agreement_tells_right_poses_from_wrong_ones():
    a, b = scan_of(sheet(seed=1)), scan_of(applied(inverse(T), sheet(seed=2)))
    good = place([a, b], [np.eye(4), T], ["a", "b"], WITH_POSES)
    assert good.agreement_m.max() < 0.02
    assert good.notes == ()
    tilted = T.copy()
    tilted[2, 3] += 0.15
    bad = place([a, b], [np.eye(4), tilted], ["a", "b"], WITH_POSES)
    assert bad.agreement_m.min() > 0.1
    assert "check its pose" in bad.notes[0]


def test_without_poses_inputs_stay_and_with_poses_the_unnamed_are_left_out():
    a, b = scan_of(sheet(seed=1)), scan_of(sheet(seed=2) + np.array([5, 0, 0]))
    stay = place([a, b], [None, None], ["a", "b"])
    assert stay.trajectory.placed.all()
    assert stay.trajectory.T_world_frame.tolist() == [np.eye(4).tolist()] * 2
    assert np.isnan(stay.agreement_m).all()  # no overlap
    left = place([a, b], [None, T], ["a", "b"], WITH_POSES)
    assert left.trajectory.placed.tolist() == [False, True]
    assert np.isnan(left.trajectory.T_world_frame[0]).all()
    assert left.scan.cloud.frame.tolist() == [1] * 2000
    assert len(left.notes) == 1
    says = "a: left out, poses.txt gives no pose for it, and the shared surface leaves 3 of 6 motions open"
    assert left.notes[0].startswith(says)


def test_columns_that_some_inputs_lack():
    a = Scan(cloud=PointCloud.of(sheet(10), label=np.arange(10), colour=np.zeros((10, 3), np.uint8)))
    b = scan_of(sheet(5), intensity=np.ones(5))
    cloud = place([a, b], [None, None], ["a", "b"]).scan.cloud
    assert cloud.label.tolist() == [*range(10), *[-1] * 5]
    assert np.isnan(cloud.intensity[:10]).all()
    assert cloud.colour is None
    assert cloud.ray.tolist() == [-1] * 10 + [0, 1, 2, 3, 4]


def test_nothing_left_is_an_error():
    with pytest.raises(EmptyScanError, match="no input is left"):
        place([scan_of(sheet())], [None], ["a"], WITH_POSES)
