import itertools

import numpy as np

from scan2fea.kernel.transforms import applied, random_rotation, rigid
from scan2fea.registration.ransac import Features, RansacOptions, kabsch, matched, propose

T = rigid(random_rotation(4), [1.0, -2.0, 0.5])


def frames_of(n, seed):
    return np.array([random_rotation(seed + k) for k in range(n)])


def features_pair(n=120, wrong=0.6, seed=0):
    """Key points of one scene in two frames; a share has features that lead nowhere."""
    random = np.random.default_rng(seed)
    points, frames, values = random.random((n, 3)) * 5, frames_of(n, seed), random.random((n, 66))
    other = values.copy()
    astray = random.random(n) < wrong
    other[astray] = random.random((int(astray.sum()), 66))
    source = Features(points=points, frames=frames, values=values, variants=np.array([0]))
    moved = applied(T, points) + random.normal(0, 0.005, (n, 3))
    target = Features(points=moved, frames=np.einsum("ij,njk->nik", T[:3, :3], frames), values=other, variants=np.array([0]))
    return source, target, astray


def test_kabsch_recovers_motions_and_never_mirrors():
    points = np.random.default_rng(0).random((3, 6, 3))
    motions = np.array([rigid(random_rotation(k), [k, 1.0, -2.0]) for k in range(3)])
    found = kabsch(points, np.array([applied(M, p) for M, p in zip(motions, points, strict=True)]))
    np.testing.assert_allclose(found, motions, atol=1e-12)
    mirrored = points * [1, 1, -1]
    np.testing.assert_allclose(np.linalg.det(kabsch(points, mirrored)[:, :3, :3]), 1.0)
    flat = points * [1, 1, 0]
    np.testing.assert_allclose(np.linalg.det(kabsch(flat, flat)[:, :3, :3]), 1.0)


def test_the_motion_is_found_among_wrong_matches():
    source, target, _ = features_pair()
    found = propose(source, target, 0.05, 0.2)
    np.testing.assert_allclose(found[0].T_target_source, T, atol=0.01)
    assert found[0].n_pairs >= 40
    assert all(a.n_pairs >= b.n_pairs for a, b in itertools.pairwise(found))


def test_the_same_seed_gives_the_same_bytes():
    source, target, _ = features_pair()
    first, again = propose(source, target, 0.05, 0.2, seed=3), propose(source, target, 0.05, 0.2, seed=3)
    assert [p.T_target_source.tobytes() for p in first] == [p.T_target_source.tobytes() for p in again]


def test_proposals_are_different_places():
    source, target, _ = features_pair()
    found = propose(source, target, 0.05, 0.2, RansacOptions(proposals=5))
    for k, p in enumerate(found):
        for q in found[:k]:
            assert np.abs(p.T_target_source - q.T_target_source).max() > 0.01


def test_matches_find_the_turned_variant():
    source, target, _ = features_pair(wrong=0.0)
    found = matched(source, target, 1000)
    right = found.source == found.target
    assert right.sum() >= len(source.points)
    np.testing.assert_allclose(found.R[right], np.broadcast_to(T[:3, :3], (int(right.sum()), 3, 3)), atol=1e-9)


def test_nothing_comes_of_nothing():
    source, _, _ = features_pair()
    none = Features(points=np.zeros((0, 3)), frames=np.zeros((0, 3, 3)), values=np.zeros((0, 66)), variants=np.array([0]))
    assert propose(source, none, 0.05, 0.2) == ()
    assert propose(none, source, 0.05, 0.2) == ()
    assert len(matched(none, source, 10).source) == 0
