"""Sums in one pass against the point by point density, which is tested on its own; slopes against differences."""

import numpy as np
import pytest

from scan2fea.estimation.likelihood import Layout, model_of
from scan2fea.kernel.noise_kernels import KERNELS, bell_and_tail
from scan2fea.kernel.round_sums import bessel_at
from scan2fea.kernel.section_likelihood import faces
from scan2fea.kernel.section_sums import SLOPE, VALUE
from scan2fea.kernel.sections import ROUND

VALUES = {"L": [0.13, 0.1, 0.01], "I": [0.2, 0.1, 0.006, 0.009], "C": [0.16, 0.07, 0.008, 0.01], "T": [0.1, 0.12, 0.01, 0.012],
          "RHS": [0.15, 0.1, 0.008], "rect": [0.12, 0.02], "CHS": [0.17, 0.01], "round": [0.06]}  # fmt: skip
CURVES = [{}, {"tilt": True}, {"tilt": True, "n_bow": 3, "n_twist": 1}, {"n_twist": 2}]


def case(family, noise, curve, free, seed=0, n=400):
    rng = np.random.default_rng(seed)
    layout = Layout(family=family, free_faces=faces(family)[1:3] if free and family not in ROUND else (), **curve)
    points = np.c_[rng.uniform(-0.15, 0.2, (n, 2)), rng.uniform(0, 2, n)]
    weight = rng.uniform(0.2, 2.0, len(faces(family))) if free else None
    model = model_of(points, layout, (0.0, 2.0), noise=noise, face_weight=weight)
    theta = rng.normal(0, 0.01, len(layout.names))
    theta[: layout.n_values] = VALUES[family]
    theta[layout.place["log_sigma"]], theta[layout.place["logit_outliers"]] = np.log(rng.choice([0.0003, 0.004, 0.03])), -4.0
    return model, theta


@pytest.mark.parametrize("noise", KERNELS)
@pytest.mark.parametrize("family", VALUES)
def test_sums_are_those_of_the_points(family, noise):
    for k, curve in enumerate(CURVES):
        model, theta = case(family, noise, curve, free=k % 2 == 1, seed=k)
        logp, scores = model.evaluate(theta)
        total, slope, information = model.sums(theta)
        assert total == pytest.approx(logp.sum(), rel=1e-11)
        assert np.allclose(slope, scores.sum(0), rtol=1e-9, atol=1e-10 * np.abs(scores).max() * len(logp))
        assert np.allclose(information, scores.T @ scores, rtol=1e-9, atol=1e-11 * information.max())
        assert model.sums(theta, VALUE)[0] == total and np.array_equal(model.sums(theta, SLOPE)[1], slope)


@pytest.mark.parametrize("family", VALUES)
def test_the_slope_is_that_of_differences(family):
    model, theta = case(family, "gaussian", {"tilt": True, "n_bow": 1, "n_twist": 1}, free=True, seed=5)
    theta[model.layout.place["log_sigma"]] = np.log(0.01)
    slope = model.sums(theta)[1]
    for i in range(len(theta)):
        step = np.zeros(len(theta))
        step[i] = 1e-6
        numeric = (model.sums(theta + step)[0] - model.sums(theta - step)[0]) / 2e-6
        assert slope[i] == pytest.approx(numeric, rel=1e-5, abs=1e-4 * np.abs(slope).max())


def test_no_section_is_minus_infinity():
    for bad in ([0.1, 0.1, 0.1], [0.1, -0.1, 0.01], [np.nan, 0.1, 0.01], [0.0, 0.1, 0.01]):
        model, theta = case("L", "gaussian", {}, free=False)
        theta[:3] = bad
        assert model.sums(theta)[0] == -np.inf


def test_levels_of_many_starts_are_those_of_each():
    for family in ("T", "CHS"):
        model, theta = case(family, "uniform", {}, free=False)
        starts = theta + np.random.default_rng(3).normal(0, 0.002, (20, len(theta)))
        assert np.allclose(model.levels(starts), [model.evaluate(one)[0].sum() for one in starts], rtol=1e-11)


def test_points_far_off_are_strays_alone():
    model, theta = case("L", "gaussian", {}, free=False, n=1000)
    far = model_of(np.c_[model.xy + 100.0, np.zeros(len(model.xy))], model.layout, (-1.0, 1.0), area_m2=2.0)
    eps = model.layout.outlier_share(theta)
    total, slope, _ = far.sums(theta)
    assert total == pytest.approx(1000 * np.log(eps / 2.0), rel=1e-12)
    assert slope[model.layout.place["logit_outliers"]] == pytest.approx(1000 * (1 - eps)) and not slope[:6].any()


def test_the_tail_table_is_the_error_function():
    from scipy.special import erfc

    x = np.r_[np.linspace(-9, 9, 4001), 0.0, 20.0, 37.0]
    found = np.array([bell_and_tail(v) for v in x])
    assert np.allclose(found[:, 1], 0.5 * erfc(x / np.sqrt(2)), rtol=1e-13 * 5, atol=0)
    assert np.allclose(found[:, 0], np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi), rtol=1e-14, atol=0)


def test_the_bessel_table_is_the_functions():
    from scipy.special import i0e, i1e

    x = np.r_[0.0, np.logspace(-6, 2.5, 500)]
    found = np.array([bessel_at(v) for v in x])
    assert np.allclose(found[:, 0], i0e(x), rtol=1e-14, atol=0) and np.allclose(found[:, 1], 1 - i1e(x) / i0e(x), rtol=1e-12, atol=0)
    far = np.logspace(4, 9, 50)
    found = np.array([bessel_at(v) for v in far])
    assert np.allclose(found[:, 0], i0e(far), rtol=1e-14, atol=0) and np.allclose(found[:, 1], 0.5 / far + 0.125 / far**2, rtol=1e-8, atol=0)


def test_circles_without_a_section_are_minus_infinity():
    for bad in ([0.1, 0.05], [-0.1, 0.01], [np.nan, 0.01]):
        model, theta = case("CHS", "gaussian", {}, free=False)
        theta[:2] = bad
        assert model.sums(theta)[0] == -np.inf
