"""Boundary, tags, mid nodes and the proof of a tet mesh, on meshes small enough to write down."""

import itertools

import numpy as np
import pytest

from scan2fea.errors import MeshingError
from scan2fea.kernel.quality import TET_EDGES
from scan2fea.tetmeshing.tets import boundary_of, proved, tagged, tet_mesh, with_mid_nodes

NODES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], float)
TETS = np.array([[0, 1, 2, 3], [1, 2, 3, 4]], np.int64)  # the second on the slanted face of the first


def test_boundary_by_brute_force():
    faces = [tuple(sorted(f)) for t in TETS.tolist() for f in itertools.combinations(t, 3)]
    once = {f for f in faces if faces.count(f) == 1}
    found = boundary_of(TETS)
    assert {tuple(sorted(f)) for f in found.tolist()} == once


def test_boundary_is_outward():
    tri = NODES[boundary_of(TETS)]
    normal = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    assert (((tri.mean(1) - NODES.mean(0)) * normal).sum(1) > 0).all()


def test_a_face_of_three_tets_is_refused():
    with pytest.raises(MeshingError, match="more than two tets"):
        boundary_of(np.array([[0, 1, 2, 3], [0, 1, 2, 4], [0, 1, 2, 5]], np.int64))


def test_tags_follow_the_corners_in_any_order():
    boundary = boundary_of(TETS)
    shuffled = boundary[::-1, [1, 2, 0]]
    assert tagged(boundary, shuffled, np.arange(len(boundary))).tolist() == list(range(len(boundary)))[::-1]
    with pytest.raises(MeshingError, match="1 boundary triangles"):
        tagged(boundary, boundary[1:], np.arange(len(boundary) - 1))


def test_proof_passes_what_is_right_and_names_what_is_not():
    boundary = boundary_of(TETS)
    volume = 1 / 6 + 1 / 3
    proved(NODES, TETS, boundary, volume)
    proved(NODES, TETS, boundary, volume * (1 + 0.9e-6))
    with pytest.raises(MeshingError, match="fill"):
        proved(NODES, TETS, boundary, volume * (1 + 1.1e-6))
    with pytest.raises(MeshingError, match="1 of 2 tets"):
        proved(NODES, TETS[:, [0, 1, 2, 3]] * [[1], [0]] + TETS[:, [1, 0, 2, 3]] * [[0], [1]], boundary, volume)
    with pytest.raises(MeshingError, match="not one closed surface"):
        proved(NODES, TETS, boundary[1:], volume)
    with pytest.raises(MeshingError, match="gave no tets"):
        proved(NODES, TETS[:0], boundary, volume)


def test_mid_nodes_by_definition():
    nodes, tets, boundary = with_mid_nodes(NODES, TETS, boundary_of(TETS))
    assert len(nodes) == 5 + 9  # 9 edges
    for tet in tets:
        for k, (i, j) in enumerate(TET_EDGES):
            assert np.array_equal(nodes[tet[4 + k]], (nodes[tet[i]] + nodes[tet[j]]) / 2)
    for tri in boundary:
        for k, (i, j) in enumerate([(0, 1), (1, 2), (0, 2)]):
            assert np.array_equal(nodes[tri[3 + k]], (nodes[tri[i]] + nodes[tri[j]]) / 2)
    assert np.array_equal(nodes[:5], NODES)


@pytest.mark.parametrize(("order", "width"), [(1, 4), (2, 10)])
def test_order(order, width):
    boundary = boundary_of(TETS)
    mesh = tet_mesh(NODES, TETS, boundary, np.zeros(len(boundary), np.int64), ("A",), order)
    assert (mesh.order, mesh.tets.shape[1], mesh.boundary.shape[1]) == (order, width, 3 * order)
