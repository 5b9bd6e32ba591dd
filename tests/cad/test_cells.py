"""Which cells of space lie inside a body."""

import numpy as np
import pytest

from scan2fea.cad.cells import _side, are_inside, cells_of, margin_face
from scan2fea.cad.live import direction, moved_by, parts, pnt, tessellated
from scan2fea.cad.readback import volume_of
from scan2fea.kernel.surfaces import PLANE, Surface
from scan2fea.types import TriangleMesh

CORNERS = np.array([[x, y, z] for x in (0, 10.0) for y in (0, 10.0) for z in (0, 10.0)])
FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])


def test_cells_are_asked_together_and_told_apart():
    """Planes x, y, z = -5, 0, 10, 15 cut space into 27 boxes: the middle one is the body, alone and among the others."""
    from OCP.TopAbs import TopAbs_SOLID

    body = TriangleMesh(vertices=CORNERS, faces=FACES)
    drawn = []
    for axis in range(3):
        for place in (-5.0, 0.0, 10.0, 15.0):
            at = np.full(3, 5.0)
            at[axis] = place
            spread = CORNERS * 2 - 5
            spread[:, axis] = place
            drawn.append(margin_face(Surface(kind=PLANE, point=at, axis=np.eye(3)[axis]), spread, 1.0))
    cells = parts(cells_of(drawn), TopAbs_SOLID)
    for cell in cells:
        tessellated(cell, 0.1)
    inside = are_inside(cells, body)
    volumes = np.array([volume_of(cell) for cell in cells])
    assert len(cells) == 27
    assert volumes[np.array(inside)].tolist() == [np.float64(volumes.max())]
    assert abs(volumes.max() - 1000.0) < 1e-6
    assert [are_inside([cell], body)[0] for cell in cells] == inside


@pytest.mark.parametrize("shift", [0.0, 2000.0])
def test_the_volume_of_crossing_cylinders_is_exact_wherever_they_stand(shift):
    """Two pipes of radius 30 and 20 that meet square: the part of the second beyond the first by an integral of its own."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Fuse
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2
    from scipy.integrate import quad

    upright = BRepPrimAPI_MakeCylinder(gp_Ax2(pnt(np.zeros(3)), direction(np.array([0.0, 0, 1]))), 30.0, 200.0).Shape()
    lying = BRepPrimAPI_MakeCylinder(gp_Ax2(pnt(np.array([0.0, 0, 100])), direction(np.array([1.0, 0, 0]))), 20.0, 100.0).Shape()
    beyond = quad(lambda y: 2 * np.sqrt(400 - y * y) * (100 - np.sqrt(900 - y * y)), -20, 20, epsabs=1e-9, epsrel=1e-12)[0]
    found = volume_of(moved_by(BRepAlgoAPI_Fuse(upright, lying).Shape(), np.array([shift, -shift, 0.0])))
    assert found == pytest.approx(np.pi * 900 * 200 + beyond, rel=1e-8)


@pytest.mark.parametrize("turn", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("long", [1.0, 1.5])
def test_a_plane_is_drawn_along_the_sides_of_its_region(turn, long):
    """Of a square the largest spread has any direction: its corners reached through the walls beside it."""
    grid = np.stack(np.meshgrid(np.linspace(-long, long, 9), np.linspace(-1, 1, 8)), axis=-1).reshape(-1, 2)
    grid = grid + 0.01 * np.random.default_rng(0).standard_normal(grid.shape)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    way = _side(grid @ R.T)
    best = min(
        np.linspace(0, np.pi / 2, 9001), key=lambda a: np.ptp(grid @ R.T @ [np.cos(a), np.sin(a)]) * np.ptp(grid @ R.T @ [-np.sin(a), np.cos(a)])
    )
    assert max(abs(way @ [np.cos(best), np.sin(best)]), abs(way @ [-np.sin(best), np.cos(best)])) > 1 - 1e-6
    if long > 1:
        assert abs(way @ R[:, 0]) > 0.999


def test_a_plane_region_on_one_line_has_some_side():
    assert np.linalg.norm(_side(np.array([[0.0, 0], [1, 1], [2, 2]]))) == 1
