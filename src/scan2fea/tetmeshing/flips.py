"""Local flips: 2-3, and the removal of an edge with any number of tets round it (3-2 and 4-4 are those of three and four).

An edge is removed in the best way there is: the polygon round it is cut into triangles by dynamic programming (Klincsek 1980; Shewchuk 2002,
"Two discrete optimization algorithms for the topological improvement of tetrahedral meshes"). A flip is made only where the worst angle rises.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.tetmeshing.work import MOST, Work, corner_of, exchange, outward, quality_of, ring_of, shape_quality
from scan2fea.types import IntArray

RING = 10  # edges with more tets are left to the other operations; beyond 7 a removal rarely helps
RISE = 1e-9  # by which the quality must rise: rounding must not make flips go round in circles


@jit
def flip_face(w: Work, t: int, i: int, rows: IntArray) -> int:
    """2-3: the face of t across corner i gives way to an edge. Returns the number of new tets, 0 where it does not help."""
    u = w.beside[t, i]
    if u < 0:
        return 0
    d = w.tets[t, i]
    e = -1
    for j in range(4):
        if corner_of(w, t, w.tets[u, j]) < 0:
            e = w.tets[u, j]
    before = min(quality_of(w, t), quality_of(w, u))
    face = np.empty(3, np.int64)
    outward(w, t, i, face)
    new = np.empty((3, 4), np.int64)
    for k in range(3):
        new[k, 0], new[k, 1], new[k, 2], new[k, 3] = d, face[k], face[(k + 1) % 3], e
        if shape_quality(w.points[d], w.points[face[k]], w.points[face[(k + 1) % 3]], w.points[e]) <= before + RISE:
            return 0
    old = np.empty(2, np.int64)
    old[0], old[1] = t, u
    return 3 if exchange(w, old, 2, new, 3, rows) else 0


@jit
def remove_edge(w: Work, t: int, a: int, b: int, rows: IntArray) -> int:
    """The edge a b of t taken out where that makes its worst tet better. Returns the number of new tets, 0 where it does not help."""
    around, old = np.empty(RING, np.int64), np.empty(MOST, np.int64)
    n = ring_of(w, t, a, b, around, old)
    if n < 3:
        return 0
    before = 2.0
    for k in range(n):
        before = min(before, quality_of(w, old[k]))
    best, apex = np.full((n, n), 2.0), np.zeros((n, n), np.int64)
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            best[i, j] = -2.0
            for k in range(i + 1, j):
                limit = min(best[i, k], best[k, j])
                if limit <= max(before, best[i, j]):
                    continue
                p, q, r = w.points[around[i]], w.points[around[k]], w.points[around[j]]
                found = min(limit, shape_quality(w.points[a], p, q, r))
                if found > max(before, best[i, j]):
                    found = min(found, shape_quality(w.points[b], q, p, r))
                if found > best[i, j]:
                    best[i, j], apex[i, j] = found, k
    if best[0, n - 1] <= before + RISE:
        return 0
    new = np.empty((2 * (n - 2), 4), np.int64)
    todo = np.empty((2 * n, 2), np.int64)
    todo[0, 0], todo[0, 1] = 0, n - 1
    depth, m = 1, 0
    while depth:
        depth -= 1
        i, j = todo[depth, 0], todo[depth, 1]
        if j - i < 2:
            continue
        k = apex[i, j]
        new[m, 0], new[m, 1], new[m, 2], new[m, 3] = a, around[i], around[k], around[j]
        new[m + 1, 0], new[m + 1, 1], new[m + 1, 2], new[m + 1, 3] = b, around[k], around[i], around[j]
        m += 2
        todo[depth, 0], todo[depth, 1] = i, k
        todo[depth + 1, 0], todo[depth + 1, 1] = k, j
        depth += 2
    return m if exchange(w, old, n, new, m, rows) else 0


@jit
def flip_tet(w: Work, t: int, rows: IntArray) -> int:
    """The first flip of an edge or a face of t that helps; the number of new tets."""
    for i in range(4):
        for j in range(i + 1, 4):
            made = remove_edge(w, t, w.tets[t, i], w.tets[t, j], rows)
            if made:
                return made
    for i in range(4):
        made = flip_face(w, t, i, rows)
        if made:
            return made
    return 0


@jit
def flip_all(w: Work, queue: IntArray) -> int:
    """Flip round every queued tet that still stands, until none helps there. Returns how many flips were made."""
    rows = np.empty(MOST, np.int64)
    flips = 0
    for t in queue:
        if w.tets[t, 0] < 0:
            continue
        for _ in range(8):
            made = flip_tet(w, t, rows)
            if not made:
                break
            flips += 1
            worst = 0  # go on with the worst of the new ones
            for k in range(1, made):
                if quality_of(w, rows[k]) < quality_of(w, rows[worst]):
                    worst = k
            t = rows[worst]
    return flips
