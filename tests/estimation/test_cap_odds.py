"""Bar or tube, by how many points lie at the ends of the core."""

import math

import pytest
from scipy.integrate import quad
from scipy.stats import poisson

from scan2fea.estimation.cap_odds import bar_log_odds
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.types import PointCloud, Scan


@pytest.mark.parametrize(("n_core", "n_elsewhere", "n_cap"), [(10, 8.95, 93.0), (3, 0.5, 4.0), (0, 0.1, 4.0), (50, 9.0, 93.0), (9, 9.0, 1.0)])
def test_they_are_those_of_any_part_of_a_cap(n_core, n_elsewhere, n_cap):
    third = n_cap / 3
    thin, scanned = (
        quad(lambda c: poisson.pmf(n_core, n_elsewhere + c), low, high, limit=200)[0] / (high - low) for low, high in ((0, third), (third, n_cap))
    )
    ratio = 0.3 + (0.1 * thin + 0.6 * scanned) / poisson.pmf(n_core, n_elsewhere)
    assert bar_log_odds(n_core, n_elsewhere, n_cap) == pytest.approx(math.log(ratio), abs=5e-3)


def test_a_few_points_more_than_strays_put_there_are_no_cap():
    """They spoke for a bar (its caps at their best), and half-hidden tubes whose rings were scanned were told as bars."""
    assert bar_log_odds(10, 8.95, 93.0) < math.log(0.4)
    assert bar_log_odds(60, 8.95, 93.0) == pytest.approx(50.0)


def test_caps_that_would_hold_nothing_say_nothing():
    assert bar_log_odds(0, 0.5, 0.0) == 0.0
    assert bar_log_odds(0, 0.5, 0.01) == pytest.approx(0.0, abs=0.01)


def test_an_empty_core_says_no_more_than_that_caps_were_not_scanned():
    assert bar_log_odds(0, 0.02, 93.0) == pytest.approx(math.log(0.3), abs=0.1)
    assert bar_log_odds(0, 1000.0, 1e5) == pytest.approx(math.log(0.3), abs=0.1)


@pytest.mark.parametrize(("noise_m", "seed"), [(0.0015, 2), (0.0045, 1)])
def test_three_faces_of_a_tube_and_its_rings_are_no_bar(noise_m, seed):
    """A bar with a belief of 0.999: one with a hidden face was never held against the tube, and six strays more than expected were its caps."""
    values = {"h": 0.15, "b": 0.1, "t": 0.008, "length": 1.6}
    seen = MemberScanOptions(noise_m=noise_m, clutter=0.15, caps=True, faces=("BOTTOM_OUTER", "LEFT_OUTER", "RIGHT_OUTER"), seed=seed)
    found = fit_member(Scan(cloud=PointCloud.of(member_points("RHS", values, 8_000, seen))), MemberOptions()).member
    assert found.family == "RHS" and found.families["rect"] > 0.2  # which of both stays open
    assert found.values()["b"] == pytest.approx(0.1, abs=5e-4)
