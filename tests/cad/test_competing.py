"""Patches that pass into each other without an angle, shared out between their surfaces."""

import functools

import numpy as np
import pytest

from drawn import drawing, triangles
from predicates import box
from scan2fea.cad import true_solid
from scan2fea.cad.competing import competed
from scan2fea.cad.patches import Near, segmented
from scan2fea.kernel.surfaces import CYLINDER, PLANE, Surface
from scan2fea.remeshing.exact import drawn
from scan2fea.repair import repair
from scan2fea.types import TriangleMesh

EDGE, RADIUS, NOISE = 1.06e-3, 3.18e-3, 1e-4


@functools.cache
def pocket():
    """A block with a pocket whose upright corners are round."""
    with drawing() as occ:
        rounded = occ.addRectangle(0.02, 0.01, 0.007, 0.02, 0.03, 0, RADIUS)
        tool = [part for part in occ.extrude([(2, rounded)], 0, 0, 0.01) if part[0] == 3]
        occ.cut([(3, occ.addBox(0, 0, 0, 0.06, 0.05, 0.012))], tool)
        mesh = triangles(EDGE)
    return repair(mesh).mesh


@pytest.mark.parametrize("seed", range(2))
def test_the_round_corners_of_a_pocket_and_its_sides_have_their_own_size(seed):
    """The sides took what lay within the tolerance: of the corners 45 faces were left for 90, and one was a plane."""
    mesh = pocket()
    mesh = TriangleMesh(vertices=mesh.vertices + NOISE * np.random.default_rng(seed).standard_normal(mesh.vertices.shape), faces=mesh.faces)
    found = true_solid(mesh, mesh.vertices, spacing_m=EDGE, noise_m=NOISE)
    assert sorted(found.brep.face_kinds) == [CYLINDER] * 4 + [PLANE] * 11
    held = 0.06 * 0.05 * 0.012 - 0.005 * (0.02 * 0.03 - (4 - np.pi) * RADIUS**2)
    assert found.brep.volume_m3 == pytest.approx(held, rel=2e-3)


def half_pipe(n=24, length=20):
    """A sheet: flat for x < 0, then a quarter of a cylinder of radius 1 about (0, ., 1); its exact surfaces."""
    flat = np.column_stack([np.linspace(-2, 0, n + 1)[:-1], np.zeros(n)])
    turn = np.linspace(0, np.pi / 2, n + 1)
    profile = np.concatenate([flat, np.column_stack([np.sin(turn), 1 - np.cos(turn)])])
    y = np.linspace(0, 2, length + 1)
    points = np.array([(x, at, z) for x, z in profile for at in y])
    k = length + 1
    a = np.array([i * k + j for i in range(len(profile) - 1) for j in range(length)])
    faces = np.concatenate([np.stack([a, a + k, a + k + 1], 1), np.stack([a, a + k + 1, a + 1], 1)])
    mesh = TriangleMesh(vertices=points, faces=faces)
    surfaces = [
        Surface(kind=PLANE, point=np.zeros(3), axis=np.array([0.0, 0, 1])),
        Surface(kind=CYLINDER, point=np.array([0.0, 0, 1]), axis=np.array([0.0, 1, 0]), radius=1.0, sense=-1),
    ]
    return mesh, surfaces


def neighbours(mesh):
    """(m, 3) of an open sheet: a face is its own neighbour at the rim."""
    edges = {}
    for f, tri in enumerate(mesh.faces.tolist()):
        for a, b in zip(tri, tri[1:] + tri[:1], strict=True):
            edges.setdefault(frozenset((a, b)), []).append(f)
    return np.array(
        [
            [next((g for g in edges[frozenset((a, b))] if g != f), f) for a, b in zip(t, t[1:] + t[:1], strict=True)]
            for f, t in enumerate(mesh.faces.tolist())
        ]
    )


@pytest.mark.parametrize("shift", [-0.5, 0.4])
def test_a_border_in_the_wrong_place_moves_to_where_the_surfaces_touch(shift):
    mesh, surfaces = half_pipe()
    middle = mesh.vertices[mesh.faces].mean(1)
    label = (middle[:, 0] > shift).astype(np.int64)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    found, out = competed(mesh, neighbours(mesh), normals, label, surfaces)
    assert np.abs(middle[found == 1, 0].min()) < 0.1
    assert np.abs(middle[found == 0, 0].max()) < 0.1
    assert out[1].radius == pytest.approx(1.0, abs=1e-3)
    assert label.tolist() == (middle[:, 0] > shift).astype(int).tolist()


def test_faces_at_a_crease_stay():
    mesh = box((0.04, 0.04, 0.04), 0.004)
    found = segmented(mesh, 1e-5)
    near = Near(mesh)
    again, _ = competed(mesh, near.of, near.smooth, found.label, found.surfaces)
    assert (again == found.label).all()


def test_without_surfaces_nothing_changes():
    mesh = box((0.04, 0.04, 0.04), 0.02)
    near = Near(mesh)
    label, out = competed(mesh, near.of, near.smooth, np.full(len(mesh.faces), -1), [])
    assert (label == -1).all()
    assert out == []


@functools.cache
def shallow(depth):
    """A block with a shallow pocket, its planes exact as in a drawn file; and its volume."""
    side, radius = 0.014, 3.19e-3
    with drawing() as occ:
        rounded = occ.addRectangle(0.003, 0.003, 0.006 - depth, side, side, 0, radius)
        tool = [part for part in occ.extrude([(2, rounded)], 0, 0, 0.01) if part[0] == 3]
        occ.cut([(3, occ.addBox(0, 0, 0, side + 0.006, side + 0.006, 0.006))], tool)
        mesh = triangles(6e-4)
    return drawn(repair(mesh).mesh).mesh, (side + 0.006) ** 2 * 0.006 - depth * (side**2 - (4 - np.pi) * radius**2)


@pytest.mark.parametrize("depth", [1.17e-3, 2e-3])
def test_the_round_corners_of_a_pocket_beside_exact_planes_are_faces(depth):
    """A plane that one face of the arc had joined became a cylinder, and its corner was lost (2 mm); a floor drawn askew closed the pocket (1.17)."""
    mesh, held = shallow(depth)
    found = true_solid(mesh, mesh.vertices, spacing_m=6e-4, noise_m=6e-4**2 / (8 * 3.19e-3))
    assert sorted(found.brep.face_kinds) == [CYLINDER] * 4 + [PLANE] * 11
    assert found.brep.volume_m3 == pytest.approx(held, rel=1e-6)


def test_a_known_surface_keeps_its_values_while_its_faces_move():
    mesh, surfaces = half_pipe()
    middle = mesh.vertices[mesh.faces].mean(1)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    label = (middle[:, 0] > 0.4).astype(np.int64)
    found, out = competed(mesh, neighbours(mesh), normals, label, surfaces, 1)
    assert out[0] is surfaces[0]
    assert np.abs(middle[found == 0, 0].max()) < 0.1
