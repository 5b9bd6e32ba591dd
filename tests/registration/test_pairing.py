"""Pairs by the tree and by what is kept from pose to pose, against all distances."""

import numpy as np
import pytest

from scan2fea.kernel.near_tree import near_tree, nearest_of
from scan2fea.kernel.transforms import applied, random_rotation, rigid, rotated, rotation_about
from scan2fea.registration.pairing import FACING, Partners, pairs_of
from scan2fea.registration.surface import Surface


def surface(seed, n, seen=0.5):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return Surface(
        points=rng.random((n, 3)),
        normals=normals,
        is_seen=rng.random(n) < seen,
        is_smooth=np.ones(n, bool),
        station=np.full(3, np.nan),
        edge_m=0.1,
        spacing_m=0.05,
        sigma_m=0.0,
    )


def by_definition(source, target, T, reach):
    moved, own = applied(T, source.points), rotated(T, source.normals)
    distance = np.linalg.norm(moved[:, None] - target.points[None], axis=2)
    near = distance.argmin(axis=1)
    cosine = np.einsum("nc,nc->n", own, target.normals[near])
    both = source.is_seen & target.is_seen[near]
    rows = np.flatnonzero((distance.min(axis=1) < reach) & (np.where(both, cosine, np.abs(cosine)) > FACING))
    own = np.where((cosine < 0)[:, None], -own, own)[rows]
    middle = own + target.normals[near[rows]]
    middle /= np.linalg.norm(middle, axis=1)[:, None]
    across = np.einsum("nc,nc->n", moved[rows] - target.points[near[rows]], middle)
    return rows, near[rows], moved[rows], middle, own, target.normals[near[rows]], across


@pytest.mark.parametrize("reach", [0.05, 0.3, np.inf])
def test_pairs_from_pose_to_pose_are_those_of_the_definition(reach):
    source, target = surface(1, 300), surface(2, 400)
    partners, T = Partners(source, target, target.tree()), np.eye(4)
    for k in range(25):  # steps that shrink, then one that leaps, and a reach that closes
        size = 0.3 * 0.7**k if k != 15 else 0.5
        T = rigid(rotation_about([1.0, k, 2.0], size), [size / 3, -size / 4, 0.0]) @ T
        own_reach = reach * (0.9**k if np.isfinite(reach) else 1.0)
        expected = by_definition(source, target, T, own_reach)
        rows, found, across = partners.under(T, own_reach)
        assert rows[:, 0].tolist() == expected[0].tolist() and rows[:, 1].tolist() == expected[1].tolist()
        np.testing.assert_allclose(np.c_[found, across], np.c_[expected[2], expected[3], expected[6]], atol=1e-12)
    pairs = pairs_of(source, target, target.tree(), T, own_reach)
    for got, right in zip((pairs.moved, pairs.normal, pairs.normal_source, pairs.normal_target, pairs.across_m), expected[2:], strict=True):
        np.testing.assert_allclose(got, right, atol=1e-12)


def test_few_queries_one_by_one():
    rng = np.random.default_rng(3)
    points, queries = np.r_[rng.random((500, 3)), [[2.0, 2, 2], [2.0, 2, 2]]], np.r_[rng.random((50, 3)), [[2.0, 2, 2]]] @ random_rotation(1).T
    for moved in (points @ random_rotation(1).T, points[:1]):
        distance = np.linalg.norm(queries[:, None] - moved[None], axis=2)
        far, row = nearest_of(near_tree(moved), queries)
        assert row.tolist() == distance.argmin(axis=1).tolist()  # of the two that are equal the first
        np.testing.assert_allclose(far, distance.min(axis=1), atol=1e-15)
        _, none = nearest_of(near_tree(moved), queries, 0.5 * float(distance.min()))
        assert (none == -1).all()
