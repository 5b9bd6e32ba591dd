"""Needles and folds are found where they are."""

import numpy as np
import pytest

from predicates import box, moved, rotation, sphere
from scan2fea.errors import MeshingError
from scan2fea.tetmeshing import FillOptions, fill
from scan2fea.tetmeshing.faults import faults_in_words, smallest_angles
from scan2fea.types import TriangleMesh


def wedge(angle_deg):
    """A prism over a triangle of the given angle at the origin, 1 m deep."""
    a = np.radians(angle_deg)
    loop = np.array([[0, 0], [1, 0], [np.cos(a), np.sin(a)]])
    vertices = np.vstack([np.column_stack([loop, np.zeros(3)]), np.column_stack([loop, np.ones(3)])])
    faces = [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]]
    return TriangleMesh(vertices=vertices, faces=np.array(faces, np.int64))


@pytest.mark.parametrize("angle", [0.3, 4.0, 30.0])
def test_fold_of_a_wedge_is_its_angle(angle):
    solid = moved(wedge(angle), rotation(1), np.array([10.0, 20.0, 30.0]))
    _, _, fold, place = smallest_angles(solid)
    assert fold == pytest.approx(angle, rel=1e-6)
    assert place == pytest.approx((solid.vertices[0] + solid.vertices[3]) / 2)


def test_words_only_below_the_threshold():
    assert faults_in_words(wedge(5.1)) == ""
    assert "folds back on itself to 4.9 deg at (0, 0, 0.5) m, its thinnest triangle has 4.9 deg" in faults_in_words(wedge(4.9))
    assert faults_in_words(sphere(rounds=2)) == faults_in_words(box()) == ""


def test_a_face_without_area_has_no_fold_but_is_a_needle():
    solid = box()
    a, b = solid.faces[0, :2]
    vertices = np.vstack([solid.vertices, solid.vertices[[a, b]].mean(0)])
    new = len(solid.vertices)
    rows = [f for f in solid.faces.tolist() if not {a, b} <= set(f)]
    for f in solid.faces.tolist():
        if {a, b} <= set(f):
            k = next(k for k in range(3) if {f[k], f[(k + 1) % 3]} == {a, b})
            u, v, w = f[k], f[(k + 1) % 3], f[(k + 2) % 3]
            rows += [[u, v, w], [u, new, v]] if f == solid.faces[0].tolist() else [[u, new, w], [new, v, w]]
    rows = np.array(rows, np.int64)
    needle, place, fold, _ = smallest_angles(TriangleMesh(vertices=vertices, faces=rows))
    assert needle == pytest.approx(0.0, abs=1e-9)
    assert place == pytest.approx(vertices[new])
    assert fold > 80


def test_surfaces_that_bound_no_solid_are_refused_with_what_was_counted():
    solid = box()
    open_box = TriangleMesh(vertices=solid.vertices, faces=solid.faces[1:])
    inverted = TriangleMesh(vertices=solid.vertices, faces=solid.faces[:, ::-1])
    inner = TriangleMesh(
        vertices=np.vstack([solid.vertices, 0.25 + 0.5 * solid.vertices]), faces=np.vstack([solid.faces, solid.faces[:, ::-1] + len(solid.vertices)])
    )
    flat = TriangleMesh(vertices=solid.vertices * [1, 1, 0], faces=solid.faces)
    for mesh, says in ((open_box, "open: 3 edges"), (inverted, "inside out"), (inner, "2 shells"), (flat, "encloses 0 m3")):
        with pytest.raises(MeshingError, match=says):
            fill(mesh, None)
    crossing = sphere(rounds=2).vertices.copy()
    crossing[0] = -1.5 * crossing[0]
    with pytest.raises(MeshingError, match="pairs of its faces cross"):
        fill(TriangleMesh(vertices=crossing, faces=sphere(rounds=2).faces), None)


def test_a_budget_too_small_for_the_walls_is_told():
    ball = sphere(rounds=2)
    assert "over_budget" not in fill(ball, None, FillOptions(order=1)).how
    filled = fill(ball, None, FillOptions(max_elements=100, order=1))
    assert filled.how["over_budget"] is True and filled.how["max_elements"] == 100
    assert len(filled.tets.tets) > 100
