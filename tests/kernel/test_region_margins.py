"""Densities around regions against the definition: each region grown step by step on its own."""

import numpy as np
import pytest
from scipy import ndimage

from scan2fea.kernel.region_margins import region_margins


def by_definition(label, n_regions, one, other, own, reach):
    cells, density = [], []
    for region in range(1, n_regions + 1):
        inside = label == region
        beside = ndimage.binary_dilation(inside, iterations=reach) & ~inside & own
        cells.append(int(inside.sum()))
        density.append(float(one[beside].mean() + other[beside].mean()) if beside.any() else 0.0)
    return cells, density


@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.9])
@pytest.mark.parametrize("reach", [1, 2])
def test_they_are_those_of_the_definition(share, reach) -> None:
    rng = np.random.default_rng(7)
    for shape in ((1, 40), (30, 1), (23, 61)):
        label, n_regions = ndimage.label(rng.random(shape) < share)
        one, other, own = rng.poisson(6.0, shape), rng.poisson(3.0, shape), rng.random(shape) < 0.9
        cells, density = region_margins(label.astype(np.int64), n_regions, one, other, own, reach)
        expected = by_definition(label, n_regions, one, other, own, reach)
        assert cells.tolist() == expected[0]
        assert np.allclose(density, expected[1], rtol=1e-14)


def test_nothing_is_asked_where_no_region_is_and_nothing_beside_is_zero() -> None:
    none = region_margins(np.zeros((3, 4), np.int64), 0, np.ones((3, 4), np.int64), np.ones((3, 4), np.int64), np.ones((3, 4), bool), 2)
    assert len(none[0]) == len(none[1]) == 0
    full = np.ones((3, 4), np.int64)
    cells, density = region_margins(full, 1, full, full, np.ones((3, 4), bool), 2)
    assert cells.tolist() == [12] and density.tolist() == [0.0]
