"""Coordinates that were rounded to whole steps."""

from __future__ import annotations

import numpy as np
import pytest

from scan2fea.kernel.coordinate_steps import coordinate_step, noise_before, rounding_std, spread
from scan2fea.types import PointCloud, Rays, Scan

RANDOM = np.random.default_rng(0).random((4000, 3)) * [1.0, 0.4, 0.2] + [500_123.2, 5_400_321.5, 312.0]


@pytest.mark.parametrize("step", [1e-3, 2.5e-4, 0.01])
def test_the_step_is_found_whatever_the_origin(step):
    assert coordinate_step(np.round(RANDOM / step) * step, 0.05) == pytest.approx(step, rel=1e-4)


def test_what_was_not_rounded_has_no_step_that_counts():
    assert coordinate_step(RANDOM - RANDOM[0], 0.05) < 1e-8
    grid = np.stack(np.meshgrid(*[np.arange(20) * 0.05] * 2, [0.0]), -1).reshape(-1, 3)
    assert coordinate_step(grid, 0.05) == 0.0  # drawn on a lattice as wide as the points are apart
    turned = np.round(RANDOM - RANDOM[0], 3) @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    assert coordinate_step(turned, 0.05) < 1e-6


@pytest.mark.parametrize("noise", [0.0, 0.2, 0.3, 0.6])
def test_the_mean_of_rounded_draws_is_off_by_as_much_as_told(noise):
    rng = np.random.default_rng(2)
    places = rng.random(400)
    off = [np.round(place + noise * rng.normal(size=4000)).mean() - place for place in places]
    chance = max(noise, 0.3) / np.sqrt(4000)
    assert np.hypot(rounding_std(1.0, noise), chance) == pytest.approx(np.std(off), rel=0.3)


def on_a_plane(noise_m, step_m, n=6000, z=0.0037, seed=3):
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.random((n, 2)), z + noise_m * rng.normal(size=n)])
    return np.round(points / step_m) * step_m if step_m else points


@pytest.mark.parametrize("noise_m, step_m, is_spread", [
    (0.001, 0.005, True), (0.001, 0.0, False), (0.004, 0.002, False), (0.0, 0.00001, False), (0.001, 0.012, False), (0.001, 0.009, True),
])  # fmt: skip
def test_points_are_spread_over_steps_wider_than_their_noise(noise_m, step_m, is_spread):
    """The spacing is 12.8 mm: of a step of 9 mm 0.7, of one of 12 mm 0.88 as of a lattice."""
    cloud = PointCloud.of(on_a_plane(noise_m, step_m))
    out, step = spread(Scan(cloud=cloud), 0)
    assert (out.cloud is not cloud) == is_spread
    if is_spread:
        off = out.cloud.points - cloud.points
        assert step == pytest.approx(step_m) and np.abs(off).max() <= step / 2 and off.std() == pytest.approx(step / np.sqrt(12), rel=0.02)
        assert spread(Scan(cloud=cloud), 0)[0].cloud.points.tobytes() == out.cloud.points.tobytes()
    assert noise_before(np.sqrt(0.2**2 + 1 / 6), 1.0) == pytest.approx(0.2) and noise_before(0.1, 1.0) == 0.0


def test_rays_end_at_points_that_were_spread_and_what_was_not_measured_stays():
    points = on_a_plane(0.001, 0.005)
    inferred, origin = np.arange(len(points)) % 5 == 0, np.tile([0.5, 0.5, 3.0], (len(points), 1))
    way = points - origin
    range_m = np.linalg.norm(way, axis=1)
    cloud = PointCloud.of(points, ray=np.where(inferred, -1, np.arange(len(points))), is_inferred=inferred)
    out, _ = spread(Scan(cloud=cloud, rays=Rays(origin=origin, direction=way / range_m[:, None], range_m=range_m)), 0)
    assert (out.cloud.points[inferred] == points[inferred]).all() and (out.cloud.points[~inferred] != points[~inferred]).any(axis=1).all()
    ends = out.rays.origin + out.rays.range_m[:, None] * out.rays.direction
    np.testing.assert_allclose(ends[~inferred], out.cloud.points[~inferred], atol=1e-12)
    np.testing.assert_array_equal(out.rays.range_m[inferred], range_m[inferred])
