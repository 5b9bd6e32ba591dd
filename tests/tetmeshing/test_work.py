"""Flips, cavities and new vertices keep a mesh whole; each against brute force on small data."""

import itertools

import numpy as np
import pytest

from balls import ball
from scan2fea.kernel.measures import tet_volumes
from scan2fea.kernel.quality import scaled_jacobian, tet_dihedrals
from scan2fea.tetmeshing.cavity import falls_at, squared_radius
from scan2fea.tetmeshing.exude import exude_all
from scan2fea.tetmeshing.flips import flip_all, flip_face, remove_edge
from scan2fea.tetmeshing.insert import insert_all
from scan2fea.tetmeshing.perturb import perturb_all, perturb_vertex
from scan2fea.tetmeshing.tets import boundary_of, proved
from scan2fea.tetmeshing.work import FREE, MOST, PER_JACOBIAN, POINTS, all_qualities, closed, opened, ring_of, shape_quality, star_of

ROWS = np.empty(2 * MOST, np.int64)


def quality(angle_deg):
    return 1 - np.cos(np.radians(angle_deg))


def queue(work, bound):
    found = all_qualities(work)
    rows = np.flatnonzero(found < bound)
    return rows[np.argsort(found[rows], kind="stable")]


def assert_whole(work, nodes, tets):
    """Same volume and boundary, conforming, and neighbours that name each other across the same face."""
    now, packed, used = closed(work)
    proved(now, packed, boundary_of(packed), tet_volumes(nodes, tets).sum())
    kept = {tuple(sorted(f)) for f in used[boundary_of(packed)].tolist()}
    assert kept == {tuple(sorted(f)) for f in boundary_of(tets).tolist()}
    alive = np.flatnonzero(work.tets[:, 0] >= 0)
    assert len(alive) == len(work.tets) - work.tally[FREE]
    for t in alive:
        for i in range(4):
            u = work.beside[t, i]
            face = set(work.tets[t].tolist()) - {work.tets[t, i]}
            if u >= 0:
                j = [j for j in range(4) if work.tets[u, j] not in face]
                assert len(j) == 1 and work.beside[u, j[0]] == t
            else:
                assert tuple(sorted(face)) in kept
        assert (work.tet_of[work.tets[t]] >= 0).all()
    for v in range(int(work.tally[POINTS])):
        assert work.tet_of[v] < 0 or v in work.tets[work.tet_of[v]]


def test_quality_is_that_of_the_smallest_dihedral_or_of_the_jacobian():
    nodes, tets = ball(60, 60, seed=3)
    found = [shape_quality(*nodes[t]) for t in tets]
    angle, jacobian = quality(tet_dihedrals(nodes, tets).min(1)), PER_JACOBIAN * scaled_jacobian(nodes, tets)
    np.testing.assert_allclose(found, np.minimum(angle, jacobian), atol=1e-12)
    assert 0 < (jacobian < angle).sum() < len(tets)
    assert shape_quality(*nodes[tets[0][[1, 0, 2, 3]]]) == -1


def test_spheres_against_their_definition():
    nodes, tets = ball(40, 40, seed=1)
    work = opened(nodes, tets)
    p = np.array([0.1, 0.2, -0.3])
    for t in range(30):
        a = nodes[tets[t]]
        centre = np.linalg.solve(2 * (a[1:] - a[0]), (a[1:] ** 2).sum(1) - (a[0] ** 2).sum())
        radius2 = ((a[0] - centre) ** 2).sum()
        assert squared_radius(work, t) == pytest.approx(radius2, rel=1e-8)
        assert falls_at(work, t, p) == pytest.approx(((p - centre) ** 2).sum() - radius2, rel=1e-7, abs=1e-9)


def test_stars_and_rings_are_complete():
    nodes, tets = ball(60, 60, seed=2)
    work = opened(nodes, tets)
    star, around, ring = np.empty(400, np.int64), np.empty(30, np.int64), np.empty(30, np.int64)
    for v in (0, 70, 100):
        assert set(star[: star_of(work, v, star)].tolist()) == set(np.flatnonzero((tets == v).any(1)).tolist())
    for t, (i, j) in itertools.product(range(40), itertools.combinations(range(4), 2)):
        a, b = tets[t, i], tets[t, j]
        n = ring_of(work, t, a, b, around, ring)
        both = np.flatnonzero((tets == a).any(1) & (tets == b).any(1))
        if n:
            assert sorted(ring[:n].tolist()) == both.tolist()
            corners = np.stack([np.full(n, a), np.full(n, b), around[:n], np.roll(around[:n], -1)], axis=1)
            assert (tet_volumes(nodes, corners) > 0).all()
        else:  # the edge lies on the boundary
            assert work.held[a] and work.held[b]


def crown(n, height=1.0):
    """n tets round one edge, and a place for it in a closed cell."""
    turn = 2 * np.pi * np.arange(n) / n
    nodes = np.concatenate([[[0, 0, -height], [0, 0, height]], np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)])
    k = np.arange(n)
    return nodes, np.stack([0 * k, 0 * k + 1, k + 2, (k + 1) % n + 2], axis=1)


@pytest.mark.parametrize("n", [3, 4, 5, 7])
def test_edge_removal_finds_the_best_triangulation(n):
    nodes, tets = crown(n)
    nodes = nodes + np.random.default_rng(n).uniform(-0.1, 0.1, nodes.shape)
    wall = nodes[2:4].mean(0)
    nodes[:2] += 0.85 * wall * [1, 1, 0]  # the edge close to the wall of its cell: better gone
    work = opened(nodes, tets)
    made = remove_edge(work, 0, 0, 1, ROWS)
    assert made == 2 * (n - 2)

    def triangulations(i, j):
        if j - i < 2:
            return [[]]
        return [[(i, k, j), *x, *y] for k in range(i + 1, j) for x in triangulations(i, k) for y in triangulations(k, j)]

    ring = np.arange(n) + 2
    best = max(
        min(min(shape_quality(nodes[0], *nodes[ring[list(t)]]), shape_quality(nodes[1], *nodes[ring[[t[1], t[0], t[2]]]])) for t in found)
        for found in triangulations(0, n - 1)
    )
    assert all_qualities(work).min() == pytest.approx(best, abs=1e-12)
    assert_whole(work, nodes, tets)


def test_flip_from_two_to_three_and_back():
    nodes = np.array([[0, 0, -0.3], [1, 0, 0], [-0.5, 0.8, 0], [-0.5, -0.8, 0], [0, 0, 0.3]])  # two flat caps
    tets = np.array([[1, 3, 2, 0], [1, 2, 3, 4]])
    tets = np.where((tet_volumes(nodes, tets) < 0)[:, None], tets[:, [1, 0, 2, 3]], tets)
    work = opened(nodes, tets)
    face = int(np.flatnonzero(work.tets[0] == 0)[0])
    assert flip_face(work, 0, face, ROWS) == 3
    assert_whole(work, nodes, tets)
    long = nodes * [1, 1, 12]
    work = opened(long, tets)
    assert flip_face(work, 0, face, ROWS) == 0  # three long tets would be worse


@pytest.mark.parametrize("seed", range(3))
def test_every_operation_keeps_the_mesh_whole_and_its_worst_angle(seed):
    nodes, tets = ball(seed=seed)
    work = opened(nodes, tets)
    bound = quality(20)
    for operation in (
        lambda: flip_all(work, queue(work, bound)),
        lambda: exude_all(work, queue(work, bound), bound),
        lambda: insert_all(work, queue(work, bound), bound, 30, 0),
        lambda: perturb_all(work, queue(work, bound), bound, 0),
        lambda: exude_all(work, queue(work, bound), bound),
        lambda: insert_all(work, queue(work, bound), bound, 30, 1),
    ):
        before = all_qualities(work).min()
        operation()
        assert all_qualities(work).min() >= before
        assert_whole(work, nodes, tets)


def test_exudation_moves_nothing_and_reconnects():
    nodes, tets = ball(seed=5)
    work = opened(nodes, tets)
    bound = quality(15)
    pumped = exude_all(work, queue(work, bound), bound)
    assert pumped > 0
    assert np.array_equal(work.points[: len(nodes)], nodes)
    assert len(queue(work, bound)) < (all_qualities(opened(nodes, tets)) < bound).sum()


def test_perturbation_keeps_only_what_helps_and_holds_the_boundary():
    nodes, tets = ball(seed=7)
    work = opened(nodes, tets)
    star = np.empty(400, np.int64)
    assert perturb_vertex(work, 0, 0) == 0.0 and np.array_equal(work.points[0], nodes[0])
    rises = 0
    for v in range(120, 240):
        n = star_of(work, v, star)
        before = all_qualities(work)[star[:n]].min()
        rise = perturb_vertex(work, v, 0)
        assert all_qualities(work)[star[:n]].min() == pytest.approx(before + rise, abs=1e-12)
        rises += rise > 0
    assert rises > 60


def test_what_finds_no_room_is_not_done():
    nodes, tets = ball(seed=1)
    work = opened(nodes, tets)
    work.tally[FREE] = 0
    bound = quality(20)
    flip_all(work, queue(work, bound))
    insert_all(work, queue(work, bound), bound, 100, 0)
    assert (work.tets[:, 0] >= 0).sum() <= len(tets)
    now, packed, _ = closed(work)
    assert tet_volumes(now, packed).sum() == pytest.approx(tet_volumes(nodes, tets).sum(), rel=1e-12)
