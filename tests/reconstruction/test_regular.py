"""Directions and places that several faces of one part share."""

import numpy as np
import pytest

from predicates import rotation
from scan2fea.kernel.primitives import Plane
from scan2fea.reconstruction.plane_growing import robust_plane, settled
from scan2fea.reconstruction.regular import near_ways, regular

NOISE = 3e-4


def _legs(rng, noise=NOISE):
    """Points on the outer x faces of two legs 60 mm wide and 1 m apart, on two y faces, and on a rim 1.2 m long and 30 mm high; outward normals."""

    def face(axis, at, low, high, n):
        points = rng.uniform(low, high, (n, 3))
        points[:, axis] = at + rng.normal(0.0, noise, n)
        return points, np.tile(np.eye(3)[axis], (n, 1))

    parts = [
        face(0, 1.0, (0, 0.0, 0.0), (0, 0.06, 0.7), 200),
        face(0, 1.0, (0, 1.0, 0.0), (0, 1.06, 0.7), 200),
        face(1, 1.06, (0.94, 0, 0.0), (1.0, 0, 0.7), 200),
        face(1, 0.06, (0.94, 0, 0.0), (1.0, 0, 0.7), 200),
        face(0, 1.05, (0, -0.1, 0.7), (0, 1.1, 0.73), 90),
        face(2, 0.73, (-0.5, -0.1, 0), (1.05, 1.1, 0), 4000),
    ]
    label = np.concatenate([np.full(len(p), k) for k, (p, _) in enumerate(parts)])
    return np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts]), label


def _one_frame(planes, axes):
    """Largest angle (rad) of a plane's normal from the nearest axis."""
    return max(float(np.arccos(np.clip(np.max(axes @ p.normal), -1, 1))) for p in planes)


@pytest.mark.parametrize("seed", range(5))
def test_small_faces_take_the_direction_that_all_of_them_fix(seed):
    rng = np.random.default_rng(seed)
    points, normals, label = _legs(rng)
    T = rotation(rng)
    points, normals = points @ T.T, normals @ T.T
    alone = [robust_plane(points[label == k], normals[label == k][0]) for k in range(6)]
    together = regular(points, alone, label, NOISE)
    assert _one_frame(alone, T.T) > 5e-4  # a leg alone leaves a milliradian open
    assert _one_frame(together, T.T) < 4e-4
    exact = [together[k].normal @ together[j].normal for k in (0, 1, 4) for j in (0, 1, 4)]
    np.testing.assert_allclose(exact, 1.0, atol=1e-12)  # one direction, not nearly one


def test_faces_that_are_not_parallel_stay_so():
    rng = np.random.default_rng(1)
    points, normals, label = _legs(rng, noise=1e-5)
    tilted = label == 1
    points[tilted, 0] += 0.01 * (points[tilted, 1] - 1.03)
    planes = [robust_plane(points[label == k], normals[label == k][0]) for k in range(6)]
    found = regular(points, planes, label, 1e-5)
    assert np.arccos(np.clip(found[0].normal @ found[1].normal, -1, 1)) == pytest.approx(0.01, rel=0.05)


def test_two_planes_within_the_noise_of_one_face_become_one_and_two_legs_share_their_plane():
    rng = np.random.default_rng(2)
    points, normals, label = _legs(rng)
    start = [robust_plane(points[label == k], normals[label == k][0]) for k in range(6)]
    split = [Plane(normal=start[0].normal, offset=start[0].offset + s) for s in (-NOISE, NOISE)]
    planes = settled(points, normals, [*split, *start[1:]], 0.013, NOISE)
    assert len(planes) == 5
    assert np.abs(planes.offset - 1.0).min() < 1e-4


def test_steps_wider_than_the_noise_stay_steps():
    rng = np.random.default_rng(3)
    points, normals, label = _legs(rng)
    points[label == 1, 0] += 10 * NOISE
    start = [robust_plane(points[label == k], normals[label == k][0]) for k in range(6)]
    planes = settled(points, normals, start, 0.002, NOISE)
    assert len(planes) == 6


def test_ways_are_normals_and_lines_the_nearest_first():
    known = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(near_ways(known, np.array([0.02, -1.0, 0.0])), [[0.0, -1.0, 0.0]])
    assert near_ways(known, np.array([0.5, 0.5, 0.5])).shape == (0, 3)
    assert near_ways(np.zeros((0, 3)), np.array([0.0, 0.0, 1.0])).shape == (0, 3)


def test_near_ways_are_those_that_plain_greedy_picking_gives():
    rng = np.random.default_rng(4)
    for _ in range(20):
        known = np.repeat(np.eye(3), 6, axis=0) + 10.0 ** rng.uniform(-5, -1) * rng.normal(size=(18, 3))
        known /= np.linalg.norm(known, axis=1)[:, None]
        first, second = np.triu_indices(18, 1)
        lines = np.cross(known[first], known[second])
        long = np.linalg.norm(lines, axis=1) > 0.5
        every = np.concatenate([known, lines[long] / np.linalg.norm(lines[long], axis=1)[:, None]])
        every = np.where(every[:, :1] > 0, every, -every)
        plain = []
        for way in every[np.argsort(-every[:, 0], kind="stable")]:
            if way[0] >= np.cos(np.radians(8.0)) and all(way @ other < 1.0 - 1e-6 for other in plain):
                plain.append(way)
        found = near_ways(known, np.array([1.0, 0.0, 0.0]))
        assert len(found) == len(plain) > 0
        np.testing.assert_allclose(found, plain, atol=1e-12)
