"""Faces of drawings from their own triangles: which surfaces the corners lie on, and the solid that these close."""

import numpy as np
import pytest

from drawn import drawing
from predicates import rotation
from scan2fea.cad import drawn_solid
from scan2fea.cad.drawn import drawn_patches
from scan2fea.cad.drawn_solid import chord_of, finer
from scan2fea.kernel.measures import area, volume
from scan2fea.kernel.surfaces import CONE, CYLINDER, PLANE, SPHERE, TORUS
from scan2fea.kernel.topology import surface_topology
from scan2fea.types import TriangleMesh


def turned(profile, n=24, seed=None):
    """A polyline (r, z) that begins and ends on the axis, turned in n steps, as CAD programs write it."""
    unit = np.array([(np.cos(a), np.sin(a)) for a in 2 * np.pi * np.arange(n) / n])
    profile = np.array(profile, float)
    rings = [np.c_[r * unit, np.full(n, z)] for r, z in profile[1:-1]]
    vertices = np.concatenate([[[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]], *rings])
    k, j = np.arange(n), (np.arange(n) + 1) % n
    faces = [np.c_[np.zeros(n, int), 2 + j, 2 + k]]
    for i in range(len(rings) - 1):
        low, top = 2 + i * n, 2 + (i + 1) * n
        faces += [np.c_[low + k, low + j, top + j], np.c_[low + k, top + j, top + k]]
    last = 2 + (len(rings) - 1) * n
    faces.append(np.c_[np.ones(n, int), last + k, last + j])
    vertices = vertices if seed is None else vertices @ rotation(seed).T + 0.2
    return TriangleMesh(vertices=vertices, faces=np.concatenate(faces).astype(np.int64))


def kinds(mesh):
    return sorted(s.kind for s in drawn_patches(mesh).surfaces)


STEPS = np.linspace(0, np.pi / 2, 7)
SHAFT = [(0, 0), (0.02, 0), (0.02, 0.05), (0, 0.05)]
SUNK = [(0, 0), (0.02, 0), (0.02, 0.03), (0.01, 0.05), (0, 0.05)]
ROUND = [(0, 0), (0.02, 0), *[(0.015 + 0.005 * np.cos(a), 0.03 + 0.005 * np.sin(a)) for a in STEPS], (0, 0.035)]
BALL = [(0, 0), (0.02, 0), *[(0.02 * np.cos(a), 0.03 + 0.02 * np.sin(a)) for a in STEPS[:-1]], (0, 0.05)]


@pytest.mark.parametrize(
    ("profile", "wanted"),
    [
        (SHAFT, [CYLINDER, PLANE, PLANE]),
        (SUNK, [CONE, CYLINDER, PLANE, PLANE]),
        (ROUND, [CYLINDER, PLANE, PLANE, TORUS]),
        (BALL, [CYLINDER, PLANE, SPHERE]),
    ],
)
@pytest.mark.parametrize("seed", [None, 3])
def test_each_kind_is_told_by_its_corners(profile, wanted, seed) -> None:
    mesh = turned(profile, seed=seed)
    patches = drawn_patches(mesh)
    assert sorted(s.kind for s in patches.surfaces) == wanted and (patches.label >= 0).all()
    for k, surface in enumerate(patches.surfaces):
        own = np.unique(mesh.faces[patches.label == k])
        assert np.abs(surface.distance(mesh.vertices[own])).max() < 1e-8


def test_a_prism_is_one_of_planes_and_a_finer_one_a_cylinder() -> None:
    assert kinds(turned(SHAFT, n=8)) == [PLANE] * 10
    assert kinds(turned(SHAFT, n=12)) == [CYLINDER, PLANE, PLANE]


def test_noise_of_a_scan_leaves_no_drawing() -> None:
    mesh = turned(SHAFT)
    noisy = TriangleMesh(vertices=mesh.vertices + 1e-5 * np.random.default_rng(0).standard_normal(mesh.vertices.shape), faces=mesh.faces)
    assert not any(s.kind == CYLINDER for s in drawn_patches(noisy).surfaces)
    assert drawn_solid(noisy).brep is None


def test_an_egg_is_on_no_surface() -> None:
    egg = [(0, -0.03), *[(0.02 * np.cos(a), 0.03 * np.sin(a)) for a in np.linspace(-1.4, 1.4, 12)], (0, 0.03)]
    found = drawn_solid(turned(egg))
    assert found.brep is None and found.reason


@pytest.mark.parametrize("seed", [None, 4, 5])
@pytest.mark.parametrize(("profile", "n_faces"), [(SHAFT, 3), (SUNK, 4), (ROUND, 4)])
def test_the_solid_is_that_of_the_surfaces(profile, n_faces, seed) -> None:
    mesh = turned(profile, seed=seed)
    found = drawn_solid(mesh)
    assert found.brep is not None, found.reason
    assert len(found.brep.face_names) == n_faces and found.brep.is_valid and found.brep.n_free_edges == 0
    fine = np.array(profile if profile is not ROUND else [*ROUND[:2], *[
        (0.015 + 0.005 * np.cos(a), 0.03 + 0.005 * np.sin(a)) for a in np.linspace(0, np.pi / 2, 2000)], ROUND[-1]])  # fmt: skip
    (r0, z0), (r1, z1) = fine[:-1].T, fine[1:].T
    exact = float((np.pi / 3 * (z1 - z0) * (r0**2 + r0 * r1 + r1**2)).sum())
    assert found.brep.volume_m3 == pytest.approx(exact, rel=1e-6) and volume(mesh) < 0.99 * exact


def test_a_file_of_four_byte_numbers_is_as_good() -> None:
    mesh = turned(ROUND, seed=7)
    rounded = TriangleMesh(vertices=mesh.vertices.astype(np.float32).astype(float), faces=mesh.faces)
    assert kinds(rounded) == kinds(mesh) and drawn_solid(rounded).brep is not None


def test_a_plate_whose_rim_is_rounded_into_its_side_touches() -> None:
    with drawing() as occ:
        import gmsh

        box = occ.addBox(0, 0, 0, 80, 60, 12)
        occ.synchronize()
        upright = [t for _, t in gmsh.model.getEntities(1) if abs(np.subtract(*[gmsh.model.getBoundingBox(1, t)[k] for k in (5, 2)])) > 11]
        occ.fillet([box], upright, [15.0])
        occ.synchronize()
        low = [t for _, t in gmsh.model.getEntities(1) if gmsh.model.getBoundingBox(1, t)[5] < 0.01]
        occ.fillet([box], low, [5.0])
        mesh = tessellated_by_occ(gmsh)
    found = drawn_solid(mesh)
    assert found.brep is not None, found.reason
    assert sorted(found.brep.face_kinds) == [CYLINDER] * 8 + [PLANE] * 6 + [TORUS] * 4


def tessellated_by_occ(gmsh):
    """The shape as a CAD program's triangles, metres."""
    import tempfile
    from pathlib import Path

    from scan2fea.cad.compared import faces_of
    from scan2fea.cad.live import joined_triangles, tessellated
    from scan2fea.cad.readback import shape_of_step

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "body.step"
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
        shape = shape_of_step(path)
    tessellated(shape, 0.5, 0.3)
    mesh, _ = joined_triangles(faces_of(shape))
    return TriangleMesh(vertices=1e-3 * mesh.vertices, faces=mesh.faces)


def test_a_wall_of_free_form_keeps_its_triangles() -> None:
    wave = [(x, 0.02 + 0.002 * np.sin(90 * x) + 0.0004 * np.sin(300 * x)) for x in np.linspace(0, 0.1, 25)]
    flat = np.array([(0, 0), (0.1, 0), *wave[::-1]])
    n = len(flat)
    vertices = np.concatenate([np.c_[flat, np.zeros(n)], np.c_[flat, np.full(n, 0.2)]])
    k, j = np.arange(n), (np.arange(n) + 1) % n
    top = [(1, i + 1, i) for i in range(2, n - 1)] + [(0, 1, n - 1)]
    cap = [(0, 1, n - 1), *[(1, i, i + 1) for i in range(2, n - 1)]]
    faces = [np.c_[k, j, n + j], np.c_[k, n + j, n + k], np.array(cap)[:, ::-1], np.array(cap) + n]
    del top
    mesh = TriangleMesh(vertices=vertices, faces=np.concatenate(faces).astype(np.int64))
    assert surface_topology(mesh).is_clean
    patches = drawn_patches(mesh)
    free = patches.label < 0
    assert sorted(s.kind for s in patches.surfaces)[-5:] == [PLANE] * 5 and 40 <= free.sum() <= 48


def test_finer_triangles_keep_the_shape_and_lie_on_their_surfaces() -> None:
    mesh = turned(SHAFT)
    patches = drawn_patches(mesh)
    fine, label = finer(mesh, patches, 0.003)
    assert surface_topology(fine).is_clean and len(fine.faces) > 4 * len(mesh.faces)
    assert area(fine) == pytest.approx(area(mesh), rel=0.02) and volume(fine) >= volume(mesh)
    edges = np.linalg.norm(fine.vertices[fine.faces] - fine.vertices[np.roll(fine.faces, -1, axis=1)], axis=2)
    assert edges.max() <= 0.003 * 1.001
    for k, surface in enumerate(patches.surfaces):
        if surface.kind == PLANE:
            assert np.abs(surface.distance(fine.vertices[np.unique(fine.faces[label == k])])).max() < 1e-9


def test_the_height_of_chords_is_that_of_the_circle() -> None:
    mesh = turned(SHAFT)
    assert chord_of(mesh, drawn_patches(mesh)) == pytest.approx(0.02 * (1 - np.cos(np.pi / 24)), rel=1e-6)
