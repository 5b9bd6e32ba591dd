"""Planes, cylinders and spheres out of one cloud: each whole, its size against the truth, the same wherever it stands, and nothing made of noise."""

import numpy as np
import pytest

from scan2fea.errors import SegmentationError
from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation import SegmentationOptions, segment_scene
from scan2fea.segmentation.primitives import find_primitives
from scan2fea.types import PointCloud, Scan

SIGMA = 0.003


def scene(seed=0):
    """A tube (radius 0.3 m), a ball (0.5 m) and a block of six faces; and the number of the surface of each point."""
    rng = np.random.default_rng(seed)
    around = rng.uniform(0, 2 * np.pi, 5000)
    tube = np.c_[0.3 * np.cos(around), 0.3 * np.sin(around), rng.uniform(0, 2, 5000)]
    way = rng.standard_normal((4000, 3))
    ball = 0.5 * way / np.linalg.norm(way, axis=1)[:, None] + [3, 0, 0]
    block, side = rng.uniform(-0.5, 0.5, (7200, 3)), rng.integers(6, size=7200)
    block[np.arange(7200), side // 2] = side % 2 - 0.5
    points = np.concatenate([tube, ball, block * [1.0, 0.6, 0.4] + [0, 3, 0]])
    return points + SIGMA * rng.standard_normal(points.shape), np.concatenate([np.zeros(5000, int), np.ones(4000, int), 2 + side])


@pytest.fixture(scope="module")
def found():
    return find_primitives(scene()[0])


def test_each_surface_is_found_once_and_whole(found):
    points, truth = scene()
    assert [p.surface.kind for p in found] == ["cylinder", "sphere", *["plane"] * 6]
    for primitive in found:
        own = np.bincount(truth[primitive.rows], minlength=8)
        assert own.max() >= 0.98 * len(primitive.rows)
        assert own.max() >= 0.85 * (truth == own.argmax()).sum()
    assert len({int(np.bincount(truth[p.rows]).argmax()) for p in found}) == 8
    rows = np.concatenate([p.rows for p in found])
    assert len(np.unique(rows)) == len(rows) and len(rows) > 0.94 * len(points)


def test_sizes_and_places_are_true_to_the_noise(found):
    tube, ball = found[0].surface, found[1].surface
    assert tube.radius == pytest.approx(0.3, abs=5 * SIGMA / 5000**0.5 + 3e-4)
    assert abs(tube.axis[2]) > 0.9999 and np.linalg.norm(tube.point[:2]) < 5e-4
    assert ball.radius == pytest.approx(0.5, abs=5e-4) and np.linalg.norm(ball.point - [3, 0, 0]) < 5e-4
    for primitive in found:
        assert primitive.surface.rms_m == pytest.approx(SIGMA, rel=0.2)  # points at an edge that lie on the next face are left out
    assert sorted(int(np.abs(p.surface.axis).argmax()) for p in found[2:]) == [0, 0, 1, 1, 2, 2]


def test_a_turned_and_shifted_cloud_has_the_same_surfaces(found):
    R = random_rotation(3)
    again = find_primitives(scene()[0] @ R.T + [10.0, -4.0, 2.0])
    assert [p.surface.kind for p in again] == [p.surface.kind for p in found]
    assert again[0].surface.radius == pytest.approx(found[0].surface.radius, abs=1e-3)
    assert abs(again[0].surface.axis @ R @ found[0].surface.axis) > 0.9999


def test_it_repeats_and_leaves_its_input(found):
    points, _ = scene()
    kept = points.copy()
    again = find_primitives(points)
    assert np.array_equal(points, kept)
    assert all(np.array_equal(a.rows, b.rows) and a.surface.radius == b.surface.radius for a, b in zip(found, again, strict=True))


def test_scattered_points_are_no_surface():
    points = np.random.default_rng(0).standard_normal((4000, 3))
    assert sum(len(p.rows) for p in find_primitives(points, 300)) < 0.2 * 4000


def test_the_report_names_each_surface():
    points, _ = scene(1)
    segments = segment_scene(Scan(cloud=PointCloud.of(points)), SegmentationOptions(method="primitives"))
    rows = segments.how["primitives"]
    assert [row["kind"] for row in rows] == ["cylinder", "sphere", *["plane"] * 6]
    assert [row["n_points"] for row in rows] == [int((segments.labels == k).sum()) for k in range(8)]
    assert rows[0]["radius_m"] == pytest.approx(0.3, abs=1e-3) and "radius_m" not in rows[2]


NO_SURFACE = [(np.full((9, 3), np.inf), "not finite"), (np.zeros((9, 3)), "one place"), (np.zeros((1, 3)), "one place")]


@pytest.mark.parametrize(("points", "told"), NO_SURFACE)
def test_points_without_a_surface_are_told(points, told):
    with pytest.raises(SegmentationError, match=told):
        find_primitives(points)
