"""Lloyd and ODT on surfaces: energies against drawn points, fixed points, and a surface that stays where it was."""

import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, box, l_beam, moved, rotation, sphere
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import volume
from scan2fea.kernel.quality import triangle_quality
from scan2fea.kernel.topology import edge_table
from scan2fea.remeshing.lloyd import lloyd
from scan2fea.remeshing.odt import odt
from scan2fea.remeshing.relaxing import relaxed_by
from scan2fea.remeshing.surface_kernels import lloyd_cells, lloyd_of, odt_energy, odt_of, odt_targets
from scan2fea.types import TriangleMesh

METHODS = (lloyd, odt)
TRIANGLES = {
    "acute": [[0, 0, 0], [1, 0.1, 0], [0.4, 0.9, 0.2]],
    "obtuse": [[0, 0, 0], [1, 0.1, 0], [0.3, 0.2, 0.1]],
    "right": [[0, 0, 0], [1, 0, 0], [0, 0.7, 0]],
    "needle": [[0, 0, 0], [1, 0, 0], [0.98, 0.03, 0.0]],
}


def jittered(mesh, share, seed=0):
    """Free-form noise along the surface: vertices moved at random, put back onto a sphere of radius 1."""
    rng = np.random.default_rng(seed)
    edge = np.median(np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1))
    points = mesh.vertices + rng.normal(0, share * edge, mesh.vertices.shape)
    return TriangleMesh(vertices=points / np.linalg.norm(points, axis=1)[:, None], faces=mesh.faces)


def patch(n=9, jitter=0.0, seed=0):
    """A flat patch of equilateral triangles with a border."""
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    points = np.stack([i + 0.5 * j, j * 3**0.5 / 2, 0 * i], axis=-1).reshape(-1, 3).astype(float)
    rng = np.random.default_rng(seed)
    inner = ((i > 0) & (i < n - 1) & (j > 0) & (j < n - 1)).ravel()
    points[inner, :2] += rng.uniform(-jitter, jitter, (inner.sum(), 2))
    v = (i * n + j)[:-1, :-1].ravel()
    return TriangleMesh(vertices=points, faces=np.concatenate([np.stack([v, v + n, v + 1], 1), np.stack([v + n, v + n + 1, v + 1], 1)])), inner


@pytest.mark.parametrize("name", TRIANGLES)
@pytest.mark.parametrize("turn", range(3))
def test_energies_of_a_triangle_against_drawn_points(name, turn):
    corner = np.roll(np.array(TRIANGLES[name], float), turn, axis=0)
    faces, n = np.array([[0, 1, 2]]), np.zeros(3)
    area = np.linalg.norm(np.cross(corner[1] - corner[0], corner[2] - corner[0])) / 2
    weights = np.random.default_rng(0).dirichlet(np.ones(3), 400_000)
    x = weights @ corner
    away = ((x[:, None] - corner[None]) ** 2).sum(2)
    near = away.argmin(1)
    energy = away.min(1).mean() * area
    centroids, found = lloyd_cells(corner, faces)
    assert found == pytest.approx(energy, rel=1e-2)
    assert lloyd_of(*corner, n) == pytest.approx(found, rel=1e-12)
    for k in range(3):
        np.testing.assert_allclose(centroids[k], x[near == k].mean(0), atol=4e-3)
    error = (weights @ (corner**2).sum(1) - (x**2).sum(1)).mean() * area
    assert odt_of(*corner, n) == pytest.approx(error, rel=1e-2)
    assert odt_energy(corner, faces) == pytest.approx(odt_of(*corner, n), rel=1e-12)


def test_odt_target_is_the_least_energy_of_a_flat_star():
    mesh, inner = patch(jitter=0.3)
    v = int(np.flatnonzero(inner)[20])
    target = odt_targets(mesh.vertices, mesh.faces)[v]

    def energy(x, y):
        points = mesh.vertices.copy()
        points[v, :2] = x, y
        return odt_energy(points, mesh.faces)

    best = energy(*target[:2])
    for dx, dy in ((1e-3, 0), (-1e-3, 0), (0, 1e-3), (0, -1e-3)):
        assert energy(target[0] + dx, target[1] + dy) > best


@pytest.mark.parametrize("method", METHODS)
def test_even_triangles_are_a_fixed_point_and_uneven_ones_come_back_to_them(method):
    mesh, inner = patch()
    same, found = method(mesh, 5)
    np.testing.assert_allclose(same.vertices, mesh.vertices, atol=1e-12)
    assert found.why == "settled"
    rough, _ = patch(jitter=0.3, seed=1)
    even, found = method(rough, 300)
    before, after = (triangle_quality(m.vertices, m.faces)["min_angle_deg"] for m in (rough, even))
    assert after.min() > before.min() + 15 and np.median(after) > 54
    assert np.array_equal(even.vertices[~inner], mesh.vertices[~inner])
    assert (np.diff(found.energies) <= 0).all()


@pytest.mark.parametrize("method", METHODS)
def test_vertices_slide_on_the_surface_and_the_energy_never_rises(method):
    ball = jittered(sphere(rounds=3), 0.1)
    first = ball.vertices.copy()
    made, found = method(ball, 60)
    assert np.array_equal(ball.vertices, first)
    assert (np.diff(found.energies) <= 0).all() and found.energies[-1] < 0.97 * found.energies[0]
    assert_closed_manifold_oriented(made)
    edge = np.median(np.linalg.norm(ball.vertices[ball.faces[:, 0]] - ball.vertices[ball.faces[:, 1]], axis=1))
    assert PointToMesh(ball).nearest(made.vertices).distance.max() < 1e-12
    assert PointToMesh(made).nearest(ball.vertices).distance.max() < 0.1 * edge
    before, after = (triangle_quality(m.vertices, m.faces)["min_angle_deg"] for m in (ball, made))
    assert after.min() > before.min() + 10 and np.median(after) > np.median(before) + 5


@pytest.mark.parametrize("method", METHODS)
def test_creases_stay_creases_corners_stay_and_planes_stay_flat(method):
    beam = l_beam(length=0.1, pitch=0.00635)
    turn, shift = rotation(2), np.array([1.0, -2.0, 3.0])
    solid = moved(beam, turn, shift)
    made, found = method(solid, 30)
    assert_closed_manifold_oriented(made)
    assert (np.diff(found.energies) <= 0).all()
    assert volume(made) == pytest.approx(volume(solid), rel=1e-9)
    table, old = edge_table(made.faces), edge_table(solid.faces)

    def bends(mesh, edges):
        tri = mesh.vertices[mesh.faces]
        normal = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        half = np.arange(3 * len(mesh.faces))
        return (normal[half // 3] * normal[edges.twin // 3]).sum(1)

    for mesh, edges in ((solid, old), (made, table)):
        cosine = bends(mesh, edges)
        assert ((np.abs(cosine) < 1e-6) | (cosine > 1 - 1e-9)).all()  # right angles or flat, nothing between
    assert (np.abs(bends(made, table)) < 1e-6).sum() == (np.abs(bends(solid, old)) < 1e-6).sum()
    creases = np.bincount(old.edges[old.edge_of[np.abs(bends(solid, old)) < 1e-6]].ravel(), minlength=len(solid.vertices)) // 2
    corners = solid.vertices[creases > 2]
    assert len(corners) == 12
    assert np.linalg.norm(corners[:, None] - made.vertices[None], axis=2).min(1).max() < 1e-9


@pytest.mark.parametrize("method", METHODS)
def test_connections_are_delaunay_and_named_right_after_the_flips(method):
    rough, _ = patch(n=12, jitter=0.45, seed=3)
    made, _ = method(rough, 40)
    table = edge_table(made.faces)
    assert table.twin.max() < 3 * len(made.faces)
    half = np.flatnonzero(table.twin >= 0)
    assert np.array_equal(table.twin[table.twin[half]], half)
    angle = {}
    for h in half:
        f, k = divmod(int(h), 3)
        a, b, c = (made.vertices[made.faces[f, (k + j) % 3]] for j in range(3))
        angle[int(h)] = np.arccos((a - c) @ (b - c) / np.linalg.norm(a - c) / np.linalg.norm(b - c))
    assert all(angle[h] + angle[int(table.twin[h])] < np.pi + 1e-6 for h in angle)


@pytest.mark.parametrize("method", METHODS)
def test_without_constraints_the_surface_shrinks_as_in_the_thesis(method):
    cube = box()
    for _ in range(3):
        cube = _split(cube)
    made, found = method(cube, 50, constrained=False)
    assert (np.diff(found.energies) <= 0).all()
    assert volume(made) < 0.9 * volume(cube)
    kept, _ = method(cube, 50)
    assert volume(kept) == pytest.approx(volume(cube), rel=1e-9)


def _split(mesh):
    """Each triangle into four."""
    table = edge_table(mesh.faces)
    middle = mesh.vertices[table.edges].mean(1)
    at = len(mesh.vertices) + table.edge_of.reshape(-1, 3)
    a, b, c = mesh.faces.T
    ab, bc, ca = at.T
    faces = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return TriangleMesh(vertices=np.vstack([mesh.vertices, middle]), faces=faces)


def test_what_was_done_is_told():
    ball = jittered(sphere(rounds=2), 0.15)
    assert relaxed_by("none", ball, 10, 0.1) == (ball, "")
    made, said = relaxed_by("odt", ball, 10, 0.01)
    assert said.startswith("odt: ") and "energy 0." in said
    free, _ = relaxed_by("lloyd_free", ball, 10, 0.01)
    assert (free.face_region == -1).all() and volume(free) < volume(made)


def test_a_needle_without_a_centre_pulls_nothing():
    """Its corners lie on a line but for rounding: 16 area^2 comes out as nothing, and the centre of its circle is nowhere."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0], [0.5, -1, 0]])
    with_needle = odt_targets(points, np.array([[0, 1, 2], [1, 0, 3]]))
    assert np.array_equal(with_needle[2], points[2])
    assert np.array_equal(with_needle[[0, 1, 3]], odt_targets(points, np.array([[1, 0, 3]]))[[0, 1, 3]])
