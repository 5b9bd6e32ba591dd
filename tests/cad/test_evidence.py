"""Patches that the measured points do not ask for."""

import numpy as np
import pytest

from drawn import drawing, triangles
from predicates import l_beam
from scan2fea.cad.evidence import asked_for
from scan2fea.cad.patches import Patches, segmented
from scan2fea.kernel.measures import volume
from scan2fea.kernel.surfaces import CYLINDER, PLANE
from scan2fea.types import TriangleMesh

NOISE = 5e-5


def meshed(draw, edge=0.0025):
    with drawing() as occ:
        draw(occ)
        mesh = triangles(edge)
    return mesh if volume(mesh) > 0 else TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[:, ::-1])


def tube(occ):
    """A thick tube with a bore through one wall: cylinders beside cylinders, which are none of each other's pieces."""
    tools = [(3, occ.addCylinder(0, 0, -0.1, 0, 0, 0.3, 0.022)), (3, occ.addCylinder(0, 0, 0.05, 0.1, 0, 0, 0.01))]
    occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 0.1, 0.03))], tools)


def plate(occ):
    occ.cut([(3, occ.addBox(0, 0, 0, 0.06, 0.05, 0.012))], [(3, occ.addCylinder(0.03, 0.025, -0.1, 0, 0, 0.3, 0.01))])


def points_of(mesh, seed=0):
    """A noisy point on each face."""
    return mesh.vertices[mesh.faces].mean(1) + NOISE * np.random.default_rng(seed).standard_normal((len(mesh.faces), 3)), np.arange(len(mesh.faces))


def kinds(patches):
    return sorted(s.kind for s in patches.surfaces)


@pytest.mark.parametrize(("draw", "wanted"), [(tube, [CYLINDER] * 3 + [PLANE] * 2), (plate, [CYLINDER] + [PLANE] * 6)])
def test_what_the_points_ask_for_stays(draw, wanted):
    mesh = meshed(draw)
    found = segmented(mesh, 3 * NOISE)
    assert kinds(found) == wanted
    again = asked_for(mesh, found, *points_of(mesh))
    assert kinds(again) == wanted
    assert (again.label == found.label).all()


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_toes_one_triangle_wide_stay_where_the_vertices_are_the_points(noise):
    """All corners of a toe of the angle lie on the faces beside it; four of its eight faces had gone."""
    mesh = l_beam(length=0.4, pitch=0.00635)
    corners = mesh.vertices + noise * np.random.default_rng(3).standard_normal(mesh.vertices.shape)
    mesh = TriangleMesh(vertices=corners, faces=mesh.faces)
    face = np.zeros(len(corners), np.int64)
    face[mesh.faces] = np.arange(len(mesh.faces))[:, None]
    found = segmented(mesh, 3 * noise + 1.3e-4)
    assert kinds(found) == [PLANE] * 8
    assert kinds(asked_for(mesh, found, corners, face)) == [PLANE] * 8


def test_a_piece_whose_points_lie_on_its_neighbour_is_part_of_it():
    mesh = meshed(plate)
    found = segmented(mesh, 3 * NOISE)
    side = int(np.argmax([s.kind == PLANE and s.axis[0] > 0.9 for s in found.surfaces]))
    strip = np.flatnonzero((found.label == side) & (mesh.vertices[mesh.faces].mean(1)[:, 2] > 0.0105))
    wrong = found.label.copy()
    wrong[strip] = len(found.surfaces)
    round_one = next(s for s in found.surfaces if s.kind == CYLINDER)
    again = asked_for(mesh, Patches(label=wrong, surfaces=(*found.surfaces, round_one)), *points_of(mesh))
    assert kinds(again) == kinds(found)
    assert (again.label == found.label).all()


@pytest.mark.parametrize("kind", [PLANE, CYLINDER])
def test_a_narrow_ring_in_pieces_is_one_plane(kind):
    mesh = meshed(tube)
    found = segmented(mesh, 3 * NOISE)
    end = next(k for k, s in enumerate(found.surfaces) if s.kind == PLANE)
    middle = mesh.vertices[mesh.faces].mean(1)
    ring = np.flatnonzero(found.label == end)
    turn = np.floor(2 * np.arctan2(middle[ring, 1], middle[ring, 0]) / np.pi).astype(int)  # quarters
    wrong = found.label.copy()
    wrong[ring] = np.where(turn == turn[0], end, len(found.surfaces) + turn % 4)
    piece = next(s for s in found.surfaces if s.kind == kind)
    again = asked_for(mesh, Patches(label=wrong, surfaces=(*found.surfaces, *[piece] * 4)), *points_of(mesh))
    assert kinds(again) == kinds(found)
    assert len(np.unique(again.label[ring])) == 1


def test_a_piece_whose_points_lie_on_two_neighbours_is_given_up():
    mesh = meshed(plate)
    found = segmented(mesh, 3 * NOISE)
    middle = mesh.vertices[mesh.faces].mean(1)
    crease = np.flatnonzero((middle[:, 0] > 0.058) & (middle[:, 2] > 0.010) & (middle[:, 1] > 0.005) & (middle[:, 1] < 0.045))
    wrong = found.label.copy()
    wrong[crease] = len(found.surfaces)
    round_one = next(s for s in found.surfaces if s.kind == CYLINDER)
    again = asked_for(mesh, Patches(label=wrong, surfaces=(*found.surfaces, round_one)), *points_of(mesh))
    assert kinds(again) == kinds(found)
    assert (again.label[crease] == -1).all()


def test_two_halves_of_a_hole_are_one():
    mesh = meshed(plate)
    found = segmented(mesh, 3 * NOISE)
    hole = next(k for k, s in enumerate(found.surfaces) if s.kind == CYLINDER)
    half = np.flatnonzero((found.label == hole) & (mesh.vertices[mesh.faces].mean(1)[:, 0] > 0.03))
    wrong = found.label.copy()
    wrong[half] = len(found.surfaces)
    again = asked_for(mesh, Patches(label=wrong, surfaces=(*found.surfaces, found.surfaces[hole])), *points_of(mesh))
    assert kinds(again) == kinds(found)


def test_a_sixteenth_of_a_hole_takes_the_points_of_the_free_form_beside_it():
    mesh = meshed(plate)
    found = segmented(mesh, 3 * NOISE)
    hole = next(k for k, s in enumerate(found.surfaces) if s.kind == CYLINDER)
    centre = mesh.vertices[mesh.faces].mean(1) - [0.03, 0.025, 0]
    off = (found.label == hole) & (np.arctan2(centre[:, 1], centre[:, 0]) % (2 * np.pi) > np.pi / 8)
    again = asked_for(mesh, Patches(label=np.where(off, -1, found.label), surfaces=found.surfaces), *points_of(mesh))
    assert kinds(again) == kinds(found)
    assert (again.label >= 0).mean() > 0.98
    assert next(s for s in again.surfaces if s.kind == CYLINDER).radius == pytest.approx(0.01, abs=4 * NOISE)
