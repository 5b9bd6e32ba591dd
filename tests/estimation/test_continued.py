"""A face that goes on beyond its corner: the section is only part of what was scanned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import SIZES, made
from scan2fea.estimation.continued import continued
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.transforms import rotation_about
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan

STRAIGHT = ("L", "I", "C", "T", "RHS", "rect")


def scanned(family, sigma, clutter=0.1, seed=5, n=12_000):
    member = replace(made(family, sigma=max(sigma, 1e-12)), seen=dict.fromkeys(faces(family), 1.0))
    return member, member_points(family, member.values(), n, MemberScanOptions(noise_m=sigma, caps=True, clutter=clutter, seed=seed))


def strip(member, beyond, sigma, seed=6):
    """A strip in line with a channel's top flange, outside and inside of it, as dense as its faces."""
    rng = np.random.default_rng(seed)
    v = member.values()
    n = round(12_000 / 0.65 * beyond)
    y = [np.full(n, v["h"] / 2), np.full(n, v["h"] / 2 - v["tf"])]
    points = np.column_stack([-beyond * rng.random(2 * n), np.concatenate(y), rng.random(2 * n)])
    return points + sigma * rng.standard_normal(points.shape)


@pytest.mark.parametrize("family", STRAIGHT)
@pytest.mark.parametrize("sigma", [0.0, 2e-4, 1e-3, 3e-3])
def test_whole_sections_end_where_they_say(family, sigma) -> None:
    member, points = scanned(family, sigma)
    assert continued(points, member) == ""


@pytest.mark.parametrize("sigma", [0.0, 5e-4])
def test_a_strip_in_line_with_a_flange_is_no_channel(sigma) -> None:
    member, points = scanned("C", sigma, clutter=0.02)
    tolerated, more = 0.004 * SIZES["C"]["h"], 0.04 * SIZES["C"]["h"]
    assert continued(np.concatenate([points, strip(member, tolerated, sigma)]), member) == ""
    said = continued(np.concatenate([points, strip(member, more, sigma)]), member)
    assert said.startswith("TOP_OUTER goes on") and "WEB_OUTER" in said


def test_thin_strays_beyond_a_corner_are_no_face() -> None:
    member, points = scanned("C", 5e-4, clutter=0.0)
    few = strip(member, 0.04, 5e-4)
    assert continued(np.concatenate([points, few[:: len(few) // 30]]), member) == ""


def test_round_sections_have_no_corner_and_few_points_say_nothing() -> None:
    assert continued(np.zeros((10, 3)), made("CHS")) == ""
    member, points = scanned("C", 5e-4)
    assert continued(points[:80], member) == ""


def test_an_i_cut_beside_its_web_is_no_channel() -> None:
    """What the fit makes of it: the strips are too few to be a second body."""
    values = {"h": 0.244, "b": 0.174, "tw": 0.0159, "tf": 0.0212, "length": 3.34}
    points = member_points("I", values, 9000, MemberScanOptions(noise_m=0.00212, caps=True, seed=3))
    cut = points[points[:, 0] > -0.5 * values["tw"] - 0.015] @ rotation_about((1, 2, 3), 0.8).T
    found = fit_member(Scan(cloud=PointCloud.of(cut)), MemberOptions())
    assert not found.explains or found.member.family == "I"


def test_its_input_is_left_alone() -> None:
    member, points = scanned("T", 5e-4)
    before = points.copy()
    continued(points, member)
    assert (points == before).all()


ZED = {"h": 0.137, "b": 0.109, "tw": 0.0082, "tf": 0.0082, "length": 0.65}


def zed(sigma, n=12_000):
    """Points of an I without the faces of which a Z has none, and with those of its web that run through to the outer faces of the flanges."""
    v = ZED
    points = member_points("I", v, n, MemberScanOptions(noise_m=0.0, caps=False, seed=4))
    x, y = points[:, 0] * np.sign(points[:, 1]), np.abs(points[:, 1])
    kept = points[~((x > 0.5 * v["tw"] + 1e-9) & (y > 0.5 * v["h"] - v["tf"] - 1e-9))]
    rng = np.random.default_rng(7)
    perimeter = 4 * v["b"] + 2 * v["h"] - 2 * v["tw"]
    m = round(n * v["tf"] / perimeter)
    more = [np.column_stack([np.full(m, s * v["tw"] / 2), s * (v["h"] / 2 - v["tf"] * rng.random(m)), v["length"] * rng.random(m)]) for s in (1, -1)]
    points = np.concatenate([kept, *more])
    return points + sigma * rng.standard_normal(points.shape)


@pytest.mark.parametrize("sigma", [1e-4, 5e-4])
def test_a_z_is_no_i_of_which_half_of_each_flange_was_not_seen(sigma) -> None:
    """It was built, with 43 % more volume: the web runs through to the outer faces."""
    found = fit_member(Scan(cloud=PointCloud.of(zed(sigma))), MemberOptions())
    assert not found.explains


def test_an_i_of_which_half_a_flange_was_not_seen_ends_where_it_says() -> None:
    member = replace(made("I", sigma=5e-4), seen=dict.fromkeys(faces("I"), 1.0) | {"TOP_INNER_RIGHT": 0.0, "TOP_TOE_RIGHT": 0.0})
    points = member_points("I", member.values(), 12_000, MemberScanOptions(noise_m=5e-4, caps=True, clutter=0.02, seed=5))
    v = member.values()
    hidden = (points[:, 0] > 0.5 * v["tw"] + 0.003) & (points[:, 1] > 0.5 * v["h"] - v["tf"] - 0.003)
    assert continued(points[~hidden], member) == ""
