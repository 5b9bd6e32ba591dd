import numpy as np
import pytest

from scan2fea.segmentation.led_on import is_one
from scan2fea.segmentation.pieces import Thin

H = 0.01


def tee(length=1.0, seed=0):
    """Points of a tee 0.12 x 0.12 m along z, one surface a wall, and their normals."""
    rng = np.random.default_rng(seed)
    n = int(0.24 * length / H**2)
    across, z, is_web = rng.uniform(0, 0.12, n), rng.uniform(0, length, n), rng.random(n) < 0.5
    points = np.where(is_web[:, None], np.stack([np.zeros(n), across, z], 1), np.stack([across - 0.06, np.zeros(n), z], 1))
    normals = np.where(is_web[:, None], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    return points, normals


def thin(points, normals):
    return Thin(points=points, normals=normals, h=H, of_point=np.arange(len(points)), spacing=H, sigma=0.0)


def streak(points, low, high):
    """Points of the web between two heights, as a piece of its own."""
    return (np.abs(points[:, 0]) < 1e-9) & (points[:, 1] > 0.04) & (points[:, 2] > low) & (points[:, 2] < high)


def test_a_member_whose_ends_have_taken_other_directions_is_one():
    points, normals = tee()
    group = np.where(points[:, 2] < 0.8, 0, -1)
    group[streak(points, 0.7, 1.0)] = 1
    assert is_one(thin(points, normals), group)


@pytest.mark.parametrize(("depth", "is_alike"), [(0.09, True), (0.0, False)])
def test_what_shows_less_than_three_quarters_of_the_section_is_another(depth, is_alike):
    points, normals = tee()
    there = (points[:, 2] < 0.8) | (points[:, 1] <= depth)  # the flange, with or without most of the web
    points, normals = points[there], normals[there]
    assert is_one(thin(points, normals), np.where(points[:, 2] < 0.8, 0, -1)) == is_alike


def test_leaves_round_an_end_are_not_its_section():
    points, normals = tee()
    rng = np.random.default_rng(2)
    on = points[:, 2] < 0.8
    leaves = np.stack([rng.uniform(-0.1, 0.1, 8000), rng.uniform(-0.04, 0.16, 8000), rng.uniform(0.8, 1.0, 8000)], 1)
    both = np.concatenate([points[on], leaves])
    turned = np.concatenate([normals[on], leaves / np.linalg.norm(leaves, axis=1, keepdims=True)])
    assert not is_one(thin(both, turned), np.where(np.arange(len(both)) < on.sum(), 0, -1))


def test_what_runs_across_is_another():
    points, normals = tee()
    bar = np.stack([np.zeros(400), np.linspace(-0.3, 0.3, 400), np.full(400, 0.9)], 1)
    group = np.concatenate([np.where(points[:, 2] < 0.8, 0, -1), np.full(400, 1)])
    assert not is_one(thin(np.concatenate([points, bar]), np.concatenate([normals, np.tile([1.0, 0.0, 0.0], (400, 1))])), group)
