"""Parts of one section that were seen apart are one object; parallel neighbours are not."""

import numpy as np
import pytest

from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation.members import members
from scan2fea.segmentation.shadow import one_section

LENGTH, H = 1.2, 0.015


def strip(u, v, z=(0.0, LENGTH), seed=0, sigma=0.0005):
    """Points (n, 3) on a rectangle from place u to place v of the section, swept along z."""
    rng = np.random.default_rng(seed)
    u, v = np.array(u), np.array(v)
    n = int(np.linalg.norm(v - u) * (z[1] - z[0]) / H**2)
    flat = u + rng.random((n, 1)) * (v - u)
    return np.c_[flat, rng.uniform(*z, n)] + sigma * rng.standard_normal((n, 3))


def parts_of(*objects):
    return np.concatenate(objects), np.split(np.arange(sum(map(len, objects))), np.cumsum([len(o) for o in objects])[:-1])


def girder(web=(0.145, 0.3)):
    """A top flange with as much of the web as is seen, and the bottom flange."""
    upper = np.concatenate([strip((-0.1, 0.3), (0.1, 0.3)), strip((0.0, web[0]), (0.0, web[1]), seed=1)])
    return upper, strip((-0.1, 0.0), (0.1, 0.0), seed=2)


def test_flange_in_the_shadow_of_the_other_is_of_the_same_girder_whatever_motion():
    for seed in range(3):
        points, parts = parts_of(*girder())
        points = points @ random_rotation(seed).T + seed
        nowhere = np.full(points.shape, np.nan)
        assert one_section(points, parts, nowhere).tolist() == [0, 0]
        assert one_section(points, parts[::-1], nowhere).tolist() == [0, 0]


@pytest.mark.parametrize(
    ("upper", "lower"),
    [
        (girder()[0], strip((-0.1, 0.0), (0.1, 0.0), z=(0.0, 0.7), seed=2)),  # does not end with it
        (girder(web=(0.155, 0.3))[0], strip((-0.1, 0.0), (0.1, 0.0), seed=2)),  # a gap wider than the web that is seen
        (girder()[0], strip((0.0, 0.0), (0.2, 0.0), seed=2)),  # the web points at an edge: an angle
        (girder()[0], strip((0.0, 0.05), (0.0, -0.15), seed=2)),  # in the web's own plane
        (strip((-0.1, 0.3), (0.1, 0.3)), strip((-0.1, 0.2), (0.1, 0.2), seed=2)),  # two plates, one over the other
        (girder()[0], strip((-0.1, 0.0), (0.1, 0.0), seed=2)[:, [2, 1, 0]]),  # not parallel
    ],
)
def test_neighbours_stay_apart(upper, lower):
    points, parts = parts_of(upper, lower)
    assert one_section(points, parts, np.full(points.shape, np.nan)).tolist() == [0, 1]


def test_a_gap_that_was_seen_through_is_a_gap():
    points, parts = parts_of(*girder(), strip((1.0, 0.0), (1.0, 0.3), seed=3))  # a plate behind the girder
    behind = np.arange(len(points)) >= parts[2][0]
    seen_from = np.where(behind[:, None], [[-2.0, 0.1, 0.6]], np.nan)
    assert one_section(points, parts, seen_from).tolist() == [0, 1, 2]
    from_above = np.where(behind[:, None], [[-0.2, 5.0, 0.6]], np.nan)
    assert one_section(points, parts, from_above).tolist() == [0, 0, 1]


def test_nothing_and_flat_and_tiny_parts():
    assert len(one_section(np.zeros((0, 3)), [], np.zeros((0, 3)))) == 0
    points = np.zeros((50, 3))
    assert one_section(points, [np.arange(20), np.arange(20, 48), np.arange(48, 50)], points).tolist() == [0, 1, 2]


def node(brace_width):
    """A flange four times as long as wide and a brace that ends under it, seen from below, square and oblique: 0 and 1."""
    flange = strip((-0.15, 0.0), (0.15, 0.0))
    side = brace_width / 2
    faces = [strip((-side, -side), (side, -side), (0.0, 0.7), 4), strip((side, -side), (side, side), (0.0, 0.7), 5)]
    brace = np.concatenate([*faces, strip((-side, -side), (-side, side), (0.0, 0.7), 6)])
    a = np.radians(130.0)
    turn = np.array([[1.0, 0, 0], [0, np.cos(a), np.sin(a)], [0, -np.sin(a), np.cos(a)]])
    brace = brace @ turn.T
    return np.concatenate([flange, brace + [0, -0.02 - brace[:, 1].max(), 0.5 - brace[np.argmax(brace[:, 1]), 2]]]), len(flange)


def test_a_joint_of_short_members_of_two_sections_falls_into_them():
    points, n = node(0.14)
    found = members(points)
    assert found.max() == 1
    truth = np.arange(len(points)) >= n
    assert max((found == truth).mean(), (found != truth).mean()) > 0.97
