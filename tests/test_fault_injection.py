"""Six wrong meshes of an L-beam (reference/style.md, 10): the strongest predicates catch all, weaker ones let some pass, repair undoes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_same_surface, l_beam
from scan2fea.kernel.measures import volume
from scan2fea.kernel.topology import edge_table, surface_topology
from scan2fea.repair import repair
from scan2fea.types import TriangleMesh

BEAM = l_beam(length=0.3, pitch=0.05)


def face_missing():
    return replace(BEAM, faces=BEAM.faces[1:])


def face_flipped():
    faces = BEAM.faces.copy()
    faces[5] = faces[5, ::-1]
    return replace(BEAM, faces=faces)


def inside_out():
    return replace(BEAM, faces=BEAM.faces[:, ::-1])


def vertex_moved():
    vertices = BEAM.vertices.copy()
    vertices[np.argmax(np.linalg.norm(vertices, axis=1))] += 0.02
    return replace(BEAM, vertices=vertices)


def face_degenerate():
    """A vertex of one face put on another of its corners: the face has no area and its edges do not meet their neighbours'."""
    faces = BEAM.faces.copy()
    faces[7, 2] = faces[7, 1]
    return replace(BEAM, faces=faces)


def mirrored():
    """Mirrored without turning the faces: closed and coherent, but inside out."""
    return replace(BEAM, vertices=BEAM.vertices * [-1.0, 1.0, 1.0])


WRONG = {f.__name__: f for f in (face_missing, face_flipped, inside_out, vertex_moved, face_degenerate, mirrored)}


def caught_by(mesh: TriangleMesh) -> set[str]:
    """Names of the predicates that refuse the mesh."""
    topology = surface_topology(mesh)
    edges = edge_table(mesh.faces)
    out = set()
    if abs(abs(volume(mesh)) / volume(BEAM) - 1) > 1e-3:
        out.add("size of the volume alone")
    if topology.n_vertices - len(edges.edges) + topology.n_faces != 2:
        out.add("Euler number alone")
    try:
        assert_closed_manifold_oriented(mesh)
        assert volume(mesh) == pytest.approx(volume(BEAM), rel=1e-6)
    except AssertionError:
        out.add("all together")
    return out


def test_the_right_mesh_passes():
    assert not caught_by(BEAM)


@pytest.mark.parametrize("name", WRONG)
def test_every_wrong_mesh_is_caught(name):
    assert "all together" in caught_by(WRONG[name]())


def test_no_weak_predicate_catches_them_all():
    caught = {name: caught_by(make()) for name, make in WRONG.items()}
    for weak in ("size of the volume alone", "Euler number alone"):
        assert 0 < sum(weak in found for found in caught.values()) < len(WRONG)


@pytest.mark.parametrize("name", ["face_missing", "face_flipped", "inside_out", "face_degenerate", "mirrored"])
def test_repair_gives_the_beam_back(name):
    fixed = repair(WRONG[name]())
    assert_closed_manifold_oriented(fixed.mesh)
    truth = BEAM if name != "mirrored" else TriangleMesh(vertices=BEAM.vertices * [-1.0, 1.0, 1.0], faces=BEAM.faces[:, ::-1])
    assert_same_surface(fixed.mesh, truth, 1e-9, 1e-9)


def test_a_moved_vertex_is_no_fault_of_the_mesh_but_of_its_distance_to_the_truth():
    with pytest.raises(AssertionError):
        assert_same_surface(WRONG["vertex_moved"](), BEAM, 1e-9, 1e-9)
