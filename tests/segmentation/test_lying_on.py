"""A body that lies flat on a member is told from the member; a dent, a bulge, the other skin of a plate, a taper are not."""

import numpy as np
import pytest

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area
from scan2fea.kernel.normals import pca_normals
from scan2fea.kernel.transforms import random_rotation
from scan2fea.segmentation.extents import extent_of
from scan2fea.segmentation.lying_on import lying_on
from scan2fea.simulation import shapes

H, SIGMA = 0.01, 0.001
TOP = 0.15  # of the post, a square tube with a corner at the origin


def post(seed=0):
    mesh = shapes.rhs(0.15, 0.15, 0.008, 1.5)
    return sample_surface(mesh, round(area(mesh) / H**2), seed)[0]


def under(points, x=(0.02, 0.13), z=(0.6, 0.8)):
    """Points of the post's top face over which something lies."""
    return (points[:, 1] > TOP - 1e-6) & (points[:, 0] > x[0]) & (points[:, 0] < x[1]) & (points[:, 2] > z[0]) & (points[:, 2] < z[1])


def raised(points, by):
    """The post with the covered stretch of its top face `by` metres higher, and which points that are."""
    lies = under(points)
    return points + np.outer(lies * by, [0.0, 1.0, 0.0]), lies


def found(points, sigma=SIGMA, seed=0, turn=None):
    turn = np.eye(3) if turn is None else turn
    points = (points + sigma * np.random.default_rng(seed).standard_normal(points.shape)) @ turn.T
    normals = pca_normals(points, 16)
    return lying_on(points, normals, np.zeros(len(points), np.int64), [extent_of(points, normals)], H, max(sigma, 1e-6))


@pytest.mark.parametrize(("seed", "thick"), [(0, 0.012), (1, 0.02), (2, 0.008)])
def test_a_plate_on_a_face_is_a_second_body_whatever_the_motion(seed, thick):
    points, lies = raised(post(seed), thick)
    for turn in (None, random_rotation(seed)):
        got = found(points, seed=seed, turn=turn)
        assert got[lies].mean() > 0.97
        assert got[~lies].mean() < 0.001


def test_what_stands_out_by_no_more_than_the_noise_is_the_face_itself():
    points, _ = raised(post(), 3.0 * SIGMA)
    assert not found(points).any()
    assert not found(post()).any()


def test_a_dent_is_the_member_and_so_is_a_bulge():
    points = post()
    away = np.hypot(points[:, 0] - TOP / 2, points[:, 2] - 0.7) / 0.07
    swell = np.where(points[:, 1] > TOP - 1e-6, np.maximum(0.0, 1.0 - away**2), 0.0)
    for by in (-0.012, 0.012):
        assert not found(points + np.outer(swell * by, [0.0, 1.0, 0.0])).any()


def test_the_other_skin_of_a_plate_is_the_member():
    points, lies = raised(post(), 0.012)
    assert not found(np.concatenate([points, post(3)[under(post(3))]])).any()  # the face goes on below
    assert lies.any()


def test_a_member_that_is_bowed_still_has_its_faces():
    points, lies = raised(post(), 0.012)
    bowed = points + np.outer(0.02 * np.sin(np.pi * points[:, 2] / 1.5), [0.0, 1.0, 0.0])
    got = found(bowed)
    assert got[lies].mean() > 0.9
    assert got[~lies].mean() < 0.01


def test_round_members_and_other_labels_are_left_alone():
    mesh = shapes.chs(0.15, 0.008, 1.5)
    points = sample_surface(mesh, round(area(mesh) / H**2), 0)[0]
    assert not found(points).any()
    points, _ = raised(post(), 0.012)
    normals = pca_normals(points, 16)
    assert not lying_on(points, normals, np.full(len(points), 5), [extent_of(points, normals)], H, SIGMA).any()
    assert not lying_on(points[:10], normals[:10], np.zeros(10, np.int64), [extent_of(points, normals)], H, SIGMA).any()
