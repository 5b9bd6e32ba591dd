"""Free forms as solids of NURBS patches: shared borders, closeness, one valid solid, and why there is none."""

import dataclasses
import functools

import numpy as np
import pytest

from predicates import rotation, sphere, torus
from scan2fea.cad import patched_solid
from scan2fea.cad.freeform import DEGREE, FOLDED, KNOTS, patches_of
from scan2fea.cad.quads import SAMPLES, quads_on
from scan2fea.cad.readback import read_back
from scan2fea.cad.tiles import spread, tiles_at, web_of
from scan2fea.kernel.measures import face_normals, vertex_normals, volume
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


def quads(mesh, n):
    web = web_of(mesh)
    return quads_on(mesh, tiles_at(web, spread(web, n)))


def test_the_borders_of_neighbours_are_the_same_to_the_last_bit():
    laid = quads(ball(4), 20)
    assert (np.bincount(laid.sides.ravel()) == 2).all()
    control = patches_of(laid, ball(4)).controls
    sides = np.stack([control[:, :, 0], control[:, -1], control[:, :, -1], control[:, 0]], axis=1).reshape(-1, len(KNOTS) - DEGREE - 1, 3)
    for curve in range(len(laid.curves)):
        first, second = sides[laid.sides.ravel() == curve]
        assert (first == second).all()


def test_grids_lie_on_the_surface_between_their_borders_and_point_outward():
    laid = quads(ball(5), 20)
    assert laid.grids.shape[1:] == (SAMPLES, SAMPLES, 3)
    radius = np.linalg.norm(laid.grids, axis=-1)
    assert radius.min() > 0.0999
    for k, side in enumerate([laid.grids[:, :, 0], laid.grids[:, -1], laid.grids[:, :, -1], laid.grids[:, 0]]):
        np.testing.assert_allclose(side, laid.curves[laid.sides[:, k]], atol=1e-12)
    across = np.cross(laid.grids[:, 1:, :-1] - laid.grids[:, :-1, :-1], laid.grids[:, :-1, 1:] - laid.grids[:, :-1, :-1])
    assert (np.einsum("quvc,quvc->quv", across, laid.grids[:, :-1, :-1]) > 0).all()


def test_a_ball_is_one_valid_solid_of_its_volume():
    found = patched_solid(ball(5), spacing_m=0.005, noise_m=0.0)
    assert found.reason == ""
    back = read_back(found.brep.step)
    assert back.is_valid
    assert (back.n_solids, back.n_free_edges, len(back.face_area)) == (1, 0, len(found.brep.face_names))
    assert back.volume_m3 == pytest.approx(volume(ball(5)), rel=2e-3)
    assert found.brep.face_names[0].startswith("FACE_0") and found.brep.face_names[0].endswith("1_NURBS")
    assert set(found.brep.face_kinds) == {"nurbs"}
    assert "SI_UNIT(.MILLI.,.METRE.)" in found.brep.step
    assert patched_solid(ball(5), spacing_m=0.005, noise_m=0.0).brep.step == found.brep.step
    assert found.how["off_max_m"] < 5e-4
    assert found.how["across_max_deg"] < 3


def test_patches_come_closer_as_they_become_smaller():
    off = [patches_of(quads(ball(5), n), ball(5)).off_m.max() for n in (12, 48)]
    assert off[1] < off[0]
    assert off[1] < 1e-4  # of a ball of 0.1 m


def test_a_torus_closes_too():
    mesh = torus(0.1, 0.03, 96, 48)
    found = patched_solid(mesh, spacing_m=0.004, noise_m=0.0)
    assert found.reason == ""
    assert found.brep.volume_m3 == pytest.approx(volume(mesh), rel=2e-3)


def test_a_thin_body_keeps_its_two_sides():
    """A tenth as thick as wide: the point nearest in space may be on the other side."""
    flat = TriangleMesh(vertices=ball(5).vertices * [1.0, 1.0, 0.1], faces=ball(5).faces)
    found = patched_solid(flat, spacing_m=0.004, noise_m=0.0)
    assert found.reason == ""
    assert found.brep.volume_m3 == pytest.approx(volume(flat), rel=5e-3)


def test_it_stands_wherever_the_surface_stands():
    R, at = rotation(4), np.array([30.0, -20.0, 5.0])
    moved = TriangleMesh(vertices=body().vertices @ R.T + at, faces=body().faces)
    web = web_of(body())
    tiles = tiles_at(web, spread(web, 20))
    a, b = patches_of(quads_on(body(), tiles), body()), patches_of(quads_on(moved, tiles), moved)
    assert b.off_m.max() == pytest.approx(a.off_m.max(), rel=0.05)
    assert b.p95_m == pytest.approx(a.p95_m, rel=0.05)
    assert np.median(np.linalg.norm(b.controls - (a.controls @ R.T + at), axis=-1)) < 1e-7


def test_tiles_are_parted_until_their_patches_are_close_enough_and_the_input_is_left_alone():
    kept = body().vertices.copy()
    coarse = patched_solid(body(), spacing_m=0.02, noise_m=0.0)
    fine = patched_solid(body(), spacing_m=0.002, noise_m=0.0)
    assert coarse.how["off_max_m"] <= 0.005
    assert fine.how["off_max_m"] <= 0.0005
    assert len(fine.brep.face_names) > len(coarse.brep.face_names)
    assert fine.brep.volume_m3 == pytest.approx(volume(body()), rel=1e-3)
    assert np.array_equal(body().vertices, kept)


def test_what_is_too_far_off_is_refused_with_the_figure():
    found = patched_solid(body(), spacing_m=1e-5, noise_m=0.0)
    assert found.brep is None
    assert "off the surface (limit 0.0025 mm)" in found.reason


def test_spikes_narrower_than_patches_are_told_before_all_is_parted():
    """Single vertices pulled out of a ball: however small the tiles, no patch of three triangles follows them."""
    mesh, limit = ball(4), 0.0005
    up = np.arange(0, len(mesh.vertices), 100)
    places = mesh.vertices.copy()
    places[up] *= 1.05
    found = patched_solid(TriangleMesh(vertices=places, faces=mesh.faces), spacing_m=4 * limit, noise_m=0.0)
    assert found.brep is None and "places the surface turns more sharply" in found.reason


def test_one_spike_or_two_are_parted_until_patches_follow_them():
    mesh = ball(5)
    places = mesh.vertices.copy()
    places[[0, 5000]] *= 1.03
    found = patched_solid(TriangleMesh(vertices=places, faces=mesh.faces), spacing_m=0.002, noise_m=0.0)
    assert found.brep is not None and found.brep.is_valid and found.how["off_max_m"] <= 0.0005


def test_a_patch_on_the_flank_of_a_spike_is_no_fold():
    """The normals of its corners lean away from the triangle between them; a patch that lies on it does not turn over."""
    mesh = ball(4)
    places = mesh.vertices.copy()
    places[0] *= 2.0
    spike = TriangleMesh(vertices=places, faces=mesh.faces)
    k = int(np.flatnonzero((mesh.faces == 0).any(axis=1))[0])
    a, b, c = places[np.roll(mesh.faces[k], -int(np.flatnonzero(mesh.faces[k] == 0)[0]))]
    s, t = np.meshgrid(np.linspace(0.01, 0.5, SAMPLES), np.linspace(0.01, 0.45, SAMPLES), indexing="ij")
    grid = a + s[..., None] * (b - a) + t[..., None] * (c - a)
    laid = quads(ball(4), 12)
    curves = laid.curves.copy()
    curves[laid.sides[0]] = [grid[:, 0], grid[-1], grid[:, -1], grid[0]]
    one = dataclasses.replace(laid, grids=np.concatenate([grid[None], laid.grids[1:]]), curves=curves)
    assert face_normals(spike)[k] @ vertex_normals(spike)[0] < FOLDED
    assert not patches_of(one, spike).is_folded[0]


def test_a_patch_that_turns_over_is_told():
    laid = quads(ball(4), 12)
    grids = laid.grids.copy()
    grids[3, 1:-1, 1:-1] = grids[3, -2:0:-1, 1:-1]
    turned = patches_of(dataclasses.replace(laid, grids=grids), ball(4))
    assert np.flatnonzero(turned.is_folded).tolist() == [3]


def test_knots_run_alike_both_ways():
    at = np.linspace(0, 1, 9)
    np.testing.assert_allclose(basis(KNOTS, DEGREE, at), basis(KNOTS, DEGREE, 1 - at)[:, ::-1], atol=1e-15)
