"""A toe that was not seen: told by its mirror image where both faces of the wall end there, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.mirrored import told_toes
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.transforms import rotation_about
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.verification.member import open_walls

HIDDEN = {"C": ("TOP_TOE",), "T": ("FLANGE_TOE_LEFT",), "I": ("TOP_TOE_LEFT", "BOTTOM_TOE_LEFT")}
AWAY = {"C": 1.0, "T": -1.0, "I": -1.0}


def scanned_without(family, sigma, seed=3, n=20_000):
    member = made(family, sigma=sigma)
    seen = tuple(name for name in faces(family) if name not in HIDDEN[family])
    points = member_points(family, member.values(), n, MemberScanOptions(noise_m=sigma, faces=seen, caps=True, clutter=0.02, seed=seed))
    share = dict.fromkeys(faces(family), 1.0) | dict.fromkeys(HIDDEN[family], 0.0)
    return replace(member, seen=share), points


def cut(points, member, share):
    """Without the last part of the flange whose toe is hidden, or of a C's top flange."""
    b, away = member.values()["b"], AWAY[member.family]
    reach = b * (1 - share) if member.family == "C" else 0.5 * b - share * b
    own = points[:, 1] > 0 if member.family == "C" else np.ones(len(points), bool)
    return points[~((away * points[:, 0] > reach) & own)]


@pytest.mark.parametrize("family", HIDDEN)
@pytest.mark.parametrize("sigma", [0.0, 0.001])
def test_both_faces_end_at_the_mirror_image_of_a_seen_toe(family, sigma) -> None:
    member, points = scanned_without(family, sigma)
    assert open_walls(member) == 1
    told = told_toes(points, member)
    assert set(told) == set(HIDDEN[family])
    assert open_walls(replace(member, told_toes=told)) == 0


ALSO = {"C": "TOP_OUTER", "T": "FLANGE_INNER_LEFT", "I": "TOP_INNER_LEFT"}


def scanned_from_one_side(family, sigma):
    """Neither the toe nor one of the faces beside it was seen."""
    member = made(family, sigma=sigma)
    hidden = {HIDDEN[family][0], ALSO[family]}
    seen = tuple(name for name in faces(family) if name not in hidden)
    points = member_points(family, member.values(), 20_000, MemberScanOptions(noise_m=sigma, faces=seen, caps=True, clutter=0.02, seed=4))
    sure = tuple(replace(p, std_m=2e-5) for p in member.parameters)
    return replace(member, seen=dict.fromkeys(faces(family), 1.0) | dict.fromkeys(hidden, 0.0), parameters=sure), points


@pytest.mark.parametrize("family", HIDDEN)
@pytest.mark.parametrize("sigma", [0.0, 0.0002])
def test_one_face_alone_tells_where_it_is_known_ten_times_as_well(family, sigma) -> None:
    member, points = scanned_from_one_side(family, sigma)
    assert told_toes(points, member) == HIDDEN[family][:1]
    for share in (0.02, 0.05, 0.2):
        assert told_toes(cut(points, member, share), member) == ()
    hardly = points[np.random.default_rng(0).random(len(points)) < 0.02]
    assert told_toes(hardly, member) == ()


@pytest.mark.parametrize("family", HIDDEN)
@pytest.mark.parametrize("share", [0.05, 0.2])
def test_faces_that_end_before_it_tell_nothing(family, share) -> None:
    member, points = scanned_without(family, 0.001)
    assert told_toes(cut(points, member, share), member) == ()


def test_a_wall_that_goes_on_is_no_toe() -> None:
    """A channel fitted to what is a tube with one wall not seen: the bottom flange goes on beyond the toe of the top one."""
    member, points = scanned_without("C", 0.001)
    longer = points[points[:, 1] > 0.05] + [0.03, 0, 0]
    assert told_toes(np.concatenate([points, longer]), member) == ()


def test_neither_toe_seen_tells_neither() -> None:
    member, points = scanned_without("C", 0.001)
    assert told_toes(points, replace(member, seen={**member.seen, "BOTTOM_TOE": 0.0})) == ()


def test_few_points_tell_nothing_and_seen_toes_are_not_asked() -> None:
    member, points = scanned_without("C", 0.001)
    assert told_toes(points[:300], member) == ()
    assert told_toes(points, made("C")) == ()
    assert told_toes(points, made("L")) == ()


def test_it_moves_with_the_member_and_leaves_its_input_alone() -> None:
    member, points = scanned_without("T", 0.001)
    R = rotation_about((1, 2, 3), 1.1)
    moved = points @ R.T + [3, -1, 2]
    before = moved.copy()
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, (3, -1, 2)
    assert told_toes(moved, replace(member, T_world_member=T)) == told_toes(points, member) == HIDDEN["T"]
    assert (moved == before).all()
