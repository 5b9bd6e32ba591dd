"""Rounded edges: the path of a ball that rolls along two faces, and bodies whose edges are rounded."""

import functools

import gmsh
import numpy as np
import pytest

from drawn import drawing, triangles
from scan2fea.cad import true_solid
from scan2fea.cad.fillets import Fillet, fitted_fillets, rolled
from scan2fea.cad.readback import read_back
from scan2fea.kernel.surfaces import CYLINDER, PLANE, TORUS, Surface
from scan2fea.types import TriangleMesh

EDGE = 0.003
FLOOR = Surface(kind=PLANE, point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]))
WALL = Surface(kind=PLANE, point=np.zeros(3), axis=np.array([1.0, 0.0, 0.0]))
POST = Surface(kind=CYLINDER, point=np.array([0.5, 0.0, 9.0]), axis=np.array([0.0, 0.0, -1.0]), radius=0.2)
NEAR = np.array([[0.0, 0.3, 0.0], [0.0, 0.5, 0.0]])


@pytest.mark.parametrize("sense", [1, -1])
def test_a_ball_between_two_planes_touches_both_from_one_side(sense):
    ball = rolled(FLOOR, WALL, 0.1, sense, NEAR)
    assert (ball.kind, ball.radius, ball.sense) == (CYLINDER, 0.1, sense)
    middle = ball.point[None]
    assert FLOOR.distance(middle)[0] == pytest.approx(-sense * 0.1, abs=1e-15)
    assert WALL.distance(middle)[0] == pytest.approx(-sense * 0.1, abs=1e-15)
    assert abs(ball.axis @ [0.0, 1.0, 0.0]) == pytest.approx(1.0)
    for face in (FLOOR, WALL):  # where it touches, it looks as the face does
        foot = middle + sense * 0.1 * face.axis
        assert ball.distance(foot)[0] == pytest.approx(0.0, abs=1e-15)
        np.testing.assert_allclose(ball.normals(foot)[0], face.axis, atol=1e-12)


@pytest.mark.parametrize("sense", [1, -1])
def test_a_ball_round_a_post_leaves_a_torus(sense):
    ring = rolled(POST, FLOOR, 0.05, sense, NEAR)
    assert (ring.kind, ring.second, ring.sense) == (TORUS, 0.05, sense)
    assert ring.radius == pytest.approx(0.2 - sense * 0.05)
    assert FLOOR.distance(ring.point[None])[0] == pytest.approx(-sense * 0.05)
    touch = np.array([[0.5 + 0.2, 0.0, -sense * 0.05]])
    assert ring.distance(touch)[0] == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(ring.normals(touch), POST.normals(touch), atol=1e-12)


def test_faces_without_an_edge_between_them_have_no_fillet():
    assert rolled(FLOOR, FLOOR, 0.1, 1, NEAR) is None
    assert rolled(POST, POST, 0.1, 1, NEAR) is None
    assert rolled(WALL, POST, 0.1, 1, NEAR) is None
    assert rolled(POST, FLOOR, 0.3, 1, NEAR) is None  # wider than the post


def test_where_no_ball_rolls_between_the_faces_as_fitted_the_radius_stays():
    points = np.random.default_rng(1).uniform(0, 1, (400, 3)) * [1, 1, 0.01]
    given = [Fillet(first=0, second=0, radius_m=r, std_m=1e-4, sense=1, faces=np.array([k]), reach_m=r) for k, r in enumerate((0.02, 0.05))]
    found = fitted_fillets(given, [FLOOR], points, np.arange(400) % 2, 0.001)
    assert [f.radius_m for f in found] == [0.02, 0.05]


@functools.cache
def angle_piece():
    """An angle 60 x 40 x 50 mm, 8 mm thick, its corner filled with 10 mm, two ridges rounded with 12 mm; with its volume, m3."""
    with drawing() as occ:
        body, _ = occ.fuse([(3, occ.addBox(0, 0, 0, 60, 40, 8))], [(3, occ.addBox(0, 0, 0, 8, 40, 50))])
        occ.synchronize()
        radii = {}
        for _, edge in gmsh.model.getEntities(1):
            low, high = np.array(gmsh.model.getBoundingBox(1, edge)).reshape(2, 3)
            middle = (low + high) / 2
            if np.allclose(middle, [8, 20, 8], atol=0.01):
                radii[edge] = 10.0
            elif np.allclose(middle, [60, 0, 4], atol=0.01) or np.allclose(middle, [60, 40, 4], atol=0.01):
                radii[edge] = 12.0
        made = occ.fillet([body[0][1]], list(radii), list(radii.values()))
        occ.synchronize()
        held = occ.getMass(*made[0]) * 1e-9
        mesh = triangles(EDGE * 1e3, 1e-3)
    return mesh.vertices, mesh.faces, held


@pytest.mark.parametrize(("sigma", "off"), [(0.0, 1e-6), (1e-4, 3e-3)])
def test_rounded_edges_are_faces_with_their_radii(sigma, off):
    vertices, faces, held = angle_piece()
    vertices = vertices + sigma * np.random.default_rng(1).standard_normal(vertices.shape)
    found = true_solid(TriangleMesh(vertices=vertices, faces=faces), vertices, spacing_m=EDGE, noise_m=sigma)
    assert found.reason == ""
    assert sorted(found.brep.face_kinds) == ["cylinder"] * 3 + ["plane"] * 8
    assert found.brep.volume_m3 == pytest.approx(held, rel=off)
    radii = sorted(f["radius_m"] for f in found.how["fillets"])
    assert radii == pytest.approx([0.010, 0.012, 0.012], rel=0.02 if sigma else 1e-4)
    back = read_back(found.brep.step)
    assert (back.is_valid, back.n_solids, back.n_free_edges, len(back.face_area)) == (True, 1, 0, 11)


def test_sharp_edges_that_the_surface_has_rounded_are_no_fillets():
    """The vertices are those of a rounded body; the points lie on sharp edges."""
    vertices, faces, _ = angle_piece()
    rng = np.random.default_rng(0)
    flat = rng.random((4000, 2)) * [0.04, 0.05]
    wall = np.column_stack([np.full(4000, 0.008), flat[:, 0], 0.008 + flat[:, 1] * 0.042 / 0.05])
    floor = np.column_stack([0.008 + flat[:, 1] * 0.052 / 0.05, flat[:, 0], np.full(4000, 0.008)])
    far = vertices[(vertices[:, 0] < 0.0075) | (vertices[:, 2] < 0.0075)]
    found = true_solid(TriangleMesh(vertices=vertices, faces=faces), np.concatenate([wall, floor, far]), spacing_m=EDGE, noise_m=1e-5)
    assert all(f["radius_m"] > 0.011 for f in found.how.get("fillets", ()))
