"""Delaunay tetrahedra point by point: the tets whose spheres hold a new point make way for those that join it to their outer facets.

Bowyer (1981) and Watson (1981), in an order of rounds that double, each along a Morton curve (Amenta, Choi, Rote 2003): a walk of a few steps finds
the place. Near-linear where points lie on surfaces. Signs are taken in double precision without an exact fallback: where rounding leaves a cavity
that its point does not see whole, there is no answer, and the caller asks qhull.
"""

from __future__ import annotations

import itertools

import numpy as np

from scan2fea.kernel.face_tree import morton_order
from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray, IntArray

FIRST_ROUND = 64  # points of the first round, about
TETS_PER_POINT = 8  # room to begin with
LONGEST_WALK = 100_000


def inserted(points: FloatArray, tets: IntArray, neighbors: IntArray, n: int, seed: int) -> tuple[IntArray, IntArray] | None:
    """Tets (m, 4), positive, and neighbours (m, 4), -1 on the hull, of all points; None where rounding gets in the way.

    points : (k, 3), the first n of them inside the hull of the others, none twice.   tets, neighbors : the Delaunay tets of the others.
    """
    alive, all_tets, all_neighbors = _insert(np.ascontiguousarray(points), _order(points[:n], seed), tets, neighbors)
    if not len(alive):
        return None
    number = np.full(len(all_tets) + 1, -1)
    number[alive] = np.arange(len(alive))
    return all_tets[alive], number[all_neighbors[alive]]


def _order(points: FloatArray, seed: int) -> IntArray:
    """Rounds of random points, each twice as large as the one before and along a Morton curve of its own."""
    n = len(points)
    drawn = np.random.default_rng(seed).permutation(n)
    cuts = [n]
    while cuts[-1] > FIRST_ROUND:
        cuts.append(cuts[-1] // 2)
    edges = [0, *cuts[::-1]]
    parts = [np.sort(drawn[a:b]) for a, b in itertools.pairwise(edges) if b > a]
    return np.concatenate([part[morton_order(points[part])] for part in parts])


@jit_ieee
def _side(points: FloatArray, a: int, b: int, c: int, d: int) -> float:
    """Six times the signed volume of a, b, c, d."""
    px, py, pz = points[d, 0], points[d, 1], points[d, 2]
    ax, ay, az = points[a, 0] - px, points[a, 1] - py, points[a, 2] - pz
    bx, by, bz = points[b, 0] - px, points[b, 1] - py, points[b, 2] - pz
    cx, cy, cz = points[c, 0] - px, points[c, 1] - py, points[c, 2] - pz
    return float((bz * cy - by * cz) * ax + (bx * cz - bz * cx) * ay + (by * cx - bx * cy) * az)


@jit_ieee
def _in_sphere(points: FloatArray, a: int, b: int, c: int, d: int, e: int) -> float:
    """Positive where e lies inside the sphere through the positive tet a, b, c, d: the determinant of the differences and their squares."""
    px, py, pz = points[e, 0], points[e, 1], points[e, 2]
    ax, ay, az = points[a, 0] - px, points[a, 1] - py, points[a, 2] - pz
    bx, by, bz = points[b, 0] - px, points[b, 1] - py, points[b, 2] - pz
    cx, cy, cz = points[c, 0] - px, points[c, 1] - py, points[c, 2] - pz
    dx, dy, dz = points[d, 0] - px, points[d, 1] - py, points[d, 2] - pz
    ab, bc, cd = ax * by - bx * ay, bx * cy - cx * by, cx * dy - dx * cy
    da, ac, bd = dx * ay - ax * dy, ax * cy - cx * ay, bx * dy - dx * by
    abc = az * bc - bz * ac + cz * ab
    bcd = bz * cd - cz * bd + dz * bc
    cda = cz * da + dz * ac + az * cd
    dab = dz * ab + az * bd + bz * da
    aa, bb, cc, dd = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz, dx * dx + dy * dy + dz * dz
    return float((cc * dab - dd * abc) + (aa * bcd - bb * cda))


@jit_ieee
def _facet(tets: IntArray, t: int, i: int) -> tuple[int, int, int]:
    """The corners of the facet opposite corner i, in an order that looks outward."""
    if i == 0:
        return tets[t, 1], tets[t, 2], tets[t, 3]
    if i == 1:
        return tets[t, 0], tets[t, 3], tets[t, 2]
    if i == 2:
        return tets[t, 0], tets[t, 1], tets[t, 3]
    return tets[t, 0], tets[t, 2], tets[t, 1]


@jit_ieee
def _located(points: FloatArray, tets: IntArray, neighbors: IntArray, start: int, p: int) -> int:
    """The tet that holds point p, by a walk through facets that p lies beyond; -1 where it does not end."""
    t, before = start, -1
    for _ in range(LONGEST_WALK):
        onward = -1
        for i in range(4):
            other = neighbors[t, i]
            if other == before and other >= 0:
                continue
            a, b, c = _facet(tets, t, i)
            if _side(points, a, b, c, p) > 0.0:
                onward = i
                break
        if onward < 0:
            return t
        before, t = t, neighbors[t, onward]
        if t < 0:
            return -1
    return -1


@jit_ieee
def _beyond(tets: IntArray, neighbors: IntArray, made: IntArray, t: int, i: int, x: int, y: int) -> int:
    """The new tet on the other side of edge x y of the cavity's facet i of tet t: round the edge through the cavity to its next facet."""
    leave = 0
    for k in range(4):
        v = tets[t, k]
        if k != i and v != x and v != y:
            leave = k
    for _ in range(LONGEST_WALK):
        if made[t, leave] >= 0:
            return int(made[t, leave])
        other = neighbors[t, leave]
        entry = _slot(neighbors, other, t)
        nxt = 0
        for k in range(4):
            v = tets[other, k]
            if k != entry and v != x and v != y:
                nxt = k
        t, leave = other, nxt
    return -1


@jit_ieee
def _slot(neighbors: IntArray, t: int, other: int) -> int:
    """The facet of t through which `other` lies."""
    for k in range(3):
        if neighbors[t, k] == other:
            return k
    return 3


@jit_ieee
def _wider(rows: IntArray, n: int) -> IntArray:
    out = np.full((n, 4), -1)
    for t in range(len(rows)):
        for k in range(4):
            out[t, k] = rows[t, k]
    return out


@jit_ieee
def _cavity(
    points: FloatArray, tets: IntArray, neighbors: IntArray, start: int, p: int, mark: int, state: IntArray, cavity: IntArray
) -> tuple[int, int]:
    """Tets whose spheres hold point p, written to `cavity` and marked: how many, and how many outer facets; (0, 0) where p sees one from behind."""
    cavity[0], size, done, facets = start, 1, 0, 0
    state[start] = mark
    while done < size:
        t = cavity[done]
        done += 1
        for i in range(4):
            o = neighbors[t, i]
            if o >= 0 and state[o] < mark:
                inside = _in_sphere(points, tets[o, 0], tets[o, 1], tets[o, 2], tets[o, 3], p) > 0.0
                state[o] = mark if inside else mark + 1
                if inside:
                    cavity[size] = o
                    size += 1
            if o < 0 or state[o] == mark + 1:
                a, b, c = _facet(tets, t, i)
                if not _side(points, a, b, c, p) < 0.0:
                    return 0, 0
                facets += 1
    return size, facets


@jit_ieee
def _filled(
    tets: IntArray, neighbors: IntArray, made: IntArray, p: int, mark: int, state: IntArray, cavity: IntArray, free: IntArray, n_free: int, used: int
) -> tuple[int, int, int]:
    """Tets from point p to the outer facets of the cavity, in free rows or new ones, joined to each other and to those outside.

    Returns n_free and used as they are then, and one of the new tets.
    """
    new = -1
    for t in cavity:
        for i in range(4):
            o = neighbors[t, i]
            if o >= 0 and state[o] == mark:
                continue
            if n_free > 0:
                n_free -= 1
                new = free[n_free]
            else:
                new = used
                used += 1
            a, b, c = _facet(tets, t, i)
            tets[new, 0], tets[new, 1], tets[new, 2], tets[new, 3] = a, c, b, p
            neighbors[new, 3] = o
            if o >= 0:
                neighbors[o, _slot(neighbors, o, t)] = new
            made[t, i] = new
            state[new] = mark + 1
    for t in cavity:
        for i in range(4):
            m = made[t, i]
            if m >= 0:
                for e in range(3):
                    neighbors[m, e] = _beyond(tets, neighbors, made, t, i, tets[m, (e + 1) % 3], tets[m, (e + 2) % 3])
    return n_free, used, new


@jit_ieee
def _insert(points: FloatArray, order: IntArray, first_tets: IntArray, first_neighbors: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """(tets in use, all tets, all neighbours) after the points of `order`; none in use where the work was given up."""
    room = max(TETS_PER_POINT * len(order), 64) + len(first_tets)
    tets, neighbors = _wider(first_tets, room), _wider(first_neighbors, room)
    made = np.full((room, 4), -1)  # the new tet behind each facet of the cavity
    state = np.zeros(room, np.int64)  # 2 k: in the cavity of the k-th point; 2 k + 1: asked, and outside of it
    free, cavity = np.zeros(room, np.int64), np.zeros(room, np.int64)
    n_free, used, last = 0, len(first_tets), 0
    for k in range(len(order)):
        p, mark = order[k], 2 * (k + 1)
        start = _located(points, tets, neighbors, last, p)
        size, facets = (0, 0) if start < 0 else _cavity(points, tets, neighbors, start, p, mark, state, cavity)
        if size == 0:
            return np.zeros(0, np.int64), tets, neighbors
        if used + facets > room:
            more = room + facets
            tets, neighbors, made = _wider(tets, room + more), _wider(neighbors, room + more), _wider(made, room + more)
            none = np.zeros(more, np.int64)
            state, free, cavity = np.concatenate((state, none)), np.concatenate((free, none)), np.concatenate((cavity, none))
            room += more
        n_free, used, last = _filled(tets, neighbors, made, p, mark, state, cavity[:size], free, n_free, used)
        for t in cavity[:size]:
            made[t] = -1
            tets[t, 0] = -1
            free[n_free] = t
            n_free += 1
    return np.flatnonzero(tets[:used, 0] >= 0), tets, neighbors
