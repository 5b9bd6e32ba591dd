import numpy as np
import pytest
from scipy import stats

from scan2fea.simulation.noise import NoiseOptions, disturbed

N = 40_000
RNG = np.random.default_rng(0)
DIRECTION = RNG.standard_normal((N, 3))
DIRECTION /= np.linalg.norm(DIRECTION, axis=1, keepdims=True)
RANGE = RNG.uniform(2.0, 50.0, N)
ONE = np.ones(N)


def run(seed=1, cosine=ONE, shine=ONE, range_m=RANGE, more=0.0, **options):
    return disturbed(range_m, DIRECTION, cosine, shine, NoiseOptions(**options), np.random.default_rng(seed), more)


def is_drawn_from(sample, distribution):
    return stats.kstest(sample, distribution).pvalue > 0.01


def test_gaussian_along_the_ray():
    got = run(noise_m=0.02)
    off = got.range_m - RANGE
    assert is_drawn_from(off, stats.norm(0, 0.02).cdf)
    assert not is_drawn_from(off, stats.norm(0, 0.021).cdf)  # the test tells 5 % of deviation
    assert abs(off.std() / 0.02 - 1) < 0.01
    assert (got.offset_m == 0).all()
    assert (got.sigma_along_m == 0.02).all()
    assert (got.sigma_across_m == 0).all()


def test_uniform_along_the_ray():
    got = run(noise="uniform", noise_m=0.02)
    off = got.range_m - RANGE
    assert np.abs(off).max() <= 0.02
    assert is_drawn_from(off, stats.uniform(-0.02, 0.04).cdf)
    np.testing.assert_allclose(got.sigma_along_m, 0.02 / np.sqrt(3))
    assert abs(off.std() / got.sigma_along_m[0] - 1) < 0.02


@pytest.mark.parametrize("noise", ["gaussian", "uniform"])
def test_isotropic_is_the_same_along_every_axis(noise):
    got = run(noise=noise, noise_m=0.02, noise_along="isotropic")
    moved = (got.range_m - RANGE)[:, None] * DIRECTION + got.offset_m
    law = stats.norm(0, 0.02) if noise == "gaussian" else stats.uniform(-0.02, 0.04)
    for axis in range(3):
        assert is_drawn_from(moved[:, axis], law.cdf)
    correlation = np.corrcoef(moved.T)
    assert np.abs(correlation - np.eye(3)).max() < 0.02
    assert np.abs(np.einsum("nc,nc->n", got.offset_m, DIRECTION)).max() < 1e-15
    np.testing.assert_array_equal(got.sigma_along_m, got.sigma_across_m)


def test_noise_grows_with_the_range():
    got = run(noise_m=0.003, noise_per_m=0.001)
    sigma = np.hypot(0.003, 0.001 * RANGE)
    assert is_drawn_from((got.range_m - RANGE) / sigma, "norm")
    for low in (2, 14, 26, 38):
        part = (low <= RANGE) & (low + 12 > RANGE)
        assert is_drawn_from(((got.range_m - RANGE) / sigma)[part], "norm")
    np.testing.assert_allclose(got.sigma_along_m, sigma)
    more = run(noise_m=0.003, more=0.004 * ONE)
    np.testing.assert_allclose(more.sigma_along_m, 0.005)
    assert is_drawn_from((more.range_m - RANGE) / 0.005, "norm")


def test_outliers_have_their_share_and_law_and_leave_the_others_alone():
    clean, got = run(noise_m=0.001), run(noise_m=0.001, outlier_share=0.1, outlier_m=0.5)
    share = stats.binomtest(int(got.is_false.sum()), N, 0.1)
    assert share.pvalue > 0.01
    assert is_drawn_from((got.range_m - RANGE)[got.is_false], stats.uniform(-0.5, 1.0).cdf)
    np.testing.assert_array_equal(got.range_m[~got.is_false], clean.range_m[~got.is_false])


def test_quantised_ranges_are_multiples_and_lose_no_more_than_half_a_step():
    got = run(quantum_m=0.004)
    steps = got.range_m / 0.004
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert is_drawn_from(got.range_m - RANGE, stats.uniform(-0.002, 0.004).cdf)
    np.testing.assert_allclose(got.sigma_along_m, 0.004 / np.sqrt(12))


def test_grazing_surfaces_drop_out_at_the_limit():
    cosine = np.cos(np.radians([59.999, 60.0, 60.001]))
    got = disturbed(np.full(3, 5.0), DIRECTION[:3], cosine, ONE[:3], NoiseOptions(max_incidence_deg=60.0), np.random.default_rng(0))
    assert np.isfinite(got.range_m).tolist() == [True, True, False]


def test_half_the_returns_are_lost_at_the_detection_range_and_light_surfaces_carry_farther():
    at = np.full(N, 20.0)
    lost = [
        np.isnan(run(range_m=at, shine=ONE * rho, cosine=ONE * c, detection_m=20.0).range_m).mean()
        for rho, c in ((0.1, 1), (0.2, 0.5), (0.3, 1), (0.05, 1))
    ]
    assert stats.binomtest(round(lost[0] * N), N, 0.5).pvalue > 0.01
    assert stats.binomtest(round(lost[1] * N), N, 0.5).pvalue > 0.01  # a lighter surface at a slant sends as much
    assert lost[2] == 0
    assert lost[3] > 0.999
    twice = run(range_m=2 * at, shine=ONE * 0.4, detection_m=20.0)  # four times the light at twice the range
    assert stats.binomtest(int(np.isnan(twice.range_m).sum()), N, 0.5).pvalue > 0.01


def test_misses_stay_misses_and_nothing_falls_behind_the_lens():
    got = disturbed(np.array([np.nan, 0.01]), DIRECTION[:2], ONE[:2], ONE[:2], NoiseOptions(noise_m=0.0), np.random.default_rng(0))
    assert np.isnan(got.range_m[0])
    near = run(range_m=np.full(N, 0.01), noise_m=0.02)
    assert np.nanmin(near.range_m) > 0
    assert np.isnan(near.range_m).mean() == pytest.approx(stats.norm.cdf(-0.5), abs=0.01)


def test_same_seed_same_bytes():
    a, b, c = run(noise_m=0.02, outlier_share=0.1), run(noise_m=0.02, outlier_share=0.1), run(seed=2, noise_m=0.02, outlier_share=0.1)
    assert a.range_m.tobytes() == b.range_m.tobytes() != c.range_m.tobytes()
