"""The front itself: which vertices and edges are on it, and what gluing a triangle on does to it (compiled).

A front edge u -> v runs as the NEXT triangle on it will. The surface stays a manifold at every step, so that a vertex of the front has one edge
in and one out: `after` and `before` are the front.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import IntArray

Front = tuple[IntArray, IntArray, IntArray, IntArray, IntArray, IntArray, IntArray]
# state, after, before : (n,) of each vertex; home : (n, 3) tet, facet and apex of the triangle behind the edge that leaves it; choice : (n, 3)
# corner, tet and facet of the best next one; stamp : (n,) counts the edges that left it; used : table of the edges of all triangles
UNUSED, ON_FRONT, INNER = 0, 1, 2


@jit
def empty_front(n: int) -> Front:
    size = 16
    while size < 8 * n:
        size *= 2
    state, after, before, stamp = np.zeros(n, np.int64), np.full(n, -1, np.int64), np.full(n, -1, np.int64), np.zeros(n, np.int64)
    return state, after, before, np.zeros((n, 3), np.int64), np.full((n, 3), -1, np.int64), stamp, np.full(size, -1, np.int64)


@jit
def slot(a: int, b: int, keys: IntArray, n: int) -> int:
    """Row of the open-addressing table that holds the undirected edge, or the empty one where it would go."""
    key = min(a, b) * n + max(a, b)
    mask = len(keys) - 1
    row = key * 0x9E3779B97F4A7C1
    row = (row ^ (row >> 29)) & mask
    while keys[row] >= 0 and keys[row] != key:
        row = (row + 1) & mask
    return row


@jit
def is_free(a: int, b: int, after: IntArray, used: IntArray) -> bool:
    """May a triangle run from a to b? Yes along a front edge, and along an edge that no triangle has yet."""
    return bool(after[a] == b or used[slot(a, b, used, len(after))] < 0)


@jit
def partner_at(u: int, v: int, x: int, after: IntArray, before: IntArray, choice: IntArray, used: IntArray) -> int:
    """Where triangle (u, v, x) touches the front at x alone: 1 if the edge into x wants v next, 2 if the edge out of x wants u, else 0.

    With such a partner glued on as well the surface stays a manifold at x.
    """
    y, z = before[x], after[x]
    if choice[y, 0] == v and y != v and is_free(v, y, after, used):
        return 1
    if choice[x, 0] == u and z != u and is_free(z, u, after, used):
        return 2
    return 0


@jit
def enter(
    a: int, b: int, c: int, t: int, f: int, used: IntArray, n: int, faces: IntArray, where: IntArray, count: int
) -> int:  # fmt: skip
    """Write triangle (a, b, c), facet f of tet t, and its three edges; returns the new count of faces."""
    used[slot(a, b, used, n)] = min(a, b) * n + max(a, b)
    used[slot(b, c, used, n)] = min(b, c) * n + max(b, c)
    used[slot(c, a, used, n)] = min(c, a) * n + max(c, a)
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
def glue(
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
def glue_two(
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
