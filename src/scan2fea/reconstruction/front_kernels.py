"""Compiled parts of the advancing front: radii of Delaunay facets, and the front itself.

A front edge u -> v runs as the NEXT triangle on it will. The surface stays a manifold at every step, so that a vertex of the front has one edge
in and one out: `after` and `before` are the front.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from scan2fea.kernel.delaunay import FACETS
from scan2fea.kernel.jit import jit
from scan2fea.kernel.side_normals import SAME_SIDE
from scan2fea.types import FloatArray, IntArray

Graph = tuple[FloatArray, FloatArray, IntArray, IntArray, FloatArray, float, float]  # points, normals, tets, neighbors, radii, wedge, ratio
Front = tuple[IntArray, IntArray, IntArray, IntArray, IntArray, IntArray, IntArray]
# state, after, before : (n,) of each vertex; home : (n, 3) tet, facet and apex of the triangle behind the edge that leaves it; choice : (n, 3)
# corner, tet and facet of the best next one; stamp : (n,) counts the edges that left it; used : table of the edges of all triangles
UNUSED, ON_FRONT, INNER = 0, 1, 2
FOLDED = 5.0 * math.pi / 6.0  # a triangle turned by more lies on its neighbour (the sliver bound of Cohen-Steiner and Da)
OUTSIDE_WEDGE, STANDBY = 2.0, 10.0  # added to a key: wedge first, then by angle, then those that wait for a partner


@jit
def facet_radii(points: FloatArray, tets: IntArray, neighbors: IntArray, centre: FloatArray, ball: FloatArray, n_input: int) -> FloatArray:
    """(m, 4) radius of the smallest empty ball through each facet, m: its distance to the dual Voronoi edge; inf at the box and on the hull."""
    out = np.full((len(tets), 4), np.inf)
    for t in range(len(tets)):
        for i in range(4):
            other = neighbors[t, i]
            a, b, c = tets[t, FACETS[i, 0]], tets[t, FACETS[i, 1]], tets[t, FACETS[i, 2]]
            if other < 0 or a >= n_input or b >= n_input or c >= n_input:
                continue
            ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
            vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
            if size == 0.0:
                continue
            here = nx * (centre[t, 0] - points[a, 0]) + ny * (centre[t, 1] - points[a, 1]) + nz * (centre[t, 2] - points[a, 2])
            there = nx * (centre[other, 0] - points[a, 0]) + ny * (centre[other, 1] - points[a, 1]) + nz * (centre[other, 2] - points[a, 2])
            if here * there <= 0.0:  # the circle's own ball is empty
                out[t, i] = math.sqrt(max(0.0, ball[t] ** 2 - (here / size) ** 2))
            else:
                out[t, i] = min(ball[t], ball[other])
    return out


@jit
def _slot(a: int, b: int, keys: IntArray, n: int) -> int:
    """Row of the open-addressing table that holds the undirected edge, or the empty one where it would go."""
    key = min(a, b) * n + max(a, b)
    mask = len(keys) - 1
    row = key * 0x9E3779B97F4A7C1
    row = (row ^ (row >> 29)) & mask
    while keys[row] >= 0 and keys[row] != key:
        row = (row + 1) & mask
    return row


@jit
def _is_free(a: int, b: int, after: IntArray, used: IntArray) -> bool:
    """May a triangle run from a to b? Yes along a front edge, and along an edge that no triangle has yet."""
    return bool(after[a] == b or used[_slot(a, b, used, len(after))] < 0)


@jit
def _turn(points: FloatArray, u: int, v: int, apex: int, c: int) -> float:
    """Angle between triangle (v, u, apex) and its neighbour (u, v, c): 0 where flat, pi where folded back."""
    ex, ey, ez = points[v, 0] - points[u, 0], points[v, 1] - points[u, 1], points[v, 2] - points[u, 2]
    ax, ay, az = points[apex, 0] - points[v, 0], points[apex, 1] - points[v, 1], points[apex, 2] - points[v, 2]
    cx, cy, cz = points[c, 0] - points[u, 0], points[c, 1] - points[u, 1], points[c, 2] - points[u, 2]
    px, py, pz = ay * ez - az * ey, az * ex - ax * ez, ax * ey - ay * ex
    qx, qy, qz = ey * cz - ez * cy, ez * cx - ex * cz, ex * cy - ey * cx
    size = math.sqrt((px * px + py * py + pz * pz) * (qx * qx + qy * qy + qz * qz))
    if size == 0.0:
        return math.pi
    return math.acos(min(1.0, max(-1.0, (px * qx + py * qy + pz * qz) / size)))


@jit
def _faces_its_side(points: FloatArray, normals: FloatArray, u: int, v: int, x: int) -> bool:
    """Do the outward normals of all three corners lie on the side that triangle (u, v, x) faces? Always where no normals are given."""
    if len(normals) == 0:
        return True
    ax, ay, az = points[v, 0] - points[u, 0], points[v, 1] - points[u, 1], points[v, 2] - points[u, 2]
    bx, by, bz = points[x, 0] - points[u, 0], points[x, 1] - points[u, 1], points[x, 2] - points[u, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    least = SAME_SIDE * math.sqrt(nx * nx + ny * ny + nz * nz)
    worst = np.inf
    for k in (u, v, x):
        worst = min(worst, nx * normals[k, 0] + ny * normals[k, 1] + nz * normals[k, 2])
    return bool(worst >= least)


@jit
def _candidate(graph: Graph, front: Front, u: int, largest: float) -> float:
    """The key of the most plausible triangle on the front edge that leaves u, inf where there is none; choice[u] takes its (corner, tet, facet)."""
    points, normals, tets, neighbors, radii, wedge, ratio = graph
    state, after, _, home, choice, _, used = front
    out = choice[u]
    v, tet, facet, apex = after[u], home[u, 0], home[u, 1], home[u, 2]
    own = radii[tet, facet]
    best = np.inf
    out[0] = -1
    t, w, x = tet, apex, tets[tet, facet]
    while True:
        j = 0
        for k in range(4):
            if tets[t, k] == w:
                j = k
        r = radii[t, j]  # facet (u, v, x)
        if x < len(state) and r < best and state[x] != INNER and _is_free(v, x, after, used) and _is_free(x, u, after, used):
            angle = _turn(points, u, v, apex, x)
            if angle < FOLDED and (angle < wedge or r <= ratio * own) and _faces_its_side(points, normals, u, v, x):
                best = r
                out[0], out[1], out[2] = x, t, j
        onward = neighbors[t, j]
        if onward < 0:
            break
        t = onward
        w = x
        for k in range(4):
            p = tets[t, k]
            if p not in (u, v, w):
                x = p
        if x == apex:
            break
    if best == np.inf:
        return np.inf
    angle = _turn(points, u, v, apex, out[0])
    return best / largest if angle < wedge else OUTSIDE_WEDGE + angle


@jit
def _partner(u: int, v: int, x: int, after: IntArray, before: IntArray, choice: IntArray, used: IntArray) -> int:
    """Where triangle (u, v, x) touches the front at x alone: 1 if the edge into x wants v next, 2 if the edge out of x wants u, else 0.

    With such a partner glued on as well the surface stays a manifold at x.
    """
    y, z = before[x], after[x]
    if choice[y, 0] == v and y != v and _is_free(v, y, after, used):
        return 1
    if choice[x, 0] == u and z != u and _is_free(z, u, after, used):
        return 2
    return 0


@jit
def _enter(
    a: int, b: int, c: int, t: int, f: int, used: IntArray, n: int, faces: IntArray, where: IntArray, count: int
) -> int:  # fmt: skip
    """Write triangle (a, b, c), facet f of tet t, and its three edges; returns the new count of faces."""
    used[_slot(a, b, used, n)] = min(a, b) * n + max(a, b)
    used[_slot(b, c, used, n)] = min(b, c) * n + max(b, c)
    used[_slot(c, a, used, n)] = min(c, a) * n + max(c, a)
    faces[count, 0], faces[count, 1], faces[count, 2] = a, b, c
    where[count, 0], where[count, 1] = t, f
    return count + 1


@jit
def _join(a: int, b: int, t: int, f: int, apex: int, state: IntArray, after: IntArray, before: IntArray, home: IntArray) -> None:
    """The front edge a -> b, with the triangle (facet f of tet t, third corner apex) behind it."""
    after[a], before[b] = b, a
    home[a, 0], home[a, 1], home[a, 2] = t, f, apex
    state[a], state[b] = ON_FRONT, ON_FRONT


@jit
def _leave(a: int, state: IntArray, after: IntArray, before: IntArray) -> None:
    state[a], after[a], before[a] = INNER, -1, -1


@jit
def _glue(
    u: int, v: int, x: int, t: int, f: int, state: IntArray, after: IntArray, before: IntArray, home: IntArray, fresh: IntArray
) -> int:  # fmt: skip
    """Triangle (u, v, x) on the front edge u -> v: extends the front, fills an ear or the last hole. Returns how many edges in `fresh` are new."""
    left, right = after[v] == x, after[x] == u
    if left and right:
        _leave(u, state, after, before)
        _leave(v, state, after, before)
        _leave(x, state, after, before)
        return 0
    if left:
        _leave(v, state, after, before)
        _join(u, x, t, f, v, state, after, before, home)
        fresh[0] = u
        return 1
    if right:
        _leave(u, state, after, before)
        _join(x, v, t, f, u, state, after, before, home)
        fresh[0] = x
        return 1
    _join(u, x, t, f, v, state, after, before, home)
    _join(x, v, t, f, u, state, after, before, home)
    fresh[0], fresh[1] = u, x
    return 2


@jit
def _glue_two(
    u: int, v: int, x: int, t: int, f: int, partner: int, corners: IntArray, g: int, h: int,
    state: IntArray, after: IntArray, before: IntArray, home: IntArray, fresh: IntArray,
) -> int:  # fmt: skip
    """Triangle (u, v, x) that touches the front at x, and its partner (facet h of tet g; its `corners` are set here)."""
    if partner == 1:
        y = before[x]
        corners[0], corners[1], corners[2] = y, x, v
        _join(u, x, t, f, v, state, after, before, home)
        fresh[0] = u
        if after[v] == y:
            _leave(v, state, after, before)
            _leave(y, state, after, before)
            return 1
        _join(y, v, g, h, x, state, after, before, home)
        fresh[1] = y
        return 2
    z = after[x]
    corners[0], corners[1], corners[2] = x, z, u
    _join(x, v, t, f, u, state, after, before, home)
    fresh[0] = x
    if after[z] == u:
        _leave(z, state, after, before)
        _leave(u, state, after, before)
        return 1
    _join(u, z, g, h, x, state, after, before, home)
    fresh[1] = u
    return 2


@jit
def _plant(a: int, b: int, c: int, t: int, f: int, graph: Graph, front: Front, largest: float, queue: list[tuple[float, int, int, int]]) -> bool:
    """The front round the seed (a, b, c), facet f of tet t. False, and nothing changed, where it does not go on smoothly over all its edges."""
    state, after, before, home, stamp = front[0], front[1], front[2], front[3], front[5]
    start = (c, b, a)  # the front runs against the seed
    smooth = True
    for k in range(3):
        p, q, r = start[k], start[(k + 1) % 3], start[(k + 2) % 3]
        after[p], before[q] = q, p
        home[p, 0], home[p, 1], home[p, 2] = t, f, r
        key = _candidate(graph, front, p, largest)
        smooth = smooth and key < OUTSIDE_WEDGE
        stamp[p] += 1
        heapq.heappush(queue, (key, stamp[p], p, q))
    for p in start:
        state[p] = ON_FRONT if smooth else UNUSED
        if not smooth:
            after[p], before[p] = -1, -1
    return smooth


@jit
def _grow(
    queue: list[tuple[float, int, int, int]], graph: Graph, front: Front, largest: float, faces: IntArray, where: IntArray, count: int
) -> int:  # fmt: skip
    """Triangles glued on, best first, until no edge of the front has one left; returns the new count of faces."""
    state, after, before, home, choice, stamp, used = front
    fresh, other = np.zeros(3, np.int64), np.zeros(3, np.int64)
    while len(queue) > 0:
        key, mark, u, v = heapq.heappop(queue)
        if stamp[u] != mark or after[u] != v:
            continue
        x, t, f = choice[u, 0], choice[u, 1], choice[u, 2]
        if x < 0 or state[x] == INNER or not (_is_free(v, x, after, used) and _is_free(x, u, after, used)):
            again = _candidate(graph, front, u, largest)
            if again < np.inf:
                heapq.heappush(queue, (again, mark, u, v))
            continue
        if state[x] == ON_FRONT and after[v] != x and after[x] != u:
            partner = _partner(u, v, x, after, before, choice, used)
            if partner == 0:
                if key < STANDBY:
                    heapq.heappush(queue, (STANDBY + key, mark, u, v))
                continue
            behind = before[x] if partner == 1 else x
            g, h = choice[behind, 1], choice[behind, 2]
            n_fresh = _glue_two(u, v, x, t, f, partner, other, g, h, state, after, before, home, fresh)
            count = _enter(other[0], other[1], other[2], g, h, used, len(state), faces, where, count)
        else:
            n_fresh = _glue(u, v, x, t, f, state, after, before, home, fresh)
        count = _enter(u, v, x, t, f, used, len(state), faces, where, count)
        for k in range(n_fresh):
            p = fresh[k]
            stamp[p] += 1
            key = _candidate(graph, front, p, largest)
            if key < np.inf:
                heapq.heappush(queue, (key, stamp[p], p, after[p]))
    return count


@jit
def advance(
    points: FloatArray, normals: FloatArray, tets: IntArray, neighbors: IntArray, radii: FloatArray, seeds: IntArray, n: int, wedge: float,
    ratio: float,
) -> tuple[IntArray, IntArray, IntArray]:  # fmt: skip
    """Triangles (k, 3) into the n points, coherently oriented; the (k, 2) tet and facet of each; (k,) the number of the seed it grew from.

    normals : (n, 3) outward, then a triangle must face the side its corners do; or (0, 3).   seeds : facets (4 tet + facet), smallest radius first.
    """
    size = 16
    while size < 8 * n:
        size *= 2
    graph = (points, normals, tets, neighbors, radii, wedge, ratio)
    state, after, before = np.zeros(n, np.int64), np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    home, choice = np.zeros((n, 3), np.int64), np.full((n, 3), -1, np.int64)
    front = (state, after, before, home, choice, np.zeros(n, np.int64), np.full(size, -1, np.int64))
    faces, where, part = np.zeros((len(seeds), 3), np.int64), np.zeros((len(seeds), 2), np.int64), np.zeros(len(seeds), np.int64)
    count, n_parts = 0, 0
    largest = radii[seeds[-1] // 4, seeds[-1] % 4] if len(seeds) else 1.0
    for s in range(len(seeds)):
        t, f = seeds[s] // 4, seeds[s] % 4
        a, b, c = tets[t, FACETS[f, 0]], tets[t, FACETS[f, 1]], tets[t, FACETS[f, 2]]
        if state[a] != UNUSED or state[b] != UNUSED or state[c] != UNUSED:
            continue
        if not _faces_its_side(points, normals, a, b, c):
            a, c = c, a
            if not _faces_its_side(points, normals, a, b, c):
                continue
        queue = [(0.0, 0, 0, 0)]
        queue.pop()
        if not _plant(a, b, c, t, f, graph, front, largest, queue):
            continue
        begin = count
        count = _enter(a, b, c, t, f, front[6], n, faces, where, count)
        count = _grow(queue, graph, front, largest, faces, where, count)
        part[begin:count] = n_parts
        n_parts += 1
    return faces[:count].copy(), where[:count].copy(), part[:count].copy()
