"""Counts of surface_topology on wrong meshes, each wrong in one way; helpers against brute force."""

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, box, l_beam, sphere, torus
from scan2fea.kernel.topology import corner_fans, edge_table, face_components, half_edges, neighbour_vertices, surface_topology, vertex_faces
from scan2fea.types import TriangleMesh

BOX = box(pitch=0.5)


@pytest.mark.parametrize("mesh", [box(), BOX, l_beam(), sphere(rounds=1), torus(n=8, m=6)])
def test_solids_are_clean(mesh):
    assert_closed_manifold_oriented(mesh)


def without(mesh, rows):
    return TriangleMesh(vertices=mesh.vertices, faces=np.delete(mesh.faces, rows, axis=0))


def flipped(mesh, row):
    faces = mesh.faces.copy()
    faces[row] = faces[row, ::-1]
    return TriangleMesh(vertices=mesh.vertices, faces=faces)


def test_a_missing_face_opens_three_edges():
    found = surface_topology(without(BOX, [5]))
    assert found.n_boundary_edges == 3
    assert not found.is_closed
    assert not found.is_clean


def test_a_flipped_face_repeats_three_directed_edges():
    found = surface_topology(flipped(BOX, 5))
    assert found.n_repeated_directed_edges == 3
    assert found.is_closed and found.is_manifold and not found.is_oriented


def test_a_face_twice_is_not_manifold():
    found = surface_topology(TriangleMesh(vertices=BOX.vertices, faces=np.concatenate([BOX.faces, BOX.faces[:1]])))
    assert found.n_nonmanifold_edges == 3


def test_two_boxes_on_one_vertex_pinch_it():
    n = len(BOX.vertices)
    corner = int(np.flatnonzero((BOX.vertices == 1).all(1))[0])
    origin = int(np.flatnonzero((BOX.vertices == 0).all(1))[0])
    second = BOX.faces + n
    second[second == origin + n] = corner
    both = TriangleMesh(vertices=np.concatenate([BOX.vertices, BOX.vertices + 1]), faces=np.concatenate([BOX.faces, second]))
    found = surface_topology(both)
    assert (found.n_pinched_vertices, found.n_components, found.n_unused_vertices) == (1, 2, 1)


def test_a_flat_face_is_degenerate_on_the_threshold():
    def mesh(height):
        return TriangleMesh(vertices=np.array([[0, 0, 0], [1, 0, 0], [0.5, height, 0]]), faces=np.array([[0, 1, 2]]))

    assert surface_topology(mesh(1.9e-12)).n_degenerate_faces == 1
    assert surface_topology(mesh(2.1e-12)).n_degenerate_faces == 0


def test_twins_are_mutual_and_opposite():
    table = edge_table(BOX.faces)
    ends = half_edges(BOX.faces)
    assert (table.twin[table.twin] == np.arange(len(ends))).all()
    assert (ends[table.twin] == ends[:, ::-1]).all()
    assert (table.count == 2).all() and len(table.edges) == 3 * len(BOX.faces) // 2


def test_no_faces():
    none = TriangleMesh(vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), np.int64))
    assert not surface_topology(none).is_closed
    assert surface_topology(none).n_components == 0


def test_components_fans_and_neighbours_equal_brute_force():
    rng = np.random.default_rng(1)
    faces = BOX.faces[rng.random(len(BOX.faces)) < 0.6]
    n, label = face_components(faces)
    edge_sets = [{frozenset(e) for e in (f[[0, 1]], f[[1, 2]], f[[2, 0]])} for f in faces]
    same = np.array([[bool(a & b) for b in edge_sets] for a in edge_sets])
    reach = np.linalg.matrix_power(same.astype(float), len(faces)) > 0
    assert ((label[:, None] == label[None]) == reach).all() and n == label.max() + 1
    start, rows = vertex_faces(faces, len(BOX.vertices))
    for v in range(len(BOX.vertices)):
        assert (rows[start[v] : start[v + 1]] == np.flatnonzero((faces == v).any(1))).all()
    start, other = neighbour_vertices(faces, len(BOX.vertices))
    for v in range(len(BOX.vertices)):
        around = set(faces[(faces == v).any(1)].ravel().tolist()) - {v}
        assert set(other[start[v] : start[v + 1]].tolist()) == around
    fans = corner_fans(BOX.faces)
    assert len(np.unique(fans)) == len(BOX.vertices)
