"""Range images, what stands in the way in them, and what is made up behind it."""

import numpy as np
import pytest

from occluded import BOXES, ROOM, inside_room, rings, seen
from scan2fea.errors import UsageError
from scan2fea.filtering import FilteringOptions, fill_behind
from scan2fea.filtering.disocclusion import disocclude
from scan2fea.filtering.occluders import occluders
from scan2fea.filtering.range_classes import classes
from scan2fea.filtering.range_image import range_image, range_noise
from scan2fea.kernel.transforms import applied, random_rotation, rigid, rotated
from scan2fea.types import PointCloud, Rays, Scan

DIRECTION, RING = rings(2160)
STATION = np.zeros(3)


def image_of(points, ring=RING):
    return range_image(points, STATION, ring)


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


def off_walls(points):
    return np.min([np.abs(points - ROOM[0]).min(axis=1), np.abs(points - ROOM[1]).min(axis=1)], axis=0)


# ---- the image


@pytest.mark.parametrize("ring", [RING, None])
def test_every_point_has_its_cell_and_every_cell_its_range(ring):
    points, _, _ = seen(DIRECTION)
    order = np.random.default_rng(4).permutation(len(points))
    image = image_of(points[order], None if ring is None else ring[order])
    assert image.range_m.shape == (32, 2160) and image.is_closed
    own = image.row_of_point.ravel()[image.cell]
    distance = np.linalg.norm(points[order], axis=1)
    assert (distance >= image.range_m.ravel()[image.cell] - 1e-12).all()
    np.testing.assert_allclose(image.range_m.ravel()[image.cell], distance[own], rtol=1e-14)  # a cell holds the nearest of its points
    direction = image.directions(*np.divmod(image.cell, 2160))
    assert np.abs((direction * points[order]).sum(axis=1) / distance - 1).max() < 1e-4


def test_a_grid_scanner_of_half_a_turn_begins_where_it_begins():
    direction, _ = rings(720, np.arange(-20, 20, 0.5))
    azimuth = np.arctan2(direction[:, 1], direction[:, 0])
    points = seen(direction[np.abs(azimuth) > 2.0])[0]  # the gap is ahead
    image = range_image(points, STATION)
    assert not image.is_closed
    assert np.isfinite(image.range_m).mean() > 0.9
    assert np.ptp(image.azimuth) == pytest.approx(2 * (np.pi - 2.0), abs=0.02)


def test_noise_from_second_differences():
    image = image_of(seen(DIRECTION, 0.02)[0])
    assert range_noise(image) == pytest.approx(0.02, rel=0.05)
    assert range_noise(image_of(seen(DIRECTION, 0.0)[0])) < 1e-4


# ---- classes (eq 2.5, 2.6)


def row_image(ranges):
    a = np.linspace(-1.0, 1.0, len(ranges))
    return range_image(np.stack([np.cos(a), np.sin(a), 0 * a], axis=1) * np.asarray(ranges)[:, None], STATION, np.zeros(len(a), np.int64))


def test_classes_are_heaps_of_the_histogram_merged_at_tau_and_not_beyond():
    image = row_image(np.repeat([5.0, 5.3, 5.0, 5.3], 32))  # four windows of 32 columns
    for tau, n in ((0.29, 4), (0.30001, 1)):
        # alternating windows at 5.0 and 5.3: neighbours differ by 0.3, so below tau they stay four, at tau all is one
        found = classes(image, np.full(image.range_m.shape, tau))
        assert len(np.unique(found)) == n
    half = row_image(np.tile(np.repeat([4.0, 6.0], 16), 4))  # two heaps in each window
    found = classes(half, np.full(half.range_m.shape, 0.5))
    assert len(np.unique(found)) == 2
    assert ((found == found[0, 0]) == (half.range_m < 5.0)).all()


# ---- what stands in the way, and behind it


@pytest.mark.parametrize("columns, elevations", [(1080, None), (2160, None), (1440, np.arange(-40, 40, 0.5))])
@pytest.mark.parametrize("sigma", [0.0, 0.02])
@pytest.mark.parametrize("has_ring", [True, False])
def test_occluders_are_marked_and_the_room_behind_them_is_filled(columns, elevations, sigma, has_ring):
    direction, ring = rings(columns, elevations)
    points, in_the_way, _ = seen(direction, sigma)
    found = disocclude(image_of(points, ring if has_ring else None), sigma)
    assert iou(found.is_occluder, in_the_way) > 0.9
    assert np.sqrt((off_walls(found.points) ** 2).mean()) < 0.02
    assert len(found.points) > 0.9 * in_the_way.sum() * (0.9 if has_ring else 0.8)
    assert not in_the_way[found.source].any()  # what is behind continues a wall, not the thing before it


def test_a_plane_is_filled_exactly():
    """Without noise, each direction hit in the middle of its cell: the fill is the wall to rounding where one wall is behind."""
    points, _, _ = seen(DIRECTION, 0.0, boxes=BOXES[2:])
    found = disocclude(image_of(points), 0.0)
    distance = np.linalg.norm(found.points, axis=1)
    off = np.abs(distance - inside_room(found.points / distance[:, None]))
    assert off.max() < 1e-6


def test_nothing_stands_in_the_way_in_an_empty_room():
    points, _, _ = seen(DIRECTION, 0.02, boxes=())
    assert disocclude(image_of(points), 0.02).is_occluder.mean() < 1e-3


def test_a_thing_before_a_thing_is_peeled_off():
    """A pole before a crate before the wall: all is in the way of the wall, and behind both the wall is filled."""
    pole = (np.array([1.5, -0.05, -1.6]), np.array([1.6, 0.05, 2.4]))
    points, in_the_way, _ = seen(DIRECTION, 0.01, boxes=(BOXES[0], pole))
    found = disocclude(image_of(points), 0.01)
    assert iou(found.is_occluder, in_the_way) > 0.95
    assert np.sqrt((off_walls(found.points) ** 2).mean()) < 0.02


def test_tau_and_the_width_limit_what_counts():
    points, in_the_way, _ = seen(DIRECTION, 0.0, boxes=BOXES[1:2])
    image = image_of(points)
    assert occluders(image, 0.0, tau_m=3.0)[0].sum() == pytest.approx(in_the_way.sum(), abs=2)  # the wall is 4.1 m farther
    assert not occluders(image, 0.0, tau_m=4.5)[0].any()
    assert occluders(image, 0.0, widest_rad=np.radians(10.0))[0].sum() < 60  # it is 15 degrees wide, but for corners in the outermost rings


@pytest.mark.parametrize("method", ["diffusion", "anisotropic"])
def test_diffusion_is_the_mean_of_neighbours_and_keeps_to_their_range(method):
    """The discrete maximum principle: no filled range leaves those of the cells around; ranges that are equal all around are filled by that."""
    points, _, _ = seen(DIRECTION, 0.0)
    image = image_of(points)
    filled = disocclude(image, 0.0, method).filled_m
    known = filled[np.isfinite(filled)]
    assert len(known) > 4000 and known.min() >= np.nanmin(image.range_m) and known.max() <= np.nanmax(image.range_m)
    sphere = DIRECTION * np.where(np.abs(DIRECTION[:, 1]) < 0.1, 2.0, 5.0)[:, None]  # a ball of 5 m, with a bar of 2 m ahead and behind
    found = disocclude(image_of(sphere), 0.0, method)
    assert len(found.points) > 1000
    np.testing.assert_allclose(np.linalg.norm(found.points, axis=1), 5.0, atol=1e-6)


def test_an_unknown_method():
    with pytest.raises(UsageError, match=r"filtering\.disocclusion 'magic': use none, planes, diffusion, anisotropic"):
        disocclude(image_of(seen(DIRECTION)[0]), 0.02, "magic")


# ---- through the stage


def scan_of(points, T=np.eye(4), spread=0.0):
    rng = np.random.default_rng(1)
    origin = applied(T, spread * rng.uniform(-1, 1, (len(points), 3)))
    world = applied(T, points)
    ray = world - origin
    distance = np.linalg.norm(ray, axis=1)
    rays = Rays(origin=origin, direction=ray / distance[:, None], range_m=distance, ring=RING)
    return Scan(cloud=PointCloud.of(world, ray=np.arange(len(points))), rays=rays)


def test_inferred_points_carry_their_mark_and_move_with_their_frame():
    T = rigid(random_rotation(3), [100.0, -20.0, 3.0])
    points, in_the_way, _ = seen(DIRECTION, 0.02)
    options = FilteringOptions(disocclusion="planes")
    made, moved = (fill_behind(scan_of(points, pose), pose[None], ["a"], options) for pose in (np.eye(4), T))
    n, new = len(points), made.cloud.is_inferred
    assert not new[:n].any() and new[n:].all() and len(new) > n + 4000
    assert (made.cloud.points[:n] == points).all() and (made.cloud.ray[n:] == -1).all() and (made.cloud.raw_index[n:] == -1).all()
    assert (made.source[:n] == -1).all() and not in_the_way[made.source[n:]].any()
    assert iou(made.is_occluder[:n], in_the_way) > 0.9 and not made.is_occluder[n:].any()
    assert (np.einsum("nc,nc->n", made.cloud.normals[n:], made.cloud.points[n:]) < 0).all()  # toward the station at the origin
    np.testing.assert_allclose(moved.cloud.points, applied(T, made.cloud.points), atol=1e-9)
    np.testing.assert_allclose(moved.cloud.normals[n:], rotated(T, made.cloud.normals[n:]), atol=1e-9)
    assert "marked is_inferred and used in no fit" in made.notes[0]


def test_what_cannot_be_done_is_said():
    points, _, _ = seen(DIRECTION, 0.02)
    options = FilteringOptions(disocclusion="planes")
    bare = fill_behind(Scan(cloud=PointCloud.of(points)), np.eye(4)[None], ["bare.ply"], options)
    assert "bare.ply: nothing was put behind what stands in the way, its sensor position is not known" in bare.notes
    assert len(bare.cloud) == len(points)
    moving = fill_behind(scan_of(points, spread=0.5), np.eye(4)[None], ["moved.ply"], options)
    assert any("its sensor moved by" in note for note in moving.notes)
    off = fill_behind(scan_of(points), np.eye(4)[None], ["a"])
    assert off.notes == () and len(off.cloud) == len(points) and not off.is_occluder.any()
