import numpy as np
import pytest

from scan2fea.errors import InternalError
from scan2fea.kernel.transforms import applied, random_rotation, rigid
from scan2fea.registration.keypoints import KeypointOptions, keypoints, saliency, within
from workpiece import workpiece

RADII = (0.12, 0.4)


def cloud(n=500, seed=0):
    return workpiece(n, seed)[0]


def test_within_is_the_definition():
    points = cloud()
    rows = np.arange(0, len(points), 3)
    begin, near = within(points, rows, 0.5)
    for k, row in enumerate(rows):
        expected = np.flatnonzero(np.linalg.norm(points - points[row], axis=1) < 0.5)
        assert sorted(near[begin[k] : begin[k + 1]].tolist()) == expected.tolist()
    with pytest.raises(InternalError, match="positive radius"):
        within(points, rows, 0.0)
    begin, near = within(np.zeros((0, 3)), np.zeros(0, np.int64), 1.0)
    assert begin.tolist() == [0] and len(near) == 0


def test_a_point_on_the_radius_is_not_within():
    points = np.array([[0, 0, 0], [1.0, 0, 0], [0, np.nextafter(1.0, 0), 0]])
    begin, near = within(points, np.array([0]), 1.0)
    assert sorted(near.tolist()) == [0, 2] and begin.tolist() == [0, 2]


def test_weights_and_scatter_are_equations_2_1_and_2_2():
    points = cloud()
    found = saliency(points, np.arange(len(points)), *RADII)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    weight = 1.0 / (distance < RADII[0]).sum(axis=1)
    np.testing.assert_allclose(found.weight, weight)
    for i in range(0, len(points), 17):
        near = distance[i] < RADII[1]
        d = points[near] - points[i]
        S = (weight[near, None, None] * d[:, :, None] * d[:, None, :]).sum(axis=0) / weight[near].sum()
        np.testing.assert_allclose(found.values[i], np.linalg.eigvalsh(S)[::-1].clip(0), atol=1e-14)
        np.testing.assert_allclose(found.axes[i] @ np.diag(found.values[i]) @ found.axes[i].T, S, atol=1e-14)


def test_keypoints_are_the_definition():
    points, options = cloud(), KeypointOptions(gamma_21=0.9, gamma_32=0.8)
    l1, l2, l3 = saliency(points, np.arange(len(points)), *RADII).values.T
    salient = np.flatnonzero((l2 < 0.9 * l1) & (l3 < 0.8 * l2) & (l3 > 1e-10 * l1))
    expected = [i for i in salient if all(l3[i] >= l3[j] for j in salient if np.linalg.norm(points[i] - points[j]) < 0.3)]
    found = keypoints(points, *RADII, 0.3, options)
    assert len(expected) > 10
    assert sorted(found.tolist()) == expected
    assert (np.diff(l3[found]) <= 0).all()
    assert keypoints(points, *RADII, 0.3, KeypointOptions(gamma_21=0.9, gamma_32=0.8, at_most=4)).tolist() == found[:4].tolist()


def test_keypoints_move_turn_scale_and_shuffle_with_the_points():
    points = cloud()
    found = keypoints(points, *RADII, 0.3)
    before = points.copy()
    T = rigid(random_rotation(3), [5.0, -2.0, 1.0])
    assert sorted(keypoints(applied(T, points), *RADII, 0.3).tolist()) == sorted(found.tolist())
    assert sorted(keypoints(1e-3 * points, 1e-3 * RADII[0], 1e-3 * RADII[1], 3e-4).tolist()) == sorted(found.tolist())
    order = np.random.default_rng(0).permutation(len(points))
    assert sorted(order[keypoints(points[order], *RADII, 0.3)].tolist()) == sorted(found.tolist())
    np.testing.assert_array_equal(points, before)


def test_a_plane_has_no_keypoint():
    flat = np.c_[np.random.default_rng(0).random((400, 2)), np.zeros(400)]
    assert len(keypoints(flat, 0.05, 0.2, 0.1)) == 0
