"""Where neither side of a wall was seen: cut through where the cut was scanned, else untold."""

import numpy as np
import pytest

from estimation.made import made, scanned
from scan2fea.estimation.cuts import share_of_sides
from scan2fea.estimation.explain import explanation
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.outline import outline_distance
from scan2fea.kernel.sections import section
from scan2fea.types import PointCloud, Scan
from scan2fea.verification.member import bare_wall_checks

N, LENGTH, FROM = 40_000, 0.8, 0.6
SIGMA = 0.0005


def away(member, share, *, cut, sigma=SIGMA):
    """Points of a member without what lies above a share of its height beyond FROM; cut : with the points of the two faces of the cut."""
    rng = np.random.default_rng(3)
    points = scanned(member, N, 0.0, 0)
    shape = section(member.family, member.values())
    corners = np.concatenate(shape.loops)
    (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
    level = low + share * (high - low)
    points = points[(points[:, 1] < level) | (points[:, 2] < FROM)]
    if cut:
        outline = sum(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum() for loop in shape.loops)
        n_across, n_along = (round(N / (outline * LENGTH) * (right - left) * size) for size in (high - level, LENGTH - FROM))
        across = np.c_[rng.uniform(left, right, n_across), rng.uniform(level, high, n_across), np.full(n_across, FROM)]
        along = np.c_[rng.uniform(left, right, n_along), np.full(n_along, level), rng.uniform(FROM, LENGTH, n_along)]
        faces = np.concatenate([across, along])
        points = np.concatenate([points, faces[outline_distance(shape, faces[:, :2])[0] < 0]])
    return points + sigma * rng.standard_normal(points.shape)


@pytest.mark.parametrize(("family", "share"), [("L", 0.5), ("I", 0.8), ("C", 0.7), ("T", 0.6), ("RHS", 0.5)])
def test_a_wall_that_was_cut_through_is_told_by_the_points_of_its_cut(family, share):
    member = made(family, LENGTH)
    told = explanation(away(member, share, cut=True), member, SIGMA)
    assert not told.explains
    assert "cut through" in told.reason
    where = next(place for place in told.cuts if place.is_cut)
    assert where.from_m == pytest.approx(FROM, abs=0.02)
    assert where.to_m == pytest.approx(LENGTH, abs=0.02)


@pytest.mark.parametrize("family", ["I", "C"])
def test_a_flange_that_is_narrower_than_its_fellow_is_told(family):
    """Strips along the toes, narrower than square cells: an I with flanges of 200 and 170 mm had been told as one with two of 200.0 +- 0.4 mm."""
    member = made(family, LENGTH)
    values, rng = member.values(), np.random.default_rng(5)
    points = scanned(member, 6_000, 0.0, 0)
    top, right = points[:, 1].max(), points[:, 0].max()
    toe = right - 0.07 * values["b"]
    points = points[(points[:, 1] < top - 1.01 * values["tf"]) | (points[:, 0] < toe)]
    n = round(6_000 / (4 * values["b"] + 2 * values["h"]) * values["tf"])
    toes = np.c_[np.full(n, toe), rng.uniform(top - values["tf"], top, n), rng.uniform(0, LENGTH, n)]
    points = np.concatenate([points, toes]) + SIGMA * rng.standard_normal((len(points) + n, 3))
    told = explanation(points, member, SIGMA)
    assert not told.explains and "cut through" in told.reason


@pytest.mark.parametrize(("family", "share"), [("L", 0.5), ("I", 0.8), ("RHS", 0.5)])
def test_a_wall_that_no_side_was_seen_of_may_be_hidden(family, share):
    member = made(family, LENGTH)
    told = explanation(away(member, share, cut=False), member, SIGMA)
    assert told.explains
    assert told.cuts
    assert not any(place.is_cut for place in told.cuts)


@pytest.mark.parametrize("family", ["L", "I", "C", "T", "RHS", "CHS", "rect", "round"])
@pytest.mark.parametrize(("sigma", "clutter"), [(SIGMA, 0.0), (0.003, 0.0), (SIGMA, 0.15)])
def test_a_whole_member_shows_none(family, sigma, clutter):
    member = made(family, LENGTH, normals=((0, 0, -1), (0.5, 0, 0.75**0.5)))
    assert not explanation(scanned(member, N, sigma, 1, clutter), member, sigma).cuts


def test_one_side_of_a_wall_that_was_not_seen_is_no_matter():
    member = made("I", LENGTH)
    points = scanned(member, N, SIGMA, 2)
    outside = points[:, 1] > section("I", member.values()).loops[0][:, 1].max() - 0.002
    assert not explanation(points[~(outside & (points[:, 2] > FROM))], member, SIGMA).cuts


def test_bolt_holes_smaller_than_a_hole_of_one_side_would_be_told():
    member, radius = made("L", LENGTH), 0.009
    points = scanned(member, N, 0.0, 4)
    shape = section("L", member.values())
    x = np.concatenate(shape.loops)[:, 0].max()
    place = np.array([x - 0.04, 0.3])
    leg = outline_distance(shape, points[:, :2])[0] > -1e-4
    near = np.hypot(points[:, 0] - place[0], points[:, 2] - place[1]) < radius
    rng = np.random.default_rng(5)
    turn, t = rng.uniform(0, 2 * np.pi, 60), member.values()["t"]
    low = np.concatenate(shape.loops)[:, 1].min()
    ring = np.c_[place[0] + radius * np.cos(turn), low + t * rng.random(60), place[1] + radius * np.sin(turn)]
    points = np.concatenate([points[~(near & leg & (points[:, 1] < low + 1.5 * t))], ring])
    told = explanation(points + SIGMA * rng.standard_normal(points.shape), member, SIGMA)
    assert "cut through" in told.reason


def profile(loop, n, sigma, seed=6):
    """Points of the sides of a prism."""
    rng = np.random.default_rng(seed)
    way = np.roll(loop, -1, axis=0) - loop
    size = np.linalg.norm(way, axis=1)
    edge = rng.choice(len(loop), n, p=size / size.sum())
    points = np.c_[loop[edge] + rng.random((n, 1)) * way[edge], rng.uniform(0, LENGTH, n)]
    return points + sigma * rng.standard_normal(points.shape)


def test_a_lipped_channel_is_no_box_whose_fourth_wall_is_hidden():
    h, b, t, lip = 0.1, 0.05, 0.004, 0.018
    outer = [(0, 0), (b, 0), (b, lip), (b - t, lip), (b - t, t), (t, t), (t, h - t), (b - t, h - t), (b - t, h - lip), (b, h - lip), (b, h), (0, h)]
    told = fit_member(Scan(cloud=PointCloud.of(profile(np.array(outer), N, 0.0004))), MemberOptions())
    assert not told.explains


def test_an_i_of_unequal_flanges_is_no_i_whose_toes_are_hidden():
    h, t, w, narrow, wide = 0.15, 0.009, 0.0065, 0.0375, 0.06
    half = [(wide, 0), (wide, t), (w / 2, t), (w / 2, h - t), (narrow, h - t), (narrow, h)]
    loop = np.array(half + [(-x, y) for x, y in reversed(half)])
    told = fit_member(Scan(cloud=PointCloud.of(profile(loop, N, 0.0006))), MemberOptions())
    assert not told.explains


def test_a_wall_bare_between_its_seen_edges_is_told_where_the_noise_hides_a_cut():
    member = made("RHS", LENGTH)
    sigma = 0.3 * member.values()["t"]
    points = scanned(member, N, 0.0, 7)
    shape = section("RHS", member.values())
    right, h = np.concatenate(shape.loops)[:, 0].max(), member.values()["h"]
    middle = np.concatenate(shape.loops)[:, 1].mean()
    gap = (points[:, 0] > right - 1.5 * member.values()["t"]) & (np.abs(points[:, 1] - middle) < 0.25 * h)
    told = explanation(points[~gap] + sigma * np.random.default_rng(8).standard_normal((int((~gap).sum()), 3)), member, sigma)
    assert not any(place.is_cut for place in told.cuts)
    assert [check.passed for check in bare_wall_checks(share_of_sides(told.cuts, member))] == [False]


@pytest.mark.parametrize("family", ["CHS", "RHS"])
def test_a_bar_turned_down_along_part_of_it_is_no_tube(family):
    """A solid shaft of 60 and 54 mm, its ends unseen, had been converted as a tube of 60 x 3 (-80 % of its volume)."""
    member = made(family, LENGTH)
    points = scanned(member, 6_000, 0.0, 0)
    loops = section(member.family, member.values()).loops
    is_inner = outline_distance(section(member.family, member.values()), points[:, :2])[1] >= len(loops[0])
    cap = np.abs(points[:, 2] - LENGTH / 2) > LENGTH / 2 - 1e-6
    z, noise = points[:, 2], SIGMA * np.random.default_rng(7).standard_normal(points.shape)
    stepped = ~cap & (is_inner == (z > FROM))
    assert "two sections" in explanation((points + noise)[stepped], member, SIGMA).reason
    for seen in (~is_inner | (z > FROM), ~is_inner, is_inner | (z > FROM)):  # a little way in; from outside; a duct from within
        assert "two sections" not in explanation((points + noise)[~cap & seen], member, SIGMA).reason
