"""Triangulation of one hole: that with the smallest worst dihedral angle, of those the one with the least area (Liepa 2003)."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray

DENSE_LOOP = 300  # corners up to which the best is searched for (cubic); the rest of a longer loop is cut off by ears first
FLAT = 1e-6  # of the squares of its edges: a smaller area is none
EQUAL, ANY = 1e-6, 10.0  # turns (1 - cosine) nearer than this are equal: area decides


@jit
def _turn(normals: FloatArray, a: int, b: int, x: float, y: float, z: float) -> float:
    """1 - cosine between the unit normal (x, y, z) and that of edge (a, b); 0 where none is known there."""
    n = normals[a, b]
    if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
        return 0.0
    return float(1.0 - (n[0] * x + n[1] * y + n[2] * z))


@jit
def _best(p: FloatArray, beside: FloatArray, forbidden: BoolArray, equal: float) -> IntArray:
    """(n - 2, 3) corners over the ring p (n, 3); none where every triangulation uses a forbidden diagonal.

    beside : (n, 3) unit normal of the face beyond edge k -> k + 1, zero where there is none.   equal : turns nearer than this count as equal.
    """
    n = len(p)
    worst, area = np.full((n, n), np.inf), np.full((n, n), np.inf)
    cut = np.full((n, n), -1, np.int64)
    normals = np.zeros((n, n, 3))
    for i in range(n - 1):
        worst[i, i + 1], area[i, i + 1] = 0.0, 0.0
        normals[i, i + 1] = beside[i]
    for gap in range(2, n):
        for i in range(n - gap):
            k = i + gap
            is_last = i == 0 and k == n - 1
            if forbidden[i, k] and not is_last:
                continue
            ex, ey, ez = p[k, 0] - p[i, 0], p[k, 1] - p[i, 1], p[k, 2] - p[i, 2]
            for j in range(i + 1, k):
                below = max(worst[i, j], worst[j, k])
                if below > worst[i, k] + equal or below == np.inf:
                    continue
                ux, uy, uz = p[j, 0] - p[i, 0], p[j, 1] - p[i, 1], p[j, 2] - p[i, 2]
                x, y, z = uy * ez - uz * ey, uz * ex - ux * ez, ux * ey - uy * ex
                doubled = np.sqrt(x * x + y * y + z * z)
                if doubled <= FLAT * (ux * ux + uy * uy + uz * uz + ex * ex + ey * ey + ez * ez):
                    continue  # three corners on a line: a face without area
                x, y, z = x / doubled, y / doubled, z / doubled
                below = max(below, _turn(normals, i, j, x, y, z), _turn(normals, j, k, x, y, z))
                if is_last:
                    last = beside[n - 1]
                    if last[0] != 0.0 or last[1] != 0.0 or last[2] != 0.0:
                        below = max(below, 1.0 - (last[0] * x + last[1] * y + last[2] * z))
                total = area[i, j] + area[j, k] + 0.5 * doubled
                if below < worst[i, k] - equal or (below <= worst[i, k] + equal and total < area[i, k]):
                    worst[i, k], area[i, k], cut[i, k] = below, total, j
                    normals[i, k, 0], normals[i, k, 1], normals[i, k, 2] = x, y, z
    return _collected(cut, n)


@jit
def _collected(cut: IntArray, n: int) -> IntArray:
    out = np.zeros((max(n - 2, 0), 3), np.int64)
    if n < 3 or cut[0, n - 1] < 0:
        return out[:0]
    stack = [(0, n - 1)]
    count = 0
    while len(stack) > 0:
        i, k = stack.pop()
        if k - i < 2:
            continue
        j = cut[i, k]
        out[count, 0], out[count, 1], out[count, 2] = i, j, k
        count += 1
        stack.append((i, j))
        stack.append((j, k))
    return out


def triangulated(vertices: FloatArray, ring: IntArray, beside: FloatArray, edges: set[tuple[int, int]], equal: float = EQUAL) -> IntArray | None:
    """(k, 3) faces over a ring of vertices, running as the ring does; None where every triangulation would repeat an edge of the mesh.

    beside : (n, 3) unit normal of the face beyond edge ring[k] -> ring[k + 1], zero where there is none.   edges : of the mesh, smaller end first;
    those of ears are added.   equal : turns (1 - cosine) nearer than this are equal and area decides; ANY for area alone.
    """
    left, normals = [int(v) for v in ring], [np.asarray(n, float) for n in beside]
    ears: list[tuple[int, int, int]] = []
    while len(left) > DENSE_LOOP:
        p = vertices[left]
        before, after = np.roll(p, 1, axis=0) - p, np.roll(p, -1, axis=0) - p
        cosine = (before * after).sum(1) / np.maximum(np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1), 1e-300)
        for k in np.argsort(-cosine, kind="stable"):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            if (min(a, c), max(a, c)) not in edges:
                break
        else:
            return None
        ears.append((a, b, c))
        edges.add((min(a, c), max(a, c)))
        turned = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
        normals[k - 1] = turned / max(float(np.linalg.norm(turned)), np.finfo(float).tiny)
        left.pop(int(k))
        normals.pop(int(k))
    n = len(left)
    forbidden = np.zeros((n, n), np.bool_)
    if n > 3:
        places = {v: i for i, v in enumerate(left)}
        for v, i in places.items():
            for w, k in places.items():
                forbidden[i, k] = v < w and (v, w) in edges
        forbidden |= forbidden.T
    dense = _best(np.ascontiguousarray(vertices[left]), np.array(normals), forbidden, equal)
    if len(dense) != n - 2:
        return None
    return np.array(ears + [(left[i], left[j], left[k]) for i, j, k in dense.tolist()], np.int64).reshape(-1, 3)
