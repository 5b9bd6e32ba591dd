"""Strips beside an object are found by their shape, and by how near they are."""

from __future__ import annotations

import numpy as np
import pytest

from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation import strips_beside
from scan2fea.types import PointCloud, Segments

RNG = np.random.default_rng(2)
PLATE = RNG.random((5_000, 3)) * [1.5, 0.2, 0.0]


def scene(other, kind="object", R=None):
    points = np.concatenate([PLATE, other]) + 3e-4 * np.random.default_rng(1).standard_normal((len(PLATE) + len(other), 3))
    cloud = PointCloud.of(points if R is None else points @ R.T)
    labels = np.repeat([0, 1], [len(PLATE), len(other)])
    return cloud.take(labels == 0), cloud, Segments(labels=labels, kinds=("object", kind), how={}), 0


def piece(n, size, at):
    return np.random.default_rng(5).random((n, 3)) * size + at


@pytest.mark.parametrize("seed", [0, 4])
@pytest.mark.parametrize("thick", [0.0, 0.05])
def test_a_strip_as_long_as_the_object_is_found(thick, seed) -> None:
    other = piece(600, [1.5, 0.01 + thick, thick], [0.0, 0.1, 0.25])
    own, cloud, segments, label = scene(other, R=random_rotation(seed) if seed else None)
    (found,) = strips_beside(own, cloud, segments, label)
    np.testing.assert_array_equal(found, cloud.points[segments.labels == 1])


@pytest.mark.parametrize(
    ("n", "size", "at"),
    [
        (600, [0.6, 0.01, 0.0], [0.4, 0.1, 0.25]),  # short
        (600, [1.5, 0.5, 0.0], [0.0, 0.0, 0.25]),  # a plate
        (600, [1.5, 0.01, 0.0], [0.0, 0.1, 1.5]),  # far off
        (20, [1.5, 0.01, 0.0], [0.0, 0.1, 0.25]),  # too few points
    ],
)
def test_other_pieces_are_no_strips(n, size, at) -> None:
    assert strips_beside(*scene(piece(n, size, at))) == ()


def test_supports_are_no_strips() -> None:
    assert strips_beside(*scene(piece(600, [1.5, 0.01, 0.0], [0.0, 0.1, 0.25]), "support")) == ()
