"""The stretch of two densities of greatest likelihood, against every stretch looked at in turn."""

import itertools

import numpy as np
import pytest

from scan2fea.kernel.two_densities import densest_stretch


def gain(counts, i, j):
    inside, outside = counts[i:j].sum(), counts.sum() - counts[i:j].sum()
    rest = len(counts) - (j - i)
    if inside * rest < outside * (j - i):
        return -np.inf
    return (inside * np.log(inside / (j - i)) if inside > 0 else 0.0) + (outside * np.log(outside / rest) if outside > 0 else 0.0)


@pytest.mark.parametrize("seed", range(12))
def test_no_other_stretch_is_likelier(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(10, 40))
    counts = rng.poisson(2.0, n).astype(float)
    a, b = np.sort(rng.integers(0, n, 2))
    counts[a:b] += rng.poisson(20.0, b - a)
    i, j = densest_stretch(counts)
    best = max(gain(counts, a, b) for a, b in itertools.combinations(range(n + 1), 2) if b - a > 1)
    assert gain(counts, i, j) == pytest.approx(best, rel=1e-12)


def test_even_counts_are_one_stretch_of_some_length():
    i, j = densest_stretch(np.ones(12))
    assert j - i >= 2
