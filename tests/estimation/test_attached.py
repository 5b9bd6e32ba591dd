"""Points off a member that lie on a surface of their own: a few per cent of them deny the member, as clutter does not."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.made import made
from scan2fea.estimation.attached import attached, sunk
from scan2fea.estimation.explain import MAX_ATTACHED, explanation
from scan2fea.kernel.transforms import rotation_about
from scan2fea.simulation.member import MemberScanOptions, member_points

N = 12_000
PLATE = (0.04, 0.08, 0.0)  # m, a plate in the tube of `made.SIZES`, across it


def scanned(family, sigma, clutter=0.0, seed=4):
    member = made(family, sigma=sigma)
    return member, member_points(family, member.values(), N, MemberScanOptions(noise_m=sigma, caps=True, clutter=clutter, seed=seed))


def plate(n, sigma, size=PLATE, at=(0.0, 0.0, 0.4), seed=5):
    """(n, 3) points of a flat rectangle."""
    rng = np.random.default_rng(seed)
    return np.asarray(at) + rng.uniform(-0.5, 0.5, (n, 3)) * size + rng.normal(0, sigma, (n, 3))


def ball(n, radius, at, seed=6):
    rng = np.random.default_rng(seed)
    way = rng.standard_normal((n, 3))
    return np.asarray(at) + radius * rng.random((n, 1)) ** (1 / 3) * way / np.linalg.norm(way, axis=1)[:, None]


@pytest.mark.parametrize("sheets", [1, 2])
def test_a_diaphragm_in_a_tube_denies_it(sheets) -> None:
    member, points = scanned("RHS", 5e-4)
    inside = [plate(400 // sheets, 5e-4, at=(0.0, 0.0, 0.4 + 0.006 * i), seed=i) for i in range(sheets)]
    told = explanation(np.concatenate([points, *inside]), member, member.sigma_m)
    assert told.attached_share == pytest.approx(400 / (N + 400), rel=0.15)
    assert "surfaces of their own" in told.reason
    assert explanation(points, member, member.sigma_m).attached_share == 0


def test_a_diaphragm_of_less_than_the_limit_is_let_pass() -> None:
    member, points = scanned("RHS", 5e-4)
    told = explanation(np.concatenate([points, plate(100, 5e-4)]), member, member.sigma_m)
    assert told.attached_share < MAX_ATTACHED
    assert told.explains


@pytest.mark.parametrize("share", [0.0075, 0.05])
def test_points_inside_a_bar_are_of_its_slots(share) -> None:
    """A bar of aluminium with grooves, seen from without stations, had been told as a full one (+26 % of its volume)."""
    member, points = scanned("round", 5e-4)
    length, d, n = member.values()["length"], member.values()["d"], int(share * N)
    within = np.random.default_rng(7).uniform([-0.25 * d, -0.25 * d, 0.1], [0.25 * d, 0.25 * d, length - 0.1], (n, 3))
    told = explanation(np.concatenate([points, within]), member, member.sigma_m)
    assert told.sunk_share == pytest.approx(n / (N + n), rel=0.02)
    assert told.explains == (share < MAX_ATTACHED)
    assert told.explains or "where nothing can be seen" in told.reason
    either_side = np.concatenate([within[: n // 2], within[: n // 2] + [0.85 * d, 0.0, 0.0]])
    assert explanation(np.concatenate([points, either_side]), member, member.sigma_m).sunk_share < MAX_ATTACHED / 2


def test_clutter_that_ends_close_to_a_bar_is_of_no_slots() -> None:
    """15 % of the points spread evenly over a box an eighth wider than the bar: more of it inside than beside."""
    member = made("rect", values={"b": 0.1, "t": 0.03})
    points = member_points("rect", member.values(), N, MemberScanOptions(noise_m=5e-4, caps=True, seed=4))
    low, high = points.min(axis=0), points.max(axis=0)
    strays = np.random.default_rng(7).uniform(low - (high - low) / 8, high + (high - low) / 8, (round(0.15 * N / 0.85), 3))
    assert explanation(np.concatenate([points, strays]), member, member.sigma_m).sunk_share < MAX_ATTACHED
    assert sunk(np.full(40, -0.01), 1e-3, np.repeat([-0.01, 0.005], [90, 10])) == 40  # no room beside it: nothing is known of clutter


@pytest.mark.parametrize("family", ["L", "I", "C", "T", "RHS", "CHS", "rect", "round"])
@pytest.mark.parametrize("seed", [0, 1])
def test_clutter_lies_on_no_surface(family, seed) -> None:
    """Neither spread evenly, 15 % of the points, nor gathered in a ball."""
    member, points = scanned(family, 1e-3, 0.15, seed)
    told = explanation(points, member, member.sigma_m)
    assert max(told.attached_share, told.sunk_share) < MAX_ATTACHED
    gathered = ball(300, 0.03, (0.09, 0.02, 0.5), seed)
    assert attached(gathered, np.full(len(gathered), 0.05), 1e-3, 0.15, N / 0.3, 0.01) == 0


def test_what_lies_near_the_member_is_a_fillet_or_a_dent() -> None:
    points = plate(400, 5e-4)
    assert attached(points, np.full(400, 0.005), 5e-4, 0.12, 4e4, 0.01) == 0
    assert attached(points, np.full(400, 0.02), 5e-4, 0.12, 4e4, 0.01) > 350


def test_thin_points_in_wide_noise_and_few_of_them_say_nothing() -> None:
    points = plate(400, 5e-4)
    assert attached(points, np.full(400, 0.2), 0.01, 0.12, 4e4, 0.01) == 0
    assert attached(points[:8], np.full(8, 0.02), 5e-4, 0.12, 4e4, 0.01) == 0
    assert attached(np.empty((0, 3)), np.empty(0), 5e-4, 0.12, 4e4, 0.01) == 0


def test_turned_with_the_points() -> None:
    points, R = plate(400, 5e-4), rotation_about((1, 2, 3), 0.7)
    off = np.full(400, 0.02)
    assert attached(points @ R.T, off, 5e-4, 0.12, 4e4, 0.01) == attached(points, off, 5e-4, 0.12, 4e4, 0.01)
