"""Area, volume, centroid and inertia of closed surfaces and of tets, exact for flat faces.

All sums are taken about the mean vertex, so that a part 1 mm across keeps its figures 10 km from the origin.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray, IntArray, TriangleMesh


def corners(mesh: TriangleMesh) -> FloatArray:
    """(m, 3, 3) corners of the faces."""
    return mesh.vertices[mesh.faces]


def face_vectors(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m, 3) area vectors: along the normal, as long as the area."""
    return _vectors(np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces, np.int64))


@jit_ieee
def _vectors(vertices: FloatArray, faces: IntArray) -> FloatArray:
    out = np.empty((len(faces), 3))
    for f in range(len(faces)):
        a, b, c = faces[f]
        ax, ay, az = vertices[a]
        ux, uy, uz = vertices[b, 0] - ax, vertices[b, 1] - ay, vertices[b, 2] - az
        vx, vy, vz = vertices[c, 0] - ax, vertices[c, 1] - ay, vertices[c, 2] - az
        out[f, 0], out[f, 1], out[f, 2] = 0.5 * (uy * vz - uz * vy), 0.5 * (uz * vx - ux * vz), 0.5 * (ux * vy - uy * vx)
    return out


def face_areas(mesh: TriangleMesh) -> FloatArray:
    """(m,) m2."""
    return np.asarray(np.linalg.norm(face_vectors(mesh.vertices, mesh.faces), axis=1))


def face_normals(mesh: TriangleMesh) -> FloatArray:
    """(m, 3) unit normals; zero for a face without area."""
    normals = face_vectors(mesh.vertices, mesh.faces)
    _to_unit(normals)
    return normals


@jit_ieee
def _to_unit(rows: FloatArray) -> None:
    """Divides each row (n, 3) by its length IN PLACE; a zero one stays."""
    for k in range(len(rows)):
        length = math.sqrt(rows[k, 0] ** 2 + rows[k, 1] ** 2 + rows[k, 2] ** 2)
        if length > 0.0:
            for a in range(3):
                rows[k, a] /= length


def vertex_normals(mesh: TriangleMesh) -> FloatArray:
    """(n, 3) unit normals, faces weighted by their angle at the vertex (Thuermer and Wuethrich 1998); zero for an unused vertex."""
    tri, normals = corners(mesh), face_normals(mesh)
    total = np.zeros_like(mesh.vertices)
    for k in range(3):
        u, v = tri[:, (k + 1) % 3] - tri[:, k], tri[:, (k + 2) % 3] - tri[:, k]
        angle = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(1))
        for axis in range(3):
            total[:, axis] += np.bincount(mesh.faces[:, k], weights=angle * normals[:, axis], minlength=len(total))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(np.divide(total, length, out=np.zeros_like(total), where=length > 0))


def median_edge(mesh: TriangleMesh) -> float:
    """Median length of the sides of all faces."""
    sides = corners(mesh)
    return float(np.median(np.linalg.norm(sides - np.roll(sides, 1, axis=1), axis=2)))


def area(mesh: TriangleMesh) -> float:
    """Area of all faces, m2."""
    return float(face_areas(mesh).sum())


def volume(mesh: TriangleMesh) -> float:
    """Volume enclosed by a closed surface, m3, positive where its faces look outward (divergence theorem)."""
    if not len(mesh.faces):
        return 0.0
    tri = mesh.vertices[mesh.faces] - mesh.vertices.mean(0)
    return float(np.einsum("ij,ij->", tri[:, 0], np.cross(tri[:, 1], tri[:, 2])) / 6)


def centroid(mesh: TriangleMesh) -> FloatArray:
    """(3,) centre of mass of the solid inside a closed surface, metres. Sums over the tets from the mean vertex to each face."""
    mean = mesh.vertices.mean(0)
    tri = mesh.vertices[mesh.faces] - mean
    six = np.einsum("ij,ij->i", tri[:, 0], np.cross(tri[:, 1], tri[:, 2]))
    return np.asarray(mean + (six[:, None] * tri.sum(1)).sum(0) / (4 * six.sum()))


def inertia(mesh: TriangleMesh) -> FloatArray:
    """(3, 3) inertia tensor of the solid about its centroid for unit density, m5.

    Second moments of a tet (0, a, b, c) of volume V: V / 20 (s s^T + a a^T + b b^T + c c^T), s = a + b + c.
    """
    tri = mesh.vertices[mesh.faces] - centroid(mesh)
    vol = np.einsum("ij,ij->i", tri[:, 0], np.cross(tri[:, 1], tri[:, 2])) / 6
    total = tri.sum(1)
    second = np.einsum("i,ij,ik->jk", vol, total, total) + np.einsum("i,inj,ink->jk", vol, tri, tri)
    second = second / 20
    return np.asarray(np.trace(second) * np.eye(3) - second)


def tet_volumes(nodes: FloatArray, tets: IntArray) -> FloatArray:
    """(m,) signed volumes of the corner tets of (m, 4) or (m, 10) elements, m3; positive in VTK order."""
    a, b, c, d = (nodes[tets[:, k]] for k in range(4))
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6)


def extent(points: FloatArray) -> float:
    """Length of the diagonal of the box around (n, 3) points, metres."""
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
