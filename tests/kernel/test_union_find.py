"""Disjoint sets against flooding of a random graph."""

import numpy as np
import pytest

from scan2fea.kernel.union_find import join, root


@pytest.mark.parametrize("seed", range(5))
def test_sets_are_the_parts_of_the_graph(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, edges = 60, rng.integers(0, 60, (45, 2))
    parent = np.arange(n)
    joined = [join(parent, a, b) for a, b in edges]
    label = np.arange(n)  # flooding: the least label of the two ends until nothing changes
    while True:
        least = label.copy()
        for a, b in edges:
            least[a] = least[b] = min(least[a], least[b])
        if np.array_equal(least, label):
            break
        label = least
    assert np.array_equal([root(parent, i) for i in range(n)], label)  # a set is named after its least member
    assert sum(joined) == n - len(np.unique(label))  # each true join makes one set fewer
