"""Round holes of a member: middle and radius within what is told, and nothing told of what is no round hole right through a wall."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.drilled import LENGTH, RADIUS, SIGMA, WALLS, bolted
from estimation.made import made, scanned
from scan2fea.estimation.bored import bored
from scan2fea.estimation.explain import explanation
from scan2fea.estimation.hole_fit import telling_holes
from scan2fea.estimation.member import MemberOptions
from scan2fea.estimation.round_holes import in_world, plugged, round_holes
from scan2fea.kernel.transforms import applied, random_rotation, rigid
from scan2fea.pipeline.route import RouteOptions, estimate
from scan2fea.types import PointCloud, Rays, Scan

FAR = 3.5  # standard deviations


def middles(family, member):
    """(k, 2) of its holes, across and along."""
    values = member.values()
    return np.array([(across * values.get("a", values["b"]), along) for across, along in WALLS[family][2]])


@pytest.mark.parametrize("family", WALLS)
@pytest.mark.parametrize("sigma", [0.0, 0.0003, SIGMA])
def test_middle_and_radius_are_as_sure_as_they_are_told(family, sigma):
    points, member, n = bolted(family, 20_000, sigma, seed=2)
    member = replace(member, sigma_m=max(sigma, 1e-6))
    found = round_holes(points, member)
    assert len(found) == n
    at, off = middles(family, member), []
    for hole in in_world(found, points, member):
        place = hole.start[[1 - WALLS[family][0], 2]]
        nearest = at[np.linalg.norm(at - place, axis=1).argmin()]
        off += [*((place - nearest) / hole.place_std_m), (hole.radius_m - RADIUS) / hole.std_m]
        assert hole.std_m < 3e-4
    assert np.abs(off).max() < FAR


def squeezed(points, family, member, times):
    """The points with all about each hole stretched along the member: a slot."""
    out = points.copy()
    for middle in middles(family, member):
        away = points[:, 2] - middle[1]
        near = np.abs(away) < 4 * RADIUS
        out[near, 2] = middle[1] + away[near] * np.where(np.abs(away[near]) < 1.5 * RADIUS, times, 1.0)
    return out


@pytest.mark.parametrize("seed", [2, 7])
def test_holes_that_noise_fills_are_told_by_how_likely_they_make_the_points(seed):
    """5 spacings wide, noise 0.16 of the wall: what both faces lack does not tell them, and the member had been whole."""
    points, member, n = bolted("L", 14_000, SIGMA, seed)
    member = replace(member, sigma_m=SIGMA)
    assert bored(member, points, SIGMA) == ()
    assert not explanation(points, member, SIGMA).explains
    assert len(round_holes(points, member)) == n


@pytest.mark.parametrize("family", ["L", "I", "C", "T", "RHS", "rect"])
def test_whole_members_have_none(family):
    member = replace(made(family, LENGTH), sigma_m=SIGMA)
    points = scanned(member, 12_000, 0.0, 3)
    points = points + SIGMA * np.random.default_rng(3).standard_normal(points.shape)
    assert telling_holes(member, points, SIGMA) == []
    assert round_holes(points, member) == ()


def test_a_hole_that_is_longer_than_wide_is_no_round_one():
    points, member, _ = bolted("rect", 30_000, 3e-4, seed=1)
    assert len(round_holes(points, member)) == 2
    assert round_holes(squeezed(points, "rect", member, 1.25), member) == ()


def test_a_wide_six_sided_opening_is_no_circle_though_most_of_its_rim_lies_far_beside_one():
    member = replace(made("rect", 0.4), sigma_m=3e-4)
    b, t = member.values()["b"], member.values()["t"]
    rng = np.random.default_rng(1)
    flat = np.column_stack([b * (rng.random(20_000) - 0.5), 0.4 * rng.random(20_000)])
    corner = 0.035 * np.column_stack([np.cos(np.arange(7) * np.pi / 3), np.sin(np.arange(7) * np.pi / 3)]) + [0.0, 0.2]
    normal = np.column_stack([np.cos((np.arange(6) + 0.5) * np.pi / 3), np.sin((np.arange(6) + 0.5) * np.pi / 3)])
    flat = flat[((flat - [0.0, 0.2]) @ normal.T).max(axis=1) > 0.035 * np.cos(np.pi / 6)]
    which, share = rng.integers(0, 6, 1000), rng.random((1000, 1))
    side = corner[which] + share * (corner[which + 1] - corner[which])
    depth = np.concatenate([np.where(rng.random(len(flat)) < 0.5, -t / 2, t / 2), t * (rng.random(1000) - 0.5)])
    across, along = np.concatenate([flat, side]).T
    points = np.column_stack([across, depth, along])
    points += 3e-4 * rng.standard_normal(points.shape)
    assert bored(member, points, 3e-4)  # a hole is told
    assert round_holes(points, member) == ()


def test_a_countersunk_hole_is_no_cylinder():
    points, member, _ = bolted("rect", 30_000, 0.0, seed=1)
    low, high = WALLS["rect"][1](member.values()["t"])
    for middle in middles("rect", member):
        away = points[:, [0, 2]] - middle
        rho = np.linalg.norm(away, axis=1)
        share = 1 + 0.3 * (points[:, 1] - low) / (high - low) * (np.abs(rho - RADIUS) < 1e-9)  # its side becomes a cone
        points[:, [0, 2]] = middle + share[:, None] * away
        points = points[(points[:, 1] < high - 1e-6) | (np.linalg.norm(points[:, [0, 2]] - middle, axis=1) > 1.3 * RADIUS)]
    points += 3e-4 * np.random.default_rng(2).standard_normal(points.shape)
    assert round_holes(points, member) == ()


def test_a_hole_with_a_bottom_does_not_go_through():
    points, member, _ = bolted("rect", 30_000, 3e-4, seed=1)
    rng = np.random.default_rng(3)
    middle, (low, high) = middles("rect", member)[0], WALLS["rect"][1](member.values()["t"])
    rho, turn = RADIUS * np.sqrt(rng.random(200)), 2 * np.pi * rng.random(200)
    bottom = np.stack([middle[0] + rho * np.cos(turn), np.full(200, low + 0.3 * (high - low)), middle[1] + rho * np.sin(turn)], axis=1)
    assert round_holes(np.concatenate([points, bottom]), member) == ()


def test_a_hole_of_which_one_mouth_alone_was_seen_is_told_by_its_side():
    points, member, n = bolted("rect", 30_000, 3e-4, seed=1)
    low, high = WALLS["rect"][1](member.values()["t"])
    depth = (points[:, 1] - low) / (high - low)
    assert len(round_holes(points[depth < 0.8], member)) == n
    one_face = points[depth < 0.15]
    assert round_holes(one_face, member) == ()
    rays = through(member, 4)
    assert len(round_holes(one_face, member, rays=rays)) == n
    stopped = replace(rays, range_m=np.full(len(rays), 3.0))
    assert round_holes(one_face, member, rays=stopped) == ()


def through(member, each):
    """Sight lines from 3 m below through each hole of the flat, 2 m on."""
    middle = np.repeat([[x, 0.0, z] for x, z in middles("rect", member)], each, axis=0)
    middle[:, 0] += np.tile(np.linspace(-0.3, 0.3, each), len(middle) // each) * RADIUS
    origin = middle - [0.0, 3.0, 0.0]
    return Rays(origin=origin, direction=np.tile([0.0, 1.0, 0.0], (len(middle), 1)), range_m=np.full(len(middle), 5.0))


def test_a_place_as_bare_as_a_hole_must_be_one():
    """Where one face alone shows it there may be a hole, or a shadow: the member is left to reconstruction."""
    points, member, n = bolted("rect", 30_000, 3e-4, seed=1)
    low, _ = WALLS["rect"][1](member.values()["t"])
    strip = np.abs(points[:, 2] - 0.32) < 3 * RADIUS  # of which the lower face alone was seen
    points = points[~strip | (points[:, 1] < low + 2e-3)]
    assert len(round_holes(points, member)) == n
    assert round_holes(points[np.hypot(points[:, 0], points[:, 2] - 0.32) > RADIUS], member) == ()


@pytest.mark.parametrize("family", WALLS)
def test_a_member_is_told_with_its_holes(family):
    points, member, n = bolted(family, 14_000, SIGMA, seed=4)
    T = rigid(random_rotation(5), np.array([3.0, -2.0, 1.0]))
    found = estimate(Scan(cloud=PointCloud.of(applied(T, points))), MemberOptions(), RouteOptions())
    assert found.explains, found.reason
    assert found.member is not None and found.member.family == family
    assert len(found.member.holes) == n
    told, true = found.member.values(), member.values()
    for p in found.member.parameters:
        if p.name in true and p.std_m is not None:
            assert abs(told[p.name] - true[p.name]) < FAR * p.std_m
    for hole in found.member.holes:
        assert abs(hole.radius_m - RADIUS) < FAR * hole.std_m
        assert abs(np.linalg.norm(hole.through) - true["t"]) < 0.1 * true["t"]


def test_a_plugged_scan_has_neither_holes_nor_rays_through_them():
    points, member, _ = bolted("rect", 20_000, 3e-4, seed=6)
    origin = np.where(points[:, 1:2] > 0, [[0.0, 3.0, LENGTH / 2]], [[0.0, -3.0, LENGTH / 2]])
    through = np.stack([np.zeros(2), np.full(2, 1.0), middles("rect", member)[:, 1] + [0.0, 0.0]], axis=1)  # seen behind the holes
    through[:, 0] = middles("rect", member)[:, 0]
    seen = np.concatenate([points, through])
    origin = np.concatenate([origin, [[x, -3.0, z] for x, _, z in through]])
    way = seen - origin
    far = np.linalg.norm(way, axis=1)
    rays = Rays(origin=origin, direction=way / far[:, None], range_m=far)
    scan = Scan(cloud=PointCloud.of(seen, ray=np.arange(len(seen))), rays=rays)
    whole = plugged(scan, member, round_holes(points, member))
    assert whole.rays is not None
    ends = whole.rays.origin + whole.rays.range_m[:, None] * whole.rays.direction
    assert np.allclose(ends[whole.cloud.ray], whole.cloud.points, atol=1e-9)
    assert whole.cloud.points[:, 1].max() < 0.5  # nothing is seen behind
    assert abs(len(whole.cloud) - len(points)) < 0.02 * len(points)
    assert explanation(whole.cloud.points, member, 3e-4).explains
    again = plugged(scan, member, round_holes(points, member))
    assert np.array_equal(again.cloud.points, whole.cloud.points)
