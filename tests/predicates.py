"""Strong predicates and exact solids that tests of every room share."""

from __future__ import annotations

import itertools

import numpy as np

from scan2fea.kernel.distances import distance_to_mesh, sample_surface
from scan2fea.kernel.measures import volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.surfaces import PLANE, Surface
from scan2fea.kernel.topology import half_edges, surface_topology
from scan2fea.types import TriangleMesh


def assert_closed_manifold_oriented(mesh, n_components=1):
    """Every edge used twice, every directed edge once, one fan per vertex, no loose vertex, no flat face, positive volume."""
    directed = half_edges(mesh.faces)
    assert len(np.unique(directed, axis=0)) == len(directed), "a directed edge is used twice"
    assert len(np.unique(np.sort(directed, axis=1), axis=0)) * 2 == len(directed), "an edge has not two faces"
    topology = surface_topology(mesh)
    assert topology.is_clean, topology
    assert topology.n_components == n_components, topology
    assert volume(mesh) > 0


def assert_no_crossing(mesh):
    pairs = self_intersections(mesh)
    assert not len(pairs), f"{len(pairs)} pairs of faces cross, first {pairs[0]}"


def two_sided(a, b, n=20_000, seed=0):
    """(n,), (n,) distances of samples of a (and its vertices) to b, and of b to a."""
    of_a, of_b = (np.concatenate([sample_surface(m, n, seed)[0], m.vertices[np.unique(m.faces)]]) for m in (a, b))
    return distance_to_mesh(of_a, b).distance, distance_to_mesh(of_b, a).distance


def assert_same_surface(a, b, p95_m, max_m):
    """Distance both ways: 95th percentile and largest."""
    for name, distance in zip(("there", "back"), two_sided(a, b), strict=True):
        assert np.percentile(distance, 95) <= p95_m, (name, np.percentile(distance, 95))
        assert distance.max() <= max_m, (name, distance.max())


def rotation(seed=0):
    """A proper (3, 3) rotation."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def moved(mesh, R, shift):
    return TriangleMesh(vertices=mesh.vertices @ R.T + shift, faces=mesh.faces)


def merged(corners, tolerance=1e-9):
    """Mesh of (m, 3, 3) corners whose equal vertices are one."""
    flat = corners.reshape(-1, 3)
    _, first, inverse = np.unique(np.round(flat / tolerance).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    return TriangleMesh(vertices=flat[first], faces=inverse.reshape(-1, 3).astype(np.int64))


def box(size=(1.0, 1.0, 1.0), pitch=None):
    """A closed box from the origin, its faces cut into squares of about `pitch` (one each if None)."""
    return extruded(np.array([[0, 0], [size[0], 0], [size[0], size[1]], [0, size[1]]], float), size[2], pitch)


def _grid_polygon(loop, pitch):
    """Triangles (k, 3, 2) of an axis-parallel polygon, cut at every corner coordinate and about every pitch."""
    cuts = []
    for axis in range(2):
        at = np.unique(np.round(loop[:, axis], 12))
        parts = [np.linspace(a, b, max(1, round((b - a) / pitch)) + 1)[:-1] if pitch else [a] for a, b in itertools.pairwise(at)]
        cuts.append(np.concatenate([*parts, at[-1:]]))
    xs, ys = cuts
    out = []
    for x0, x1 in itertools.pairwise(xs):
        for y0, y1 in itertools.pairwise(ys):
            x, y = (x0 + x1) / 2, (y0 + y1) / 2
            (ax, ay), (bx, by) = loop.T, np.roll(loop, -1, axis=0).T
            with np.errstate(divide="ignore", invalid="ignore"):
                inside = (((ay > y) != (by > y)) & (x < (bx - ax) * (y - ay) / (by - ay) + ax)).sum() % 2
            if inside:
                out += [[[x0, y0], [x1, y0], [x1, y1]], [[x0, y0], [x1, y1], [x0, y1]]]
    return np.array(out), cuts


def extruded(loop, length, pitch=None):
    """A closed prism over an axis-parallel polygon (counter-clockwise), along z from 0 to length."""
    caps, cuts = _grid_polygon(loop, pitch)
    zs = np.linspace(0, length, max(1, round(length / pitch)) + 1 if pitch else 2)
    flat = lambda z: np.concatenate([caps, np.full((*caps.shape[:2], 1), z)], axis=2)  # noqa: E731
    tri = [flat(length), flat(0.0)[:, ::-1]]
    for p, q in zip(loop, np.roll(loop, -1, axis=0), strict=True):
        axis = int(np.abs(q - p).argmax())
        at = cuts[axis]
        at = at[(at >= min(p[axis], q[axis]) - 1e-12) & (at <= max(p[axis], q[axis]) + 1e-12)]
        line = np.repeat(p[None], len(at), axis=0)
        line[:, axis] = at
        line = line if q[axis] > p[axis] else line[::-1]
        for a, b in itertools.pairwise(line):
            for z0, z1 in itertools.pairwise(zs):
                corner = [[*a, z0], [*b, z0], [*b, z1], [*a, z1]]
                tri.append(np.array([[corner[0], corner[1], corner[2]], [corner[0], corner[2], corner[3]]]))
    return merged(np.concatenate(tri))


def l_beam(a=0.127, b=0.127, t=0.00635, length=0.5, pitch=None):
    """An L section with sharp corners, extruded along z."""
    return extruded(np.array([[0, 0], [a, 0], [a, t], [t, t], [t, b], [0, b]], float), length, pitch)


def quartered(tri):
    """Each of (m, 3, 3) triangles cut into four at the middles of its edges."""
    m = (tri + np.roll(tri, -1, axis=1)) / 2
    corners = [np.stack([tri[:, k], m[:, k], m[:, k - 1]], axis=1) for k in range(3)]
    return np.concatenate([*corners, m])


def spiral(turns=1.6, step_deg=72.0, inner=0.03, outer=0.05, height=0.02):
    """A square bar bent round more than once, through itself: what it covers is a ring of five sides."""
    n = round(turns * 360 / step_deg)
    angle = np.radians(step_deg) * np.arange(n + 1)
    way = np.c_[np.cos(angle), np.sin(angle)]
    vertices = np.array([[*(d * r), z] for d in way for r, z in ((inner, 0), (outer, 0), (outer, height), (inner, height))])
    sides = []
    for i in range(0, 4 * n, 4):
        for k in range(4):
            m = (k + 1) % 4
            sides += [[i + k, i + 4 + k, i + 4 + m], [i + k, i + 4 + m, i + m]]
    ends = [[0, 1, 2], [0, 2, 3], [4 * n, 4 * n + 2, 4 * n + 1], [4 * n, 4 * n + 3, 4 * n + 2]]
    tilt = 4e-4 * np.arange(n + 1).repeat(4)  # no two turns quite in one plane
    return TriangleMesh(vertices=vertices + np.c_[tilt, tilt, tilt], faces=np.array(sides + ends, np.int64))


def sphere(radius=1.0, rounds=3):
    """An icosahedron, each face cut into four `rounds` times, on the sphere."""
    g = (1 + 5**0.5) / 2
    v = np.array([[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g],
                  [0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]])  # fmt: skip
    f = np.array([[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
                  [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]])  # fmt: skip
    tri = v[f]
    for _ in range(rounds):
        tri = quartered(tri)
        tri /= np.linalg.norm(tri, axis=2, keepdims=True)
    return merged(radius * tri / np.linalg.norm(tri, axis=2, keepdims=True))


def torus(big=1.0, small=0.3, n=48, m=24):
    """A closed torus about z."""
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    r = big + small * np.cos(v)
    vertices = np.stack([r * np.cos(u), r * np.sin(u), small * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    at = lambda p, q: (p % n) * m + q % m  # noqa: E731
    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    return TriangleMesh(vertices=vertices, faces=np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int64))


def subdivided(mesh, rounds=1):
    """Each face cut into four flat ones."""
    tri = mesh.vertices[mesh.faces]
    for _ in range(rounds):
        tri = quartered(tri)
    return merged(tri)


TOPPED_SIZE = np.array([40.0, 20.0, 10.0])


def topped(height, noise, seed=0):
    """A block whose top is higher by `height(x, y)`, with noise; the side of each face, the top's -1; its five planes."""
    flat = box(TOPPED_SIZE, 1.0)
    middle, at = flat.vertices[flat.faces].mean(1), flat.vertices
    sides = [(k, side) for k in range(3) for side in (-1, 1)]
    label = np.argmin([np.abs(middle[:, k] - TOPPED_SIZE[k] * (side > 0)) for k, side in sides], axis=0)
    up = at + np.outer(height(at[:, 0], at[:, 1]) * at[:, 2] / TOPPED_SIZE[2], [0, 0, 1])
    moved = up + noise * np.random.default_rng(seed).standard_normal(up.shape)
    planes = [Surface(kind=PLANE, point=TOPPED_SIZE * (side > 0) * np.eye(3)[k], axis=side * np.eye(3)[k]) for k, side in sides[:5]]
    return TriangleMesh(vertices=moved, faces=flat.faces), TriangleMesh(vertices=up, faces=flat.faces), np.where(label == 5, -1, label), planes
