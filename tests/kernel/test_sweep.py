"""Sweeps: end planes, bow, twist, strips within their tolerance."""

import numpy as np
import pytest

from predicates import rotation
from scan2fea.kernel.sweep import Sweep, axis_at, ends_at, stations, swept_points, swept_volume
from scan2fea.kernel.transforms import rigid

SQUARE = np.array([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]])


def sweep(length=2.0, bow=((), ()), twist=(), normals=((0, 0, -1), (0, 0, 1)), T=None):
    unit = np.asarray(normals, float) / np.linalg.norm(normals, axis=1)[:, None]
    return Sweep(
        T_world_member=np.eye(4) if T is None else T,
        length_m=length,
        bow=np.asarray(bow, float).reshape(2, -1),
        twist=np.asarray(twist, float),
        end_normals=unit,
    )


def test_ends_of_straight_members_are_closed_forms():
    first, last = ends_at(sweep(normals=((0.3, 0, -1), (0, 0.5, 1))), SQUARE)
    assert first == pytest.approx(0.3 * SQUARE[:, 0])
    assert last == pytest.approx(2 - 0.5 * SQUARE[:, 1])


def test_ends_of_bent_members_lie_in_their_planes():
    bent = sweep(bow=((0.02, 0.005), (-0.01, 0)), twist=(0.1,), normals=((0.3, 0.1, -1), (-0.2, 0.4, 1)))
    points = swept_points(bent, SQUARE, np.array([0.0, 1.0]))
    for k, at in enumerate((0.0, 2.0)):
        origin = np.append(axis_at(bent, np.array([at]))[0][0], at)
        assert np.abs((points[k] - origin) @ bent.end_normals[k]).max() < 1e-12


def test_twist_turns_and_bow_moves():
    turned = swept_points(sweep(twist=(0.25,)), SQUARE, np.array([0.0, 0.5, 1.0]))
    angle = np.arctan2(turned[:, 2, 1], turned[:, 2, 0]) - np.pi / 4
    assert angle == pytest.approx([-0.25, 0, 0.25])
    moved = swept_points(sweep(bow=((0.01,), (0,))), np.zeros((1, 2)), np.array([0.0, 0.5, 1.0]))[:, 0, 0]
    assert moved == pytest.approx([0.01, -0.005, 0.01])  # P2 is 1 at the ends, -1/2 in the middle


def test_motion_moves_all():
    T = rigid(rotation(2), [1, 2, 3])
    share = np.linspace(0, 1, 5)
    here, there = (swept_points(sweep(bow=((0.01,), (0,)), T=m), SQUARE, share) for m in (None, T))
    assert there == pytest.approx(here @ T[:3, :3].T + T[:3, 3])


@pytest.mark.parametrize("bent", [{"bow": ((0.02, 0.004), (0.01, 0))}, {"twist": (0.2,)}])
def test_strips_keep_their_tolerance(bent):
    one = sweep(**bent)
    for tolerance in (1e-3, 1e-4):
        share, worst = stations(one, [SQUARE], tolerance)
        assert worst <= tolerance
        fine = swept_points(one, SQUARE, np.linspace(0, 1, 2001))
        knots = swept_points(one, SQUARE, share)
        for corner in range(4):
            path = np.stack([np.interp(np.linspace(0, 1, 2001), share, knots[:, corner, k]) for k in range(3)], axis=1)
            assert np.linalg.norm(fine[:, corner] - path, axis=1).max() <= tolerance * 1.001


def test_straight_members_need_one_strip_and_volume_is_area_times_length():
    share, worst = stations(sweep(), [SQUARE], 1e-9)
    assert share.tolist() == [0, 1] and worst == 0
    assert swept_volume(sweep(), 0.01, np.zeros(2)) == pytest.approx(0.02, rel=1e-15)
    assert swept_volume(sweep(normals=((0, 0, -1), (0.5, 0, 1))), 0.01, np.array([0.02, 0])) == pytest.approx(0.01 * (2 - 0.01), rel=1e-14)


def test_more_strips_that_do_not_help_end():
    """Lines across the oblique end of a twisted member are bent themselves: strips cannot follow, and the distance is told."""
    _, worst = stations(sweep(twist=(0.3,), normals=((1, 0, -1), (0, 0, 1))), [SQUARE], 1e-9)
    assert 1e-9 < worst < 5e-3
