"""Coordinates that were rounded to whole steps."""

from __future__ import annotations

import numpy as np
import pytest

from scan2fea.kernel.coordinate_steps import coordinate_step, rounding_std

RANDOM = np.random.default_rng(0).random((4000, 3)) * [1.0, 0.4, 0.2] + [500_123.2, 5_400_321.5, 312.0]


@pytest.mark.parametrize("step", [1e-3, 2.5e-4, 0.01])
def test_the_step_is_found_whatever_the_origin(step):
    assert coordinate_step(np.round(RANDOM / step) * step, 0.05) == pytest.approx(step, rel=1e-4)


def test_what_was_not_rounded_has_no_step_that_counts():
    assert coordinate_step(RANDOM - RANDOM[0], 0.05) < 1e-8
    grid = np.stack(np.meshgrid(*[np.arange(20) * 0.05] * 2, [0.0]), -1).reshape(-1, 3)
    assert coordinate_step(grid, 0.05) == 0.0  # drawn on a lattice as wide as the points are apart
    turned = np.round(RANDOM - RANDOM[0], 3) @ np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    assert coordinate_step(turned, 0.05) < 1e-6


@pytest.mark.parametrize("noise", [0.0, 0.2, 0.3, 0.6])
def test_the_mean_of_rounded_draws_is_off_by_as_much_as_told(noise):
    rng = np.random.default_rng(2)
    places = rng.random(400)
    off = [np.round(place + noise * rng.normal(size=4000)).mean() - place for place in places]
    chance = max(noise, 0.3) / np.sqrt(4000)
    assert np.hypot(rounding_std(1.0, noise), chance) == pytest.approx(np.std(off), rel=0.3)
