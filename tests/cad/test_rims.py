"""Rims narrower than the roundings of their creases, told by the walls beside them."""

import numpy as np
import pytest

from predicates import box, rotation
from scan2fea.cad.patches import Patches
from scan2fea.cad.rims import with_rims
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.surfaces import CYLINDER, PLANE, Surface
from scan2fea.types import TriangleMesh

LONG, WIDE, THICK = 100.0, 60.0, 8.0
SIGMA = 0.5


def plane(point, axis):
    return Surface(kind=PLANE, point=np.array(point, float), axis=np.array(axis, float))


def rounded(is_round=False):
    """A plate whose rim is a half-round, its two walls as patches, the rest free form."""
    r, sharp = THICK / 2, box((LONG, WIDE, THICK), 3.0)
    at = sharp.vertices - [LONG / 2, WIDE / 2, r]
    if is_round:
        square = at[:, :2] / [LONG / 2, WIDE / 2]
        length = np.maximum(np.linalg.norm(square, axis=1), 1e-9)
        at = np.column_stack([square * (np.abs(square).max(1) / length * WIDE / 2)[:, None], at[:, 2]])
        far = np.linalg.norm(at[:, :2], axis=1)
        core = np.column_stack([at[:, :2] * np.minimum(1.0, (WIDE / 2 - r) / np.maximum(far, 1e-9))[:, None], np.zeros(len(at))])
    else:
        core = np.clip(at, [r - LONG / 2, r - WIDE / 2, 0.0], [LONG / 2 - r, WIDE / 2 - r, 0.0])
    out = at - core
    mesh = TriangleMesh(vertices=core + r * out / np.linalg.norm(out, axis=1, keepdims=True), faces=sharp.faces)
    up = face_normals(mesh)[:, 2]
    label = np.where(up > 0.999, 0, np.where(up < -0.999, 1, -1))
    return mesh, Patches(label=label, surfaces=(plane([0, 0, r], [0, 0, 1]), plane([0, 0, -r], [0, 0, -1])))


def on_plate(n=8000, lean=0.0, is_round=False, seed=0):
    """Points on the sharp plate. lean : tangent of the angle by which its rims do."""
    rng = np.random.default_rng(seed)
    flat = rng.uniform(-0.5, 0.5, (n, 2)) * [LONG, WIDE]
    flat = flat[np.linalg.norm(flat, axis=1) < WIDE / 2] if is_round else flat
    walls = np.column_stack([flat, rng.choice([-0.5, 0.5], len(flat)) * THICK])
    m = n // 4
    z = rng.uniform(-0.5, 0.5, m) * THICK
    if is_round:
        turn = rng.uniform(0, 2 * np.pi, m)
        rim = np.column_stack([WIDE / 2 * np.cos(turn), WIDE / 2 * np.sin(turn), z])
    else:
        side, t = rng.integers(0, 4, m), rng.uniform(-0.5, 0.5, m)
        x = np.where(side < 2, (side - 0.5) * LONG, t * LONG)
        y = np.where(side < 2, t * WIDE, (side - 2.5) * WIDE)
        out = np.where((side % 2 == 1), 1.0, -1.0) * lean * z
        rim = np.column_stack([x + np.where(side < 2, out, 0.0), y + np.where(side < 2, 0.0, out), z])
    points = np.concatenate([walls, rim])
    return points + rng.normal(0, SIGMA, points.shape)


def rims_of(mesh, patches, points, raw=None):
    face = PointToMesh(mesh).nearest(points).face
    return with_rims(mesh, patches, patches if raw is None else raw, points, face, 3 * SIGMA, 3.0 + 9 * SIGMA)


@pytest.mark.parametrize("turned", [False, True])
def test_a_plate_gets_four_rims_square_to_its_walls(turned):
    mesh, patches = rounded()
    points = on_plate()
    R = rotation(3) if turned else np.eye(3)
    mesh = TriangleMesh(vertices=mesh.vertices @ R.T, faces=mesh.faces)
    patches = Patches(label=patches.label, surfaces=tuple(plane(R @ s.point, R @ s.axis) for s in patches.surfaces))
    found = rims_of(mesh, patches, points @ R.T)
    assert len(found.told) == 4
    ways = []
    for k, used in found.told.items():
        rim = found.patches.surfaces[k]
        axis, at = R.T @ rim.axis, R.T @ rim.point
        assert abs(axis[2]) < 1e-9
        which = int(np.abs(axis).argmax())
        assert abs(axis[which]) > np.cos(np.radians(1.0))
        ways.append((which, np.sign(axis[which])))
        assert abs(at @ axis - (LONG, WIDE)[which] / 2) < 4 * SIGMA / np.sqrt(len(used))
        assert (found.patches.label == k).sum() > 50
    assert len(set(ways)) == 4


def test_rims_that_lean_are_not_made_square():
    mesh, patches = rounded()
    assert not rims_of(mesh, patches, on_plate(n=80_000, lean=0.6)).told


def test_a_round_rim_is_one_cylinder():
    mesh, patches = rounded(is_round=True)
    found = rims_of(mesh, patches, on_plate(is_round=True))
    assert [found.patches.surfaces[k].kind for k in found.told] == [CYLINDER]
    assert abs(found.patches.surfaces[next(iter(found.told))].radius - WIDE / 2) < 0.1


def test_a_wall_that_was_given_up_is_one_again_where_it_lies_across_from_another():
    mesh, patches = rounded()
    alone = Patches(label=np.where(patches.label == 0, 0, -1), surfaces=patches.surfaces[:1])
    found = rims_of(mesh, alone, on_plate(), raw=patches)
    assert len(found.told) == 4 and len(found.patches.surfaces) == 6


def test_walls_far_apart_tell_no_rim():
    mesh, patches = rounded()
    points = on_plate()
    face = PointToMesh(mesh).nearest(points).face
    found = with_rims(mesh, patches, patches, points, face, 3 * SIGMA, THICK / 2.1)
    assert not found.told and found.patches.surfaces == patches.surfaces


def test_a_crumb_that_no_point_asks_for_is_given_up_where_rims_are_told():
    mesh, patches = rounded()
    points = on_plate()
    middle = mesh.vertices[mesh.faces].mean(1)
    crumb = np.argsort(np.linalg.norm(middle - [LONG / 4, WIDE / 4, THICK / 2], axis=1))[:4]
    label = patches.label.copy()
    label[crumb] = 2
    face = PointToMesh(mesh).nearest(points).face
    far = ~np.isin(face, crumb)
    given = Patches(label=label, surfaces=(*patches.surfaces, Surface(kind=CYLINDER, point=np.zeros(3), axis=np.eye(3)[0], radius=5.5, sense=-1)))
    for used, n in ((far, 6), (np.ones_like(far), 7)):
        found = with_rims(mesh, given, given, points[used], face[used], 3 * SIGMA, 3.0 + 9 * SIGMA)
        assert len(found.told) == 4 and len(found.patches.surfaces) == n
