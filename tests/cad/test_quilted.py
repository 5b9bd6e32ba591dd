"""True faces with NURBS patches for the rest: topology, volume, distance both ways, and what is given up where surfaces do not meet."""

import functools

import numpy as np
import pytest

from predicates import TOPPED_SIZE, topped
from scan2fea.cad import PATCH, QUILTED, true_solid
from scan2fea.cad.live import is_valid
from scan2fea.cad.quilted import quilted_solid
from scan2fea.cad.readback import read_back, volume_of
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import volume
from scan2fea.kernel.surfaces import PLANE, SPHERE, Surface
from scan2fea.types import TriangleMesh


def waves(x, y):
    return 2.0 * np.sin(x / 4.0) * np.sin(y / 4.0)


def quilt(noise, seed=0, free=None, planes=None):
    mesh, exact, label, found = topped(waves, noise, seed)
    planes = found if planes is None else planes
    free = label < 0 if free is None else free
    small = [1e-4 * np.eye(3)] * len(planes)
    return exact, quilted_solid(mesh, label, planes, small, 3 * noise + 0.02, 1.0, free, 3 * noise + 0.25, noise + 0.03, 1.5 + 9 * noise)


@pytest.mark.parametrize(("noise", "seed"), [(0.0, 0), (0.05, 1), (0.1, 2)])
def test_a_wavy_top_among_five_planes_is_some_patches(noise, seed):
    exact, made = quilt(noise, seed)
    assert made.reason == ""
    assert is_valid(made.solid)
    assert 3 <= made.n_patches < 60  # of 1 600 triangles
    assert volume_of(made.solid) == pytest.approx(volume(exact), rel=1e-3)


def test_nothing_free_leaves_nothing_to_patch():
    mesh, _, label, planes = topped(lambda x, y: 0 * x, 0.0)
    top = Surface(kind=PLANE, point=TOPPED_SIZE, axis=np.array([0.0, 0.0, 1.0]))
    none, label = np.zeros(len(label), bool), np.where(label < 0, 5, label)
    made = quilted_solid(mesh, label, [*planes, top], [1e-4 * np.eye(3)] * 6, 0.02, 1.0, none, 0.25, 0.03, 1.5)
    assert made.solid is None
    assert "meet" in made.reason


def test_a_surface_that_meets_its_neighbours_nowhere_is_given_up():
    mesh, exact, label, planes = topped(waves, 0.0)
    wrong = Surface(kind=SPHERE, point=np.array([-50.0, 10.0, 5.0]), axis=np.array([0.0, 0.0, 1.0]), radius=1.0)
    made = quilted_solid(mesh, label, [wrong, *planes[1:]], [1e-4 * np.eye(4), *[1e-4 * np.eye(3)] * 4], 0.02, 1.0, label < 0, 0.25, 0.03, 1.5)
    assert made.free[label == 0].mean() > 0.95 or made.solid is None
    if made.solid is not None:
        assert volume_of(made.solid) == pytest.approx(volume(exact), rel=2e-2)


@functools.cache
def dented():
    """A block 40 x 20 x 10 mm with a dent in its top, metres."""
    mesh, exact, _, _ = topped(lambda x, y: -1.5 * np.exp(-((x - 17) ** 2 + (y - 9) ** 2) / 18), 0.03)
    return (TriangleMesh(vertices=m.vertices * 1e-3, faces=m.faces) for m in (mesh, exact))


def test_a_dented_block_keeps_its_planes_and_reads_back():
    mesh, exact = dented()
    made = true_solid(mesh, mesh.vertices, spacing_m=1e-3, noise_m=3e-5, way=QUILTED)
    assert made.reason == ""
    kinds = made.brep.face_kinds
    assert kinds.count("plane") >= 5
    assert 0 < kinds.count(PATCH) < 60
    assert set(kinds) == {"plane", PATCH}
    back = read_back(made.brep.step)
    assert (back.is_valid, back.n_solids, back.n_free_edges, len(back.face_area)) == (True, 1, 0, len(kinds))
    assert made.brep.volume_m3 == pytest.approx(volume(exact), rel=1e-3)
    assert PointToMesh(made.mesh).nearest(exact.vertices).distance.max() < 4e-4
    assert PointToMesh(exact).nearest(made.mesh.vertices).distance.max() < 4e-4


def test_input_is_untouched():
    mesh, _, label, planes = topped(waves, 0.05)
    at, names = mesh.vertices.copy(), label.copy()
    quilted_solid(mesh, label, planes, [1e-4 * np.eye(3)] * 5, 0.17, 1.0, label < 0, 0.4, 0.08, 2.0)
    assert (mesh.vertices == at).all()
    assert (label == names).all()
