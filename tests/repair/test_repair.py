"""Broken solids made whole; sound ones passed through; hopeless ones refused with a reason."""

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_no_crossing, assert_same_surface, box, moved, rotation, sphere, torus
from scan2fea.errors import RepairError
from scan2fea.kernel.measures import volume
from scan2fea.repair import RepairOptions, repair
from scan2fea.repair.stitch import stitched
from scan2fea.types import TriangleMesh

BOX = box(pitch=0.1)
BALL = sphere(rounds=4)


def mesh_of(vertices, faces):
    return TriangleMesh(vertices=vertices, faces=faces)


def together(a, b):
    return mesh_of(np.concatenate([a.vertices, b.vertices]), np.concatenate([a.faces, b.faces + len(a.vertices)]))


def assert_sound(mesh):
    assert_closed_manifold_oriented(mesh)
    assert_no_crossing(mesh)


@pytest.mark.parametrize("mesh", [box(), BOX, BALL, torus(), moved(BOX, rotation(1), np.full(3, 1e3))])
def test_sound_meshes_pass_untouched(mesh):
    found = repair(mesh)
    assert found.mesh is mesh and found.steps == ()


def broken_boxes():
    rng = np.random.default_rng(0)
    faces = BOX.faces.copy()
    turned = rng.random(len(faces)) < 0.4
    faces[turned] = faces[turned, ::-1]
    yield "some faces turned", mesh_of(BOX.vertices, faces)
    yield "inside out", mesh_of(BOX.vertices, BOX.faces[:, ::-1])
    yield "triangle soup", mesh_of(BOX.vertices[BOX.faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))
    yield "repeated faces", mesh_of(BOX.vertices, np.concatenate([BOX.faces, BOX.faces[:5]]))
    yield "unused vertices", mesh_of(np.concatenate([BOX.vertices, [[9, 9, 9]]]), BOX.faces)
    yield "small second part", together(BOX, moved(mesh_of(0.02 * BALL.vertices, BALL.faces), np.eye(3), np.full(3, 3.0)))
    yield "repeated vertex in a face", mesh_of(BOX.vertices, np.concatenate([BOX.faces, [[0, 0, 1]]]))
    yield "a fin", mesh_of(np.concatenate([BOX.vertices, [[2, 2, 2.0]]]), np.concatenate([BOX.faces, [[*BOX.faces[0, :2], len(BOX.vertices)]]]))


@pytest.mark.parametrize(("name", "mesh"), list(broken_boxes()), ids=lambda value: value if isinstance(value, str) else "")
def test_plain_faults_leave_the_exact_solid(name, mesh):
    before = mesh.vertices.copy(), mesh.faces.copy()
    found = repair(mesh)
    assert_sound(found.mesh)
    assert found.steps
    assert volume(found.mesh) == pytest.approx(1, rel=1e-12)
    assert (mesh.vertices == before[0]).all() and (mesh.faces == before[1]).all()


def test_a_flat_face_in_an_edge_leaves_no_crack():
    """A vertex put onto an edge, with a face of no area between the halves and the whole."""
    mesh = box()
    a, b, c = mesh.faces[0]
    middle = len(mesh.vertices)
    vertices = np.concatenate([mesh.vertices, [(mesh.vertices[a] + mesh.vertices[b]) / 2]])
    faces = np.concatenate([mesh.faces[1:], [[a, middle, c], [middle, b, c], [a, b, middle]]])
    found = repair(mesh_of(vertices, faces)).mesh
    assert_sound(found)
    assert volume(found) == pytest.approx(1)


def test_random_holes_are_filled_where_the_surface_was():
    keep = np.random.default_rng(1).random(len(BALL.faces)) > 0.02
    found = repair(mesh_of(BALL.vertices, BALL.faces[keep]))
    assert_sound(found.mesh)
    assert found.n_holes > 50
    assert_same_surface(found.mesh, BALL, 0.003, 0.02)


def test_a_large_hole_goes_on_with_the_slope_it_comes_with():
    keep = BALL.vertices[BALL.faces].mean(1)[:, 2] < 0.8
    found = repair(mesh_of(BALL.vertices, BALL.faces[keep])).mesh
    assert_sound(found)
    flat_cap = np.pi * 0.2**2 * (3 - 0.2) / 3  # what a flat lid would lose
    assert volume(BALL) - volume(found) < 0.4 * flat_cap
    assert len(found.faces) > 1.05 * keep.sum()  # refined


def test_holes_larger_than_the_limit_are_refused():
    half = mesh_of(BALL.vertices, BALL.faces[BALL.vertices[BALL.faces].mean(1)[:, 2] < 0])
    with pytest.raises(RepairError, match=r"invent at least 5.% of its area"):
        repair(half)
    assert_sound(repair(half, RepairOptions(largest_hole=0.6)).mesh)


def test_open_is_an_error_where_filling_is_off():
    with pytest.raises(RepairError, match="3 edges belong to one face only"):
        repair(mesh_of(BOX.vertices, BOX.faces[1:]), RepairOptions(fill_holes=False))


def test_crossings_are_cut_out_and_closed():
    noisy = mesh_of(BALL.vertices + np.random.default_rng(0).normal(0, 0.02, BALL.vertices.shape), BALL.faces)
    found = repair(noisy)
    assert_sound(found.mesh)
    assert found.n_cut_out > 0
    assert volume(found.mesh) == pytest.approx(volume(noisy), rel=0.01)


def test_a_spike_through_the_far_side_is_cut_off():
    vertices = BALL.vertices.copy()
    vertices[vertices[:, 2].argmax()] *= -1.3
    found = repair(mesh_of(vertices, BALL.faces)).mesh
    assert_sound(found)
    assert_same_surface(found, BALL, 0.01, 0.05)


def test_pinched_and_crowded_parts_are_parted():
    """Two boxes that share one vertex: one solid is small enough to go, or both are told."""
    n = len(BOX.vertices)
    corner, origin = int(np.flatnonzero((BOX.vertices == 1).all(1))[0]), int(np.flatnonzero((BOX.vertices == 0).all(1))[0])
    small = BOX.faces + n
    small[small == origin + n] = corner
    tiny = mesh_of(np.concatenate([BOX.vertices, 1 + 0.05 * BOX.vertices]), np.concatenate([BOX.faces, small]))
    found = repair(tiny)
    assert_sound(found.mesh)
    assert volume(found.mesh) == pytest.approx(1)


def test_two_parts_are_refused():
    with pytest.raises(RepairError, match="2 separate shells"):
        repair(together(BOX, moved(BOX, np.eye(3), np.full(3, 3.0))))


def test_cracks_are_stitched_and_holes_are_not():
    """A ball in two halves whose rims are off by a hundredth of an edge; a gap of a tenth of an edge is no crack."""
    upper = BALL.vertices[BALL.faces].mean(1)[:, 2] > 0.3
    edge = np.linalg.norm(np.diff(BALL.vertices[BALL.faces][:, :2], axis=1), axis=2).min()
    noise = np.random.default_rng(0).uniform(-0.004, 0.004, BALL.vertices.shape) * edge
    halves = together(mesh_of(BALL.vertices, BALL.faces[~upper]), mesh_of(BALL.vertices + noise, BALL.faces[upper]))
    kept = halves.vertices.copy()
    fixed = repair(halves)
    assert_sound(fixed.mesh)
    assert "stitched cracks" in fixed.steps and fixed.n_holes == 0
    assert len(fixed.mesh.vertices) == len(BALL.vertices) and len(fixed.mesh.faces) == len(BALL.faces)
    assert volume(fixed.mesh) == pytest.approx(volume(BALL), rel=1e-2)
    assert np.array_equal(halves.vertices, kept)
    apart = together(mesh_of(BALL.vertices, BALL.faces[~upper]), mesh_of(BALL.vertices + [0, 0, 0.1 * edge], BALL.faces[upper]))
    assert stitched(apart) is apart
    assert stitched(BALL) is BALL


def test_a_shell_inside_another_is_told_as_a_cavity():
    with pytest.raises(RepairError, match=r"2 separate shells .*\(1 of them inside the largest: cavities are not carried through"):
        repair(together(BOX, moved(BOX, 0.5 * np.eye(3), np.full(3, 0.25))))


def test_a_shell_that_crosses_another_is_no_cavity():
    with pytest.raises(RepairError, match=r"2 separate shells .*\(1 of them partly inside the largest: unite them first\)"):
        repair(together(BOX, moved(BOX, 0.9 * np.eye(3), np.array([0.5, 0.05, 0.05]))))


def test_every_step_that_changed_the_surface_is_kept_for_the_ledger():
    broken = mesh_of(BALL.vertices, BALL.faces[BALL.vertices[BALL.faces].mean(1)[:, 2] < 0.9])
    again = repair(broken)
    assert [name for name, _ in again.stages] == ["holes"] or [name for name, _ in again.stages] == ["clean", "holes"]
    assert np.array_equal(again.stages[-1][1].faces, again.mesh.faces)
    assert repair(again.mesh).stages == ()


@pytest.mark.parametrize(
    ("vertices", "faces", "says"),
    [
        (np.eye(3), np.zeros((0, 3), np.int64), "no face"),
        (np.array([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), "not finite"),
        (np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]), np.array([[0, 1, 2]]), "flat or empty"),
        (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), np.array([[0, 1, 2]]), "invent"),
    ],
)
def test_hopeless_meshes_are_refused_with_a_reason(vertices, faces, says):
    with pytest.raises(RepairError, match=says):
        repair(mesh_of(vertices, faces))


def test_same_bytes_twice():
    noisy = mesh_of(BALL.vertices + np.random.default_rng(0).normal(0, 0.02, BALL.vertices.shape), BALL.faces)
    a, b = repair(noisy).mesh, repair(noisy).mesh
    assert (a.vertices == b.vertices).all() and (a.faces == b.faces).all()
