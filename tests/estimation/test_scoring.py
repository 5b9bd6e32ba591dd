"""The optimiser: the likelihood never falls, bounds and priors hold, the bound on the variance is reached."""

import numpy as np
import pytest

from scan2fea.estimation.scoring import maximise, summed

WIDE = np.full(2, np.inf)


def gaussian(data, trace=None):
    """Mean and log sd of a normal sample."""

    def evaluate(theta):
        mean, log_sd = theta
        z = (data - mean) / np.exp(log_sd)
        logp = -0.5 * z**2 - log_sd - 0.5 * np.log(2 * np.pi)
        if trace is not None:
            trace.append(float(logp.sum()))
        return logp, np.stack([z / np.exp(log_sd), z**2 - 1], 1)

    return evaluate


@pytest.fixture
def data():
    return np.random.default_rng(0).normal(3.0, 2.0, 5000)


@pytest.mark.parametrize("start", [(0.0, 0.0), (100.0, 3.0), (3.0, -4.0), (-40.0, -2.0)])
def test_finds_the_closed_form(data, start):
    found = maximise(summed(gaussian(data)), np.array(start), scale=np.ones(2), lower=-WIDE, upper=WIDE, max_iterations=200, tolerance=1e-9)
    assert found.converged
    assert np.allclose(found.theta, [data.mean(), np.log(data.std())], atol=1e-5)
    assert np.allclose(np.linalg.inv(found.information), np.diag([data.var() / 5000, 1 / 10_000]), rtol=0.1, atol=1e-5)


def test_likelihood_never_falls(data):
    kept = []
    for iterations in range(25):
        found = maximise(summed(gaussian(data)), np.array([60.0, -1.0]), scale=np.ones(2), lower=-WIDE, upper=WIDE, max_iterations=iterations)
        kept.append(found.log_likelihood)
    assert (np.diff(kept) >= 0).all() and kept[-1] > kept[0]


def test_bounds_hold_and_are_told(data):
    found = maximise(
        summed(gaussian(data)), np.array([0.0, 0.0]), scale=np.ones(2), lower=np.array([-5.0, -5.0]), upper=np.array([2.5, 5.0]), max_iterations=99
    )
    assert found.theta[0] == 2.5 and found.at_bound.tolist() == [True, False]
    assert found.theta[1] == pytest.approx(0.5 * np.log(((data - 2.5) ** 2).mean()), abs=1e-4)


def test_a_fixed_unknown_stays(data):
    found = maximise(summed(gaussian(data)), np.array([0.0, 1.0]), scale=np.ones(2), lower=np.array([-9.0, 1.0]), upper=np.array([9.0, 1.0]))
    assert found.theta[1] == 1.0 and found.at_bound.tolist() == [False, True]
    assert found.theta[0] == pytest.approx(data.mean(), abs=1e-3)


def test_prior_counts_as_data(data):
    some = data[:10]
    fixed = np.array([-np.inf, np.log(2.0)])
    found = maximise(
        summed(gaussian(some)), np.array([0.0, np.log(2.0)]), scale=np.ones(2), lower=fixed, upper=np.array([np.inf, np.log(2.0)]),
        prior=(np.array([0.0, 0.0]), np.array([0.5, np.inf])), tolerance=1e-12,
    )  # fmt: skip
    precision = 10 / 4 + 1 / 0.25
    assert found.theta[0] == pytest.approx(some.mean() * (10 / 4) / precision, abs=1e-4)
    assert found.log_posterior < found.log_likelihood


def test_parts_are_the_whole(data):
    whole = maximise(summed(gaussian(data)), np.zeros(2), scale=np.ones(2), lower=-WIDE, upper=WIDE)
    parts = maximise(summed(gaussian(data[:1000]), gaussian(data[1000:])), np.zeros(2), scale=np.ones(2), lower=-WIDE, upper=WIDE)
    assert np.allclose(whole.theta, parts.theta, atol=1e-10) and np.allclose(whole.information, parts.information)


def test_an_impossible_start_comes_back():
    def never(theta):
        return np.full(3, -np.inf), np.zeros((3, 1))

    found = maximise(summed(never), np.array([1.0]), scale=np.ones(1), lower=np.array([-9.0]), upper=np.array([9.0]))
    assert not found.converged and found.theta[0] == 1.0 and found.n_iterations == 0
