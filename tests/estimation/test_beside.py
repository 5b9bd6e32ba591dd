"""Points that run along beside a member: the section is only part of what was scanned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.beside import beside, strip_beside
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.transforms import rotation_about
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan

FAMILIES = ("L", "I", "C", "T", "RHS", "CHS", "rect", "round")
N = 12_000


def scanned(family, sigma, clutter=0.15, noise="gaussian"):
    member = made(family, sigma=max(sigma, 1e-12))
    return member, member_points(family, member.values(), N, MemberScanOptions(noise_m=sigma, noise=noise, caps=True, clutter=clutter, seed=4))


def strip(n, low, high, at=(0.0, 0.2), seed=3):
    """(n, 3) points on a strip 10 mm wide, between two heights."""
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(at[0], at[0] + 0.01, n), np.full(n, at[1]), rng.uniform(low, high, n)]


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(("sigma", "noise"), [(0.0, "gaussian"), (3e-4, "uniform"), (1e-3, "laplace"), (3e-3, "gaussian")])
def test_clutter_runs_nowhere(family, sigma, noise) -> None:
    member, points = scanned(family, sigma, noise=noise)
    assert beside(points, member) == ""


@pytest.mark.parametrize("family", FAMILIES)
def test_a_strip_beside_any_member_is_told(family) -> None:
    member, points = scanned(family, 5e-4)
    assert "run along beside" in beside(np.concatenate([points, strip(500, 0.0, 1.0)]), member)


@pytest.mark.parametrize(("n", "low", "high"), [(40, 0.0, 1.0), (500, 0.0, 0.7), (500, 0.3, 1.0), (500, 0.45, 0.55)])
def test_few_points_and_what_crosses_are_none(n, low, high) -> None:
    member, points = scanned("rect", 5e-4, clutter=0.02)
    assert beside(np.concatenate([points, strip(n, low, high)]), member) == ""


def test_a_fillet_is_within_the_hull() -> None:
    member, points = scanned("I", 5e-4, clutter=0.0)
    at = (member.values()["tw"] / 2 + 0.004, member.values()["h"] / 2 - member.values()["tf"] - 0.006)
    assert beside(np.concatenate([points, strip(800, 0.0, 1.0, at)]), member) == ""


def test_turned_with_the_points_and_where_none_are_stray() -> None:
    member, points = scanned("T", 5e-4)
    R = rotation_about((1, 2, 3), 0.7)
    turned = made("T", R=R, shift=(4, -5, 6))
    both = np.concatenate([points, strip(500, 0.0, 1.0)])
    assert beside(both @ R.T + [4, -5, 6], turned) == beside(both, member) != ""
    assert beside(points[:10], member) == ""


@pytest.mark.parametrize(("values", "sigma", "n"), [
    ({"h": 0.122, "b": 0.084, "tw": 0.00597, "tf": 0.0101, "length": 1.05}, 6e-4, 4_829),
    ({"h": 0.275, "b": 0.214, "tw": 0.00913, "tf": 0.0145, "length": 1.56}, 4e-4, 20_000),
])  # fmt: skip
def test_a_tee_of_which_no_side_of_the_web_was_seen_is_no_flat(values, sigma, n) -> None:
    """It was built as one: the end of its web was 3 % of the points, which may be clutter."""
    seen = tuple(name for name in faces("T") if name not in ("WEB_LEFT", "WEB_RIGHT"))
    points = member_points("T", values, n, MemberScanOptions(noise_m=sigma, faces=seen, seed=1))
    found = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions())
    if found.member.family == "T":  # found on the lines of its points
        assert not next(p for p in found.member.parameters if p.name == "tw").observable
    else:
        assert not found.explains and "run along beside the rect member" in found.reason


@pytest.mark.parametrize("family", FAMILIES)
def test_a_strip_that_is_an_object_of_its_own_is_told_where_it_ends_with_the_member(family) -> None:
    member = made(family)
    assert "an object of their own" in strip_beside(member, [strip(500, 0.0, 1.0, (0.0, 0.12))])


@pytest.mark.parametrize(("n", "low", "high", "at"), [(500, 0.02, 1.0, 0.2), (500, 0.0, 1.05, 0.2), (500, -0.5, 1.5, 0.2), (500, 0.0, 1.0, 0.5)])
def test_a_strip_that_ends_elsewhere_or_lies_far_off_is_another_thing(n, low, high, at) -> None:
    """The bar is 100 mm wide: its neighbour is told up to twice that."""
    assert strip_beside(made("rect"), [strip(n, low, high, (0.0, at))]) == ""
    assert strip_beside(made("rect"), []) == ""


def test_a_strip_askew_or_seen_in_its_middle_only_is_another_thing() -> None:
    whole = strip(500, 0.0, 1.0)
    askew = whole + np.c_[0.2 * whole[:, 2], np.zeros((500, 2))]
    ends = whole[(whole[:, 2] < 0.1) | (whole[:, 2] > 0.9)]
    assert strip_beside(made("rect"), [askew, ends]) == ""


def test_a_body_beyond_a_face_that_nobody_saw_may_be_the_rest_of_it() -> None:
    """A flange of an I, and the tee that is left of it, its web half seen: the flange had been built as a flat of its own."""
    bar = made("rect")
    tee = np.concatenate([strip(400, 0.0, 1.0, (x, y)) for x, y in ((-0.05, 0.15), (-0.01, 0.15), (0.03, 0.15), (-0.005, 0.08), (-0.005, 0.11))])
    hidden = replace(bar, seen={**dict.fromkeys(faces("rect"), 1.0), "TOP": 0.0})
    assert "an object of their own" in strip_beside(hidden, [tee])
    assert strip_beside(replace(bar, seen=dict.fromkeys(faces("rect"), 1.0)), [tee]) == ""
    assert strip_beside(replace(hidden, seen={**hidden.seen, "TOP": 1.0, "BOTTOM": 0.0}), [tee]) == ""
    assert strip_beside(hidden, [tee + [0.0, 0.0, 0.03]]) == ""
