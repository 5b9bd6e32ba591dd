"""The map of thickness: that of a plate is its wall on the large faces, the noise stands in the histogram, open things have none."""

import numpy as np
import pytest

from report.fake_out import angle_solid, boundary_of
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.thickness import face_thickness, wall_thickness
from scan2fea.report.camera import look_at
from scan2fea.report.thickness import thickness_figure
from scan2fea.types import TriangleMesh


def plate(x, y, z):
    corners = np.array([[a, b, c] for a in (0.0, x) for b in (0.0, y) for c in (0.0, z)])
    faces = np.array(["013", "032", "467", "475", "045", "051", "237", "276", "026", "064", "157", "173"]).view("U1").reshape(12, 3)
    return TriangleMesh(vertices=corners, faces=faces.astype(np.int64))


def test_thickness_of_each_face_of_a_block():
    mesh = plate(0.3, 0.2, 0.01)
    along = np.abs(face_normals(mesh)).argmax(axis=1)
    assert face_thickness(mesh) == pytest.approx(np.array([0.3, 0.2, 0.01])[along])
    assert len(face_thickness(TriangleMesh(vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), np.int64)))) == 0


def test_an_open_sheet_meets_nothing():
    sheet = plate(0.3, 0.2, 0.01)
    one = TriangleMesh(vertices=sheet.vertices, faces=sheet.faces[:2])
    assert np.isnan(face_thickness(one)).all() and thickness_figure(one, look_at(one.vertices), 1e-3) is None


def test_the_figure_tells_the_wall_and_the_noise():
    mesh = boundary_of(angle_solid())
    middle = 1e3 * float(np.median(wall_thickness(mesh)))
    figure = thickness_figure(mesh, look_at(mesh.vertices), 1e-3)
    assert f"{middle:.3g}" in figure.caption.replace("\u202f", "") and "\u03c3" in str(figure.chart)
    assert "noise" not in thickness_figure(mesh, look_at(mesh.vertices), None).caption
    thin = thickness_figure(plate(0.3, 0.2, 0.002), look_at(mesh.vertices), 1e-3)
    assert "none" not in thin.caption and "thinner than 3" in thin.caption  # 2 mm of wall, 1 mm of noise
