import numpy as np
import pytest

from scan2fea.errors import InputError
from scan2fea.simulation.laser_scanner import TerrestrialOptions, grid_directions, scan_terrestrial
from sensed import block, scene

FLOOR = scene(block((-50, -50, -2), (50, 50, -1.5)))


def test_a_full_turn_does_not_repeat_its_first_azimuth():
    directions, rows = grid_directions(TerrestrialOptions(step_deg=10.0, elevation_deg=(-50.0, 50.0)))
    assert rows == 11
    assert len(directions) == 36 * 11
    assert len(np.unique(np.round(directions, 9), axis=0)) == len(directions)
    part, _ = grid_directions(TerrestrialOptions(step_deg=10.0, azimuth_deg=(-20.0, 30.0), elevation_deg=(0.0, 0.0001)))
    np.testing.assert_allclose(np.degrees(np.arctan2(part[:, 1], part[:, 0])), [-20, -10, 0, 10, 20, 30])


def test_ranges_to_a_floor_and_misses_to_the_sky():
    options = TerrestrialOptions(positions_m=((0, 0, 0), (3, 4, 0.5)), step_deg=5.0, noise_m=0.0, max_range_m=1000.0)
    scans = scan_terrestrial(FLOOR, options)
    assert len(scans) == 2
    for scan, height in zip(scans, (1.5, 2.0), strict=True):
        down = -scan.rays.direction[:, 2]
        reached = (down > 0) & (np.linalg.norm(scan.rays.direction[:, :2], axis=1) * height / np.maximum(down, 1e-9) < 40)
        np.testing.assert_allclose(scan.rays.range_m[reached], height / down[reached], rtol=1e-12)
        assert np.isnan(scan.rays.range_m[down <= 0]).all()
        assert len(scan.rays) == 72 * 31
        assert (scan.rays.footprint_rad == 0.3e-3).all()
        assert len(np.unique(scan.rays.ring)) == 31
    assert scans[1].rays.time_s[0] == 1.0


def test_a_turned_station_turns_its_grid():
    options = {"positions_m": ((0, 0, 0),), "step_deg": 15.0}
    upright = scan_terrestrial(FLOOR, TerrestrialOptions(**options))[0]
    turned = scan_terrestrial(FLOOR, TerrestrialOptions(orientations_deg=((0, 0, 90),), **options))[0]
    np.testing.assert_allclose(
        turned.rays.direction, np.c_[-upright.rays.direction[:, 1], upright.rays.direction[:, 0], upright.rays.direction[:, 2]], atol=1e-15
    )


def test_bad_grids():
    with pytest.raises(InputError, match="is empty: give the lesser angle first"):
        grid_directions(TerrestrialOptions(elevation_deg=(10.0, 10.0)))
    with pytest.raises(InputError, match="widen the step"):
        grid_directions(TerrestrialOptions(step_deg=1e-4))
    with pytest.raises(InputError, match="no object to scan"):
        scan_terrestrial(scene(), TerrestrialOptions(positions_m=((0, 0, 0),)))
