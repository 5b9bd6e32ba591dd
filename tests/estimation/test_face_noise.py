"""Noise along rays that nobody told: faces whose noises differ give the dimensions a doubt, faces alike do not."""

import dataclasses

import numpy as np
import pytest

from estimation.made import made
from estimation.test_ray_noise import ASLANT, LENGTH, SIGMA, T, scanned
from scan2fea.estimation.as_member import honest
from scan2fea.estimation.face_noise import doubted_for_rays, made_up_rays, noise_of_faces
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.kernel.section_likelihood import face_lengths, faces, lines_of
from scan2fea.types import PointCloud, Scan

RHS = np.array([0.14, 0.09, 0.008])


def outer_faces(n, seed, noise):
    """(n, 3) points on the outer faces of a tube, 1.2 m long, with a noise for faces along x and one for those along y."""
    rng = np.random.default_rng(seed)
    axis, line, low, _ = (part[:4] for part in lines_of("RHS"))
    lengths = face_lengths("RHS", RHS)[:4]
    face = rng.choice(4, n, p=lengths / lengths.sum())
    points = np.empty((n, 3))
    rows = np.arange(n)
    points[:, 2] = rng.uniform(0, 1.2, n)
    points[rows, 1 - axis[face]] = (low @ RHS)[face] + rng.uniform(size=n) * lengths[face]
    points[rows, axis[face]] = (line @ RHS)[face] + np.array(noise)[axis[face]] * rng.normal(size=n)
    return points


def untold_wall(member):
    seen = {name: 1.0 for name in faces("RHS")}
    return dataclasses.replace(member, seen=seen, parameters=tuple(
        dataclasses.replace(p, std_m=None, observable=False) if p.name == "t" else p for p in member.parameters
    ))  # fmt: skip


def test_each_face_has_its_own_noise_or_none():
    values, rng = RHS, np.random.default_rng(1)
    unlike = outer_faces(20_000, 0, (4e-4, 8e-4))
    noise = noise_of_faces("RHS", values, unlike[:, :2], 6e-4)
    axis = lines_of("RHS")[0]
    assert noise[:4] == pytest.approx(np.where(axis[:4] == 0, 4e-4, 8e-4), rel=0.05)
    assert noise[4:] == pytest.approx(6e-4)  # nobody saw them
    alike = [noise_of_faces("RHS", values, outer_faces(20_000, seed, (6e-4, 6e-4))[:, :2], 6e-4) for seed in range(20)]
    assert alike == [None] * 20
    few = rng.permutation(unlike)[:60]
    assert noise_of_faces("RHS", values, few[:, :2], 6e-4) is None


@pytest.mark.parametrize("steepest", [1.0, 0.7])
@pytest.mark.parametrize("is_across", [True, False])
def test_made_up_rays_give_each_face_its_noise_and_lie_across_the_member_or_along_it(steepest, is_across):
    noise = np.array([2.0, 1.0, 1.5, 2.0]) * 1e-3
    way, face = made_up_rays("rect", noise, steepest, is_across)
    if is_across:
        assert np.linalg.norm(way, axis=1) == pytest.approx(1.0)
    axis = lines_of("rect")[0]
    for k in range(4):
        across = np.abs(way[face == k, axis[k]])
        assert across == pytest.approx(steepest * noise[k] / 2e-3)
        if not is_across:
            assert not way[face == k, 1 - axis[k]].any()
        assert way[face == k, 1 - axis[k]].mean() == pytest.approx(0.0, abs=1e-12)


def test_faces_unlike_widen_and_faces_alike_do_not():
    member = made("T", LENGTH, T, sigma=SIGMA * np.sqrt(0.6), std=1e-5)
    scan, *_ = scanned(20_000, 3)
    doubted = doubted_for_rays(scan.cloud.points, member, None, 0)
    assert [p.value_m for p in doubted.parameters] == [p.value_m for p in member.parameters]
    std = np.array([p.std_m for p in doubted.parameters[:4]])
    assert (std >= 1e-5).all() and np.diag(doubted.covariance)[:4] == pytest.approx(std**2)
    alike, *_ = scanned(20_000, 3, along_rays=False)
    even = made("T", LENGTH, T, sigma=SIGMA * np.mean(np.cos(ASLANT)), std=1e-5)
    assert doubted_for_rays(alike.cloud.points, even, None, 0) is even
    bar = made("round", LENGTH, {"d": 0.05}, sigma=SIGMA, std=1e-4)
    assert doubted_for_rays(scan.cloud.points, bar, None, 0) is bar


@pytest.mark.parametrize("seed", [0, 1])
def test_a_tube_from_outside_is_told_where_its_faces_noises_differ(seed):
    points = outer_faces(8_000, seed, (1.5e-4, 3e-4))
    member = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions(family="RHS")).member
    for p, true in zip(member.parameters[:2], RHS[:2], strict=True):
        assert p.std_m is None or abs(p.value_m - true) < 3 * p.std_m


def test_a_wall_thinner_than_any_tube_s_is_one_face():
    points = outer_faces(4_000, 5, (3e-4, 3e-4))
    thin = untold_wall(made("RHS", 1.2, {"h": 0.14, "b": 0.09, "t": 0.0004}, sigma=2e-4, std=1e-5))
    told = honest(points, thin, MemberOptions())[0]
    assert told.parameters[0].value_m == pytest.approx(0.1398) and told.parameters[0].std_m == pytest.approx(2e-4, rel=0.01)
    usual = untold_wall(made("RHS", 1.2, {"h": 0.14, "b": 0.09, "t": 0.0015}, sigma=2e-4, std=1e-5))
    assert honest(points, usual, MemberOptions())[0].parameters[0].value_m == 0.14


@pytest.mark.parametrize("inner", [("LEFT", "RIGHT"), ("TOP",)])
def test_a_wall_that_is_not_told_and_has_an_inner_face_on_some_sides_only_is_one_face(inner):
    seen = {f"{side}_OUTER": 1.0 for side in ("BOTTOM", "RIGHT", "TOP", "LEFT")} | {
        f"{side}_INNER": float(side in inner) for side in ("LEFT", "TOP", "RIGHT", "BOTTOM")
    }
    tube = untold_wall(made("RHS", 1.2, {"h": 0.14, "b": 0.09, "t": 0.003}, sigma=2e-3, std=1e-5))
    t = tube.parameters[2]
    tube = dataclasses.replace(tube, seen=seen, parameters=(*tube.parameters[:2], dataclasses.replace(t, spread_m=1e-4), tube.parameters[3]))
    told = honest(outer_faces(4_000, 5, (2e-3, 3e-3)), tube, MemberOptions())[0]
    assert told.parameters[0].value_m == pytest.approx(0.1385) and told.parameters[2].spread_m is None
    whole = dataclasses.replace(tube, seen=dict.fromkeys(seen, 1.0))
    assert honest(outer_faces(4_000, 5, (2e-3, 3e-3)), whole, MemberOptions())[0].parameters[0].value_m == 0.14
