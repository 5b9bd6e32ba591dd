"""Parts that only the gap between rings keeps apart are one; what lies side by side, behind or two rings off is not."""

import numpy as np
import pytest

from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation import segment_scene
from scan2fea.segmentation.scan_lines import across_lines
from scan2fea.types import PointCloud, Rays, Scan

STEP = np.radians(1.33)  # at 4 m: 93 mm from ring to ring
RADIUS = 0.04


def seen(elevations, ring, azimuths_deg, depth_m=4.0, seed=0):
    """Rays of one sensor that end on a cylinder of that radius: (directions, ranges, rings)."""
    el, az = (v.ravel() for v in np.meshgrid(elevations, np.radians(azimuths_deg), indexing="ij"))
    direction = np.stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)], 1)
    depth = depth_m / np.cos(el) + 0.005 * np.random.default_rng(seed).standard_normal(len(el))
    return direction, depth, np.repeat(ring, len(azimuths_deg))


def scan_of(*views, with_ring=True, turn=7):
    R = random_rotation(turn)
    direction = np.concatenate([v[0] for v in views]) @ R.T
    depth, ring = (np.concatenate([v[k] for v in views]) for k in (1, 2))
    origin = np.tile([3.0, -2.0, 1.0], (len(depth), 1))
    rays = Rays(origin=origin, direction=direction, range_m=depth, ring=ring if with_ring else None)
    cloud = PointCloud.of(origin + depth[:, None] * direction, ray=np.arange(len(depth)))
    return Scan(cloud=cloud, rays=rays), np.split(np.arange(len(depth)), np.cumsum([len(v[1]) for v in views])[:-1])


FIRST = seen([0.0, STEP], [0, 1], np.arange(-15, 0, 0.15))
SECOND = {
    "above": (seen([2 * STEP], [2], np.arange(-15, 0, 0.15)), True),
    "beside": (seen([0.0, STEP], [0, 1], np.arange(0.9, 15, 0.15)), False),  # 63 mm
    "behind": (seen([2 * STEP], [2], np.arange(-15, 0, 0.15), depth_m=4.5), False),
    "two rings above": (seen([3 * STEP, 4 * STEP], [3, 4], np.arange(-15, 0, 0.15)), False),
}


@pytest.mark.parametrize("where", SECOND)
@pytest.mark.parametrize("turn", [0, 7])
def test_adjacent_rings_are_one_and_nothing_else_is(where, turn):
    second, is_one = SECOND[where]
    between = seen([2 * STEP], [2], np.arange(100, 130, 0.15))  # the sensor has that ring, elsewhere
    scan, parts = scan_of(FIRST, second, between, turn=turn)
    found, joined = across_lines(scan, parts, RADIUS)
    one, other = len(parts[0]), len(parts[1])
    assert sorted(len(rows) for rows in found) == sorted([200, one + other] if is_one else [200, one, other])
    assert joined.sum() == is_one * (one + other)


def test_without_rings_nothing_changes():
    scan, parts = scan_of(FIRST, SECOND["above"][0], with_ring=False)
    found, joined = across_lines(scan, parts, RADIUS)
    assert all(np.array_equal(a, b) for a, b in zip(found, parts, strict=True)) and not joined.any()


def test_a_panel_seen_in_rings_is_one_object_beside_a_dense_one():
    scan, _ = scan_of(seen(STEP * np.arange(4), np.arange(4), np.arange(-15, 15, 0.15)))
    dense = np.random.default_rng(1).random((20_000, 3)) * [2.0, 2.0, 0.0] + [10.0, 0.0, 0.0]
    n = len(scan.cloud)
    cloud = PointCloud.of(np.concatenate([scan.cloud.points, dense]), ray=np.r_[np.arange(n), np.full(len(dense), -1)])
    for rays, parts in ((scan.rays, 1), (None, 4)):
        found = segment_scene(Scan(cloud=cloud if rays else PointCloud.of(cloud.points), rays=rays))
        assert len(np.unique(found.labels[:n])) == parts
