"""One bar half hidden by a post in front of it: put together only where sensors tell that the gap is a shadow."""

import itertools

import numpy as np
import pytest

from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation.hidden_gaps import one_bar

H = 0.01
STATION = np.array([1.0, -3.0, 1.4])
SCREEN = (0.95, 1.1)  # of a post 0.5 m before the bar; its shadow on it is 1.2 times as wide


def grid(x, y, z):
    """Points on a plane patch, a centimetre apart; a number stands for a fixed coordinate."""
    ranges = [np.arange(each[0], each[1], H) if isinstance(each, tuple) else np.array([each]) for each in (x, y, z)]
    return np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 3)


def bar(start, end, shift=0.0):
    """What a station before it sees of a bar of 80 by 100 mm: its front and its top."""
    return np.concatenate([grid((start, end), shift, (1.0, 1.1)), grid((start, end), (shift, shift + 0.08), 1.1)])


def crosses(points, y, x_range, z_range):
    """(n,) which points are seen through a rectangle square to y."""
    t = (y - STATION[1]) / (points[:, 1] - STATION[1])
    at = STATION + t[:, None] * (points - STATION)
    inside = (at[:, 0] > x_range[0]) & (at[:, 0] < x_range[1]) & (at[:, 2] > z_range[0]) & (at[:, 2] < z_range[1])
    return (t < 1) & inside


def scene(bars, with_post=True):
    """Points of two halves of a bar or two bars, of a post, and of a wall behind, as seen from the station."""
    points = np.concatenate([bar(*each) for each in bars])
    wall = grid((-1.0, 3.0), 1.0, (0.2, 2.0))
    for each in bars:
        wall = wall[~crosses(wall, 0.0, each[:2], (1.0, 1.1)) & ~crosses(wall, 0.08, each[:2], (1.0, 1.1))]
    post = grid(SCREEN, -0.5, (0.4, 1.8)) if with_post else np.zeros((0, 3))
    if with_post:
        points, wall = (each[~crosses(each, -0.5, SCREEN, (0.4, 1.8))] for each in (points, wall))
    left = points[:, 0] < 1.0
    return [points[left], points[~left], wall, *([post] if with_post else [])]


def numbers(parts, sensors=STATION, turn=None):
    points = np.concatenate(parts)
    seen_from = np.tile(sensors, (len(points), 1))
    if turn is not None:
        points, seen_from = points @ turn.T + 5.0, seen_from @ turn.T + 5.0
    ends = np.cumsum([0] + [len(part) for part in parts])
    before = points.copy()
    found = one_bar(points, [np.arange(a, b) for a, b in itertools.pairwise(ends)], seen_from)
    np.testing.assert_array_equal(points, before)
    return found.tolist()


@pytest.mark.parametrize("seed", [None, 1, 2])
def test_a_bar_behind_a_post_is_one_wherever_it_lies(seed):
    assert numbers(scene([(0.0, 2.0)]), turn=None if seed is None else random_rotation(seed)) == [0, 0, 1, 2]


def test_a_gap_that_is_seen_through_stays():
    assert numbers(scene([(0.0, 0.92), (1.1, 2.0)], with_post=False)) == [0, 1, 2]
    parts = scene([(0.0, 0.8), (1.2, 2.0)])  # wider than the shadow: rays pass on both sides of the post
    assert numbers(parts) == [0, 1, 2, 3]


def test_without_misses_of_the_sky_the_lack_of_rays_proves_nothing():
    """No post and no wall: nobody has seen through the gap, but nothing hides it either."""
    left, right, _ = scene([(0.0, 0.92), (1.1, 2.0)], with_post=False)
    assert numbers([left, right]) == [0, 1]


def test_where_sensors_are_not_known_or_move_parts_stay_two():
    parts = scene([(0.0, 2.0)])
    assert numbers(parts, sensors=np.full(3, np.nan)) == [0, 1, 2, 3]
    points = np.concatenate(parts)
    ends = np.cumsum([0] + [len(part) for part in parts])
    moving = STATION + 1e-3 * np.arange(len(points))[:, None]
    assert len(set(one_bar(points, [np.arange(a, b) for a, b in itertools.pairwise(ends)], moving).tolist())) == 4


@pytest.mark.parametrize(("shift", "n_bars"), [(0.0, 1), (0.01, 1), (0.06, 2), (0.2, 2)])
def test_the_section_must_go_on_where_it_was(shift, n_bars):
    """One spacing off is within what points tell; six are another bar."""
    left, right, wall, post = scene([(0.0, 2.0)])
    assert len(set(numbers([left, right + [0, shift, 0], wall, post])[:2])) == n_bars


def test_what_stands_in_the_gap_or_a_stub_shorter_than_it_parts():
    left, right, wall, post = scene([(0.0, 2.0)])
    middle = (left[:, 0].max() + right[:, 0].min()) / 2
    assert numbers([left, right, wall, post, grid(middle, (0.0, 0.08), (0.8, 1.3))])[:2] == [0, 1]
    gap = right[:, 0].min() - left[:, 0].max()
    for length, n_bars in ((gap - 2 * H, 2), (gap + 2 * H, 1)):
        stub = right[right[:, 0] < right[:, 0].min() + length]
        assert len(set(numbers([left, stub, wall, post])[:2])) == n_bars
