import numpy as np
import pytest

from predicates import box, l_beam
from scan2fea.kernel.noise import spacing
from scan2fea.reconstruction.denoise import first_normals
from scan2fea.reconstruction.sensors import REJECTED, blocked_share, outer_side
from scanned import scanned


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3])
def test_true_sensors_stand_and_false_ones_fall(noise):
    t = 0.00635
    scan, _, _ = scanned(l_beam(length=0.25), 0.005, noise * t, seed=0)
    points, sensors = scan.cloud.points, scan.sensors()
    h = spacing(points)
    normals, sigma, _ = first_normals(points, outer_side(points, sensors, None), h)
    assert blocked_share(points, normals, sensors, h, sigma) < 0.6 * REJECTED
    if noise < 0.3:  # above, a wall is no thicker than what three sigma explain
        one = np.tile([0.5, -1.0, 0.7], (len(points), 1))  # one station cannot have seen all sides
        assert blocked_share(points, normals, one, h, sigma) > 3 * REJECTED


def test_unknown_sensors_block_nothing():
    assert blocked_share(np.zeros((5, 3)), np.ones((5, 3)), np.full((5, 3), np.nan), 1.0, 0.0) == 0.0


def test_the_side_of_a_point_without_sensor():
    scan, _, normals = scanned(box((1.0, 1.0, 1.0)), 0.08, seed=0)
    points, sensors = scan.cloud.points, scan.sensors().copy()
    lost = np.arange(len(points)) % 5 == 0
    sensors[lost] = np.nan
    given = np.where(np.arange(len(points))[:, None] % 10 == 0, normals, np.nan)
    side = outer_side(points, sensors, given)
    known = np.isfinite(sensors).all(1)
    assert np.einsum("ij,ij->i", side, normals)[known].min() > 0
    assert (side[lost & np.isfinite(given).all(1)] == normals[lost & np.isfinite(given).all(1)]).all()
    assert (np.einsum("ij,ij->i", side, normals)[lost] > 0).mean() > 0.95
