"""One skin that is nearer to the axis here and farther there is no tube."""

import numpy as np
import pytest

from scan2fea.estimation.one_skin import is_one_skin

N, LENGTH, RADIUS, WALL, SIGMA = 3_000, 1.0, 0.06, 0.002, 0.0004


def points(depth, seed=0, n=N):
    """Of a skin that lies depth(angle, z) under the outer radius."""
    rng = np.random.default_rng(seed)
    angle, z = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, LENGTH, n)
    r = RADIUS - depth(angle, z) + SIGMA * rng.standard_normal(n)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def one_skin(local):
    return is_one_skin(local, np.hypot(local[:, 0], local[:, 1]) < RADIUS - WALL / 2, LENGTH)


@pytest.mark.parametrize("seed", range(3))
def test_an_oval_and_a_bar_of_two_sections_are(seed):
    assert one_skin(points(lambda angle, z: WALL / 2 * (1 + 1.5 * np.cos(2 * angle)), seed))
    assert one_skin(points(lambda angle, z: WALL * (z > 0.3), seed))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("outer", [1.0, 0.6, 0.0])
def test_a_tube_whose_inner_face_was_seen_is_not(seed, outer):
    """From both ends, a diameter or two deep, its outer face all around, on one side, or not at all."""
    inside = points(lambda angle, z: WALL + 0 * z, seed, N // 4)
    inside = inside[np.abs(inside[:, 2] - LENGTH / 2) > 0.25]
    outside = points(lambda angle, z: 0 * z, seed + 9)
    outside = outside[np.arctan2(outside[:, 1], outside[:, 0]) < (2 * outer - 1) * np.pi]
    assert not one_skin(np.concatenate([inside, outside]))
