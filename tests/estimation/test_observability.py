"""The gate before a thickness is reported; points on its thresholds."""

import pytest

from scan2fea.estimation.observability import CALIBRATED, KERNEL_SPREAD, observable, thickness_observable


@pytest.mark.parametrize(("t", "ok"), [(0.0041, True), (0.0040, False), (0.0039, False)])
def test_resolved_from_two_sigma(t, ok):
    assert thickness_observable(t, 1e-4, 0.002)[0] is ok


@pytest.mark.parametrize(("std", "ok"), [(0.00249, True), (0.0025, False), (0.0, False)])
def test_a_quarter_of_it_is_too_much(std, ok):
    assert thickness_observable(0.01, std, 0.001)[0] is ok


def test_a_calibrated_noise_opens_the_gate():
    """dsigma / sigma < 0.025 (t / sigma)^2: 2.2 % at 6.7 mm, 0.25 % at 20 mm for the wall of 6.35 (shape-estimation.md)."""
    t = 0.00635
    for sigma, limit in ((0.0067, 0.0225), (0.020, 0.0025)):
        assert CALIBRATED * (t / sigma) ** 2 == pytest.approx(limit, rel=0.02)
        assert thickness_observable(t, 1e-4, sigma, sigma_error=0.9 * limit)[0]
        assert not thickness_observable(t, 1e-4, sigma, sigma_error=1.1 * limit)[0]
        assert not thickness_observable(t, 1e-4, sigma)[0]


def test_laws_that_agree_open_the_gate():
    assert thickness_observable(0.006, 1e-4, 0.004, kernel_spread_m=0.0005)[0]
    assert not thickness_observable(0.006, 1e-4, 0.004, kernel_spread_m=KERNEL_SPREAD * 0.006)[0]


def test_each_dimension_has_its_verdict_and_its_reason():
    found = observable("L", {"a": 0.1, "b": 0.1, "t": 0.006}, {"a": 0.001, "b": 0.03, "t": 0.0001}, 0.01)
    assert found["a"] == (True, "")
    assert found["b"][0] is False and "quarter" in found["b"][1]
    assert found["t"][0] is False and "law of the noise" in found["t"][1]
    assert observable("RHS", {"h": 0.1, "b": 0.1, "t": 0.006}, {"h": 0.001, "b": 0.001, "t": 0.0}, 0.001)["t"] == (
        False,
        "the points do not depend on it",
    )


def test_solid_sections_have_no_walls():
    assert observable("rect", {"b": 0.1, "t": 0.004}, {"b": 0.001, "t": 0.0001}, 0.01)["t"][0]
