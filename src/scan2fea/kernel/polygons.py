"""Triangles for a flat polygon with holes, over its own corners and no others: ears cut off, best shape first."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray

FLAT = 1e-9  # of the squares of an ear's edges: a smaller area is none
BRIDGES = 400  # candidates tried to join a hole to its surroundings, nearest first


def signed_area(loop: FloatArray) -> float:
    """Area of a closed (n, 2) loop, positive counter-clockwise."""
    x, y = (loop - loop.mean(0)).T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def _crosses(p: FloatArray, q: FloatArray, a: FloatArray, b: FloatArray) -> bool:
    """Does the open segment pq meet any of the segments ab (n, 2) that do not start or end in p or q?"""

    def side(o: FloatArray, e: FloatArray, x: FloatArray) -> FloatArray:
        return np.asarray((e[..., 0] - o[..., 0]) * (x[..., 1] - o[..., 1]) - (e[..., 1] - o[..., 1]) * (x[..., 0] - o[..., 0]))

    ends = ((a == p) | (a == q)).all(1) | ((b == p) | (b == q)).all(1) | (a == p).all(1) | (a == q).all(1) | (b == p).all(1) | (b == q).all(1)
    a, b = a[~ends], b[~ends]
    return bool(((side(p, q, a) * side(p, q, b) <= 0) & (side(a, b, p) * side(a, b, q) <= 0)).any())


def _looks_inside(ring: FloatArray, i: int, towards: FloatArray) -> bool:
    """Does the ray from corner i of a ring (inside on its left) to `towards` start inside?"""
    before, at, after = ring[i - 1], ring[i], ring[(i + 1) % len(ring)]
    turn = _cross(at - before, after - at)
    left_of_first, left_of_second = _cross(at - before, towards - at) > 0, _cross(after - at, towards - at) > 0
    return bool((left_of_first and left_of_second) if turn > 0 else (left_of_first or left_of_second))


def _cross(u: FloatArray, v: FloatArray) -> float:
    return float(u[0] * v[1] - u[1] * v[0])


def _joined(outer: IntArray, hole: IntArray, others: list[IntArray], xy: FloatArray) -> IntArray | None:
    """One ring of the outer ring and the hole, over a bridge that crosses nothing."""
    gap = ((xy[outer][:, None] - xy[hole][None]) ** 2).sum(2)
    order = np.argsort(gap, axis=None, kind="stable")[:BRIDGES]
    rings = [outer, hole, *others]
    a = np.concatenate([xy[ring] for ring in rings])
    b = np.concatenate([np.roll(xy[ring], -1, axis=0) for ring in rings])
    for i, j in zip(*np.unravel_index(order, gap.shape), strict=True):
        p, q = xy[outer[i]], xy[hole[j]]
        if _looks_inside(xy[outer], int(i), q) and _looks_inside(xy[hole], int(j), p) and not _crosses(p, q, a, b):
            return np.concatenate([outer[: i + 1], hole[j:], hole[: j + 1], outer[i:]])
    return None


@jit
def _ear(x: FloatArray, y: FloatArray, before: IntArray, after: IntArray, i: int) -> float:
    """Shape of the ear at ring place i, -1 where it is none."""
    a, c = before[i], after[i]
    ux, uy, vx, vy = x[i] - x[a], y[i] - y[a], x[c] - x[a], y[c] - y[a]
    doubled = ux * vy - uy * vx
    squares = ux * ux + uy * uy + vx * vx + vy * vy + (x[c] - x[i]) ** 2 + (y[c] - y[i]) ** 2
    if doubled <= FLAT * squares:
        return -1.0
    k = after[c]
    while k != a:
        px, py = x[k], y[k]
        at_corner = (px == x[a] and py == y[a]) or (px == x[i] and py == y[i]) or (px == x[c] and py == y[c])
        if not at_corner:
            s1 = (x[i] - x[a]) * (py - y[a]) - (y[i] - y[a]) * (px - x[a])
            s2 = (x[c] - x[i]) * (py - y[i]) - (y[c] - y[i]) * (px - x[i])
            s3 = (x[a] - x[c]) * (py - y[c]) - (y[a] - y[c]) * (px - x[c])
            # a corner on the diagonal blocks the ear, rounding or not: cutting it would leave a piece without area
            if s1 >= -FLAT * squares and s2 >= -FLAT * squares and s3 >= -FLAT * squares:
                return -1.0
        k = after[k]
    return float(2 * np.sqrt(3.0) * doubled / squares)


@jit
def _clipped(x: FloatArray, y: FloatArray) -> IntArray:
    """(n - 2, 3) places of the triangles of a ring, or fewer where no ear is left."""
    n = len(x)
    before = (np.arange(n) - 1) % n
    after = (np.arange(n) + 1) % n
    shape = np.array([_ear(x, y, before, after, i) for i in range(n)])
    out = np.zeros((max(n - 2, 0), 3), np.int64)
    for count in range(n - 2):
        best = np.argmax(shape)
        if shape[best] <= 0:
            return out[:count]
        a, c = before[best], after[best]
        out[count, 0] = a
        out[count, 1] = best
        out[count, 2] = c
        after[a] = c
        before[c] = a
        shape[best] = -2.0
        if count < n - 3:
            shape[a] = _ear(x, y, before, after, a)
            shape[c] = _ear(x, y, before, after, c)
    return out


def triangulated(loops: list[IntArray], xy: FloatArray) -> IntArray | None:
    """(k, 3) counter-clockwise triangles over rows of `xy` that fill the region inside the loops; None where the loops bound none.

    loops : rows of `xy` (n, 2), the region on their left: one outer loop counter-clockwise, holes clockwise.
    """
    if any(len(loop) < 3 for loop in loops):
        return None
    areas = [signed_area(xy[loop]) for loop in loops]
    outside = [k for k, value in enumerate(areas) if value > 0]
    if len(outside) != 1:
        return None
    ring = loops[outside[0]]
    # holes with the rightmost corner farthest out first keeps bridges short; any order is right
    holes = sorted((k for k in range(len(loops)) if k != outside[0]), key=lambda k: -float(xy[loops[k]][:, 0].max()))
    for place, k in enumerate(holes):
        joined = _joined(ring, loops[k], [loops[other] for other in holes[place + 1 :]], xy)
        if joined is None:
            return None
        ring = joined
    places = _clipped(np.ascontiguousarray(xy[ring, 0]), np.ascontiguousarray(xy[ring, 1]))
    if len(places) != len(ring) - 2:
        return None
    triangles = ring[places]
    u, v = xy[triangles[:, 1]] - xy[triangles[:, 0]], xy[triangles[:, 2]] - xy[triangles[:, 0]]
    filled, wanted = float((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum() / 2), sum(areas)
    return triangles if abs(filled - wanted) <= 1e-6 * abs(wanted) else None


@jit
def _crossings(a: FloatArray, b: FloatArray, found: BoolArray) -> None:
    """Marks the segments ab (n, 2) that cross another one they share no end with; `found` is written."""
    n = len(a)
    for i in range(n):
        lx, hx = min(a[i, 0], b[i, 0]), max(a[i, 0], b[i, 0])
        ly, hy = min(a[i, 1], b[i, 1]), max(a[i, 1], b[i, 1])
        for j in range(i + 1, n):
            if min(a[j, 0], b[j, 0]) > hx or max(a[j, 0], b[j, 0]) < lx or min(a[j, 1], b[j, 1]) > hy or max(a[j, 1], b[j, 1]) < ly:
                continue
            s1 = (b[i, 0] - a[i, 0]) * (a[j, 1] - a[i, 1]) - (b[i, 1] - a[i, 1]) * (a[j, 0] - a[i, 0])
            s2 = (b[i, 0] - a[i, 0]) * (b[j, 1] - a[i, 1]) - (b[i, 1] - a[i, 1]) * (b[j, 0] - a[i, 0])
            s3 = (b[j, 0] - a[j, 0]) * (a[i, 1] - a[j, 1]) - (b[j, 1] - a[j, 1]) * (a[i, 0] - a[j, 0])
            s4 = (b[j, 0] - a[j, 0]) * (b[i, 1] - a[j, 1]) - (b[j, 1] - a[j, 1]) * (b[i, 0] - a[j, 0])
            if ((s1 > 0) != (s2 > 0)) and ((s3 > 0) != (s4 > 0)) and s1 != 0 and s2 != 0 and s3 != 0 and s4 != 0:
                found[i] = True
                found[j] = True


def crossing_corners(loops: list[IntArray], xy: FloatArray) -> IntArray:
    """Rows of `xy` at the ends of the segments of the loops that cross one another."""
    start = np.concatenate(loops)
    end = np.concatenate([np.roll(loop, -1) for loop in loops])
    found = np.zeros(len(start), np.bool_)
    _crossings(np.ascontiguousarray(xy[start]), np.ascontiguousarray(xy[end]), found)
    return np.unique(np.concatenate([start[found], end[found]]))
