"""Holes filled: triangulation of least area, refined to the density around it, then faired so that it goes on as its surroundings do (Liepa 2003)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import spsolve

from scan2fea.kernel.jit import jit
from scan2fea.kernel.topology import edge_table, half_edges
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

DENSE_LOOP = 160  # corners up to which the least area is searched for; the rest of a longer loop is cut off by ears first
REFINED = 1.5  # of the mean edge of the loop: longer edges of the fill are halved
FLAT = 1e-6  # of the squares of its edges: a smaller area is none
MOST_NEW = 20_000  # vertices put into one hole at most


def boundary_loops(faces: IntArray) -> list[IntArray]:
    """The borders as loops of vertices, each running as the half-edges of its faces do. Wants one fan per vertex."""
    directed = half_edges(faces)
    table = edge_table(faces)
    open_edges = directed[table.count[table.edge_of] == 1]
    after = {int(a): int(b) for a, b in open_edges}
    loops = []
    while after:
        start = min(after)
        loop, v = [], start
        while v in after:
            loop.append(v)
            v = after.pop(v)
        loops.append(np.array(loop, np.int64))
    return loops


@jit
def _least_area(p: FloatArray, forbidden: BoolArray) -> tuple[IntArray, float]:
    """(n - 2, 3) corners of the triangulation of a loop with the least area (Barequet and Sharir 1995) that uses no forbidden diagonal."""
    n = len(p)
    cost = np.full((n, n), np.inf)
    cut = np.full((n, n), -1, np.int64)
    for i in range(n - 1):
        cost[i, i + 1] = 0.0
    for gap in range(2, n):
        for i in range(n - gap):
            k = i + gap
            if forbidden[i, k] and not (i == 0 and k == n - 1):
                continue
            for j in range(i + 1, k):
                below = cost[i, j] + cost[j, k]
                if below >= cost[i, k]:
                    continue
                ux, uy, uz = p[j, 0] - p[i, 0], p[j, 1] - p[i, 1], p[j, 2] - p[i, 2]
                vx, vy, vz = p[k, 0] - p[i, 0], p[k, 1] - p[i, 1], p[k, 2] - p[i, 2]
                x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
                doubled = np.sqrt(x * x + y * y + z * z)
                if doubled <= FLAT * (ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz):
                    continue  # three corners on a line: a face without area
                total = below + 0.5 * doubled
                if total < cost[i, k]:
                    cost[i, k] = total
                    cut[i, k] = j
    out = np.zeros((max(n - 2, 0), 3), np.int64)
    if not np.isfinite(cost[0, n - 1]):
        return out[:0], np.inf
    stack = [(0, n - 1)]
    count = 0
    while len(stack):
        i, k = stack.pop()
        if k - i < 2:
            continue
        j = cut[i, k]
        out[count, 0] = i
        out[count, 1] = j
        out[count, 2] = k
        count += 1
        stack.append((i, j))
        stack.append((j, k))
    return out, float(cost[0, n - 1])


def _loop_faces(vertices: FloatArray, loop: IntArray, edges: set[tuple[int, int]]) -> IntArray | None:
    """Triangles over the corners of a loop; None where every triangulation would repeat an edge of the mesh."""
    ring = [int(v) for v in loop[::-1]]  # the fill runs against the faces around it
    out: list[tuple[int, int, int]] = []
    while len(ring) > DENSE_LOOP:
        p = vertices[ring]
        before, after = np.roll(p, 1, axis=0) - p, np.roll(p, -1, axis=0) - p
        cosine = (before * after).sum(1) / np.maximum(np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1), 1e-300)
        for k in np.argsort(-cosine, kind="stable"):
            a, b, c = ring[k - 1], ring[k], ring[(k + 1) % len(ring)]
            if (min(a, c), max(a, c)) not in edges:
                break
        else:
            return None
        out.append((a, b, c))
        edges.add((min(a, c), max(a, c)))
        ring.pop(int(k))
    n = len(ring)
    forbidden = np.zeros((n, n), np.bool_)
    for i in range(n):
        for k in range(i + 2, n):
            forbidden[i, k] = (min(ring[i], ring[k]), max(ring[i], ring[k])) in edges
    places, cost = _least_area(np.ascontiguousarray(vertices[ring]), forbidden)
    if not np.isfinite(cost):
        return None
    dense = [(ring[i], ring[j], ring[k]) for i, j, k in places.tolist()]
    return np.array(out + dense, np.int64).reshape(-1, 3)


def _refined(vertices: FloatArray, fill: IntArray, target: float) -> tuple[FloatArray, IntArray]:
    """The fill with its inner edges halved, longest first, until none is much longer than `target`; edges turned for better shape in between."""
    faces = [tuple(int(v) for v in face) for face in fill]
    points = list(vertices)
    first_new = len(points)
    for _ in range(20):
        edges: dict[tuple[int, int], list[int]] = {}
        for f, face in enumerate(faces):
            for k in range(3):
                a, b = face[k], face[(k + 1) % 3]
                edges.setdefault((min(a, b), max(a, b)), []).append(f)
        inner = [(float(np.linalg.norm(points[a] - points[b])), a, b) for (a, b), on in edges.items() if len(on) == 2]
        long = sorted((item for item in inner if item[0] > REFINED * target), reverse=True)
        touched: set[int] = set()
        split = False
        for _, a, b in long:
            f, g = edges[min(a, b), max(a, b)]
            if f in touched or g in touched or len(points) - first_new >= MOST_NEW:
                continue
            touched |= {f, g}
            middle = len(points)
            points.append((points[a] + points[b]) / 2)
            for h in (f, g):
                face = faces[h]
                k = next(k for k in range(3) if {face[k], face[(k + 1) % 3]} == {a, b})
                x, y, z = face[k], face[(k + 1) % 3], face[(k + 2) % 3]
                faces[h] = (x, middle, z)
                faces.append((middle, y, z))
            split = True
        _turn_edges(points, faces)
        if not split:
            break
    return np.array(points), np.array(faces, np.int64)


def _turn_edges(points: list[FloatArray], faces: list[tuple[int, ...]]) -> None:
    """Inner edges turned while the sum of the two angles across exceeds 180 degrees (Delaunay); `faces` is changed."""
    for _ in range(3):
        edges: dict[tuple[int, int], list[int]] = {}
        for f, face in enumerate(faces):
            for k in range(3):
                a, b = face[k], face[(k + 1) % 3]
                edges.setdefault((min(a, b), max(a, b)), []).append(f)
        touched: set[int] = set()
        turned = False
        for (a, b), on in edges.items():
            if len(on) != 2 or on[0] in touched or on[1] in touched:
                continue
            c, d = (next(v for v in faces[f] if v not in (a, b)) for f in on)
            if c == d or (min(c, d), max(c, d)) in edges or _angle(points, c, a, b) + _angle(points, d, a, b) <= np.pi + 1e-9:
                continue
            face = faces[on[0]]
            k = face.index(a)
            x, y = (a, b) if face[(k + 1) % 3] == b else (b, a)
            faces[on[0]], faces[on[1]] = (x, d, c), (d, y, c)
            touched |= set(on)
            turned = True
        if not turned:
            break


def _angle(points: list[FloatArray], at: int, a: int, b: int) -> float:
    u, v = points[a] - points[at], points[b] - points[at]
    return float(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))


def _faired(vertices: FloatArray, faces: IntArray, moving: IntArray) -> FloatArray:
    """Vertices `moving` placed so that the umbrella of the umbrella vanishes there: the surface goes on with the slope it comes with."""
    if not len(moving):
        return vertices
    edges = edge_table(faces).edges
    n = len(vertices)
    both = np.concatenate([edges, edges[:, ::-1]])
    valence = np.bincount(both[:, 0], minlength=n)
    umbrella = coo_array((-1.0 / valence[both[:, 0]], (both[:, 0], both[:, 1])), shape=(n, n)).tocsr()
    umbrella = csr_array(umbrella + coo_array((np.ones(n), (np.arange(n), np.arange(n))), shape=(n, n)).tocsr())
    rows = csr_array(umbrella[moving] @ umbrella)
    fixed = np.setdiff1d(np.arange(n), moving)
    right = -(rows[:, fixed] @ vertices[fixed])
    solved = np.asarray(spsolve(rows[:, moving].tocsc(), right)).reshape(-1, 3)
    out = vertices.copy()
    if np.isfinite(solved).all():
        out[moving] = solved
    return out


def filled(mesh: TriangleMesh, *, smooth: bool = True) -> tuple[TriangleMesh, int]:
    """The mesh with every hole filled that can be, and how many were. smooth : refine and fair; else only the corners of the holes are used."""
    vertices, faces = mesh.vertices, mesh.faces
    loops = boundary_loops(faces)
    if not loops:
        return mesh, 0
    edges = {(int(a), int(b)) for a, b in edge_table(faces).edges}
    new_faces, done = [faces], 0
    for loop in loops:
        fill = _loop_faces(vertices, loop, edges) if len(loop) >= 3 else None
        if fill is None:
            continue
        done += 1
        if smooth:
            before = len(vertices)
            target = float(np.linalg.norm(vertices[loop] - vertices[np.roll(loop, -1)], axis=1).mean())
            vertices, fill = _refined(vertices, fill, target)
            near = np.isin(faces, loop).any(1) | np.isin(faces, faces[np.isin(faces, loop).any(1)]).any(1)
            local, packed = np.unique(np.concatenate([faces[near], fill]), return_inverse=True)
            moving = np.searchsorted(local, np.arange(before, len(vertices)))
            vertices = vertices.copy()
            vertices[local] = _faired(vertices[local], packed.reshape(-1, 3), moving)
        edges |= {(int(min(a, b)), int(max(a, b))) for a, b in half_edges(fill)}
        new_faces.append(fill)
    return TriangleMesh(vertices=vertices, faces=np.concatenate(new_faces)), done


def without_faces(mesh: TriangleMesh, drop: BoolArray) -> TriangleMesh:
    """The mesh without some faces."""
    return replace(mesh, faces=mesh.faces[~drop], face_origin=None, face_region=None)
