"""Corners that noise left empty: short faces are then known to the noise alone, and long ones as before."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from estimation.made import SIZES, made
from scan2fea.estimation.corner_noise import beyond_corners, doubted_for_corners
from scan2fea.simulation.member import MemberScanOptions, member_points

STRAIGHT = ("L", "I", "C", "T", "RHS", "rect")
N = 20_000


def scanned(family, noise="gaussian", seed=2, of_wall=0.3):
    """A member and points (n, 2) of its sides under noise that is alike in all directions."""
    sigma = of_wall * min(SIZES[family].values())
    member = made(family, sigma=sigma)
    points = member_points(family, member.values(), N, MemberScanOptions(noise_m=sigma, noise=noise, seed=seed))
    return member, points[:, :2]


def across_each_face(member, u, seed=3):
    """(n, 2) points of the same faces, each moved across its own alone."""
    flat = dataclasses.replace(member, sigma_m=1e-9)
    on = member_points(member.family, flat.values(), N, MemberScanOptions(noise_m=0.0, seed=seed))[:, :2]
    rng = np.random.default_rng(seed)
    lines = np.unique(np.round(on, 9)[:, 0]), np.unique(np.round(on, 9)[:, 1])
    counts = [np.array([(np.abs(on[:, k] - line) < 1e-8).sum() for line in lines[k]]) for k in (0, 1)]
    is_x = np.isin(np.round(on[:, 0], 9), lines[0][counts[0] > 20])
    on[np.arange(N), np.where(is_x, 0, 1)] += rng.normal(0, member.sigma_m, N)
    return on


@pytest.mark.parametrize("family", STRAIGHT)
@pytest.mark.parametrize("noise", ["gaussian", "uniform", "laplace"])
def test_noise_alike_in_all_directions_fills_corners(family, noise) -> None:
    member, u = scanned(family, noise)
    found, expected = beyond_corners(u, member)
    assert found > 0.6 * expected - 2 * np.sqrt(expected)
    assert doubted_for_corners(u, member) is member


def test_the_share_is_that_of_gaussian_noise() -> None:
    member, u = scanned("rect", of_wall=0.05)
    found, expected = beyond_corners(u, member)
    assert found == pytest.approx(expected, rel=4 / np.sqrt(expected))


@pytest.mark.parametrize("family", STRAIGHT)
def test_noise_across_each_face_leaves_them_empty(family) -> None:
    member, u = scanned(family)
    doubted = doubted_for_corners(across_each_face(member, u), member)
    assert doubted is not member
    std = {p.name: p.std_m for p in doubted.parameters}
    thin = "tw" if family in "ICT" else "t"
    assert std["length"] == 1e-4
    assert std[thin] < 0.5 * member.sigma_m  # its faces are long
    if family in "ICTL":  # a toe stands between two corners
        assert std["b"] > 0.6 * member.sigma_m
    assert np.allclose(np.sqrt(np.diag(doubted.covariance)), [p.std_m for p in doubted.parameters])


def test_few_points_and_little_noise_say_nothing() -> None:
    member, u = scanned("T")
    empty = across_each_face(member, u)
    assert doubted_for_corners(empty[:60], member) is member
    quiet = dataclasses.replace(member, sigma_m=1e-6)
    told = doubted_for_corners(np.empty((0, 2)), quiet)
    assert told is quiet
