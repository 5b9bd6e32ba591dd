"""What joins what in a triangle mesh: edges, fans, components, and the counts that say whether it bounds a solid.

Half-edge 3 f + k of face f goes from faces[f, k] to faces[f, (k + 1) % 3]. All functions take any faces, closed or not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

DEGENERATE = 1e-12  # a face of less than this times the square of its longest edge has no normal


@dataclass(frozen=True, eq=False, kw_only=True)
class EdgeTable(Value):
    """The undirected edges of m faces.

    edges : (e, 2) int64, smaller vertex first.   edge_of : (3 m,) row in `edges` of each half-edge.   count : (e,) faces on each edge.
    twin : (3 m,) the other half-edge of an edge with exactly two faces, whichever way it runs; -1 otherwise.
    """

    edges: IntArray
    edge_of: IntArray
    count: IntArray
    twin: IntArray


@dataclass(frozen=True, kw_only=True)
class SurfaceTopology:
    """Counts over one triangle mesh. A pinched vertex is one whose faces form more than one fan."""

    n_vertices: int
    n_faces: int
    n_boundary_edges: int
    n_nonmanifold_edges: int
    n_repeated_directed_edges: int
    n_pinched_vertices: int
    n_components: int
    n_unused_vertices: int
    n_degenerate_faces: int

    @property
    def is_closed(self) -> bool:
        """Every edge has two faces or more, and there is a face."""
        return self.n_faces > 0 and self.n_boundary_edges == 0

    @property
    def is_manifold(self) -> bool:
        """No edge with three faces, no vertex with two fans."""
        return self.n_nonmanifold_edges == 0 and self.n_pinched_vertices == 0

    @property
    def is_oriented(self) -> bool:
        """Each directed edge is used once, so neighbours agree on which side is out."""
        return self.n_repeated_directed_edges == 0

    @property
    def n_handles(self) -> int:
        """Holes that go through, of all shells together (Euler: V - E + F = 2 C - 2 G); of closed manifold surfaces alone."""
        return self.n_components - (self.n_vertices - self.n_unused_vertices - self.n_faces // 2) // 2

    @property
    def is_clean(self) -> bool:
        """Closed, manifold, oriented, every vertex used, every face with an area."""
        return self.is_closed and self.is_manifold and self.is_oriented and self.n_unused_vertices == 0 and self.n_degenerate_faces == 0


def half_edges(faces: IntArray) -> IntArray:
    """(3 m, 2) start and end vertex of each half-edge of (m, 3) faces."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def edge_table(faces: IntArray) -> EdgeTable:
    """The edges of (m, 3) faces, and which half-edges lie on each."""
    edges, edge_of, count, twin = _edges(np.array(faces, np.int64, order="C"), int(faces.max(initial=-1)) + 1)
    return EdgeTable(edges=edges, edge_of=edge_of, count=count, twin=twin)


@jit
def _edges(faces: IntArray, n: int) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """The columns of EdgeTable: half-edges are put in the row of their smaller vertex (of n), and each row sorted by the larger one."""
    half = 3 * len(faces)
    first, place = np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64)
    for f in range(len(faces)):
        for k in range(3):
            first[min(faces[f, k], faces[f, (k + 1) % 3]) + 1] += 1
    for v in range(n):
        first[v + 1] += first[v]
    for v in range(n + 1):
        place[v] = first[v]
    larger, owner = np.empty(half, np.int64), np.empty(half, np.int64)
    for f in range(len(faces)):
        for k in range(3):
            a, b = faces[f, k], faces[f, (k + 1) % 3]
            at = place[min(a, b)]
            larger[at], owner[at] = max(a, b), 3 * f + k
            place[min(a, b)] += 1
    edges, edge_of = np.empty((half, 2), np.int64), np.empty(half, np.int64)
    count, twin = np.zeros(half, np.int64), np.full(half, -1, np.int64)
    e = -1
    for v in range(n):
        start, end = first[v], first[v + 1]
        _sort(larger[start:end], owner[start:end])
        for k in range(start, end):
            if k == start or larger[k] != larger[k - 1]:
                e += 1
                edges[e, 0], edges[e, 1] = v, larger[k]
            edge_of[owner[k]] = e
            count[e] += 1
            if count[e] == 2:
                twin[owner[k]], twin[owner[k - 1]] = owner[k - 1], owner[k]
            elif count[e] == 3:
                twin[owner[k - 1]] = twin[owner[k - 2]] = -1
    return edges[: e + 1].copy(), edge_of, count[: e + 1].copy(), twin


@jit
def _sort(key: IntArray, value: IntArray) -> None:
    """Both in place by key, equal ones as they stood: by insertion where few."""
    if len(key) > 64:
        order = np.argsort(key, kind="mergesort")
        keys, values = key[order], value[order]
        for k in range(len(key)):
            key[k], value[k] = keys[k], values[k]
        return
    for k in range(1, len(key)):
        at, its = key[k], value[k]
        j = k
        while j > 0 and key[j - 1] > at:
            key[j], value[j] = key[j - 1], value[j - 1]
            j -= 1
        key[j], value[j] = at, its


def _pairs_on_edges(table: EdgeTable) -> tuple[IntArray, IntArray]:
    """Half-edges that follow one another on the same edge: enough to join all faces of each edge."""
    order = _by_edge(table.edge_of, table.count)
    same = table.edge_of[order[:-1]] == table.edge_of[order[1:]]
    return order[:-1][same], order[1:][same]


@jit
def _by_edge(edge_of: IntArray, count: IntArray) -> IntArray:
    """Half-edges in the order of their edges, those of one edge ascending."""
    place, order = np.zeros(len(count), np.int64), np.empty(len(edge_of), np.int64)
    for e in range(1, len(count)):
        place[e] = place[e - 1] + count[e - 1]
    for h in range(len(edge_of)):
        order[place[edge_of[h]]] = h
        place[edge_of[h]] += 1
    return order


def _join(n: int, i: IntArray, j: IntArray) -> tuple[int, IntArray]:
    graph = coo_array((np.ones(len(i), np.int8), (i, j)), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    return int(count), label.astype(np.int64)


def face_components(faces: IntArray, joined: BoolArray | None = None) -> tuple[int, IntArray]:
    """Number of components and (m,) label of each face; faces are joined over shared edges, only those with `joined` (e,) where given."""
    table = edge_table(faces)
    i, j = _pairs_on_edges(table)
    if joined is not None:
        keep = joined[table.edge_of[i]]
        i, j = i[keep], j[keep]
    return _join(len(faces), i // 3, j // 3)


def corner_fans(faces: IntArray, table: EdgeTable | None = None) -> IntArray:
    """(3 m,) label of the fan each corner (face f, k -> 3 f + k) belongs to: corners of one vertex joined over its edges."""
    table = edge_table(faces) if table is None else table
    directed = half_edges(faces)
    i, j = _pairs_on_edges(table)
    start = np.arange(3 * len(faces))
    end = start // 3 * 3 + (start + 1) % 3
    same = directed[i, 0] == directed[j, 0]
    a = np.concatenate([start[i], end[i]])
    b = np.concatenate([np.where(same, start[j], end[j]), np.where(same, end[j], start[j])])
    return _join(3 * len(faces), a, b)[1]


def degenerate_faces(vertices: FloatArray, faces: IntArray) -> BoolArray:
    """(m,) True where a face has (almost) no area: height under 2e-12 of its longest edge, or a repeated vertex."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0) if len(faces) else np.zeros(0)
    return np.asarray(doubled / 2 <= DEGENERATE * longest)


def surface_topology(mesh: TriangleMesh) -> SurfaceTopology:
    """Counts that decide whether `mesh` bounds a solid; near-linear in its faces."""
    faces, n = mesh.faces, len(mesh.vertices)
    table = edge_table(faces)
    directed = half_edges(faces)
    upward = np.bincount(table.edge_of[directed[:, 0] < directed[:, 1]], minlength=len(table.count))
    fan = corner_fans(faces, table)
    vertex_of_fan = np.zeros(int(fan.max(initial=-1)) + 1, np.int64)
    vertex_of_fan[fan] = faces.ravel()  # all corners of a fan are of one vertex
    fans_per_vertex = np.bincount(vertex_of_fan, minlength=n)
    i, j = _pairs_on_edges(table)
    return SurfaceTopology(
        n_vertices=n,
        n_faces=len(faces),
        n_boundary_edges=int((table.count == 1).sum()),
        n_nonmanifold_edges=int((table.count > 2).sum()),
        n_repeated_directed_edges=int((upward > 1).sum() + (table.count - upward > 1).sum()),
        n_pinched_vertices=int((fans_per_vertex > 1).sum()),
        n_components=_join(len(faces), i // 3, j // 3)[0] if len(faces) else 0,
        n_unused_vertices=int((fans_per_vertex == 0).sum()),
        n_degenerate_faces=int(degenerate_faces(mesh.vertices, faces).sum()),
    )


def vertex_faces(faces: IntArray, n_vertices: int) -> tuple[IntArray, IntArray]:
    """Faces around each vertex, in rows: those of vertex v are face[start[v]:start[v + 1]], ascending."""
    flat = faces.ravel()
    order = np.argsort(flat, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=n_vertices))])
    return start.astype(np.int64), (order // 3).astype(np.int64)


def neighbour_vertices(faces: IntArray, n_vertices: int) -> tuple[IntArray, IntArray]:
    """Vertices joined to each vertex by an edge, in rows: those of v are other[start[v]:start[v + 1]], ascending."""
    edges = edge_table(faces).edges
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    start = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=n_vertices))])
    return start.astype(np.int64), both[:, 1].astype(np.int64)
