"""The Euclidean minimum spanning tree of a cloud: what single linkage is made of (Gower and Ross 1969), without all pairs.

Boruvka's rounds (1926) over a tree of boxes (Bentley 1975): in each round every part finds the shortest edge that leaves it. A box that lies wholly
in the part of the point that asks, or farther than what the part already has, is passed over; the distance that a point found, or did not beat, stays
a lower bound in later rounds, as the points outside its part only become fewer.
"""

from __future__ import annotations

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.union_find import join, root
from scan2fea.types import FloatArray, IntArray

_LEAF = 12


def spanning_tree(points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Edges (n - 1, 2) of the shortest tree over points (n, 3) and their lengths (n - 1,), shortest first, ties by their rows.

    Raises InternalError for points that are not finite.
    """
    require(np.isfinite(points).all(), InternalError, "spanning_tree needs finite points")
    n = len(points)
    if n < 2:
        return np.zeros((0, 2), np.int64), np.zeros(0)
    xyz = np.ascontiguousarray(points, float)
    order, start, stop, left, box = _boxes(xyz)
    edges, squared = _boruvka(np.ascontiguousarray(xyz[order]), start, stop, left, box)
    rows = np.sort(order[edges], axis=1)
    length = np.sqrt(squared)
    ranked = np.lexsort((rows[:, 1], rows[:, 0], length))
    return rows[ranked], length[ranked]


def tree_parts(edges: IntArray, n: int) -> IntArray:
    """(n,) parts that edges (m, 2) join, numbered from 0 in the order in which their first point comes."""
    return _parts(np.ascontiguousarray(edges, np.int64), n)


@jit
def _parts(edges: IntArray, n: int) -> IntArray:
    parent = np.arange(n)
    for e in range(len(edges)):
        join(parent, edges[e, 0], edges[e, 1])
    number, labels = np.full(n, -1, np.int64), np.zeros(n, np.int64)
    found = 0
    for p in range(n):
        r = root(parent, p)
        if number[r] < 0:
            number[r] = found
            found += 1
        labels[p] = number[r]
    return labels


@jit
def _halve(points: FloatArray, order: IntArray, low: int, high: int, axis: int) -> None:
    """Reorder order[low:high] so that its middle row has the rank it would have if sorted along the axis (Hoare's selection)."""
    middle = (low + high) // 2
    first, last = low, high - 1
    while first < last:
        pivot = points[order[(first + last) // 2], axis]
        i, j = first, last
        while i <= j:
            while points[order[i], axis] < pivot:
                i += 1
            while points[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            last = j
        elif middle >= i:
            first = i
        else:
            break


@jit
def _boxes(points: FloatArray) -> tuple[IntArray, IntArray, IntArray, IntArray, FloatArray]:
    """Points in order of the tree; start, stop and first child (-1: a leaf; the second follows it) of each node; its box (nodes, 2, 3)."""
    n = len(points)
    size = 4 * (n // _LEAF + 1) + 8
    order = np.arange(n)
    start, stop, left = np.zeros(size, np.int64), np.zeros(size, np.int64), np.full(size, -1, np.int64)
    box = np.zeros((size, 2, 3))
    stop[0] = n
    count, node = 1, 0
    while node < count:
        a, b = start[node], stop[node]
        for axis in range(3):
            lowest, highest = np.inf, -np.inf
            for i in range(a, b):
                value = points[order[i], axis]
                lowest, highest = min(lowest, value), max(highest, value)
            box[node, 0, axis], box[node, 1, axis] = lowest, highest
        if b - a > _LEAF:
            axis = int(np.argmax(box[node, 1] - box[node, 0]))
            _halve(points, order, a, b, axis)
            middle = (a + b) // 2
            left[node] = count
            start[count], stop[count] = a, middle
            start[count + 1], stop[count + 1] = middle, b
            count += 2
        node += 1
    return order, start[:count], stop[:count], left[:count], box[:count]


@jit
def _gap(points: FloatArray, p: int, box: FloatArray) -> float:
    """Squared distance from a point to a box."""
    total = 0.0
    for axis in range(3):
        value = points[p, axis]
        away = max(box[0, axis] - value, value - box[1, axis], 0.0)
        total += away * away
    return total


@jit
def _nearest_outside(
    points: FloatArray, p: int, bound: float, part: IntArray, of_node: IntArray, start: IntArray, stop: IntArray, left: IntArray, box: FloatArray,
    nodes: IntArray, gaps: FloatArray
) -> tuple[int, float]:  # fmt: skip
    """The nearest point of another part that is nearer than `bound` (squared), or -1; nodes, gaps: room for the walk."""
    own, found = part[p], -1
    nodes[0], gaps[0], top = 0, 0.0, 1
    while top > 0:
        top -= 1
        node = nodes[top]
        if gaps[top] >= bound or of_node[node] == own:
            continue
        child = left[node]
        if child < 0:
            for q in range(start[node], stop[node]):
                if part[q] != own:
                    d = (points[p, 0] - points[q, 0]) ** 2 + (points[p, 1] - points[q, 1]) ** 2 + (points[p, 2] - points[q, 2]) ** 2
                    if d < bound:
                        bound, found = d, q
            continue
        one, two = _gap(points, p, box[child]), _gap(points, p, box[child + 1])
        near, far = (child, child + 1) if one <= two else (child + 1, child)
        nodes[top], gaps[top] = far, max(one, two)
        nodes[top + 1], gaps[top + 1] = near, min(one, two)
        top += 2
    return found, bound


@jit
def _mark(part: IntArray, of_node: IntArray, start: IntArray, stop: IntArray, left: IntArray) -> None:
    """The part that all points of each node belong to, -1 where there are several. Children come after their parents."""
    for node in range(len(start) - 1, -1, -1):
        if left[node] >= 0:
            a, b = of_node[left[node]], of_node[left[node] + 1]
            of_node[node] = a if a == b else -1
        else:
            of_node[node] = part[start[node]]
            for q in range(start[node] + 1, stop[node]):
                if part[q] != part[start[node]]:
                    of_node[node] = -1


@jit
def _boruvka(points: FloatArray, start: IntArray, stop: IntArray, left: IntArray, box: FloatArray) -> tuple[IntArray, FloatArray]:
    n = len(points)
    parent, part, lower = np.arange(n), np.arange(n), np.zeros(n)
    of_node = np.full(len(start), -1, np.int64)
    nodes, gaps = np.zeros(256, np.int64), np.zeros(256)
    edges, squared = np.zeros((n - 1, 2), np.int64), np.zeros(n - 1)
    best, one, two = np.zeros(n), np.zeros(n, np.int64), np.zeros(n, np.int64)
    count = 0
    while count < n - 1:
        _mark(part, of_node, start, stop, left)
        best[:] = np.inf
        for p in range(n):
            own = part[p]
            if lower[p] >= best[own]:
                continue
            q, d = _nearest_outside(points, p, best[own], part, of_node, start, stop, left, box, nodes, gaps)
            lower[p] = d
            if q >= 0:
                best[own], one[own], two[own] = d, p, q
                other = part[q]
                if d < best[other]:
                    best[other], one[other], two[other] = d, q, p
        for c in range(n):
            if part[c] == c and best[c] < np.inf and join(parent, c, part[two[c]]):
                edges[count, 0], edges[count, 1], squared[count] = one[c], two[c], best[c]
                count += 1
        for p in range(n):
            part[p] = root(parent, p)
    return edges, squared
