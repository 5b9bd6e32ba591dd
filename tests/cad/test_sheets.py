"""Bodies with a wall of free form among true faces."""

import functools

import numpy as np
import pytest

from predicates import box
from scan2fea.cad import true_solid
from scan2fea.cad.readback import read_back
from scan2fea.cad.sheets import as_facet, sheet
from scan2fea.kernel.measures import volume
from scan2fea.kernel.surfaces import PLANE, Surface
from scan2fea.tetmeshing import fill
from scan2fea.types import TriangleMesh

SIDE, HIGH, EDGE, NOISE = 0.028, 0.012, 0.002, 5e-5


@functools.cache
def wavy():
    """A block whose top is waves of 2 mm, its corners within 0.05 mm."""
    block = box((SIDE, SIDE, HIGH), EDGE)
    at = block.vertices.copy()
    top = at[:, 2] > HIGH - 1e-9
    at[top, 2] += 0.002 * np.sin(at[top, 0] / 0.0028) * np.sin(at[top, 1] / 0.0028)
    at += NOISE * np.random.default_rng(0).standard_normal(at.shape)
    return TriangleMesh(vertices=at, faces=block.faces), top[block.faces].all(1)


@functools.cache
def made():
    mesh = wavy()[0]
    return true_solid(mesh, mesh.vertices, spacing_m=EDGE, noise_m=NOISE)


def test_a_block_with_a_wavy_top_keeps_its_five_planes():
    mesh, top = wavy()
    found = made()
    assert found.reason == ""
    kinds = found.brep.face_kinds
    assert kinds.count("plane") == 5
    assert 0.9 * top.sum() < kinds.count("facet") <= 1.1 * top.sum()
    assert set(kinds) == {"plane", "facet"}
    assert found.brep.volume_m3 == pytest.approx(volume(mesh), rel=1e-3)
    back = read_back(found.brep.step)
    assert back.is_valid
    assert (back.n_solids, back.n_free_edges, len(back.face_area)) == (1, 0, len(kinds))


def test_it_is_filled_with_tets():
    found = made()
    assert len(fill(found.mesh, found.brep).tets.tets) > 1000


def test_a_sheet_crosses_each_surface_beside_it_once():
    mesh, top = wavy()
    mm = TriangleMesh(vertices=mesh.vertices * 1e3, faces=mesh.faces)
    planes, label = [], np.full(len(mm.faces), -1)
    middle = mm.vertices[mm.faces].mean(1)
    for axis, side, value in ((0, -1, 0), (0, 1, 1e3 * SIDE), (1, -1, 0), (1, 1, 1e3 * SIDE), (2, -1, 0)):
        normal, at = np.zeros(3), 500 * np.array([SIDE, SIDE, HIGH])
        normal[axis], at[axis] = side, value
        label[~top & (np.abs(middle[:, axis] - value) < 0.5)] = len(planes)
        planes.append(Surface(kind=PLANE, point=at, axis=normal))
    found = sheet(mm, np.flatnonzero(top), label, planes, 0.2, 3.5)
    assert len(found.faces) == top.sum()
    off = np.array([p.distance(found.vertices) for p in planes])
    assert ((off[:4] > 0.15).sum(1) == round(SIDE / EDGE) + 1).all()
    assert (np.abs(off[:4]) > 0.06).all()
    assert (off[4] < 0).all()


def test_a_plane_that_was_not_drawn_is_a_facet():
    drawn = [Surface(kind=PLANE, point=np.zeros(3), axis=np.array([0, 0, 1.0]))]
    same = Surface(kind=PLANE, point=np.array([3.0, 1, 0]), axis=np.array([0, 0, -1.0]))
    above = Surface(kind=PLANE, point=np.array([3.0, 1, 0.01]), axis=np.array([0, 0, 1.0]))
    ball = Surface(kind="sphere", point=np.zeros(3), axis=np.array([0, 0, 1.0]), radius=1.0)
    assert [as_facet(s, drawn).kind for s in (same, above, ball)] == ["plane", "facet", "sphere"]
