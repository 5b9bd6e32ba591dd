"""Which shells of a file are bodies of their own."""

import numpy as np

from predicates import box, moved, sphere
from scan2fea.repair import bodies, faces_among
from scan2fea.types import TriangleMesh

BOX, BALL = box(), sphere(rounds=2)


def together(*meshes):
    start = np.cumsum([0, *[len(m.vertices) for m in meshes]])
    faces = [m.faces + s for m, s in zip(meshes, start[:-1], strict=True)]
    return TriangleMesh(vertices=np.concatenate([m.vertices for m in meshes]), faces=np.concatenate(faces))


def at(mesh, *shift, scale=1.0):
    return moved(mesh, scale * np.eye(3), np.array(shift, float))


def counts(mesh, small=0.01):
    return np.bincount(bodies(mesh, small)).tolist()


def test_shells_that_stand_apart_or_touch_are_bodies_the_largest_first():
    n = len(BOX.vertices)
    both = together(BOX, at(BOX, 3, 0, 0, scale=2.0), at(BOX, 1, 0.3, 0.3))  # the third lies on the first
    assert bodies(both, 0.01).tolist() == [1] * n + [0] * n + [2] * n
    parts = [faces_among(both, bodies(both, 0.01) == k) for k in range(3)]
    assert [len(part.faces) for part in parts] == [len(BOX.faces)] * 3
    assert np.array_equal(parts[1].vertices, BOX.vertices)


def test_a_cavity_and_shells_that_cross_are_one():
    assert counts(together(BOX, at(BOX, 0.25, 0.25, 0.25, scale=0.5))) == [2 * len(BOX.vertices)]
    bars = [moved(BOX, np.diag(d), np.array(o)) for d, o in (([3.0, 1, 1], [-1.0, 0, 0]), ([0.5, 3, 0.5], [0.25, -1, 0.25]))]
    assert counts(together(*bars)) == [2 * len(BOX.vertices)]  # no corner of one is inside the other


def test_parts_that_cross_by_less_than_their_facets_do_are_two():
    assert len(counts(together(BOX, at(BOX, 0.999, 0.3, 0.3)))) == 2
    assert len(counts(together(BOX, at(BOX, 0.9, 0.3, 0.3)))) == 1


def test_a_broken_surface_is_one():
    gaps = np.arange(len(BALL.faces)) != 5
    assert len(counts(together(TriangleMesh(vertices=BALL.vertices, faces=BALL.faces[gaps]), at(BOX, 5, 0, 0)))) == 1


def test_scraps_stay_with_the_largest():
    mesh = together(at(BOX, 0, 0, 0, scale=10.0), at(BOX, 20, 0, 0, scale=10.0), at(BOX, 50, 0, 0, scale=0.1))
    assert counts(mesh) == [2 * len(BOX.vertices), len(BOX.vertices)]
    assert counts(mesh, small=0.0) == [len(BOX.vertices)] * 3


def test_unwelded_triangles_hang_together():
    soup = TriangleMesh(vertices=BOX.vertices[BOX.faces].reshape(-1, 3), faces=np.arange(3 * len(BOX.faces)).reshape(-1, 3))
    assert counts(together(soup, at(soup, 3, 0, 0))) == [3 * len(BOX.faces)] * 2
