"""Faces by least squares: circles under noise, whose points lie farther out than the circle on average."""

import numpy as np

from scan2fea.estimation.likelihood import Layout, model_of
from scan2fea.estimation.polish import polished

SIGMA, RADIUS = 0.0006, 0.03


def test_noise_along_a_circle_does_not_widen_it():
    """Uncorrected it would come out sigma^2 / radius = 0.012 mm too wide, whatever the number of points; their own error here is 0.002 mm."""
    rng = np.random.default_rng(5)
    n = 400_000
    angle = rng.uniform(0, 2 * np.pi, n)
    xy = RADIUS * np.stack([np.cos(angle), np.sin(angle)], 1) + SIGMA * rng.standard_normal((n, 2))
    layout = Layout(family="round")
    theta = np.array([2.02 * RADIUS, 1e-4, -1e-4, np.log(SIGMA), -6.0])
    found = polished(model_of(np.c_[xy, rng.uniform(0, 1, n)], layout, (0.0, 1.0), area_m2=1.0), theta, 2 * RADIUS)
    std = np.sqrt(found.covariance[0, 0])
    assert found.converged and std < 0.2 * SIGMA**2 / RADIUS
    assert abs(found.theta[0] - 2 * RADIUS) < 4 * std
