"""The likelihood of an edge against the intensity written out and a general optimiser over its rates."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize
from scipy.stats import norm

from scan2fea.kernel.edge_density import edge_levels


def intensity(z, edge, s, rho, ratio, b):
    return rho * norm.cdf((z - edge) / s) + ratio * rho * norm.pdf((z - edge) / s) / s + b


@pytest.mark.parametrize("ratio", [0.0, 0.05])
@pytest.mark.parametrize("edge", [-0.02, 0.0, 0.03])
def test_it_is_the_poisson_likelihood_at_its_best_rates(edge, ratio):
    rng = np.random.default_rng(4)
    low, high, s = -0.5, 0.5, 0.02
    z = np.r_[rng.uniform(0, 0.6, 300), rng.uniform(-0.5, 0.5, 20)] + s * rng.standard_normal(320)
    z = z[(z > low) & (z < high)]
    level, rates = edge_levels(z, np.ones(len(z)), low, high, s, np.array([edge]), ratio, 0.5)

    # the intensity is linear in its rates: one integral is its mass at all of them
    each = intensity(z, edge, s, 1.0, ratio, 0.0)
    mass = quad(lambda x: intensity(x, edge, s, 1.0, ratio, 0.0), low, high, points=[edge], epsabs=1e-11, epsrel=1e-11, limit=200)[0]

    def minus(log_rates):
        rho, b = np.exp(log_rates)
        return rho * mass + b * (high - low) - np.log(rho * each + b).sum()

    best = minimize(minus, np.log([500.0, 20.0]), method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9, "maxiter": 2000})
    assert level[0] == pytest.approx(-best.fun, abs=1e-3)  # the mass beyond the window's upper side is left out
    assert rates[:, 0] == pytest.approx([np.exp(best.x[0]), ratio * np.exp(best.x[0]), np.exp(best.x[1])], rel=2e-3)


def test_counts_stand_for_points_and_clutter_is_bounded():
    z = np.array([0.1, 0.1, 0.1, 0.2, 0.3, -0.4])
    place, count = np.unique(z, return_counts=True)
    edges = np.linspace(-0.3, 0.3, 7)
    one = edge_levels(z, np.ones(len(z)), -0.5, 0.5, 0.01, edges, 0.0, 0.5)
    other = edge_levels(place, count.astype(float), -0.5, 0.5, 0.01, edges, 0.0, 0.5)
    assert np.allclose(one[0], other[0]) and np.allclose(one[1], other[1])
    assert (one[1][2] <= 0.5 * one[1][0] * (1 + 1e-9)).all()


def test_where_clutter_is_bounded_the_bound_is_reached():
    """Far within the member as much lies before the edge as behind: the share is at its bound, and each edge is told alone as among others."""
    z = np.random.default_rng(1).uniform(-0.5, 0.5, 2000)
    edges = np.linspace(-0.4, 0.4, 9)
    level, rates = edge_levels(z, np.ones(len(z)), -0.5, 0.5, 0.01, edges, 0.0, 0.5)
    assert rates[2] == pytest.approx(0.5 * rates[0], rel=1e-9)
    alone = np.array([edge_levels(z, np.ones(len(z)), -0.5, 0.5, 0.01, edges[k : k + 1], 0.0, 0.5)[0][0] for k in range(9)])
    assert level == pytest.approx(alone, abs=1e-8)
