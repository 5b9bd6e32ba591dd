import numpy as np
import pytest

from predicates import box, l_beam, moved, rotation, sphere
from scan2fea.errors import InternalError
from scan2fea.kernel.distances import PointToMesh, distance_to_mesh, sample_surface, signed_distance
from scan2fea.types import TriangleMesh


def brute_force(points, mesh):
    """Least over all faces of the distance to the plane inside, to the edges outside."""
    best = np.full(len(points), np.inf)
    for a, b, c in mesh.vertices[mesh.faces]:
        n = np.cross(b - a, c - a)
        n /= np.linalg.norm(n)
        height = (points - a) @ n
        foot = points - height[:, None] * n
        inside = np.ones(len(points), bool)
        for p, q in ((a, b), (b, c), (c, a)):
            inside &= np.cross(q - p, foot - p) @ n >= 0
            s = np.clip((points - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - p - s[:, None] * (q - p), axis=1))
        best = np.where(inside, np.minimum(best, np.abs(height)), best)
    return best


@pytest.mark.parametrize("mesh", [l_beam(), sphere(rounds=2), box((1, 1, 1e-3))])
def test_equals_brute_force(mesh):
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (300, 3))
    found = distance_to_mesh(points, mesh)
    np.testing.assert_allclose(found.distance, brute_force(points, mesh), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(points - found.closest, axis=1), found.distance, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.einsum("ik,ikj->ij", found.weights, mesh.vertices[mesh.faces[found.face]]), found.closest, atol=1e-12)


def test_points_on_the_mesh_are_at_zero():
    mesh = l_beam(pitch=0.05)
    points, face = sample_surface(mesh, 2000, 1)
    found = PointToMesh(mesh).nearest(points)
    assert found.distance.max() < 1e-15
    assert (face == found.face).mean() > 0.99


def test_long_thin_faces_on_a_3_m_part():
    mesh = l_beam(length=3.048)  # float32 is 2.4 mm wrong here
    R, shift = rotation(2), np.array([900.0, -400, 100])
    points = np.random.default_rng(1).uniform(-0.1, 3, (500, 3))
    here, there = distance_to_mesh(points, mesh).distance, distance_to_mesh(points @ R.T + shift, moved(mesh, R, shift)).distance
    np.testing.assert_allclose(here, there, atol=1e-11)


def test_degenerate_faces_are_segments():
    mesh = TriangleMesh(vertices=np.array([[0, 0, 0], [2, 0, 0], [2.0, 0, 0]]), faces=np.array([[0, 1, 2], [0, 1, 1]]))
    assert distance_to_mesh(np.array([[1.0, 3, 0], [-4, 3, 0]]), mesh).distance == pytest.approx([3, 5])


def test_sign_inside_and_out_at_faces_edges_and_corners():
    mesh = box()
    rng = np.random.default_rng(3)
    inside = rng.uniform(0.01, 0.99, (500, 3))
    outside = rng.uniform(-0.5, 1.5, (2000, 3))
    outside = outside[((outside < -0.01) | (outside > 1.01)).any(1)]
    assert (signed_distance(inside, mesh) < 0).all()
    assert (signed_distance(outside, mesh) > 0).all()
    legs = l_beam()
    assert signed_distance(np.array([[0.0067, 0.0067, 0.2]]), legs)[0] > 0  # in the inner corner
    assert signed_distance(np.array([[0.003, 0.003, 0.2]]), legs)[0] < 0


def test_samples_are_uniform_and_seeded():
    mesh = box((1, 2, 4))
    points, face = sample_surface(mesh, 40_000, 7)
    share = np.bincount(face, minlength=12).reshape(-1)
    from scan2fea.kernel.measures import face_areas

    np.testing.assert_allclose(share / 40_000, face_areas(mesh) / 28, atol=0.01)
    assert (points == sample_surface(mesh, 40_000, 7)[0]).all()


def test_no_faces_and_no_points():
    with pytest.raises(InternalError, match="without faces"):
        PointToMesh(TriangleMesh(vertices=np.eye(3), faces=np.zeros((0, 3), np.int64)))
    assert len(distance_to_mesh(np.zeros((0, 3)), box()).distance) == 0
