"""Values such as a run saves for its objects: an angle with tets, a plate seen from one side, a ring without tets."""

from __future__ import annotations

import itertools

import numpy as np

from scan2fea.report.solids import Solid
from scan2fea.types import FloatArray, PointCloud, TriangleMesh

LEG, WALL, LENGTH = 0.127, 0.00635, 0.3048
# the six tets of a cube around its diagonal (Kuhn), corners numbered 4x + 2y + z
KUHN = [[0, *np.cumsum(np.array([4, 2, 1])[list(order)]).tolist()] for order in itertools.permutations(range(3))]


def angle_solid() -> Solid:
    """An angle of the size of the demo's, with a displacement field and two modes (a bend each way)."""
    n_leg, n_long = 12, 26
    cells = [(i, j, k) for i in range(n_long) for j in range(n_leg) for k in range(n_leg) if j == 0 or k == 0]
    corners = np.array([[cell + np.array([c >> 2, c >> 1 & 1, c & 1]) for c in range(8)] for cell in cells])
    nodes, number = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    tets = number.reshape(-1, 8)[:, KUHN].reshape(-1, 4).astype(np.int64)
    ticks = np.array([0.0, *np.linspace(WALL, LEG, n_leg)])
    xyz = np.stack([nodes[:, 0] * LENGTH / n_long, ticks[nodes[:, 1]], ticks[nodes[:, 2]]], axis=1)
    edges = xyz[tets[:, 1:]] - xyz[tets[:, :1]]
    inside_out = np.einsum("ij,ij->i", edges[:, 0], np.cross(edges[:, 1], edges[:, 2])) < 0
    tets[inside_out] = tets[inside_out][:, [0, 2, 1, 3]]
    along = xyz[:, 0] / LENGTH
    bend = np.stack([0 * along, 0.2 * along**2, -(along**2)], axis=1)
    point_data = {"displacement_m": 3e-8 * bend, "mode_7": np.sin(np.pi * along)[:, None] * [0.0, 0.7, 0.7], "mode_8": bend[:, [0, 2, 1]]}
    turn = turned(np.array([0.3, 0.2, 0.9]), 0.7)
    return Solid(nodes=xyz @ turn.T + [1.0, 2.0, 0.8], tets=tets, point_data={k: v @ turn.T for k, v in point_data.items()}, cell_data={})


def boundary_of(solid: Solid) -> TriangleMesh:
    """Its skin, with the inside of one leg invented and a deviation that is smooth on the rest."""
    faces, _ = solid.boundary()
    used, packed = np.unique(faces, return_inverse=True)
    packed = packed.reshape(-1, 3).astype(np.int64)
    vertices = solid.nodes[used]
    normal = np.cross(vertices[packed[:, 1]] - vertices[packed[:, 0]], vertices[packed[:, 2]] - vertices[packed[:, 0]])
    _, region = np.unique(np.round(normal / np.linalg.norm(normal, axis=1)[:, None], 3) + 0.0, axis=0, return_inverse=True)
    side = vertices[packed].mean(axis=1) @ [1.0, 0.2, 0.1]
    origin = np.digitize(side, np.quantile(side, [0.85, 0.95])).astype(np.int64)
    deviation = 0.0004 * np.sin(40 * vertices[:, 0]) + 0.0005 * np.cos(60 * vertices[:, 2])
    return TriangleMesh(vertices=vertices, faces=packed, face_origin=origin, face_region=region.reshape(-1).astype(np.int64), deviation_m=deviation)


def ring() -> TriangleMesh:
    """A torus."""
    n, m = 90, 40
    u, v = (a.ravel() for a in np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij"))
    radius = 0.2 + 0.07 * np.cos(v)
    vertices = np.stack([radius * np.cos(u), radius * np.sin(u), 0.07 * np.sin(v)], axis=1) + np.array([1.6, 2.5, 0.8])
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    a, b, c, d = i * m + j, (i + 1) % n * m + j, (i + 1) % n * m + (j + 1) % m, i * m + (j + 1) % m
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int64)
    low = vertices[faces].mean(axis=1)[:, 2] < 0.76
    return TriangleMesh(vertices=vertices, faces=faces, face_origin=np.where(low, 2, 0).astype(np.int64), deviation_m=0.001 * np.sin(9 * u))


def scattered(mesh: TriangleMesh, n: int, sigma_m: float, seed: int) -> PointCloud:
    """Points drawn on a surface, with noise."""
    rng = np.random.default_rng(seed)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    rows = rng.choice(len(area), n, p=area / area.sum())
    s, t = np.sqrt(rng.random(n)), rng.random(n)
    points = a[rows] * (1 - s)[:, None] + b[rows] * (s * (1 - t))[:, None] + c[rows] * (s * t)[:, None]
    return PointCloud.of(points + rng.normal(0, sigma_m, (n, 3)))


def plane(centre: FloatArray, width: float, depth: float, n: int, seed: int) -> PointCloud:
    """Points on a horizontal rectangle."""
    rng = np.random.default_rng(seed)
    return PointCloud.of(
        centre + np.stack([rng.uniform(-width / 2, width / 2, n), rng.uniform(-depth / 2, depth / 2, n), rng.normal(0, 0.0005, n)], axis=1)
    )


def turned(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation matrix (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
