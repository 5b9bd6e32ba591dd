"""What is kept of a scene on request, and what moved in it."""

import numpy as np
import pytest

from occluded import BOXES, rings, seen
from scan2fea.errors import EmptyScanError, UsageError
from scan2fea.filtering import FilteringOptions, clean_up, outliers
from scan2fea.filtering.crop import crop, in_polygon
from scan2fea.filtering.moving import moving
from scan2fea.types import PointCloud, Rays, Scan

GRID = np.stack(np.meshgrid(*[np.arange(5.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def kept(**settings):
    return GRID[crop(GRID, FilteringOptions(**settings))]


def test_box_plane_and_region_include_their_borders():
    assert (kept(crop_box_m=(1.0, 1, 1, 3, 3, 3)) == GRID[((GRID >= 1) & (GRID <= 3)).all(axis=1)]).all()
    assert (kept(crop_plane=(0.0, 0, 2, 3)) == GRID[GRID[:, 2] >= 3]).all()  # a normal of any length
    assert (kept(crop_region_m=(0.0, 0, 4, 0, 0, 4)) == GRID[GRID[:, 0] + GRID[:, 1] <= 4]).all()
    both = kept(crop_box_m=(1.0, 1, 1, 3, 3, 3), crop_plane=(1.0, 0, 0, 2))
    assert (both == GRID[((GRID >= 1) & (GRID <= 3)).all(axis=1) & (GRID[:, 0] >= 2)]).all()
    assert len(kept(crop_box_m=(1.0, 1, 1, 3, 3, 3), crop_outside=True)) == 125 - 27
    assert len(kept()) == 125


def test_a_region_may_be_concave():
    corners = np.array([[0.0, 0], [4, 0], [4, 4], [2, 1], [0, 4]])
    xy = np.random.default_rng(0).uniform(-1, 5, (2000, 2))
    below = np.where(xy[:, 0] < 2, 4 - 1.5 * xy[:, 0], 1 + 1.5 * (xy[:, 0] - 2))
    assert (in_polygon(xy, corners) == ((xy[:, 0] >= 0) & (xy[:, 0] <= 4) & (xy[:, 1] >= 0) & (xy[:, 1] <= below))).all()


@pytest.mark.parametrize("settings, said", [
    ({"crop_box_m": (1.0, 2)}, "six numbers"), ({"crop_box_m": (1.0, 1, 1, 0, 2, 2)}, "smallest x y z"),
    ({"crop_plane": (0.0, 0, 0, 1)}, "not zero"), ({"crop_region_m": (0.0, 1, 2, 3)}, "three corners"),
])  # fmt: skip
def test_what_is_no_box_plane_or_region(settings, said):
    with pytest.raises(UsageError, match=said):
        crop(GRID, FilteringOptions(**settings))


def test_an_empty_crop_is_said_and_a_crop_is_told():
    scan = Scan(cloud=PointCloud.of(GRID))
    with pytest.raises(EmptyScanError, match="no point lies in what filtering"):
        clean_up(scan, FilteringOptions(crop_box_m=(10.0, 10, 10, 11, 11, 11)))
    cleaned = clean_up(scan, FilteringOptions(crop_box_m=(0.0, 0, 0, 4, 4, 2)))
    assert "50 of 125 points lie outside the crop" in cleaned.notes[0] and len(cleaned.scan.cloud) == 75


def test_radius_is_inclusive_and_by_count():
    line = np.c_[np.arange(40.0), np.zeros((40, 2))]
    good = outliers(line, FilteringOptions(outliers="radius", neighbours=3, radius_m=2.0)).is_good
    assert good[1:-1].all() and not good[0] and not good[-1]  # an end has two others within 2.0
    with pytest.raises(UsageError, match="radius_m is 0"):
        outliers(line, FilteringOptions(outliers="radius", neighbours=3, radius_m=0.0))
    sheet = np.c_[np.random.default_rng(1).random((3000, 2)), np.zeros(3000)]
    found = outliers(np.concatenate([sheet, [[0.5, 0.5, 3.0]]]), FilteringOptions(outliers="radius")).is_good
    assert found[:-1].all() and not found[-1]


# ---- moving things


def frames(*worlds, sigma=0.02):
    """One input per world (its boxes), all from the origin; and which points are of boxes."""
    direction, _ = rings(720)
    points, of_box = [], []
    for k, boxes in enumerate(worlds):
        xyz, is_box, _ = seen(direction, sigma, seed=k, boxes=boxes)
        points.append(xyz)
        of_box.append(is_box)
    xyz = np.concatenate(points)
    distance = np.linalg.norm(xyz, axis=1)
    rays = Rays(origin=np.zeros_like(xyz), direction=xyz / distance[:, None], range_m=distance)
    frame = np.repeat(np.arange(len(worlds)), len(direction))
    return Scan(cloud=PointCloud.of(xyz, ray=np.arange(len(xyz)), frame=frame), rays=rays), np.concatenate(of_box)


def test_what_moved_is_marked_and_what_stood_is_not():
    low, high = BOXES[0]
    worlds = [(*BOXES[1:], (low + [0, 1.2 * k, 0], high + [0, 1.2 * k, 0])) for k in (-1, 0, 1)]  # the crate goes by, the others stay
    scan, of_box = frames(*worlds)
    gone = moving(scan, 0.02)
    points = scan.cloud.points
    crate = of_box & (points[:, 0] > 1.0)
    foot = points[:, 2] < -1.35  # there the floor behind is hardly farther
    assert gone[crate & ~foot].mean() > 0.9
    assert gone[~crate].mean() < 0.01


def test_one_input_alone_or_without_sensor_says_nothing():
    scan, _ = frames(BOXES)
    assert not moving(scan, 0.02).any()
    assert not moving(Scan(cloud=scan.cloud.replaced(ray=np.full(len(scan.cloud), -1))), 0.02).any()


def test_the_stage_tells_what_it_left_out():
    scan, of_box = frames((), (BOXES[0],), ())
    cleaned = clean_up(scan, FilteringOptions(moving=True, outliers="none"))
    assert "looked through them: they moved" in cleaned.notes[0]
    assert len(scan.cloud) - len(cleaned.scan.cloud) > 0.8 * of_box.sum()
