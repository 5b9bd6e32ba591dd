"""The likelihood of an edge in counts of cells against its definition, the share of strays found by a search."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.special import ndtr

from scan2fea.kernel.counted_edge import counted_levels

BOUNDS = np.arange(-8.0, 6.05, 0.1)
PLACES = np.array([-1.0, 0.0, 0.5])


@pytest.mark.parametrize("height", [0.0, 0.7])
def test_it_is_the_likelihood_at_the_likeliest_share_of_strays(height):
    middles = 0.5 * (BOUNDS[1:] + BOUNDS[:-1])
    step = ndtr(PLACES[:, None] - middles) * 0.1
    hump = np.diff(ndtr(BOUNDS - PLACES[:, None]), axis=1)
    rng = np.random.default_rng(3)
    mean = 200 * (step[1] + 0.7 * hump[1]) + 0.4
    counts = rng.poisson(mean).astype(float)
    found = counted_levels(step, hump, height, counts, 400)
    for i in range(len(PLACES)):
        mass = np.maximum(step[i] + height * hump[i], 1e-12)
        mass /= mass.sum()
        minus = lambda q, m=mass: -(counts @ np.log(q / len(m) + (1 - q) * m))  # noqa: E731
        best = minimize_scalar(minus, bounds=(0, 1), method="bounded", options={"xatol": 1e-9})
        assert found[i] == pytest.approx(-best.fun, abs=1e-3)
    if height > 0:
        assert int(np.argmax(found)) == 1
