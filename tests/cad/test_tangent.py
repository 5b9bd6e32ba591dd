"""Cylinders that pass into planes without an angle."""

import numpy as np
import pytest

from drawn import drawing, triangles
from predicates import rotation
from scan2fea.cad import CadOptions, true_solid
from scan2fea.cad.readback import read_back
from scan2fea.cad.tangent import touching
from scan2fea.kernel.measures import volume
from scan2fea.kernel.surfaces import CYLINDER, PLANE, Surface
from scan2fea.types import TriangleMesh

X, Y, Z = np.eye(3)
R = 5.0


def slot(off=0.0, wall=R):
    """One end of a slot along x: a half round about the origin and its two walls, which the cylinder misses by `off`; and points of each."""
    angle, x, z = np.linspace(-np.pi / 2, np.pi / 2, 40), np.linspace(0, -20, 20), np.linspace(0, 8, 10)
    arc = np.array([[R * np.cos(a), R * np.sin(a), h] for a in angle for h in z])
    walls = [np.array([[p, s * wall, h] for p in x for h in z]) for s in (-1, 1)]
    surfaces = [Surface(kind=CYLINDER, point=np.zeros(3), axis=Z, radius=R + off, sense=-1)]
    surfaces += [Surface(kind=PLANE, point=np.array([-10, s * wall, 4.0]), axis=-s * Y) for s in (-1, 1)]
    return surfaces, [arc, *walls]


@pytest.mark.parametrize("turn", [np.eye(3), rotation(7)])
def test_the_end_of_a_slot_is_made_to_touch_both_walls(turn):
    surfaces, own = slot(0.08)
    turned = [Surface(kind=s.kind, point=turn @ s.point, axis=turn @ s.axis, radius=s.radius, sense=s.sense) for s in surfaces]
    found, limits = touching(turned, [p @ turn.T for p in own], 0.1, 0.5)
    assert found[0].radius == pytest.approx(R)
    assert found[0].point == pytest.approx(np.zeros(3), abs=1e-12)
    assert [len(ends) for ends in limits] == [2, 1, 1]
    assert limits[1][0].inward == pytest.approx(-turn @ X)  # the wall lies behind the line, the arc before it
    assert limits[0][0].inward == pytest.approx(turn @ X)


@pytest.mark.parametrize(("off", "touches"), [(0.099, True), (0.101, False)])
def test_by_how_much_it_may_miss(off, touches):
    surfaces, own = slot(off)
    found, limits = touching(surfaces, own, 0.1, 0.5)
    assert bool(limits[0]) == touches
    assert (found[0] is surfaces[0]) != touches


def test_walls_that_no_cylinder_touches_both_leave_it_alone():
    surfaces, own = slot()
    lean = np.array([0.01, 1.0, 0.0]) / np.hypot(0.01, 1.0)
    third = Surface(kind=PLANE, point=np.array([-10, R + 0.05, 4.0]), axis=-lean)
    found, limits = touching([*surfaces, third], [*own, own[2]], 0.1, 0.5)
    assert found[0] is surfaces[0]
    assert not any(limits)


def test_a_wall_that_goes_on_beyond_the_line_is_not_cut_off():
    surfaces, own = slot()
    longer = [own[0], *(np.concatenate([p, p * [-1, 1, 1]]) for p in own[1:])]
    assert not any(touching(surfaces, longer, 0.1, 0.5)[1])


def test_nothing_given_is_changed():
    surfaces, own = slot(0.05)
    before = [p.copy() for p in own]
    touching(surfaces, own, 0.1, 0.5)
    assert surfaces[0].radius == R + 0.05
    assert all((a == b).all() for a, b in zip(before, own, strict=True))


@pytest.mark.parametrize("sigma", [0.0, 1e-4])
def test_a_plate_with_a_slot_has_four_faces_in_it(sigma):
    with drawing() as occ:
        body = [(3, occ.addBox(0, 0, 0, 0.12, 0.08, 0.01))]
        ends = [(3, occ.addCylinder(x, 0.04, -0.01, 0, 0, 0.03, 0.008)) for x in (0.04, 0.08)]
        occ.cut(body, [*ends, (3, occ.addBox(0.04, 0.032, -0.01, 0.04, 0.016, 0.03))])
        mesh = triangles(0.003)
    mesh = mesh if volume(mesh) > 0 else TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1])
    noise = sigma * np.random.default_rng(0).standard_normal(mesh.vertices.shape)
    mesh = TriangleMesh(vertices=(mesh.vertices + noise) @ rotation(2).T, faces=mesh.faces)
    found = true_solid(mesh, mesh.vertices, CadOptions(), spacing_m=0.003, noise_m=sigma)
    assert found.reason == ""
    assert sorted(found.brep.face_kinds) == ["cylinder"] * 2 + ["plane"] * 8
    assert found.brep.volume_m3 == pytest.approx(0.01 * (0.12 * 0.08 - 0.04 * 0.016 - np.pi * 0.008**2), rel=1e-6 if sigma == 0 else 2e-3)
    back = read_back(found.brep.step)
    assert back.is_valid
    assert (back.n_solids, back.n_free_edges) == (1, 0)


@pytest.mark.parametrize(("lean", "touches"), [(0.02, True), (0.03, False)])
def test_a_wall_that_leans_by_less_than_the_tolerance_runs_along_the_axis(lean, touches):
    """Refused as parallel by chance: 4 mm from its middle it moves by 0.08 and 0.12 mm (limit 0.1)."""
    surfaces, own = slot()
    axis = np.array([0.0, -1.0, lean]) / np.hypot(1.0, lean)
    found, limits = touching([surfaces[0], surfaces[1], Surface(kind=PLANE, point=np.array([-10, R, 4.0]), axis=axis)], own, 0.1, 0.5)
    assert [len(ends) for ends in limits] == ([2, 1, 1] if touches else [1, 1, 0])
    if touches:
        assert found[2].axis == pytest.approx(-Y, abs=1e-12)
        assert found[0].radius == pytest.approx(R)
    else:
        assert found[2].axis == pytest.approx(axis)


def test_planes_that_lean_elsewhere_are_left_alone():
    surfaces, own = slot()
    far = Surface(kind=PLANE, point=np.array([-10, 3 * R, 4.0]), axis=np.array([0.0, -1.0, 0.01]) / np.hypot(1.0, 0.01))
    found, _ = touching([*surfaces, far], [*own, own[2] + [0, 2 * R, 0]], 0.1, 0.5)
    assert found[3] is far
