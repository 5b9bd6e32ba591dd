"""Fronts that grow over Delaunay facets until no edge has a next triangle (compiled): by plausibility, or by balls of growing radius."""

from __future__ import annotations

import heapq

import numpy as np

from scan2fea.kernel.delaunay import FACETS
from scan2fea.kernel.jit import jit
from scan2fea.reconstruction.front_candidates import OUTSIDE_WEDGE, Graph, faces_its_side, next_triangle, rests
from scan2fea.reconstruction.front_state import INNER, ON_FRONT, UNUSED, Front, empty_front, enter, glue, glue_two, is_free, partner_at
from scan2fea.types import FloatArray, IntArray

STANDBY = 10.0  # added to the key of an edge that waits for a partner: more than any key


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
        key = next_triangle(graph, front, p, largest)
        smooth = smooth and (key < OUTSIDE_WEDGE or graph[8] > 0.0)
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
        if x < 0 or state[x] == INNER or not (is_free(v, x, after, used) and is_free(x, u, after, used)):
            again = next_triangle(graph, front, u, largest)
            if again < np.inf:
                heapq.heappush(queue, (again, mark, u, v))
            continue
        if state[x] == ON_FRONT and after[v] != x and after[x] != u:
            partner = partner_at(u, v, x, after, before, choice, used)
            if partner == 0:
                if key < STANDBY:
                    heapq.heappush(queue, (STANDBY + key, mark, u, v))
                continue
            behind = before[x] if partner == 1 else x
            g, h = choice[behind, 1], choice[behind, 2]
            n_fresh = glue_two(u, v, x, t, f, partner, other, g, h, state, after, before, home, fresh)
            count = enter(other[0], other[1], other[2], g, h, used, len(state), faces, where, count)
        else:
            n_fresh = glue(u, v, x, t, f, state, after, before, home, fresh)
        count = enter(u, v, x, t, f, used, len(state), faces, where, count)
        for k in range(n_fresh):
            p = fresh[k]
            stamp[p] += 1
            key = next_triangle(graph, front, p, largest)
            if key < np.inf:
                heapq.heappush(queue, (key, stamp[p], p, after[p]))
    return count


@jit
def _sow(
    seeds: IntArray, queue: list[tuple[float, int, int, int]], graph: Graph, front: Front, largest: float, faces: IntArray, where: IntArray,
    count: int,
) -> int:  # fmt: skip
    """A piece grown from every seed whose corners are still unused; returns the new count of faces."""
    points, normals, tets, neighbors, centre = graph[0], graph[1], graph[2], graph[3], graph[4]
    state, used = front[0], front[6]
    ball, place = graph[8], np.zeros(3)
    for s in range(len(seeds)):
        t, f = seeds[s] // 4, seeds[s] % 4
        a, b, c = tets[t, FACETS[f, 0]], tets[t, FACETS[f, 1]], tets[t, FACETS[f, 2]]
        if state[a] != UNUSED or state[b] != UNUSED or state[c] != UNUSED:
            continue
        if not faces_its_side(points, normals, a, b, c):
            a, c = c, a
            if not faces_its_side(points, normals, a, b, c):
                continue
        if ball > 0.0 and not rests(points, centre, a, b, c, t, neighbors[t, f], ball, place):
            continue
        if not _plant(a, b, c, t, f, graph, front, largest, queue):
            queue.clear()
            continue
        count = enter(a, b, c, t, f, used, len(state), faces, where, count)
        count = _grow(queue, graph, front, largest, faces, where, count)
    return count


@jit
def advance(
    points: FloatArray, normals: FloatArray, tets: IntArray, neighbors: IntArray, centre: FloatArray, radii: FloatArray, seeds: IntArray, n: int,
    wedge: float, ratio: float,
) -> tuple[IntArray, IntArray]:  # fmt: skip
    """Triangles (k, 3) into the n points, coherently oriented in each piece, and the (k, 2) tet and facet of each.

    normals : (n, 3) outward, then a triangle must face the side its corners do; or (0, 3).   seeds : facets (4 tet + facet), smallest radius first.
    """
    graph = (points, normals, tets, neighbors, centre, radii, wedge, ratio, 0.0)
    front = empty_front(n)
    faces, where = np.zeros((len(seeds), 3), np.int64), np.zeros((len(seeds), 2), np.int64)
    largest = radii[seeds[-1] // 4, seeds[-1] % 4] if len(seeds) else 1.0
    queue = [(0.0, 0, 0, 0)]
    queue.pop()
    count = _sow(seeds, queue, graph, front, largest, faces, where, 0)
    return faces[:count].copy(), where[:count].copy()


@jit
def pivot(
    points: FloatArray, normals: FloatArray, tets: IntArray, neighbors: IntArray, centre: FloatArray, seeds: IntArray, n: int, balls: FloatArray
) -> tuple[IntArray, IntArray]:
    """Triangles (k, 3) that balls of growing radius rest on, and the (k, 2) tet and facet of each.

    normals : (n, 3) outward.   seeds : facets (4 tet + facet).   balls : radii, m, ascending; each goes on from the front that the one before left.
    """
    front = empty_front(n)
    faces, where = np.zeros((len(seeds), 3), np.int64), np.zeros((len(seeds), 2), np.int64)
    queue = [(0.0, 0, 0, 0)]
    queue.pop()
    count = 0
    after, stamp = front[1], front[5]
    for b in range(len(balls)):
        graph = (points, normals, tets, neighbors, centre, np.zeros((0, 4)), 0.0, 0.0, balls[b])
        for u in range(n):
            if after[u] >= 0 and next_triangle(graph, front, u, 1.0) < np.inf:
                stamp[u] += 1
                heapq.heappush(queue, (0.0, stamp[u], u, after[u]))
        count = _grow(queue, graph, front, 1.0, faces, where, count)
        count = _sow(seeds, queue, graph, front, 1.0, faces, where, count)
    return faces[:count].copy(), where[:count].copy()
