"""Leaves are points on no surface: a bush parts from the frame it grows into, and nothing that has surfaces is taken for one."""

import numpy as np
import pytest

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation.leaves import leaves_of
from scan2fea.segmentation.members import members
from scan2fea.segmentation.metrics import agreement
from scan2fea.simulation import shapes


def post(seed=1, n=6000):
    return sample_surface(shapes.box(0.1, 0.1, 1.5), n, seed)[0]


def bush(seed=2, n=6000):
    return [0.05, -0.2, 0.6] + np.array([0.2, 0.15, 0.25]) * np.random.default_rng(seed).standard_normal((n, 3))


def frame():
    """Two posts and the beam on them."""
    second = sample_surface(shapes.box(0.1, 0.1, 1.5), 6000, 3)[0] + [1.9, 0, 0]
    beam = sample_surface(shapes.box(2.0, 0.1, 0.12), 8000, 4)[0] + [0, 0, 1.5]
    return [post(), second, beam]


@pytest.mark.parametrize("turn", [0, 5])
def test_a_frame_with_a_bush_in_it_falls_apart_and_the_bush_is_an_object(turn):
    """The bush is as many points as the frame: it hides that the cluster is mostly made of members."""
    parts = [*frame(), bush(n=20_000) + [0.95, 0, 0.7]]
    truth = np.repeat(np.arange(4), [len(part) for part in parts])
    order = np.random.default_rng(turn).permutation(len(truth))
    points = np.concatenate(parts) @ random_rotation(turn).T
    found = np.empty(len(truth), np.int64)
    found[order] = members(points[order])
    good = agreement(truth, found)
    assert good.iou[:2].min() > 0.85
    assert good.iou[2] > 0.6  # the beam stands in the bush
    assert good.iou[3] > 0.7


def test_one_bar_in_a_bush_stays_with_it():
    """The noise of a thin beam looks like leaves: what is one member, or none, without them is not cut."""
    assert members(np.concatenate([post(), bush()])).max() == 0


SURFACES = {
    "block": shapes.box(0.4, 0.3, 0.2),
    "plate three spacings thick": shapes.box(1.0, 0.8, 0.035),
    "bar two spacings thick": shapes.box(0.022, 0.022, 4.0),
    "tube": shapes.cylinder(0.08, 1.0),
    "vessel": shapes.tank(0.15, 0.3, 0.012),
}


@pytest.mark.parametrize("name", SURFACES)
def test_what_has_surfaces_is_no_bush(name):
    mesh = SURFACES[name]
    points, _ = sample_surface(mesh, 4000, 3)
    h = float(np.sqrt(np.linalg.norm(np.cross(*(np.diff(mesh.vertices[mesh.faces], axis=1).transpose(1, 0, 2))), axis=1).sum() / 2 / len(points)))
    noisy = points + 0.25 * h * np.random.default_rng(4).standard_normal(points.shape)
    assert leaves_of(points) is None and leaves_of(noisy) is None


def test_nothing_but_leaves_stays_whole():
    assert leaves_of(bush()) is None
    assert members(bush()).max() == 0
