"""Exact distances from points to a triangle mesh, in float64, and samples of its surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.face_tree import FaceTree, face_tree, morton_order
from scan2fea.kernel.jit import jit
from scan2fea.kernel.measures import face_areas, face_normals, vertex_normals
from scan2fea.kernel.topology import edge_table
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Nearest(Value):
    """distance : (n,) metres.   face : (n,) int64.   closest : (n, 3) the point of that face.   weights : (n, 3) its barycentric coordinates."""

    distance: FloatArray
    face: IntArray
    closest: FloatArray
    weights: FloatArray

    def of(self, rows: BoolArray | IntArray | slice) -> Nearest:
        """Those of some of the points."""
        return Nearest(distance=self.distance[rows], face=self.face[rows], closest=self.closest[rows], weights=self.weights[rows])


@jit
def _nearest_on_segment(p: FloatArray, t: FloatArray, i: int, j: int, out: FloatArray) -> float:
    """Squared distance of p to edge ij of t; `out` takes the weights of the three corners."""
    length, along = 0.0, 0.0
    for k in range(3):
        e = t[j, k] - t[i, k]
        length += e * e
        along += e * (p[k] - t[i, k])
    s = min(max(along / length, 0.0), 1.0) if length > 0 else 0.0
    out[0] = 0.0
    out[1] = 0.0
    out[2] = 0.0
    out[i] = 1 - s
    out[j] = s
    total = 0.0
    for k in range(3):
        r = p[k] - t[i, k] - s * (t[j, k] - t[i, k])
        total += r * r
    return total


@jit
def nearest_on_triangle(p: FloatArray, t: FloatArray, out: FloatArray, scratch: FloatArray) -> float:
    """Squared distance of p to triangle t (3, 3), degenerate or not; `out` takes the barycentric weights."""
    d00, d01, d11, d20, d21 = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        e0, e1, r = t[1, k] - t[0, k], t[2, k] - t[0, k], p[k] - t[0, k]
        d00 += e0 * e0
        d01 += e0 * e1
        d11 += e1 * e1
        d20 += r * e0
        d21 += r * e1
    det = d00 * d11 - d01 * d01
    if det > 1e-24 * d00 * d11:
        v = (d11 * d20 - d01 * d21) / det
        w = (d00 * d21 - d01 * d20) / det
        if v >= 0 and w >= 0 and v + w <= 1:
            total = 0.0
            for k in range(3):
                r = p[k] - t[0, k] - v * (t[1, k] - t[0, k]) - w * (t[2, k] - t[0, k])
                total += r * r
            out[0] = 1 - v - w
            out[1] = v
            out[2] = w
            return total
    best = np.inf
    for i in range(3):
        d = _nearest_on_segment(p, t, i, (i + 1) % 3, scratch)
        if d < best:
            best = d
            out[0] = scratch[0]
            out[1] = scratch[1]
            out[2] = scratch[2]
    return best


@jit
def _box_distance(p: FloatArray, box: FloatArray) -> float:
    total = 0.0
    for k in range(3):
        r = max(box[k] - p[k], p[k] - box[k + 3], 0.0)
        total += r * r
    return total


@jit
def _nearest(points: FloatArray, tri: FloatArray, boxes: FloatArray, start: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
    n, first_leaf = len(points), len(boxes) // 2
    distance = np.zeros(n)
    row = np.zeros(n, np.int64)
    weights = np.zeros((n, 3))
    stack = np.zeros(128, np.int64)
    bound = np.zeros(128)
    trial, scratch = np.zeros(3), np.zeros(3)
    last = 0
    for i in range(n):
        p = points[i]
        best = nearest_on_triangle(p, tri[last], trial, scratch) * (1 + 1e-12)  # the answer of the point before bounds the search
        row[i] = last
        for k in range(3):
            weights[i, k] = trial[k]
        top = 1
        stack[0] = 0
        bound[0] = 0.0
        while top:
            top -= 1
            node = stack[top]
            if bound[top] > best:
                continue
            if node < first_leaf:
                near, far = 2 * node + 1, 2 * node + 2
                d_near, d_far = _box_distance(p, boxes[near]), _box_distance(p, boxes[far])
                if d_far < d_near:
                    near, far, d_near, d_far = far, near, d_far, d_near
                stack[top] = far
                bound[top] = d_far
                stack[top + 1] = near
                bound[top + 1] = d_near
                top += 2
                continue
            for j in range(start[node - first_leaf], start[node - first_leaf + 1]):
                d = nearest_on_triangle(p, tri[j], trial, scratch)
                if d < best or (d == best and j < row[i]):
                    best = d
                    row[i] = j
                    for k in range(3):
                        weights[i, k] = trial[k]
        last = row[i]
        distance[i] = np.sqrt(best)
    return distance, row, weights


class PointToMesh:
    """Nearest points of one mesh, for many queries; the tree is built once. Raises InternalError for a mesh without faces."""

    def __init__(self, mesh: TriangleMesh) -> None:
        require(len(mesh.faces), InternalError, "distance to a mesh without faces")
        self.mesh = mesh
        self._middle = mesh.vertices.mean(0)
        self._tree: FaceTree = face_tree((mesh.vertices - self._middle)[mesh.faces])

    def nearest(self, points: FloatArray) -> Nearest:
        """The nearest point of the mesh for each of (n, 3) points."""
        shifted = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3) - self._middle
        order = morton_order(shifted) if len(shifted) else np.zeros(0, np.int64)
        distance, row, weights = np.zeros(len(shifted)), np.zeros(len(shifted), np.int64), np.zeros((len(shifted), 3))
        distance[order], row[order], weights[order] = _nearest(shifted[order], self._tree.corners, self._tree.boxes, self._tree.start)
        closest = np.einsum("ik,ikj->ij", weights, self._tree.corners[row]) + self._middle
        return Nearest(distance=distance, face=self._tree.face[row], closest=closest, weights=weights)

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """(n,) as `signed_distance`."""
        nearest = self.nearest(points)
        return nearest.distance * _signs(points, self.mesh, nearest, *self._normals)

    @cached_property
    def _normals(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """(m, 3) of the faces, (k, 3) of the vertices, and (3 m,) the half-edge beyond each."""
        return face_normals(self.mesh), vertex_normals(self.mesh), edge_table(self.mesh.faces).twin


def distance_to_mesh(points: FloatArray, mesh: TriangleMesh) -> Nearest:
    """The nearest point of `mesh` for each of (n, 3) points. Raises InternalError for a mesh without faces."""
    return PointToMesh(mesh).nearest(points)


def signs(points: FloatArray, mesh: TriangleMesh, nearest: Nearest) -> FloatArray:
    """(n,) +1 outside, -1 inside a closed oriented mesh, by the angle-weighted pseudo-normal of the face, edge or vertex that is nearest
    (Baerentzen and Aanaes 2005).
    """
    return _signs(points, mesh, nearest, face_normals(mesh), vertex_normals(mesh), edge_table(mesh.faces).twin)


def _signs(points: FloatArray, mesh: TriangleMesh, nearest: Nearest, of_faces: FloatArray, of_vertices: FloatArray, twin: IntArray) -> FloatArray:
    normal = of_faces[nearest.face]
    on_rim = nearest.weights <= 1e-9
    for k in range(3):
        half_edge = nearest.face * 3 + (k + 1) % 3  # the edge across from corner k
        other = np.where(twin[half_edge] >= 0, twin[half_edge] // 3, nearest.face)
        on_edge = on_rim[:, k] & (on_rim.sum(1) == 1)
        normal[on_edge] = (of_faces[nearest.face] + of_faces[other])[on_edge]
        on_vertex = ~on_rim[:, k] & (on_rim.sum(1) == 2)
        normal[on_vertex] = of_vertices[mesh.faces[nearest.face, k]][on_vertex]
    return np.where(np.einsum("ij,ij->i", points - nearest.closest, normal) < 0, -1.0, 1.0)


def signed_distance(points: FloatArray, mesh: TriangleMesh) -> FloatArray:
    """(n,) distance to a closed oriented mesh, metres, negative inside."""
    return PointToMesh(mesh).signed_distance(points)


def sample_surface(mesh: TriangleMesh, n: int, seed: int) -> tuple[FloatArray, IntArray]:
    """(n, 3) points uniform in area and the (n,) faces they lie on."""
    rng = np.random.default_rng(seed)
    total = np.cumsum(face_areas(mesh))
    face = np.searchsorted(total, rng.random(n) * total[-1]).clip(max=len(mesh.faces) - 1).astype(np.int64)
    u, v = rng.random((2, n))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    tri = mesh.vertices[mesh.faces[face]]
    return tri[:, 0] + u[:, None] * (tri[:, 1] - tri[:, 0]) + v[:, None] * (tri[:, 2] - tri[:, 0]), face
