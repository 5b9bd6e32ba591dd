"""Crossings against a plain definition: an edge of one face meets the other face."""

import numpy as np
import pytest

from predicates import box, moved, rotation, sphere
from scan2fea.kernel.predicates import intersections_of, self_intersections
from scan2fea.types import TriangleMesh


def joined(*meshes):
    shift = np.cumsum([0, *[len(m.vertices) for m in meshes[:-1]]])
    return TriangleMesh(
        vertices=np.concatenate([m.vertices for m in meshes]), faces=np.concatenate([m.faces + s for m, s in zip(meshes, shift, strict=True)])
    )


def edge_meets(p, q, t):
    """Signed volumes: p and q on two sides of the triangle, and the line passes inside."""
    side = lambda a, b, c, d: np.linalg.det(np.array([b - a, c - a, d - a]))  # noqa: E731
    if side(*t, p) * side(*t, q) >= 0:
        return False
    s = [side(p, q, t[k], t[(k + 1) % 3]) for k in range(3)]
    return all(x > 0 for x in s) or all(x < 0 for x in s)


def brute_force(mesh):
    found = set()
    tri = mesh.vertices[mesh.faces]
    for i in range(len(tri)):
        for j in range(i + 1, len(tri)):
            shared = set(mesh.faces[i].tolist()) & set(mesh.faces[j].tolist())
            if len(shared) > 1:
                continue
            for one, other in ((i, j), (j, i)):
                edges = [(k, (k + 1) % 3) for k in range(3) if not shared & {int(mesh.faces[one, k]), int(mesh.faces[one, (k + 1) % 3])}]
                if any(edge_meets(tri[one, a], tri[one, b], tri[other]) for a, b in edges):
                    found.add((i, j))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_equals_brute_force(seed):
    mesh = sphere(rounds=1)
    noise = np.random.default_rng(seed).normal(0, 0.35, mesh.vertices.shape)
    noisy = TriangleMesh(vertices=mesh.vertices + noise, faces=mesh.faces)
    found = {tuple(pair) for pair in self_intersections(noisy)}
    assert found == brute_force(noisy)
    assert len(found) > 5


def test_crossings_of_some_faces_are_those_of_all_that_have_one():
    mesh = sphere(rounds=3)
    noisy = TriangleMesh(vertices=mesh.vertices + np.random.default_rng(3).normal(0, 0.06, mesh.vertices.shape), faces=mesh.faces)
    rows = np.sort(np.random.default_rng(4).permutation(len(mesh.faces))[:40])
    every, some = self_intersections(noisy), intersections_of(noisy, rows)
    touched = lambda pairs: {tuple(pair) for pair in pairs[np.isin(pairs, rows).any(axis=1)]}  # noqa: E731
    assert touched(some) == touched(every) and len(touched(some)) > 5
    assert len(some) < len(every)
    assert not len(intersections_of(noisy, rows[:0]))


def test_rigid_motion_scale_offset_and_order():
    mesh = sphere(rounds=2)
    noisy = TriangleMesh(vertices=mesh.vertices + np.random.default_rng(0).normal(0, 0.12, mesh.vertices.shape), faces=mesh.faces)
    n = len(self_intersections(noisy))
    assert n > 20
    assert len(self_intersections(moved(noisy, rotation(1), np.array([1e4, 0, -1e4])))) == n
    assert len(self_intersections(TriangleMesh(vertices=noisy.vertices * 1e-6, faces=noisy.faces))) == n
    shuffled = TriangleMesh(vertices=noisy.vertices, faces=np.roll(noisy.faces[np.random.default_rng(2).permutation(len(noisy.faces))], 1, axis=1))
    assert len(self_intersections(shuffled)) == n


def test_neighbours_do_not_cross_flat_or_folded():
    assert not len(self_intersections(box(pitch=0.1)))
    assert not len(self_intersections(sphere(rounds=3)))


def test_overlap_in_one_plane_counts_and_touching_at_a_rim_does_not():
    def pair(shift):
        a = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
        return TriangleMesh(vertices=np.concatenate([a, a + np.array([shift, 0, 0])]), faces=np.array([[0, 1, 2], [3, 4, 5]]))

    assert len(self_intersections(pair(0.5))) == 1
    assert len(self_intersections(pair(0.999))) == 1
    assert len(self_intersections(pair(1.001))) == 0


def test_the_same_face_twice_counts():
    mesh = box()
    twice = TriangleMesh(vertices=mesh.vertices, faces=np.concatenate([mesh.faces, mesh.faces[:1]]))
    assert [0, 12] in self_intersections(twice).tolist()


def test_an_edge_exactly_through_an_edge_counts():
    """A spike through the far pole of a symmetric sphere meets only edges there."""
    mesh = sphere(rounds=3)
    vertices = mesh.vertices.copy()
    vertices[vertices[:, 2].argmax()] *= -1.3
    assert len(self_intersections(TriangleMesh(vertices=vertices, faces=mesh.faces)))


def test_boxes_that_share_no_numbers_but_places_do_not_cross():
    soup = TriangleMesh(vertices=box().vertices[box().faces].reshape(-1, 3), faces=np.arange(36).reshape(-1, 3))
    assert not len(self_intersections(soup))


def test_two_boxes_into_one_another_cross():
    assert len(self_intersections(joined(box(), moved(box(), rotation(0), np.full(3, 0.5)))))
    assert not len(self_intersections(joined(box(), moved(box(), rotation(0), np.full(3, 5.0)))))


def test_few_faces():
    one = TriangleMesh(vertices=np.eye(3), faces=np.array([[0, 1, 2]]))
    assert self_intersections(one).shape == (0, 2)
