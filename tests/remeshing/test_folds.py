import numpy as np
import pytest

from scan2fea.kernel.folds import interior_angles
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import surface_topology
from scan2fea.remeshing.folds import flattest_deg, folded_faces, meshable, unfolded
from scan2fea.remeshing.needles import without_needles
from scan2fea.simulation.shapes import box
from scan2fea.types import TriangleMesh


def ball(n_rings=12, n_around=24, radius=1.0):
    """A sphere of latitude rings."""
    polar = np.pi * np.arange(1, n_rings) / n_rings
    around = 2 * np.pi * np.arange(n_around) / n_around
    ring = np.stack([np.cos(around), np.sin(around)], 1)
    points = [[0, 0, radius], *[[*(radius * np.sin(a) * r), radius * np.cos(a)] for a in polar for r in ring], [0, 0, -radius]]
    at = lambda i, j: 1 + i * n_around + j % n_around  # noqa: E731
    faces = [[0, at(0, j), at(0, j + 1)] for j in range(n_around)]
    for i in range(n_rings - 2):
        for j in range(n_around):
            faces += [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    last = len(points) - 1
    faces += [[last, at(n_rings - 2, j + 1), at(n_rings - 2, j)] for j in range(n_around)]
    return TriangleMesh(vertices=np.array(points, float), faces=np.array(faces))


def test_angles_of_a_box_are_right_or_flat():
    _, angle = interior_angles(box(1.0, 2.0, 3.0))
    assert set(np.round(angle, 9)) == {90.0, 180.0}


def test_a_notch_counts_as_over_half_a_turn():
    mesh = ball()
    points = mesh.vertices.copy()
    points[0] = [0, 0, -0.5]  # the pole pushed in
    _, angle = interior_angles(TriangleMesh(vertices=points, faces=mesh.faces))
    assert angle.max() > 180
    assert angle.min() < 90


def test_spike_is_drawn_in_and_the_rest_stays():
    mesh = ball()
    points = mesh.vertices.copy()
    points[60] *= 6.0
    spiked = TriangleMesh(vertices=points, faces=mesh.faces)
    assert len(folded_faces(spiked))
    smooth = unfolded(spiked)
    assert not len(folded_faces(smooth))
    assert not len(self_intersections(smooth))
    moved = np.linalg.norm(smooth.vertices - spiked.vertices, axis=1) > 0
    assert moved[60]
    assert moved.sum() < 0.2 * len(moved)
    assert abs(volume(smooth) / volume(mesh) - 1) < 0.05
    assert np.array_equal(spiked.vertices, points)


def test_clean_surface_is_untouched():
    mesh = box(1.0, 1.0, 1.0)
    assert meshable(mesh) is mesh
    assert unfolded(mesh) is mesh
    assert without_needles(mesh) is mesh


def test_needle_is_collapsed_and_planes_stay():
    mesh = box(1.0, 1.0, 1.0)
    corner = mesh.faces[0]
    a, b, c = mesh.vertices[corner]
    close = a + 1e-3 * ((b - a) + (c - a))
    n = len(mesh.vertices)
    faces = np.r_[mesh.faces[1:], [[corner[0], corner[1], n], [corner[1], corner[2], n], [corner[2], corner[0], n]]]
    sides = np.unique(np.round(face_normals(TriangleMesh(vertices=np.r_[mesh.vertices, [close]], faces=faces))), axis=0, return_inverse=True)[1]
    needled = TriangleMesh(vertices=np.r_[mesh.vertices, [close]], faces=faces, face_region=sides.ravel())
    clean = without_needles(needled)
    assert surface_topology(clean).is_clean
    assert len(clean.vertices) == n
    assert volume(clean) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("height", [0.05, 0.5])
def test_the_flattest_angle_of_a_wedge_is_that_of_its_edge(height):
    """A tetrahedron over an equilateral face: its folds have atan(height / inradius), unless the angles of its faces are smaller."""
    corners = np.array([[1.0, 0, 0], [-0.5, 3**0.5 / 2, 0], [-0.5, -(3**0.5) / 2, 0], [0, 0, height]])
    mesh = TriangleMesh(vertices=corners, faces=np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))
    fold = np.degrees(np.arctan2(height, 0.5))
    needle = np.degrees(np.arctan2(np.hypot(0.5, height), 3**0.5 / 2))
    assert flattest_deg(mesh) == pytest.approx(min(fold, needle))
    assert flattest_deg(TriangleMesh(vertices=corners, faces=mesh.faces[:, ::-1])) == pytest.approx(min(fold, needle))
