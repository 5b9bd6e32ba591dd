import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2fea.registration.uncertainty import with_pose_noise
from scan2fea.types import PointCloud

RNG = np.random.default_rng(0)


def test_the_deviation_of_points_is_that_of_many_draws_of_the_pose():
    points = RNG.uniform(-3, 3, (40, 3)) + [10.0, 0, 0]
    own = PointCloud.of(points, sigma_along_m=np.full(40, 0.002), sigma_across_m=np.full(40, 0.001))
    told = with_pose_noise(own, 0.006, 0.003)
    centre = points.mean(axis=0)
    draws = np.stack([
        Rotation.from_rotvec(0.003 / np.sqrt(3) * RNG.standard_normal(3)).apply(points - centre) + 0.006 / np.sqrt(3) * RNG.standard_normal(3)
        for _ in range(4000)
    ])  # fmt: skip
    variance = draws.var(axis=0).mean(axis=1)  # of one axis, on average
    np.testing.assert_allclose(told.sigma_along_m, np.sqrt(0.002**2 + variance), rtol=0.03)
    np.testing.assert_allclose(told.sigma_across_m, np.sqrt(0.001**2 + variance), rtol=0.03)
    assert own.sigma_along_m[0] == 0.002


def test_noise_that_is_not_stated_is_told_from_the_points_and_a_sure_pose_changes_nothing():
    sheet = np.c_[RNG.random((20_000, 2)), 0.002 * RNG.standard_normal(20_000)]
    cloud = PointCloud.of(sheet)
    told = with_pose_noise(cloud, 0.003, 0.0)
    assert np.median(told.sigma_along_m) == pytest.approx(np.hypot(0.002, 0.003 / np.sqrt(3)), rel=0.1)
    assert told.sigma_across_m == pytest.approx(0.003 / np.sqrt(3))
    for std in ((np.nan, np.nan), (0.0, 0.0)):
        assert with_pose_noise(cloud, *std) is cloud
