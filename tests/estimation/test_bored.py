"""Bolt holes a few spacings wide are told by both faces of a wall and by what lies inside it; whole members show none."""

import numpy as np
import pytest

from estimation.drilled import LENGTH, SIGMA, WALLS, bolted
from estimation.made import made, scanned
from scan2fea.estimation.bored import bored
from scan2fea.estimation.explain import explanation
from scan2fea.estimation.outline import first_across, inward
from scan2fea.kernel.sections import section


@pytest.mark.parametrize("family", WALLS)
@pytest.mark.parametrize("seed", [0, 1])
def test_bolt_holes_are_told_where_one_face_alone_would_not(family, seed):
    points, member, n = bolted(family, 14_000, SIGMA, seed)
    assert 1 <= len(bored(member, points, SIGMA)) <= n  # one denies the member
    told = explanation(points, member, SIGMA)
    assert not told.explains
    assert "hole" in told.reason or "cut through" in told.reason


@pytest.mark.parametrize("family", ["L", "I", "C", "T", "RHS", "CHS", "rect", "round"])
@pytest.mark.parametrize(("sigma", "clutter"), [(0.0, 0.0), (SIGMA, 0.0), (0.003, 0.0), (SIGMA, 0.15)])
def test_a_whole_member_shows_none(family, sigma, clutter):
    rng, member = np.random.default_rng(5), made(family, LENGTH)
    points = scanned(member, 14_000, 0.0, 1)
    points = points + sigma * rng.standard_normal(points.shape)
    strays = rng.uniform(points.min(axis=0) - 0.05, points.max(axis=0) + 0.05, (round(clutter * len(points)), 3))
    assert bored(member, np.concatenate([points, strays]), sigma) == ()


def test_scan_lines_leave_no_holes_between_them():
    member, rng = made("rect", LENGTH), np.random.default_rng(2)
    points = scanned(member, 60_000, 0.0, 3)
    points[:, 2] = np.round(points[:, 2] / 0.02) * 0.02  # a line every 20 mm
    assert bored(member, points + SIGMA * rng.standard_normal(points.shape), SIGMA) == ()


def test_points_on_one_side_of_a_wall_or_too_few_are_no_fault():
    member = made("CHS", LENGTH)
    points = scanned(member, 5000, 0.0, 0)
    outside = points[np.hypot(points[:, 0], points[:, 1]) > member.values()["d"] / 2 - 1e-6]
    assert bored(member, outside, SIGMA) == bored(member, outside[:3], SIGMA) == bored(member, outside[:0], SIGMA) == ()


def test_what_lies_across_a_wall():
    shape = section("I", {"h": 0.2, "b": 0.1, "tw": 0.006, "tf": 0.01})
    into, corners = inward(shape), np.concatenate(shape.loops)
    assert np.allclose(np.linalg.norm(into, axis=1), 1)
    start = corners[:1] + [[0.02, 0.0]]  # under the lower flange, beside the web
    _, far = first_across(start, into[:1], shape, np.array([0]))
    assert far[0] == pytest.approx(0.01)
    _, far = first_across(corners[:1] + [[0.05, 0.0]], into[:1], shape, np.array([0]))
    assert far[0] == pytest.approx(0.2)  # up the web


@pytest.mark.parametrize("family", ["CHS", "rect"])
def test_a_strip_along_a_member_that_nobody_saw_is_no_hole(family):
    member = made(family, LENGTH)
    points = scanned(member, 14_000, 0.0, 3)
    off = np.abs(np.arctan2(points[:, 1], points[:, 0]) if family == "CHS" else points[:, 0] / 0.03)
    points = points[off > 0.7] + SIGMA * np.random.default_rng(3).standard_normal((int((off > 0.7).sum()), 3))
    assert bored(member, points, SIGMA) == ()
