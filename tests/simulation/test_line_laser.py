import numpy as np
import pytest
from scipy import stats

from scan2fea.simulation.line_laser import LineLaserOptions, scan_line_laser
from sensed import block, scene

WALL = block((1, -2, -2), (1.5, 2, 2))
HERE = {"positions_m": ((0.0, 0.0, 0.0),)}


def test_a_profile_lies_in_the_sheet_and_on_the_wall():
    (scan,) = scan_line_laser(scene(WALL), LineLaserOptions(stripe_px=0.0, points_per_profile=101, fan_deg=60.0, **HERE))
    np.testing.assert_allclose(scan.cloud.points[:, 0], 1, atol=1e-12)
    np.testing.assert_allclose(scan.cloud.points[:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(np.sort(scan.cloud.points[:, 1]), np.linspace(-1, 1, 101) * np.tan(np.radians(30)), atol=1e-12)


def test_shadow_beside_a_step():
    """The head looks down on a step of height h, moved across it; the camera is b before it. Behind the step the floor is dark to the camera."""
    h, b, z = 0.05, 0.2, 0.5
    step = scene(block((-1, -1, -0.1), (1, 1, 0)), block((0, -1, 0), (1, 1, h)))
    way = {"positions_m": ((-0.2, 0, z), (0.2, 0, z)), "orientations_deg": ((0, 90, 0), (0, 90, 0)), "times_s": (0.0, 4.0)}
    (scan,) = scan_line_laser(step, LineLaserOptions(baseline_m=b, stripe_px=0.0, profiles_per_s=100.0, points_per_profile=3, **way))
    x = np.unique(np.round(scan.cloud.points[scan.cloud.label == 0, 0], 6))
    # looking down (pitch 90), z of the head points to +x: the camera stands at x + b and looks back over the step's edge at x = 0
    # a floor point at x < 0 is dark where the line to (x + b, z) passes x = 0 below h: -x / b * z < h
    limit = -h * b / z
    assert x.max() <= limit + 1e-9
    assert x.max() == pytest.approx(limit, abs=0.0011)  # one profile
    top = np.unique(np.round(scan.cloud.points[scan.cloud.label == 1, 0], 6))
    assert top.min() == pytest.approx(0.0, abs=0.0011)
    assert (np.diff(top) < 0.0011).all()


def test_error_grows_with_the_square_of_the_range():
    for distance in (0.4, 0.8, 1.6):
        wall = scene(block((distance, -2, -2), (3, 2, 2)))
        options = LineLaserOptions(points_per_profile=20_000, fan_deg=1.0, baseline_m=0.2, focal_px=1000.0, stripe_px=0.2, max_range_m=5.0, **HERE)
        (scan,) = scan_line_laser(wall, options, 1)
        sigma = distance**2 * 0.2 / (1000.0 * 0.2)
        assert stats.kstest((scan.cloud.points[:, 0] - distance) / sigma, "norm").pvalue > 0.01
        np.testing.assert_allclose(scan.cloud.sigma_along_m, sigma, rtol=1e-3)


def test_what_returns_nothing_is_not_kept_as_a_miss():
    (scan,) = scan_line_laser(scene(block((1, 0, -1), (1.5, 1, 1))), LineLaserOptions(**HERE))
    assert 0 < len(scan.cloud) == len(scan.rays) < 640
    assert np.isfinite(scan.rays.range_m).all()
