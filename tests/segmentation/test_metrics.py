"""Figures of agreement against their definitions over pairs and sets."""

import itertools

import numpy as np
import pytest

from scan2fea.errors import SegmentationError
from scan2fea.segmentation.metrics import adjusted_rand, agreement


def brute_rand(a, b):
    pairs = list(itertools.combinations(range(len(a)), 2))
    both = sum(a[i] == a[j] and b[i] == b[j] for i, j in pairs)
    in_a, in_b = sum(a[i] == a[j] for i, j in pairs), sum(b[i] == b[j] for i, j in pairs)
    expected = in_a * in_b / len(pairs)
    return (both - expected) / ((in_a + in_b) / 2 - expected)


def test_adjusted_rand_is_its_definition():
    rng = np.random.default_rng(0)
    for _ in range(10):
        a, b = rng.integers(0, 4, 25), rng.integers(0, 3, 25)
        assert adjusted_rand(a, b) == pytest.approx(brute_rand(a, b), abs=1e-12)
        assert adjusted_rand(a, b) == pytest.approx(adjusted_rand(b, a), abs=1e-12)
        assert adjusted_rand(a, rng.permutation(4)[a]) == 1.0


def test_points_that_belong_to_nothing_are_segments_of_their_own():
    truth, found = np.array([0, 0, 0, 1, 1, 1]), np.array([0, 0, -1, 1, -1, 1])
    assert adjusted_rand(truth, found) == pytest.approx(brute_rand(truth, [0, 0, 7, 1, 8, 1]), abs=1e-12)


def test_iou_over_and_under_segmentation():
    truth = np.array([0] * 10 + [1] * 10 + [-1] * 5)
    found = np.array([0] * 8 + [1] * 2 + [1] * 6 + [2] * 4 + [0] * 5)  # the last five are not known
    got = agreement(truth, found)
    assert got.iou.tolist() == [0.8, 6 / 12]
    assert got.over.tolist() == pytest.approx([0.2, 0.4])
    assert got.under.tolist() == pytest.approx([0.0, 2 / 8])
    assert got.mean_iou == pytest.approx((0.8 + 0.5) / 2)
    assert (got.precision, got.recall) == (2 / 3, 1.0)
    assert got.f1 == pytest.approx(2 * 2 / (2 + 3))
    assert agreement(truth, found, is_counted=np.array([True, True, False])).f1 == 1.0


def test_matching_is_the_best_of_all():
    rng = np.random.default_rng(3)
    truth, found = rng.integers(0, 4, 60), rng.integers(0, 4, 60)

    def iou(t, f):
        return ((truth == t) & (found == f)).sum() / ((truth == t) | (found == f)).sum()

    best = max(sum(iou(t, p[t]) for t in range(4)) for p in itertools.permutations(range(4)))
    assert agreement(truth, found).mean_iou == pytest.approx(best / 4)


def test_nothing_found_and_perfect():
    truth = np.array([3, 3, 5])
    nothing = agreement(truth, np.full(3, -1))
    assert (nothing.mean_iou, nothing.f1, nothing.recall, nothing.over.tolist()) == (0.0, 0.0, 0.0, [1.0, 1.0])
    perfect = agreement(truth, np.array([1, 1, 0]))
    assert (perfect.adjusted_rand, perfect.mean_iou, perfect.f1) == (1.0, 1.0, 1.0)


def test_bad_input_is_told():
    with pytest.raises(SegmentationError, match="3 true labels for 2 points"):
        agreement(np.zeros(3, int), np.zeros(2, int))
    with pytest.raises(SegmentationError, match="nothing to compare"):
        agreement(np.full(2, -1), np.zeros(2, int))
