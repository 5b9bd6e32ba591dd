"""Toes under noise along a wall that differs from that across it: known no better than by how far off other blurs put them."""

import dataclasses

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.toe_noise import doubted_for_toes

B, T, SIGMA, LENGTH = 0.1, 0.008, 2e-3, 0.8


def flat(n, seed, along):
    """(n, 3) points on the sides of a flat, of noise SIGMA off the wide sides and off the narrow ones, `along` that along the wide sides."""
    rng = np.random.default_rng(seed)
    is_wide = rng.random(n) < B / (B + T)
    side, at = rng.choice([-0.5, 0.5], n), rng.uniform(-0.5, 0.5, n)
    x, y = np.where(is_wide, at * B, side * B), np.where(is_wide, side * T, at * T)
    noise = rng.standard_normal((n, 2)) * SIGMA * np.column_stack([np.where(is_wide, along, 1.0), np.where(is_wide, 1.0, along)])
    return np.column_stack([np.column_stack([x, y]) + noise, rng.uniform(0, LENGTH, n)])


def fitted(b, std=1e-4):
    return made("rect", LENGTH, {"b": b, "t": T}, sigma=SIGMA, std=std)


@pytest.mark.parametrize("seed", range(3))
def test_sharp_ends_widen_what_the_toes_tell_and_nothing_else(seed):
    member = fitted(B - 0.6 * SIGMA)  # where a fit under noise alike in all directions ends
    told = doubted_for_toes(flat(20_000, seed, 0.0), member)
    assert [p.value_m for p in told.parameters] == [p.value_m for p in member.parameters]
    assert 0.3 * SIGMA < told.parameters[0].std_m < 1.5 * SIGMA
    assert told.parameters[1].std_m == pytest.approx(1e-4, rel=0.2) and told.parameters[2].std_m == 1e-4
    assert np.diag(told.covariance)[:2] == pytest.approx([p.std_m**2 for p in told.parameters[:2]])


@pytest.mark.parametrize("seed", range(6))
def test_noise_alike_in_all_directions_changes_nothing(seed):
    member = fitted(B)
    assert doubted_for_toes(flat(12_000, seed, 1.0), member) is member


def test_toes_that_are_wide_unseen_or_of_a_tube_are_not_asked():
    points = flat(12_000, 0, 0.0)
    for member in (
        dataclasses.replace(fitted(B - 0.6 * SIGMA), sigma_m=1e-3),
        dataclasses.replace(fitted(B - 0.6 * SIGMA), seen={"LEFT": 0.0, "RIGHT": 0.0}),
        made("RHS", LENGTH, {"h": B, "b": 0.05, "t": T}, sigma=SIGMA),
    ):
        assert doubted_for_toes(points, member) is member
