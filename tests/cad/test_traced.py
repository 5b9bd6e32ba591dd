"""Solids traced along the borders of their patches: corners, edges, surfaces that touch, rings in pieces."""

import dataclasses
import functools
from types import SimpleNamespace

import numpy as np
import pytest

from drawn import drawing, triangles
from predicates import box, rotation, sphere, torus
from scan2fea.cad import corners, true_solid
from scan2fea.cad.compared import faces_of
from scan2fea.cad.corners import Meeting, met
from scan2fea.cad.live import is_valid, parts
from scan2fea.cad.network import LEAST_FACES, network_of
from scan2fea.cad.patches import Patches, segmented
from scan2fea.cad.readback import read_back, volume_of
from scan2fea.cad.rolled import with_rings_and_balls
from scan2fea.cad.tangency import Touch, made_to_touch, sided, touches_of
from scan2fea.cad.traced import LOOSE, traced_solid
from scan2fea.kernel.surfaces import CONE, CYLINDER, PLANE, SPHERE, TORUS, Surface, fitted
from scan2fea.types import TriangleMesh


def plane(point, axis):
    return Surface(kind=PLANE, point=np.array(point, float), axis=np.array(axis, float) / np.linalg.norm(axis))


def labelled(size, edge):
    """A box of triangles, the side of each, and the six planes."""
    mesh = box(size, edge)
    middle, size = mesh.vertices[mesh.faces].mean(1), np.array(size, float)
    sides = [plane(size * (side > 0) * np.eye(3)[k], side * np.eye(3)[k]) for k in range(3) for side in (-1, 1)]
    return mesh, np.argmin([np.abs(s.distance(middle)) for s in sides], axis=0), sides


def small(n):
    return [1e-4 * np.eye(k) for k in n]


def test_the_network_of_a_box_has_eight_corners_and_twelve_chains():
    mesh, label, sides = labelled((30.0, 20.0, 10.0), 2.0)
    rng = np.random.default_rng(0)
    stray = label.copy()
    stray[rng.choice(len(label), 60, replace=False)] = -1  # and faces that are on none
    found = network_of(mesh, stray, sides)
    assert len(found.chains) == 12
    assert len({int(v) for c in found.chains for v in c.vertices[[0, -1]]}) == 8
    assert not found.cuts
    assert np.mean(found.surface[found.label] == label) > 0.99  # a stray at a corner lies on two sides alike


def test_a_piece_with_fewer_faces_than_a_patch_begins_with_is_of_the_patch_around_it():
    mesh, label, sides = labelled((30.0, 20.0, 10.0), 2.0)
    middle = mesh.vertices[mesh.faces].mean(1)
    order = np.argsort(np.linalg.norm(middle - [15.0, 10.0, 10.0], axis=1))
    for n, regions in ((LEAST_FACES - 1, 6), (3 * LEAST_FACES, 7)):
        strays = label.copy()
        strays[order[:n]] = 0
        assert len(network_of(mesh, strays, sides).surface) == regions


def test_a_traced_box_is_the_box_wherever_it_stands():
    mesh, label, sides = labelled((30.0, 20.0, 10.0), 2.0)
    R = rotation(3)
    turned = TriangleMesh(vertices=mesh.vertices @ R.T, faces=mesh.faces)
    moved = [dataclasses.replace(s, point=R @ s.point, axis=R @ s.axis) for s in sides]
    found = traced_solid(turned, label, moved, small([3] * 6), 0.1, 2.0)
    assert is_valid(found.solid)
    assert volume_of(found.solid) == pytest.approx(6000.0, rel=1e-9)
    assert found.loose == 0.0


def test_where_two_sides_touch_across_a_narrow_third_the_faces_are_the_thirds():
    mesh, label, sides = labelled((30.0, 4.0, 10.0), 2.0)
    middle = mesh.vertices[mesh.faces].mean(1)
    near = (label == 5) & (np.abs(middle[:, 0] - 15) < 1.0)
    torn = np.where(near, np.where(middle[:, 1] < 2, 2, 3), label)  # y = 0 and y = 4 meet on z = 10
    made = traced_solid(mesh, torn, sides, small([3] * 6), 0.1, 2.0, bridged=True)
    assert is_valid(made.solid)
    assert volume_of(made.solid) == pytest.approx(1200.0, rel=1e-9)
    as_given = traced_solid(mesh, torn, sides, small([3] * 6), 0.1, 2.0)
    assert abs(volume_of(as_given.solid) / 1200 - 1) > 1e-3  # a notch that is not there


def test_points_meet_where_planes_do_and_on_lines_of_touch():
    three = [plane((1, 0, 0), (1, 0, 0.2)), plane((0, 2, 0), (0.1, 1, 0)), plane((0, 0, 3), (0, 0, 1))]
    found = met(np.array([1.2, 2.2, 2.7]), three, [], [])
    exact = np.linalg.solve([s.axis for s in three], [s.axis @ s.point for s in three])
    assert found.at == pytest.approx(exact, abs=1e-9)
    round_one = Surface(kind=CYLINDER, point=np.array([0.0, 0.0, 4.0]), axis=np.array([0.0, 1.0, 0.0]), radius=4.0)
    floor, end = plane((0, 0, 0), (0, 0, -1)), plane((0, 5, 0), (0, 1, 0))
    found = met(np.array([0.7, 4.8, 0.1]), [round_one, floor, end], [(round_one, floor, np.array([1.0, 0.0, 0.0]))], [])
    assert found.at == pytest.approx([0.0, 5.0, 0.0], abs=1e-6)
    assert found.off == pytest.approx(0.0, abs=1e-6)


def test_a_cylinder_that_misses_its_plane_is_moved_as_its_covariance_asks():
    floor = plane((0, 0, 0), (0, 0, -1))
    round_one = Surface(kind=CYLINDER, point=np.array([0.0, 0.0, 4.05]), axis=np.array([0.0, 1.0, 0.0]), radius=4.0)
    at = np.column_stack([np.zeros(5), np.linspace(-8, 8, 5), np.zeros(5)])
    touch = Touch(chain=0, first=0, second=1, at=at, across=np.tile([1.0, 0.0, 0.0], (5, 1)), most=3.0)
    sure, unsure = 1e-8, 1e-2
    covariances = [np.diag([sure, sure, sure]), np.diag([sure, sure, sure, sure, unsure])]
    (flat, wide), kept = made_to_touch([floor, round_one], covariances, [touch], 0.3)
    assert len(kept) == 1
    assert wide.radius == pytest.approx(4.05, abs=2e-3)  # what is known least gives way
    assert flat.point == pytest.approx(floor.point, abs=1e-3)
    assert wide.radius + flat.point[2] == pytest.approx(wide.point[2], abs=1e-4)


def test_what_does_not_touch_is_left():
    floor = plane((0, 0, 0), (0, 0, -1))
    round_one = Surface(kind=CYLINDER, point=np.array([0.0, 0.0, 4.5]), axis=np.array([0.0, 1.0, 0.0]), radius=4.0)
    at = np.column_stack([np.zeros(5), np.linspace(-8, 8, 5), np.zeros(5)])
    touch = Touch(chain=0, first=0, second=1, at=at, across=np.tile([1.0, 0.0, 0.0], (5, 1)), most=3.0)
    made, kept = made_to_touch([floor, round_one], [1e-9 * np.eye(3), 1e-9 * np.eye(5)], [touch], 0.3)
    assert not kept
    assert made[1] == round_one


def test_a_border_that_does_not_touch_keeps_none_from_it_that_do():
    floor, lower = plane((0, 0, 0), (0, 0, -1)), plane((0, 0, -0.2), (0, 0, -1))
    round_one = Surface(kind=CYLINDER, point=np.array([0.0, 0.0, 4.03]), axis=np.array([0.0, 1.0, 0.0]), radius=4.0)
    at = np.column_stack([np.zeros(5), np.linspace(-8, 8, 5), np.zeros(5)])
    touches = [Touch(chain=k, first=k // 2, second=2, at=at, across=np.tile([1.0, 0.0, 0.0], (5, 1)), most=3.0) for k in range(3)]
    made, kept = made_to_touch([floor, lower, round_one], [1e-8 * np.eye(3)] * 2 + [1e-2 * np.eye(5)], touches, 0.1)
    assert [t.first for t in kept] == [0, 0]
    assert made[2].point[2] - made[2].radius == pytest.approx(0.0, abs=1e-4)
    assert made[1].point[2] == pytest.approx(-0.2, abs=1e-9)


@pytest.mark.parametrize(("lean", "places"), [(0.0, 5), (0.006, 3), (0.0, 0)])
def test_a_border_touches_as_far_as_its_surfaces_do(lean, places):
    """A round over a floor, its axis level, rising by 0.006, or a millimetre up: all of the inner places, those before the cusp, or none."""
    floor = plane((0, 0, 0), (0, 0, 1))
    up = 0.0 if places else 1.0
    axis = np.array([0.0, 1.0, lean]) / np.hypot(1, lean)
    round_one = Surface(kind=CYLINDER, point=np.array([0.0, -10.0, 4.0 + up]), axis=axis, radius=4.0, sense=-1)
    line = np.column_stack([np.zeros(41), np.linspace(-10, 10, 41), np.zeros(41)])
    mesh = TriangleMesh(vertices=line, faces=np.zeros((0, 3), np.int64))
    network = SimpleNamespace(chains=[SimpleNamespace(vertices=np.arange(41), left=0, right=1)], surface=np.array([0, 1]))
    found = touches_of(mesh, network, [floor, round_one], [1e-12 * np.eye(3), 1e-12 * np.eye(5)], 0.15, 0.5)
    assert sum(len(t.at) for t in found) == places


def test_faces_beyond_a_line_of_touch_go_to_the_other_side_of_it():
    mesh, label, surfaces = rounded_all_over(0.0)
    c = mesh.vertices[mesh.faces].mean(1)
    top = next(k for k, s in enumerate(surfaces) if s.kind == PLANE and s.axis[2] > 0.9)
    bow = next(k for k, s in enumerate(surfaces) if s.kind == CYLINDER and abs(s.axis[0]) > 0.9 and (s.point > c.mean(0))[1:].all())
    line = surfaces[bow].point[1]
    astray = (label == bow) & (c[:, 1] < line + 2.0) & (np.abs(c[:, 0] - c[:, 0].mean()) < 8.0)
    torn = np.where(astray, top, label)
    assert astray.sum() > 10
    covariances = small([{PLANE: 3, CYLINDER: 5, SPHERE: 4}[s.kind] for s in surfaces])
    network = network_of(mesh, torn, surfaces)
    made, kept = made_to_touch(surfaces, covariances, touches_of(mesh, network, surfaces, covariances, 0.3, 1.5), 0.3)
    told = sided(mesh, network.surface[network.label], network.chains, kept, made)
    assert (told != label)[astray].mean() < 0.2  # those at its ends are left
    assert (told != label)[~astray].mean() < 0.01


@functools.cache
def ring_in_pieces():
    mesh = torus(20.0, 4.0, 96, 24)
    noisy = TriangleMesh(vertices=mesh.vertices + 0.02 * np.random.default_rng(0).standard_normal(mesh.vertices.shape), faces=mesh.faces)
    pieces = segmented(noisy, 0.1)
    return noisy, pieces


def test_a_ring_in_pieces_of_cylinders_is_one_torus():
    noisy, pieces = ring_in_pieces()
    assert len(pieces.surfaces) > 3
    found = with_rings_and_balls(noisy, pieces, 0.1)
    rings = [s for s in found.surfaces if s.kind == TORUS]
    assert len(rings) == 1
    assert (rings[0].radius, rings[0].second) == pytest.approx((20.0, 4.0), abs=0.02)


def test_a_piece_of_a_ring_that_came_as_bent_the_other_way_is_the_rings():
    noisy, pieces = ring_in_pieces()
    c = noisy.vertices[noisy.faces].mean(1)
    inner = (np.hypot(c[:, 0], c[:, 1]) < 18.0) & (np.abs(np.arctan2(c[:, 1], c[:, 0])) < 0.6)
    wrong = Surface(kind=SPHERE, point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), radius=16.0, sense=-1)
    label = np.where(inner, len(pieces.surfaces), pieces.label)
    found = with_rings_and_balls(noisy, Patches(label=label, surfaces=(*pieces.surfaces, wrong)), 0.1)
    assert [s.kind for s in found.surfaces] == [TORUS]
    assert (found.label == 0).mean() > 0.99


def test_a_ball_that_came_as_a_cylinder_or_a_cone_is_a_ball_and_a_cylinder_stays():
    rounded, _, _ = filleted()
    mesh = TriangleMesh(vertices=rounded.vertices * 1e3, faces=rounded.faces)
    patches = segmented(mesh, 0.05)
    balls = [k for k, s in enumerate(patches.surfaces) if s.kind == SPHERE]
    wrong = list(patches.surfaces)
    for k in balls[:2]:
        wrong[k] = Surface(kind=CYLINDER, point=wrong[k].point, axis=np.array([0.0, 0.0, 1.0]), radius=4.0, sense=wrong[k].sense)
    rows = np.unique(mesh.faces[patches.label == balls[2]])
    out = mesh.vertices[rows].mean(0) - wrong[balls[2]].point
    cone = Surface(kind=CONE, point=wrong[balls[2]].point, axis=out / np.linalg.norm(out), radius=4.0, second=-0.8, sense=wrong[balls[2]].sense)
    wrong[balls[2]] = fitted(cone, mesh.vertices[rows])
    found = with_rings_and_balls(mesh, Patches(label=patches.label, surfaces=tuple(wrong)), 0.05)
    kinds = [s.kind for s in found.surfaces]
    assert kinds.count(SPHERE) == len(balls)
    assert kinds.count(CYLINDER) == 12


def test_what_is_left_of_balls_between_three_rounds_becomes_balls():
    """13 faces of each of eight, noise of a sixteenth of the radius: a cylinder explains one of them better, until both have been led on."""
    noisy, label, surfaces = rounded_all_over(0.25, 1.2, 1.2)
    surfaces = [
        s if s.kind == PLANE else fitted(dataclasses.replace(s, kind=CYLINDER), noisy.vertices[np.unique(noisy.faces[label == k])])
        for k, s in enumerate(surfaces)
    ]
    kinds = [s.kind for s in with_rings_and_balls(noisy, Patches(label=label, surfaces=tuple(surfaces)), 0.8).surfaces]
    assert (kinds.count(PLANE), kinds.count(CYLINDER), kinds.count(SPHERE)) == (6, 12, 8)


def rounded_all_over(noise, edge=1.5, swallowed=0.0):
    """`filleted` with noise, in mm; the surface of each face, and these 26. swallowed : mm, width of the balls' borders that the rounds have."""
    mesh, _, _ = filleted(edge)
    at = mesh.vertices * 1e3
    c = at[mesh.faces].mean(1)
    off = c - np.clip(c, at.min(0) + 4, at.max(0) - 4)
    beyond = np.abs(off) > 1e-6
    taken = beyond.all(axis=1) & (np.abs(off).min(axis=1) < swallowed)
    beyond[np.flatnonzero(taken), np.abs(off[taken]).argmin(axis=1)] = False
    keys, label = np.unique(np.sign(off).astype(int) * beyond, axis=0, return_inverse=True)
    noisy = TriangleMesh(vertices=at + noise * np.random.default_rng(4).standard_normal(at.shape), faces=mesh.faces)
    surfaces = []
    for key in keys:
        point = np.where(key > 0, at.max(0) - 4, np.where(key < 0, at.min(0) + 4, at.mean(0)))
        n = np.abs(key).sum()
        axis = (key == 0).astype(float) if n == 2 else np.array([0.0, 0.0, 1.0])
        surfaces.append(plane(point + 4 * key, key) if n == 1 else Surface(kind={2: CYLINDER, 3: SPHERE}[n], point=point, axis=axis, radius=4.0))
    return noisy, label.ravel(), surfaces


@functools.cache
def filleted(edge=1.5):
    """A block of 40 x 30 x 20 mm with all its edges rounded by 4 mm: 6 planes, 12 cylinders, 8 balls; its volume by Steiner's formula."""
    with drawing() as occ:
        block = occ.addBox(0, 0, 0, 40, 30, 20)
        occ.synchronize()
        occ.fillet([block], list(range(1, 13)), [4.0])
        mesh = triangles(edge, 1e-3)
    a, b, c, r = 32.0, 22.0, 12.0, 4.0
    held = a * b * c + 2 * r * (a * b + b * c + c * a) + np.pi * r**2 * (a + b + c) + 4 / 3 * np.pi * r**3
    return mesh, held * 1e-9, edge * 1e-3


@pytest.mark.parametrize("noise", [0.0, 5e-5])
def test_a_block_rounded_all_over_has_its_26_faces(noise):
    mesh, held, edge = filleted()
    at = mesh.vertices + noise * np.random.default_rng(1).standard_normal(mesh.vertices.shape)
    found = true_solid(TriangleMesh(vertices=at, faces=mesh.faces), at, spacing_m=edge, noise_m=noise)
    assert found.reason == ""
    kinds = found.brep.face_kinds
    assert (kinds.count("plane"), kinds.count("cylinder"), kinds.count("sphere"), len(kinds)) == (6, 12, 8, 26)
    assert found.brep.volume_m3 == pytest.approx(held, rel=1e-3)
    back = read_back(found.brep.step)
    assert (back.is_valid, back.n_solids, back.n_free_edges, len(back.face_area)) == (True, 1, 0, 26)


def test_pieces_of_free_form_are_not_traced():
    mesh, label, _ = labelled((30.0, 20.0, 10.0), 2.0)
    blobs = [Surface(kind=SPHERE, point=np.array([15.0, 10.0, 5.0]) + k, axis=np.array([0.0, 0.0, 1.0]), radius=60.0) for k in range(6)]
    found = traced_solid(mesh, label, blobs, small([4] * 6), 1e-3, 2.0)
    assert found.solid is None
    assert found.loose > LOOSE


def test_a_tube_gets_faces_that_go_all_the_way_round():
    from OCP.TopAbs import TopAbs_FACE

    with drawing() as occ:
        occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 30, 12))], [(3, occ.addCylinder(0, 0, -1, 0, 0, 32, 9))])
        mesh = triangles(2.0)
    axis, at = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    surfaces = [
        Surface(kind=CYLINDER, point=at, axis=axis, radius=12.0), Surface(kind=CYLINDER, point=at, axis=axis, radius=9.0, sense=-1),
        plane((0, 0, 0), (0, 0, -1)), plane((0, 0, 30), (0, 0, 1)),
    ]  # fmt: skip
    off = [np.abs(s.distance(mesh.vertices)).reshape(-1)[mesh.faces].max(1) for s in surfaces]
    found = traced_solid(mesh, np.argmin(off, axis=0), surfaces, small([5, 5, 3, 3]), 0.1, 2.0)
    assert is_valid(found.solid)
    assert len(parts(found.solid, TopAbs_FACE)) == 4
    assert volume_of(found.solid) == pytest.approx(np.pi * (144 - 81) * 30, rel=1e-9)


@pytest.mark.parametrize("turn", [4, 10])
def test_halves_of_a_shaft_with_a_keyway_are_one_face_whichever_way_it_stands(turn):
    with drawing() as occ:
        occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 20, 12))], [(3, occ.addBox(8, -3, -1, 20, 6, 40))])
        mesh = triangles(2.0)
    at = [((0, 0, 0), (0, 0, -1)), ((0, 0, 20), (0, 0, 1)), ((8, 0, 0), (1, 0, 0)), ((0, 3, 0), (0, -1, 0)), ((0, -3, 0), (0, 1, 0))]
    sides = [Surface(kind=CYLINDER, point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), radius=12.0), *(plane(*p) for p in at)]
    label = np.argmin([np.abs(s.distance(mesh.vertices))[mesh.faces].max(1) for s in sides], axis=0)
    R = rotation(turn)
    moved = [dataclasses.replace(s, point=R @ s.point, axis=R @ s.axis) for s in sides]
    turned = TriangleMesh(vertices=mesh.vertices @ R.T, faces=mesh.faces)
    found = traced_solid(turned, label, moved, small([5, 3, 3, 3, 3, 3]), 0.1, 2.0).solid
    assert is_valid(found)
    assert len(faces_of(found)) == 6


def test_half_balls_that_a_cylinder_passes_into_are_cut_so_that_no_pole_lies_on_their_border():
    ball = sphere(20.0, 4)
    up = np.array([[0.0, 0.0, 30.0]])
    mesh = TriangleMesh(vertices=(ball.vertices + up * np.sign(np.round(ball.vertices[:, 2:], 6))) @ rotation(5).T, faces=ball.faces)
    up = rotation(5) @ up[0]
    height = mesh.vertices[mesh.faces].mean(1) @ up / np.linalg.norm(up)
    label = np.where(height > 29.0, 0, np.where(height < -29.0, 1, 2))
    surfaces = [Surface(kind=SPHERE, point=side * up, axis=np.array([0.0, 0.0, 1.0]), radius=20.0) for side in (1, -1)]
    surfaces.append(Surface(kind=CYLINDER, point=np.zeros(3), axis=up / np.linalg.norm(up), radius=20.0))
    made = traced_solid(mesh, label, surfaces, small([4, 4, 5]), 0.1, 2.0).solid
    assert is_valid(made)
    assert abs(volume_of(made) / (np.pi * 400 * (60 + 4 / 3 * 20)) - 1) < 1e-4


def test_faces_of_a_wall_are_regions_each_and_all_their_corners_are_corners():
    mesh, label, sides = labelled((30.0, 20.0, 10.0), 2.0)
    middle = mesh.vertices[mesh.faces].mean(1)
    wall = np.zeros(len(label), bool)
    wall[np.argsort(np.linalg.norm(middle - [15.0, 10.0, 10.0], axis=1))[: 2 * LEAST_FACES]] = True
    found = network_of(mesh, label, sides, wall)
    assert (found.surface < 0).sum() == wall.sum()
    assert (found.surface[found.label] < 0).tolist() == wall.tolist()
    ends = {int(v) for c in found.chains for v in c.vertices[[0, -1]]}
    assert set(mesh.faces[wall].ravel().tolist()) <= ends


def crossed(mesh, wall):
    """The mesh with two neighbours on the border of a patch of the top exchanged, so that the border crosses itself there."""
    other = set(mesh.faces[~wall].ravel().tolist())
    rim = np.array(sorted(set(mesh.faces[wall].ravel().tolist()) & other))
    out = mesh.vertices - mesh.vertices[rim].mean(0)
    rim = rim[np.argsort(np.arctan2(out[rim, 1], out[rim, 0]))]
    a, i, j, b = rim[:4]
    along = mesh.vertices[b] - mesh.vertices[a]
    across = 0.1 * np.cross([0, 0, 1.0], along)
    vertices = mesh.vertices.copy()
    vertices[i] = vertices[a] + 2 / 3 * along + 0.75 * across
    vertices[j] = vertices[a] + 1 / 3 * along + 0.5 * across
    return TriangleMesh(vertices=vertices, faces=mesh.faces)


@pytest.mark.parametrize(("rounds", "holds"), [(0, False), (corners.EVENED, True)])
def test_a_wall_whose_border_crosses_itself_on_a_face_is_made_even(rounds, holds, monkeypatch):
    """Noise wider than the steps of a border: the public part's two faces were not valid for it. The wall is a patch whose surface is not there."""
    mesh, label, sides = labelled((30.0, 20.0, 10.0), 1.0)
    middle = mesh.vertices[mesh.faces].mean(1)
    wall = np.zeros(len(label), bool)
    wall[np.argsort(np.linalg.norm(middle - [15.0, 10.0, 10.0], axis=1))[:40]] = True
    nowhere = Surface(kind=SPHERE, point=np.array([15.0, 10.0, 25.0]), axis=np.array([0.0, 0.0, 1.0]), radius=10.0)
    monkeypatch.setattr(corners, "EVENED", rounds)
    found = traced_solid(crossed(mesh, wall), np.where(wall, 6, label), [*sides, nowhere], small([3] * 6 + [4]), 0.1, 1.0, walls=True)
    assert (found.solid is not None and is_valid(found.solid)) == holds
    if holds:
        assert found.n_facets == 40
        assert volume_of(found.solid) == pytest.approx(6000.0, rel=1e-6)


def test_only_corners_between_a_wall_and_one_face_are_made_even():
    mesh, label, sides = labelled((30.0, 20.0, 10.0), 2.0)
    middle = mesh.vertices[mesh.faces].mean(1)
    wall = np.linalg.norm(middle - [0.0, 10.0, 10.0], axis=1) < 6.0  # over the edge of two sides
    rough = TriangleMesh(vertices=mesh.vertices + 0.1 * np.random.default_rng(0).standard_normal(mesh.vertices.shape), faces=mesh.faces)
    network = network_of(rough, label, sides, wall)
    plain, even = (Meeting(rough, network, sides, [], 0.1, 2.0, evened=e).corners for e in (False, True))
    moved = {v for v in plain if not np.allclose(plain[v].at, even[v].at, atol=1e-9)}
    region = np.where(wall, -1, label)
    regions = {v: set(region[(mesh.faces == v).any(1)].tolist()) for v in plain}
    assert moved
    assert all(len(regions[v]) == 2 and -1 in regions[v] for v in moved)
    assert all(even[v].off < 1e-9 for v in moved)


def test_a_patch_that_noise_left_inside_another_is_of_that_one():
    mesh, label, sides = labelled((30.0, 20.0, 10.0), 2.0)
    middle, up = mesh.vertices[mesh.faces].mean(1), label[np.argmax(mesh.vertices[mesh.faces].mean(1)[:, 2])]
    rows = np.flatnonzero(label == up)
    at = np.array([14.0, 9.0, 10.0])
    leaning = plane(at, [np.sin(0.4), 0.0, np.cos(0.4)])  # meets the side in one line, and not round it
    label[rows[np.argsort(np.linalg.norm(middle[rows] - at, axis=1))[: 3 * LEAST_FACES]]] = len(sides)
    found = traced_solid(mesh, label, [*sides, leaning], small([3] * 7), 0.3, 2.0, bridged=True)
    assert found.solid is not None and is_valid(found.solid)
    assert len(faces_of(found.solid)) == 6
    assert volume_of(found.solid) == pytest.approx(6000.0, rel=1e-9)


@pytest.mark.parametrize("seam", [0, 1])
def test_a_patch_that_noise_left_between_the_halves_of_another_is_of_that_one(seam):
    with drawing() as occ:
        occ.addCylinder(0, 0, 0, 0, 0, 30, 12)
        mesh = triangles(2.0)
    up = np.array([0.0, 0.0, 1.0])
    sides = [Surface(kind=CYLINDER, point=np.zeros(3), axis=up, radius=12.0), plane((0, 0, 0), -up), plane((0, 0, 30), up)]
    label = np.argmin([np.abs(s.distance(mesh.vertices))[mesh.faces].max(1) for s in sides], axis=0)
    ((_, square),) = network_of(mesh, label, sides).cuts.values()
    out = np.cross(square, up) * (1 - 2 * seam)
    at = 12 * out + 15 * up
    label[np.argsort(np.linalg.norm(mesh.vertices[mesh.faces].mean(1) - at, axis=1))[: 3 * LEAST_FACES]] = 3
    sides.append(plane(at, out + 0.1 * up))  # runs to and fro along the line in which it touches
    borders = network_of(mesh, label, sides)
    assert sum(3 in borders.surface[[c.left, c.right]] for c in borders.chains) == 2
    found = traced_solid(mesh, label, sides, small([5, 3, 3, 3]), 0.3, 2.0, bridged=True).solid
    assert is_valid(found)
    assert len(faces_of(found)) == 3
