"""Free forms as solids of NURBS patches: shared borders, closeness, one valid solid, and why there is none."""

import functools

import numpy as np
import pytest

from predicates import rotation, sphere, torus
from scan2fea.cad import patched_solid
from scan2fea.cad.freeform import DEGREE, KNOTS, patches_of
from scan2fea.cad.quads import SAMPLES, quads_on
from scan2fea.cad.readback import read_back
from scan2fea.kernel.measures import volume
from scan2fea.kernel.nurbs import basis
from scan2fea.simulation.freeform import blob
from scan2fea.types import TriangleMesh

BALL = 4 / 3 * np.pi * 0.1**3


@functools.cache
def ball(rounds):
    return sphere(0.1, rounds)


@functools.cache
def body():
    return blob(0.2, 0.3, 3, 0.0008).mesh


def rough(rounds):
    return TriangleMesh(vertices=2 * ball(rounds).vertices, faces=ball(rounds).faces)


def test_the_borders_of_neighbours_are_the_same_to_the_last_bit():
    quads = quads_on(ball(1), ball(4))
    assert (np.bincount(quads.sides.ravel()) == 2).all()
    control = patches_of(quads, ball(4)).controls
    sides = np.stack([control[:, :, 0], control[:, -1], control[:, :, -1], control[:, 0]], axis=1).reshape(-1, len(KNOTS) - DEGREE - 1, 3)
    for curve in range(len(quads.curves)):
        first, second = sides[quads.sides.ravel() == curve]
        assert (first == second).all()


def test_grids_lie_on_the_surface_between_their_borders_and_point_outward():
    quads = quads_on(ball(1), ball(5))
    assert quads.grids.shape == (3 * 80, SAMPLES, SAMPLES, 3)
    radius = np.linalg.norm(quads.grids, axis=-1)
    assert radius.min() > 0.0999
    for k, side in enumerate([quads.grids[:, :, 0], quads.grids[:, -1], quads.grids[:, :, -1], quads.grids[:, 0]]):
        np.testing.assert_allclose(side, quads.curves[quads.sides[:, k]], atol=1e-12)
    across = np.cross(quads.grids[:, 1, 0] - quads.grids[:, 0, 0], quads.grids[:, 0, 1] - quads.grids[:, 0, 0])
    assert (np.einsum("ij,ij->i", across, quads.grids[:, 0, 0]) > 0).all()


def test_a_ball_is_one_valid_solid_of_its_volume():
    found = patched_solid(ball(5), [ball(0)], spacing_m=0.005, noise_m=0.0)
    assert found.reason == ""
    back = read_back(found.brep.step)
    assert back.is_valid
    assert (back.n_solids, back.n_free_edges, len(back.face_area)) == (1, 0, 60)
    assert back.volume_m3 == pytest.approx(volume(ball(5)), rel=2e-3)
    assert found.brep.face_names[0] == "FACE_01_NURBS"
    assert set(found.brep.face_kinds) == {"nurbs"}
    assert "SI_UNIT(.MILLI.,.METRE.)" in found.brep.step
    assert patched_solid(ball(5), [ball(0)], spacing_m=0.005, noise_m=0.0).brep.step == found.brep.step
    assert found.how["off_max_m"] < 5e-4
    assert found.how["across_max_deg"] < 3


def test_patches_come_closer_as_they_become_smaller():
    off = [patches_of(quads_on(ball(rounds), ball(6)), ball(6)).off_m for rounds in (0, 1)]
    assert off[1] < off[0]
    assert off[1] < 5e-5  # what is left is how far the triangles leave the ball: 0.1 (1 - cos) of half an edge, 1e-5


def test_a_torus_closes_too():
    mesh = torus(0.1, 0.03, 96, 48)
    found = patched_solid(mesh, [torus(0.1, 0.03, 10, 5)], spacing_m=0.004, noise_m=0.0)
    assert found.reason == ""
    assert found.brep.volume_m3 == pytest.approx(volume(mesh), rel=2e-3)


def test_it_stands_wherever_the_surface_stands():
    R, at = rotation(4), np.array([30.0, -20.0, 5.0])
    coarse = rough(1)
    moved = [TriangleMesh(vertices=m.vertices @ R.T + at, faces=m.faces) for m in (body(), coarse)]
    a, b = patches_of(quads_on(coarse, body()), body()), patches_of(quads_on(moved[1], moved[0]), moved[0])
    assert b.off_m == pytest.approx(a.off_m, rel=0.05)
    assert b.p95_m == pytest.approx(a.p95_m, rel=0.05)
    assert np.median(np.linalg.norm(b.controls - (a.controls @ R.T + at), axis=-1)) < 1e-7


def test_the_first_layout_that_is_close_enough_is_taken_and_the_input_left_alone():
    layouts = [rough(0), rough(1)]
    kept = body().vertices.copy()
    off = patches_of(quads_on(layouts[0], body()), body()).off_m
    taken = patched_solid(body(), layouts, spacing_m=4 * off * 1.01, noise_m=0.0)
    assert len(taken.brep.face_names) == 3 * 20
    assert taken.how["off_max_m"] == pytest.approx(off)
    closer = patched_solid(body(), layouts, spacing_m=4 * off * 0.99, noise_m=0.0)
    assert len(closer.brep.face_names) == 3 * 80
    assert np.array_equal(body().vertices, kept)


def test_what_is_too_far_off_is_refused_with_the_figure():
    found = patched_solid(body(), [rough(1)], spacing_m=1e-5, noise_m=0.0)
    assert found.brep is None
    assert "off the surface (limit 0.0025 mm)" in found.reason
    assert patched_solid(body(), [], spacing_m=1.0, noise_m=0.0).reason == "there is no layout of quads"


def test_quads_that_fold_are_refused():
    inside_out = TriangleMesh(vertices=ball(1).vertices, faces=ball(1).faces[:, ::-1])
    found = patched_solid(ball(4), [inside_out], spacing_m=0.005, noise_m=0.0)
    assert "fold over" in found.reason


def test_knots_run_alike_both_ways():
    at = np.linspace(0, 1, 9)
    np.testing.assert_allclose(basis(KNOTS, DEGREE, at), basis(KNOTS, DEGREE, 1 - at)[:, ::-1], atol=1e-15)
