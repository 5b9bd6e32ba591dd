"""What rays tell that points cannot: holes that were shot through, and neighbours that lie in the sensor's own sheets."""

import math

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.explain import AGAIN, MAX_EXCESS, explanation
from scan2fea.estimation.ray_voids import in_sheets, seen_through, shot_through, told_by_rays
from scan2fea.estimation.solid import swept
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.types import PointCloud, Rays, Scan

PLATE = made("rect", 1.0, {"b": 0.2, "t": 0.02})  # b along x, t along y, 1 m along z
STEP = 0.008


def aimed(step_z=STEP, noise=0.0):
    """Rays from one place at a grid of the plate's front face and beyond it; what they would meet."""
    x, z = (g.ravel() for g in np.meshgrid(np.arange(-0.15, 0.15, STEP), np.arange(-0.1, 1.1, step_z)))
    there = np.stack([x, np.full(len(x), -0.01), z], 1)
    origin = np.array([0.0, -2.0, 0.5])
    away = there - origin
    reach = np.linalg.norm(away, axis=1)
    hit = (np.abs(x) <= 0.1) & (z >= 0) & (z <= 1)
    measured = np.where(hit, reach + noise * np.random.default_rng(0).standard_normal(len(reach)), np.nan)
    return there, origin, away / reach[:, None], reach, measured, hit


def scan_of(origin, way, measured):
    hit = np.flatnonzero(np.isfinite(measured))
    points = origin + measured[hit, None] * way[hit]
    rays = Rays(origin=np.tile(origin, (len(way), 1)), direction=way, range_m=measured)
    return Scan(cloud=PointCloud.of(points, ray=hit), rays=rays)


@pytest.mark.parametrize(
    ("centre", "radius", "n"), [((0.0, 0.5), 0.0, 0), ((0.0, 0.5), 0.07, 1), ((0.1, 0.5), 0.07, 0), ((0.0, 0.5), 0.012, 0)]
)
def test_a_hole_is_where_rays_passed(centre, radius, n):
    there, origin, way, _, measured, _ = aimed()
    gone = np.hypot(there[:, 0] - centre[0], there[:, 2] - centre[1]) < radius  # none, one in the middle, a notch of the rim, one of few rays
    assert shot_through(scan_of(origin, way, np.where(gone, np.nan, measured)), PLATE, 1e-3) == n
    assert shot_through(scan_of(origin, way, np.where(gone, measured + 0.5, measured)), PLATE, 1e-3) == n  # what stands behind was hit
    assert shot_through(scan_of(origin, way, np.where(gone, measured - 0.5, measured)), PLATE, 1e-3) == 0  # what stands before hides it


def test_a_place_where_nobody_looked_is_no_hole():
    there, origin, way, _, measured, _ = aimed()
    looked = np.hypot(there[:, 0], there[:, 2] - 0.5) > 0.07
    assert shot_through(scan_of(origin, way[looked], measured[looked]), PLATE, 1e-3) == 0


def test_a_wall_that_was_seen_through_is_none():
    there, origin, way, _, measured, hit = aimed(noise=0.001)
    assert seen_through(scan_of(origin, way, measured), PLATE) == ""
    for width, is_open in ((0.15, True), (0.002, False)):  # of a slot along the plate, and what stands behind it
        slot = hit & (np.abs(there[:, 0]) < width / 2)
        assert bool(seen_through(scan_of(origin, way, np.where(slot, measured + 0.3, measured)), PLATE)) is is_open
        assert seen_through(scan_of(origin, way, np.where(slot, measured - 0.3, measured)), PLATE) == ""  # before it: another body
    behind = np.where(there[:, 0] > 0.1, 3.0, measured)  # past its edge
    assert seen_through(scan_of(origin, way, behind), PLATE) == ""
    assert seen_through(Scan(cloud=scan_of(origin, way, measured).cloud), PLATE) == ""


def through(tube, is_gone, n, seed):
    """A scan of a tube from four sides: (hit, range) where is_gone(places on the wall that is met first) has rays go on to the next face but one."""
    rng = np.random.default_rng(seed)
    scene, long = scene_of(swept(tube)), tube.values()["length"]
    turn = rng.integers(0, 4, n) * math.pi / 2
    origin = np.stack([2.0 * np.cos(turn), 2.0 * np.sin(turn), np.full(n, long / 2)], 1)
    way = np.stack([*rng.uniform(-0.09, 0.09, (2, n)), rng.uniform(0, long, n)], 1) - origin
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    reach = first_hits(scene, origin, way)[0]
    met = np.isfinite(reach)
    gone = met & is_gone(origin + np.where(met, reach, 0.0)[:, None] * way)
    for _ in range(2):
        reach[gone] += 1e-6 + first_hits(scene, origin[gone] + (reach[gone] + 1e-6)[:, None] * way[gone], way[gone])[0]
    reach += 5e-4 * rng.standard_normal(n)
    hit = np.flatnonzero(np.isfinite(reach))
    rays = Rays(origin=origin, direction=way, range_m=np.where(np.isfinite(reach), reach, np.nan))
    return Scan(cloud=PointCloud.of(origin[hit] + reach[hit, None] * way[hit], ray=hit), rays=rays)


def test_what_is_measured_behind_one_place_of_a_wall_tells_its_hole():
    """Four holes of 40 mm in a tube that was seen from outside had been passed over: too few points were lacking."""
    tube = made("RHS", 1.2, {"h": 0.15, "b": 0.15, "t": 0.008})

    def hole(at):
        return np.hypot(at[:, 1], at[:, 2] - 0.4) < 0.02

    for seed in range(5):
        strays = np.random.default_rng([seed, 1])
        assert "there is a hole" in seen_through(through(tube, hole, 12_000, seed), tube)
        assert seen_through(through(tube, lambda at, draw=strays: draw.random(len(at)) < 0.01, 12_000, seed), tube) == ""


def test_a_dent_is_no_hole():
    tube = made("RHS", 1.2, {"h": 0.15, "b": 0.15, "t": 0.008})
    scan = through(tube, lambda at: np.zeros(len(at), bool), 12_000, 0)
    points = scan.cloud.points
    deep = (points[:, 0] > 0.07) * np.maximum(0.0, 0.03 - np.hypot(points[:, 1], points[:, 2] - 0.4))
    ranges = scan.rays.range_m.copy()
    ranges[scan.cloud.ray] += deep
    assert seen_through(scan_of_rays(scan.rays, ranges), tube) == ""


def scan_of_rays(rays, ranges):
    hit = np.flatnonzero(np.isfinite(ranges))
    points = rays.origin[hit] + ranges[hit, None] * rays.direction[hit]
    return Scan(cloud=PointCloud.of(points, ray=hit), rays=Rays(origin=rays.origin, direction=rays.direction, range_m=ranges))


def test_rings_far_apart_under_wide_noise_are_sheets():
    _, origin, way, _, measured, _ = aimed(step_z=0.1, noise=0.01)
    assert in_sheets(scan_of(origin, way, measured))
    _, origin, way, _, measured, _ = aimed(step_z=STEP, noise=0.001)
    near = scan_of(origin, way, measured)
    assert not in_sheets(near)
    assert not in_sheets(Scan(cloud=near.cloud)) and shot_through(Scan(cloud=near.cloud), PLATE, 1e-3) == 0


@pytest.mark.parametrize(("step_z", "noise", "scatter_tells"), [(STEP, 1e-3, True), (0.1, 0.01, False)])
def test_noise_of_a_member_beyond_its_neighbours_is_told_along_rays_too(step_z, noise, scatter_tells):
    """A tube of oval section, its noise 0.5 mm, had been converted as a T with uniform noise of 8 mm by its rays."""
    _, origin, way, _, measured, _ = aimed(step_z=step_z, noise=noise)
    scan, wide = scan_of(origin, way, measured), 0.01
    by_rays = told_by_rays(scan, PLATE, wide)
    assert (by_rays.facing > 0) is scatter_tells
    told = explanation(scan.cloud.points, PLATE, wide, along_rays=True, by_rays=by_rays)
    assert (told.noise_excess > MAX_EXCESS) is scatter_tells
    assert ("scatter about the rect member" in told.reason) is scatter_tells
    right = explanation(scan.cloud.points, PLATE, noise, along_rays=True, by_rays=by_rays)
    assert not right.noise_excess > MAX_EXCESS


def test_points_measured_again_lie_where_the_data_lie():
    _, origin, way, _, measured, _ = aimed(step_z=0.05, noise=0.01)
    scan = scan_of(origin, way, measured)
    again = told_by_rays(scan, PLATE, 0.01).again
    assert 0.99 * len(scan.cloud) < len(again) / AGAIN <= len(scan.cloud)  # a ray along an edge may miss
    # of the front face alone, blurred along the rays: the depth has the noise of the range, and none is added across
    depth = again[:, 1] + PLATE.values()["t"] / 2
    assert abs(depth.mean()) < 4 * 0.01 / len(again) ** 0.5 and depth.std() == pytest.approx(0.01, rel=0.05)
    assert np.abs(again[:, 0]).max() < 0.105
