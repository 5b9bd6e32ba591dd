import numpy as np
import pytest

from predicates import box, l_beam, moved, rotation, sphere
from scan2fea.kernel.measures import area, centroid, face_normals, inertia, tet_volumes, vertex_normals, volume


def test_box_closed_form():
    a, b, c = 2.0, 3.0, 5.0
    mesh = box((a, b, c), pitch=1.0)
    assert volume(mesh) == pytest.approx(30, rel=1e-13)
    assert area(mesh) == pytest.approx(62, rel=1e-13)
    np.testing.assert_allclose(centroid(mesh), [1, 1.5, 2.5], atol=1e-13)
    np.testing.assert_allclose(inertia(mesh), 30 / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b]), rtol=1e-12, atol=1e-10)


def test_l_beam_figures_of_the_thesis():
    mesh = l_beam(length=3.048)
    assert volume(mesh) == pytest.approx(4.793216e-3, rel=1e-6)
    np.testing.assert_allclose(centroid(mesh)[:2], 0.034111, atol=5e-7)


def test_far_from_the_origin_and_small():
    mesh = moved(box((1e-3, 1e-3, 1e-3), pitch=2.5e-4), np.eye(3), np.array([1e4, -1e4, 1e4]))
    assert volume(mesh) == pytest.approx(1e-9, rel=1e-7)  # coordinates there are rounded to 2e-12
    assert area(mesh) == pytest.approx(6e-6, rel=1e-7)


def test_rigid_motion_and_orientation():
    mesh, R = l_beam(pitch=0.05), rotation(3)
    other = moved(mesh, R, np.array([3.0, -2, 1]))
    assert volume(other) == pytest.approx(volume(mesh), rel=1e-12)
    np.testing.assert_allclose(inertia(other), R @ inertia(mesh) @ R.T, atol=1e-15)
    inside_out = type(mesh)(vertices=mesh.vertices, faces=mesh.faces[:, ::-1])
    assert volume(inside_out) == pytest.approx(-volume(mesh))


def test_normals_point_outward():
    mesh = sphere(rounds=3)
    middle = mesh.vertices[mesh.faces].mean(1)
    assert (np.einsum("ij,ij->i", face_normals(mesh), middle) > 0).all()
    assert np.einsum("ij,ij->i", vertex_normals(mesh), mesh.vertices).min() > 0.9999


def test_tets():
    nodes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    assert tet_volumes(nodes, np.array([[0, 1, 2, 3], [0, 2, 1, 3]])) == pytest.approx([1 / 6, -1 / 6])
