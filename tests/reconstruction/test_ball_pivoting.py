import numpy as np
import pytest
from scipy.spatial import cKDTree

from predicates import assert_closed_manifold_oriented, assert_no_crossing, l_beam, sphere, torus
from scan2fea.errors import UsageError
from scan2fea.kernel.delaunay import tetrahedralise
from scan2fea.kernel.measures import volume
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.thickness import median_thickness
from scan2fea.kernel.topology import half_edges, surface_topology
from scan2fea.reconstruction import ReconstructionOptions, reconstruct
from scan2fea.reconstruction.ball_pivoting import pivoted
from scan2fea.types import TriangleMesh
from scanned import scanned


def ball_centres(points, faces, radius):
    """Centres of the balls that rest on faces from the side they look at, nan where the face is too large."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    u, v = b - a, c - a
    n = np.cross(u, v)
    square = (n**2).sum(1)[:, None]
    centre = a + ((u**2).sum(1)[:, None] * np.cross(v, n) + (v**2).sum(1)[:, None] * np.cross(n, u)) / (2 * square)
    rest = radius**2 - ((centre - a) ** 2).sum(1)
    return centre + np.sqrt(np.where(rest >= 0, rest, np.nan))[:, None] * n / np.sqrt(square)


def cloud(seed=0):
    """A noisy torus of uneven density, with its exact normals."""
    rng = np.random.default_rng(seed)
    s, t = rng.uniform(0, 2 * np.pi, (2, 1500))
    normals = np.stack([np.cos(s) * np.cos(t), np.sin(s) * np.cos(t), np.sin(t)], axis=1)
    points = np.stack([np.cos(s), np.sin(s), 0 * s], axis=1) + (0.4 + 0.01 * rng.normal(size=1500))[:, None] * normals
    return points, normals


def test_every_triangle_carries_an_empty_ball():
    points, normals = cloud()
    h = spacing(points)
    tetra = tetrahedralise(points, h, 0)
    balls = h * np.array([1.0, 1.6, 3.0])
    found = pivoted(tetra, normals, balls)
    moved = tetra.points[: tetra.n_input]
    surface = TriangleMesh(vertices=moved, faces=found.faces)
    assert surface_topology(surface).is_manifold and surface_topology(surface).is_oriented
    carried = np.zeros(len(found.faces), bool)
    tree = cKDTree(moved)
    for ball in balls:
        centre = ball_centres(moved, found.faces, ball)
        fits = np.isfinite(centre).all(1)
        carried[fits] |= tree.query(centre[fits])[0] > ball * (1 - 1e-6)
    assert carried.all()
    assert len(np.unique(found.faces)) > 0.9 * len(points)  # noise lifts points off, or sinks them under, what the balls roll on


def test_no_ball_can_pivot_on():
    """Brute force at one radius: on no open edge does the ball meet, of all points, an unused one or another open edge's end first."""
    points, normals = cloud(1)
    h = spacing(points)
    tetra = tetrahedralise(points, h, 0)
    ball = 1.2 * h
    found = pivoted(tetra, normals, np.array([ball]))
    moved = tetra.points[: tetra.n_input]
    directed = half_edges(found.faces)
    there = {tuple(edge) for edge in directed.tolist()}
    used = np.zeros(len(points), bool)
    used[found.faces] = True
    tree = cKDTree(moved)
    open_edges = [(row, a, b) for row, (a, b) in enumerate(directed.tolist()) if (b, a) not in there]
    assert len(open_edges) > 20
    met = 0
    for row, a, b in open_edges[::7]:
        begin = ball_centres(moved, found.faces[row // 3][None], ball)[0]
        if not np.isfinite(begin).all() or tree.query(begin)[0] < ball * (1 - 1e-6):
            continue
        near = [c for c in tree.query_ball_point(0.5 * (moved[a] + moved[b]), 2 * ball) if c not in found.faces[row // 3]]
        end = ball_centres(moved, np.array([[b, a, c] for c in near]), ball)  # the next triangle runs against the edge
        middle, axis = 0.5 * (moved[a] + moved[b]), (moved[b] - moved[a]) / np.linalg.norm(moved[b] - moved[a])
        p, q = begin - middle, end - middle
        angle = np.arctan2(np.cross(p, q) @ axis, q @ p) % (2 * np.pi)
        if not np.isfinite(angle).any():
            continue
        first = near[int(np.nanargmin(angle))]
        out = np.cross(moved[a] - moved[b], moved[first] - moved[b])
        if (normals[[a, b, first]] @ out > 0.3 * np.linalg.norm(out)).all():
            met += 1
            assert used[first]
    assert met > 3


@pytest.mark.parametrize("mesh", [sphere(1.0, rounds=4), torus(1.0, 0.35, 60, 24)])
def test_dense_clean_points_close_by_themselves(mesh):
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1)[:, None]
    if np.ptp(mesh.vertices[:, 2]) < 1.0:
        ring = mesh.vertices * [1.0, 1.0, 0.0]
        normals = mesh.vertices - ring / np.linalg.norm(ring, axis=1)[:, None]
        normals /= np.linalg.norm(normals, axis=1)[:, None]
    h = spacing(mesh.vertices)
    tetra = tetrahedralise(mesh.vertices, h, 0)
    found = pivoted(tetra, normals, h * np.array([1.0, 2.0]))
    assert found.n_open_edges == 0 and found.n_parts == 1
    assert_closed_manifold_oriented(TriangleMesh(vertices=tetra.points[: tetra.n_input], faces=found.faces))


@pytest.mark.parametrize("method", ["ball_pivoting", "scale_space"])
def test_a_thin_beam_ends_closed_with_its_wall(method):
    t = 0.00635
    mesh = l_beam(length=0.15)
    scan, _, _ = scanned(mesh, 0.005, 0.1 * t, seed=1)
    found = reconstruct(scan, ReconstructionOptions(method=method, mesher="ball_pivoting"))
    assert_closed_manifold_oriented(found.mesh)
    assert_no_crossing(found.mesh)
    assert found.how["method"] == method and found.how["share_kept"] > 0.98
    assert median_thickness(found.mesh) == pytest.approx(t, rel=0.05)
    assert volume(found.mesh) == pytest.approx(volume(mesh), rel=0.04)


@pytest.mark.parametrize("radii", [(), (0.0, 1.0), (2.0, 1.0)])
def test_radii_must_ascend(radii):
    scan, _, _ = scanned(sphere(1.0, rounds=3), 0.2, seed=0)
    with pytest.raises(UsageError, match="pivot_radii"):
        reconstruct(scan, ReconstructionOptions(method="ball_pivoting", pivot_radii=radii))
