"""Covariance: the information's inverse, what the data do not tell, and the sandwich where the model is wrong."""

import numpy as np

from scan2fea.estimation.scoring import maximise, summed
from scan2fea.estimation.uncertainty import covariance_of, uncertainty


def mean_only(data, sd=1.0):
    """The mean of a normal law whose sd is taken to be `sd`."""

    def evaluate(theta):
        z = (data - theta[0]) / sd
        return -0.5 * z**2, (z / sd)[:, None]

    return evaluate


def test_inverse_where_all_is_told():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(5, 5))
    matrix = a @ a.T * np.outer([1, 1e3, 1e-3, 1, 1], [1, 1e3, 1e-3, 1, 1])
    covariance, told, rank = covariance_of(matrix, np.ones(5, bool))
    assert told.all() and rank == 5 and np.allclose(covariance @ matrix, np.eye(5), atol=1e-6)


def test_what_is_fixed_or_blind_is_zero():
    matrix = np.diag([4.0, 0.0, 9.0, 1.0])
    covariance, told, rank = covariance_of(matrix, np.array([True, True, True, False]))
    assert told.tolist() == [True, False, True, False] and rank == 2
    assert np.allclose(np.diag(covariance), [0.25, 0, 1 / 9, 0])


def test_only_a_sum_is_told():
    """Two unknowns of which the data know the sum, and a third: the two are not told, the third is."""
    matrix = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 4.0]])
    covariance, told, rank = covariance_of(matrix, np.ones(3, bool))
    assert told.tolist() == [False, False, True] and rank == 2
    assert covariance[0, 0] == 0 and covariance[2, 2] == 0.25


def test_the_sandwich_knows_a_wrong_sd():
    """The mean of data with sd 3 under a model that says 1: the sandwich says 3 / sqrt n, the information would say less."""
    data = np.random.default_rng(1).normal(0, 3, 4000)
    evaluate = mean_only(data)
    found = maximise(summed(evaluate), np.zeros(1), scale=np.ones(1), lower=np.full(1, -9.0), upper=np.full(1, 9.0), tolerance=1e-9)
    trust = uncertainty(summed(evaluate), found.theta, np.ones(1, bool))
    assert np.isclose(trust.covariance[0, 0] ** 0.5, 3 / 4000**0.5, rtol=0.05)
    assert np.isclose(trust.misfit[0], 9, rtol=0.05)  # the scores' products say 1 / (3 sqrt n)


def test_a_true_model_has_no_misfit():
    data = np.random.default_rng(2).normal(0, 1, 4000)
    trust = uncertainty(summed(mean_only(data)), np.array([data.mean()]), np.ones(1, bool))
    assert abs(trust.misfit[0] - 1) < 0.05 and np.isclose(trust.covariance[0, 0], 1 / 4000, rtol=0.05)


def test_a_subsample_counts_for_all():
    data = np.random.default_rng(3).normal(0, 1, 4000)
    part = uncertainty(summed(mean_only(data[:1000])), np.array([data[:1000].mean()]), np.ones(1, bool), weight=4.0)
    assert np.isclose(part.covariance[0, 0], 1 / 4000, rtol=0.1)


def test_coverage_of_the_intervals():
    """95 % intervals of the mean under a wrong sd hold it in 95 % of 400 draws (within 3 sd of the binomial)."""
    held = 0
    for seed in range(400):
        data = np.random.default_rng(seed).normal(0, 2, 200)
        trust = uncertainty(summed(mean_only(data)), np.array([data.mean()]), np.ones(1, bool))
        held += abs(data.mean()) < 1.96 * trust.covariance[0, 0] ** 0.5
    assert 0.91 < held / 400 < 0.985
