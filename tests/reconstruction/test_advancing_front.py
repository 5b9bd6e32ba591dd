import numpy as np
import pytest

from predicates import assert_closed_manifold_oriented, assert_no_crossing, l_beam, rotation, sphere, torus
from scan2fea.kernel.delaunay import FACETS, tetrahedralise
from scan2fea.kernel.measures import volume
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.thickness import median_thickness
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction import ReconstructionOptions, reconstruct
from scan2fea.reconstruction.advancing_front import front
from scan2fea.reconstruction.closing import closed
from scan2fea.reconstruction.front_candidates import facet_radii
from scan2fea.types import TriangleMesh
from scanned import scanned


def tets_of(points, seed=0):
    return tetrahedralise(points, spacing(points), seed)


def mesh_of(tetra, pieces):
    """The pieces as a mesh, each turned outward: the plain front knows no outside."""
    faces = pieces.faces.copy()
    points = tetra.points[: tetra.n_input]
    for part in range(pieces.n_parts):
        own = pieces.part == part
        if volume(TriangleMesh(vertices=points, faces=faces[own])) < 0:
            faces[own] = faces[own][:, ::-1]
    return TriangleMesh(vertices=points, faces=faces)


def test_radius_of_a_facet_is_that_of_its_smallest_empty_ball():
    """Brute force: over balls through the corners, centred along the axis of the circle, the smallest that holds no other point."""
    points = np.random.default_rng(1).normal(size=(40, 3))
    tetra = tets_of(points)
    radii = facet_radii(tetra.points, tetra.tets, tetra.neighbors, tetra.circumcentre, tetra.circumradius, tetra.n_input)
    t, f = np.argwhere(np.isfinite(radii))[::17].T
    for tet, facet in zip(t, f, strict=True):
        a, b, c = tetra.points[tetra.tets[tet, FACETS[facet]]]
        u, v = b - a, c - a
        n = np.cross(u, v)
        centre = a + ((u @ u) * np.cross(v, n) + (v @ v) * np.cross(n, u)) / (2 * n @ n)
        circle = np.linalg.norm(centre - a)
        height = np.concatenate([[0.0], np.geomspace(1e-4, 1e2, 3000)])
        places = centre + np.concatenate([height, -height])[:, None] * n / np.linalg.norm(n)
        ball = np.sqrt(circle**2 + np.concatenate([height, height]) ** 2)
        others = np.linalg.norm(tetra.points[None] - places[:, None], axis=2)
        empty = (others > ball[:, None] - 1e-9).all(axis=1)
        assert radii[tet, facet] == pytest.approx(ball[empty].min(), rel=0.02)


@pytest.mark.parametrize(("mesh", "euler"), [(sphere(1.0, rounds=4), 2), (torus(1.0, 0.35, 60, 24), 0)])
def test_dense_clean_points_close_by_themselves(mesh, euler):
    """Every vertex used, and the front ends where it meets itself: no hole, no wrong handle."""
    points = mesh.vertices + 1e-4 * np.random.default_rng(0).normal(size=mesh.vertices.shape)
    tetra = tets_of(points)
    found = front(tetra)
    surface = mesh_of(tetra, found)
    assert found.n_parts == 1 and found.n_open_edges == 0
    assert_closed_manifold_oriented(surface)
    assert_no_crossing(surface)
    assert len(surface.vertices) - len(surface.faces) // 2 == euler
    assert abs(volume(surface)) == pytest.approx(volume(mesh), rel=0.01)


def test_a_sheet_keeps_its_border():
    """A flat square: no triangle may bridge its rim, and every point is used."""
    x, y = np.random.default_rng(3).uniform(size=(2, 900))
    tetra = tets_of(np.stack([x, y, 0.02 * np.sin(3 * x)], axis=1))
    surface = mesh_of(tetra, front(tetra))
    topology = surface_topology(surface)
    assert topology.is_manifold and topology.is_oriented and topology.n_components == 1
    assert topology.n_vertices - topology.n_unused_vertices > 0.98 * 900
    edges = len(np.unique(np.sort(np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]]), axis=1), axis=0))
    assert topology.n_vertices - topology.n_unused_vertices - edges + topology.n_faces == 1  # a disc


def test_two_balls_get_a_seed_each():
    ball = sphere(1.0, rounds=3).vertices
    tetra = tets_of(np.vstack([ball, ball + [3.0, 0.0, 0.0]]))
    found = front(tetra)
    assert found.n_parts == 2
    assert_closed_manifold_oriented(mesh_of(tetra, found), n_components=2)


def test_the_front_turns_with_the_points():
    points = sphere(1.0, rounds=3).vertices + 0.02 * np.random.default_rng(0).normal(size=(642, 3))
    R = rotation(5)
    one, two = tets_of(points), tets_of(points @ R.T)
    a, b = (volume(mesh_of(t, front(t))) for t in (one, two))
    assert abs(a) == pytest.approx(abs(b), rel=2e-3)


def test_holes_of_the_front_are_closed_with_few_facets():
    """A cap without points: the front leaves it open or bridges it; the closed surface is a ball with a flat."""
    points = sphere(1.0, rounds=4).vertices
    points = points[points[:, 2] < 0.8] + 1e-4 * np.random.default_rng(0).normal(size=((points[:, 2] < 0.8).sum(), 3))
    tetra = tets_of(points)
    normals = points / np.linalg.norm(points, axis=1)[:, None]
    pieces = front(tetra, normals)
    found = closed(tetra, pieces, normals, spacing(points))
    assert_closed_manifold_oriented(found.mesh)
    assert_no_crossing(found.mesh)
    assert found.kept.mean() > 0.99
    cap = np.pi * 0.2**2 * (3 - 0.2) / 3
    assert volume(found.mesh) == pytest.approx(4 / 3 * np.pi - cap, rel=0.02)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_thin_beam_ends_closed_with_its_wall(noise):
    t = 0.00635
    mesh = l_beam(length=0.2)
    scan, _, _ = scanned(mesh, 0.005, noise * t, seed=1)
    kept = scan.cloud.points.copy()
    found = reconstruct(scan, ReconstructionOptions(method="advancing_front"))
    assert np.array_equal(scan.cloud.points, kept)
    assert_closed_manifold_oriented(found.mesh)
    assert_no_crossing(found.mesh)
    assert found.how["method"] == "advancing_front" and found.how["share_kept"] > 0.98
    assert median_thickness(found.mesh) == pytest.approx(t, rel=0.02)
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=0.03)
    assert not [check.name for check in found.checks if not check.passed and check.name != "edges between points"]
