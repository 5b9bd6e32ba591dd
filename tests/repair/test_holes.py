import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, box, sphere
from scan2fea.kernel.measures import volume
from scan2fea.repair.holes import boundary_loops, filled
from scan2fea.types import TriangleMesh


def test_loops_run_as_their_faces_do():
    mesh = box(pitch=0.25)
    top = mesh.vertices[mesh.faces].mean(1)[:, 2] > 0.999
    (loop,) = boundary_loops(mesh.faces[~top])
    assert len(loop) == 16
    ends = {(int(a), int(b)) for f in mesh.faces[~top] for a, b in zip(f, np.roll(f, -1), strict=True)}
    assert all((int(a), int(b)) in ends for a, b in zip(loop, np.roll(loop, -1), strict=True))
    assert not boundary_loops(mesh.faces)


def test_least_area_lid_of_a_box_is_flat():
    mesh = box(pitch=0.25)
    top = mesh.vertices[mesh.faces].mean(1)[:, 2] > 0.999
    lid, n = filled(TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[~top]), smooth=False)
    used, packed = np.unique(lid.faces, return_inverse=True)
    assert n == 1
    solid = TriangleMesh(vertices=lid.vertices[used], faces=packed.reshape(-1, 3))
    assert_closed_manifold_oriented(solid)
    assert volume(solid) == pytest.approx(1)


def test_a_loop_longer_than_the_dense_limit():
    mesh = sphere(rounds=5)
    keep = mesh.vertices[mesh.faces].mean(1)[:, 2] < 0.3
    (loop,) = boundary_loops(mesh.faces[keep])
    assert len(loop) > 160
    lid, n = filled(TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[keep]), smooth=False)
    assert n == 1 and not boundary_loops(lid.faces)


def test_no_holes_is_the_same_mesh():
    mesh = box()
    assert filled(mesh)[0] is mesh
