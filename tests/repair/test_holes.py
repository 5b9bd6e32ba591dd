import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_same_surface, box, sphere
from scan2fea.kernel.measures import volume
from scan2fea.repair.holes import boundary_loops, fill_holes, filled, least_area
from scan2fea.repair.ridges import parts_of
from scan2fea.repair.triangulate import ANY, EQUAL, triangulated
from scan2fea.types import TriangleMesh


def test_loops_run_as_their_faces_do():
    mesh = box(pitch=0.25)
    top = mesh.vertices[mesh.faces].mean(1)[:, 2] > 0.999
    (loop,) = boundary_loops(mesh.faces[~top])
    assert len(loop) == 16
    ends = {(int(a), int(b)) for f in mesh.faces[~top] for a, b in zip(f, np.roll(f, -1), strict=True)}
    assert all((int(a), int(b)) in ends for a, b in zip(loop, np.roll(loop, -1), strict=True))
    assert not boundary_loops(mesh.faces)


def test_least_area_lid_of_a_box_is_flat():
    mesh = box(pitch=0.25)
    top = mesh.vertices[mesh.faces].mean(1)[:, 2] > 0.999
    lid, n = filled(TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[~top]), smooth=False)
    used, packed = np.unique(lid.faces, return_inverse=True)
    assert n == 1
    solid = TriangleMesh(vertices=lid.vertices[used], faces=packed.reshape(-1, 3))
    assert_closed_manifold_oriented(solid)
    assert volume(solid) == pytest.approx(1)


def test_a_loop_longer_than_the_dense_limit():
    mesh = sphere(rounds=5)
    keep = mesh.vertices[mesh.faces].mean(1)[:, 2] < 0.3
    (loop,) = boundary_loops(mesh.faces[keep])
    assert len(loop) > 150
    lid, n = filled(TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[keep]), smooth=False)
    assert n == 1 and not boundary_loops(lid.faces)


def test_no_holes_is_the_same_mesh():
    mesh = box()
    assert filled(mesh)[0] is mesh


def cut_box(keep, pitch=0.1):
    mesh = box(pitch=pitch)
    centre = mesh.vertices[mesh.faces].mean(1)
    return mesh, TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[keep(centre)])


def test_an_edge_that_a_hole_has_cut_goes_on():
    """A hole across the edge x = y = 1/2 of a box: filled, the box is the exact box again, edge and all."""
    mesh, broken = cut_box(lambda c: (c[:, :2].min(1) < 0.7) | (np.abs(c[:, 2] - 0.5) > 0.2))
    assert len(boundary_loops(broken.faces)) == 1
    found = fill_holes(broken)
    assert found.n_holes == 1 and found.n_creases == 1
    used, packed = np.unique(found.mesh.faces, return_inverse=True)
    solid = TriangleMesh(vertices=found.mesh.vertices[used], faces=packed.reshape(-1, 3))
    assert_closed_manifold_oriented(solid)
    assert_same_surface(solid, mesh, 1e-9, 1e-9)
    assert volume(solid) == pytest.approx(1.0, abs=1e-9)


def test_a_fill_is_as_dense_and_as_round_as_what_is_around():
    ball = sphere(1.0, rounds=4)
    cap = ball.vertices[ball.faces].mean(1)[:, 2] > 0.93
    found = fill_holes(TriangleMesh(vertices=ball.vertices, faces=ball.faces[~cap]))
    new = found.mesh.faces[found.hole == 0]
    assert 0.5 * cap.sum() < len(new) < 2.0 * cap.sum()
    assert np.abs(np.linalg.norm(found.mesh.vertices[np.unique(new)], axis=1) - 1.0).max() < 0.01
    edges = np.linalg.norm(np.diff(found.mesh.vertices[new][:, [0, 1, 2, 0]], axis=1), axis=2)
    around = np.linalg.norm(np.diff(ball.vertices[ball.faces][:, [0, 1, 2, 0]], axis=1), axis=2)
    assert edges.max() < 2.0 * around.max() and edges.min() > 0.3 * around.min()


def unit_normals(p, faces):
    x = np.cross(p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]])
    return x / np.linalg.norm(x, axis=1)[:, None]


def worst_turn(p, faces, beside):
    """The largest 1 - cosine over the inner edge and the four rim edges of two faces over a ring of four."""
    normals = unit_normals(p, faces)
    turns = [1 - normals[0] @ normals[1]]
    for f, n in zip(faces.tolist(), normals, strict=True):
        turns += [1 - n @ beside[a] for a, b in zip(f, f[1:] + f[:1], strict=True) if (b - a) % 4 == 1]
    return max(turns)


def test_of_both_ways_to_part_four_corners_the_one_that_turns_less_is_taken():
    rng = np.random.default_rng(5)
    taken = set()
    for _ in range(60):
        p = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]) + 0.4 * rng.normal(size=(4, 3))
        beside = rng.normal(size=(4, 3)) + [0, 0, 2.0]
        beside /= np.linalg.norm(beside, axis=1)[:, None]
        faces = triangulated(p, np.arange(4), beside, set())
        ways = [np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0, 1, 3], [1, 2, 3]])]
        turns = [worst_turn(p, way, beside) for way in ways]
        assert worst_turn(p, faces, beside) == pytest.approx(min(turns), abs=1e-5)
        taken.add(int(np.argmin(turns)))
    assert taken == {0, 1}
    assert triangulated(p, np.arange(4), beside, {(0, 2), (1, 3)}) is None


@pytest.mark.parametrize("equal", [EQUAL, ANY])
def test_a_flat_star_is_covered_once(equal):
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    radius = np.where(np.arange(24) % 2, 0.4, 1.0)
    p = np.stack([radius * np.cos(around), radius * np.sin(around), np.zeros(24)], axis=1)
    faces = triangulated(p, np.arange(24), np.tile([0.0, 0.0, 1.0], (24, 1)), set(), equal)
    signed = 0.5 * np.cross(p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]])[:, 2]
    star = 12 * 0.4 * np.sin(np.pi / 12)
    assert len(faces) == 22 and (signed > 0).all()
    assert signed.sum() == pytest.approx(star)


def test_least_area_is_what_closing_adds_at_least():
    mesh = box(pitch=0.25)
    top = mesh.vertices[mesh.faces].mean(1)[:, 2] > 0.999
    assert least_area(TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[~top])) == pytest.approx(1.0)
    assert least_area(mesh) == 0.0


def test_chords_part_a_loop_into_loops():
    """Two chords, one inside a part of the other's: three loops, every rim edge once and every chain edge twice, in opposite ways."""
    loop, taken, chains = list(range(10)), [(0, 5), (6, 9)], [[20, 21], [30]]
    parts = parts_of(loop, taken, chains)
    assert len(parts) == 3
    edges = [(a, b) for part in parts for a, b in zip(part, part[1:] + part[:1], strict=True)]
    assert len(set(edges)) == len(edges)
    assert {(a, (a + 1) % 10) for a in loop} <= set(edges)
    chain_edges = {(0, 20), (20, 21), (21, 5), (6, 30), (30, 9)}
    assert all((b, a) in edges and (a, b) in edges for a, b in chain_edges)
