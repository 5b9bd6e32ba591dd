"""The rays that an object takes along: its own, and where its points lie in sheets of them all that pass near."""

import numpy as np

from scan2fea.pipeline.objects import _with_rays
from scan2fea.types import PointCloud, Rays


def scene(step_z, noise):
    """A plate 0.2 m x 1 m at y = 0 seen from y = -2 by rays that also pass beside it, near and far."""
    x, z = (g.ravel() for g in np.meshgrid(np.arange(-1.0, 1.0, 0.008), np.arange(0.0, 1.0, step_z)))
    origin = np.array([0.0, -2.0, 0.5])
    way = np.stack([x, np.zeros(len(x)), z], 1) - origin
    reach = np.linalg.norm(way, axis=1)
    way /= reach[:, None]
    on = np.abs(x) <= 0.1
    measured = np.where(on, reach + noise * np.random.default_rng(0).standard_normal(len(x)), np.nan)
    rays = Rays(origin=np.tile(origin, (len(x), 1)), direction=way, range_m=measured)
    hit = np.flatnonzero(on)
    return PointCloud.of(origin + measured[hit, None] * way[hit], ray=hit), rays


def test_points_in_sheets_bring_the_rays_that_pass():
    own, rays = scene(0.1, 0.01)
    scan = _with_rays(own, rays)
    at = scan.rays.origin[scan.cloud.ray] + scan.rays.range_m[scan.cloud.ray, None] * scan.rays.direction[scan.cloud.ray]
    assert np.allclose(at, own.points, atol=1e-12)  # each point still has its own ray
    missed = np.isnan(scan.rays.range_m).sum()
    assert 0 < missed < np.isnan(rays.range_m).sum() / 4  # those near, not those a metre off
    assert own.ray is not scan.cloud.ray and np.array_equal(own.points, scan.cloud.points)


def test_others_bring_their_own_alone():
    own, rays = scene(0.008, 0.0005)
    assert len(_with_rays(own, rays).rays) == len(own)
    assert _with_rays(own, None).rays is None
