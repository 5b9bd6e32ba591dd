import numpy as np
import pytest
from scipy import stats

from scan2fea.kernel.transforms import rotation_about
from scan2fea.simulation.ultrasonic import UltrasonicOptions, scan_ultrasonic, speed_of_sound
from scan2fea.types import TriangleMesh
from sensed import block, scene

HERE = {"positions_m": ((0.0, 0.0, 0.0),)}
QUIET = {"clock_us": 0.0, **HERE}


def tilted(distance, angle_deg):
    """A wall whose face passes the axis at `distance`, turned about z there."""
    mesh = block((0, -30, -30), (0.5, 30, 30))
    return TriangleMesh(vertices=mesh.vertices @ rotation_about((0, 0, 1), np.radians(angle_deg)).T + [distance, 0, 0], faces=mesh.faces)


def measured(room, **options):
    (scan,) = scan_ultrasonic(room, UltrasonicOptions(**{**QUIET, **options}))
    return scan


def test_speed_of_sound():
    assert speed_of_sound(0.0) == pytest.approx(331.3)
    assert speed_of_sound(20.0) == pytest.approx(343.2, abs=0.1)


@pytest.mark.parametrize("angle", [0.0, 5.0, 10.0, 25.0, 40.0])
def test_nearest_return_of_a_tilted_wall(angle):
    """Within the half opening it is the foot of the perpendicular, d cos(a); beyond, the ray on the rim: d cos(a) / cos(a - half)."""
    d, half = 2.0, 10.0
    scan = measured(scene(tilted(d, angle)), cone_deg=2 * half)
    a = np.radians(angle)
    expected = d * np.cos(a) / np.cos(max(a - np.radians(half), 0.0))
    np.testing.assert_allclose(scan.cloud.points, [[expected, 0, 0]], rtol=2e-6, atol=1e-12)  # put on the axis
    assert scan.rays.footprint_rad[0] == pytest.approx(np.radians(20))
    assert scan.cloud.sigma_across_m[0] == pytest.approx(expected * np.tan(np.radians(10)) / 2)


def test_a_rod_at_the_rim_comes_before_the_wall():
    room = scene(tilted(3.0, 0.0), block((1.5, 0.2, -0.5), (1.51, 0.21, 0.5)))
    scan = measured(room, cone_deg=20.0)
    assert scan.cloud.label.tolist() == [1]
    assert scan.cloud.points[0, 0] == pytest.approx(np.hypot(1.5, 0.2), abs=1e-4)
    assert measured(room, cone_deg=10.0).cloud.label.tolist() == [0]


def test_a_wall_that_throws_the_sound_aside_is_silent_and_not_a_miss():
    scan = measured(scene(tilted(2.0, 40.0)), cone_deg=20.0, max_incidence_deg=25.0)
    assert len(scan.cloud) == 0
    assert scan.rays is None


def test_wrong_temperature_scales_the_range():
    scan = measured(scene(tilted(2.0, 0.0)), air_c=35.0, assumed_c=20.0)
    assert scan.cloud.points[0, 0] == pytest.approx(2.0 * np.sqrt((1 + 20 / 273.15) / (1 + 35 / 273.15)), rel=1e-6)


def test_clock_noise():
    way = {"positions_m": ((0, 0, 0), (0, 1, 0)), "times_s": (0.0, 100.0)}
    (scan,) = scan_ultrasonic(scene(tilted(2.0, 0.0)), UltrasonicOptions(clock_us=10.0, footprint_rays=16, **way), 3)
    sigma = 10e-6 * speed_of_sound(20.0) / 2
    assert len(scan.cloud) == 2001
    assert stats.kstest((scan.cloud.points[:, 0] - 2) / sigma, "norm").pvalue > 0.01
    np.testing.assert_allclose(scan.cloud.sigma_along_m, sigma)
    (two,) = scan_ultrasonic(scene(tilted(2.0, 0.0)), UltrasonicOptions(stands=True, **way))
    assert len(two.cloud) == 2
