"""The Euclidean minimum spanning tree of a cloud: what single linkage is made of (Gower and Ross 1969), without all pairs.

Boruvka's rounds (1926): in each round every part finds the shortest edge that leaves it. The nearest few of each point serve most of them; a point
that has all of these in its own part asks a tree of boxes (Bentley 1975). A box that lies wholly in that part, or farther than what the part already
has, is passed over; the distance that a point found, or did not beat, stays a lower bound in later rounds, as the points outside its part only
become fewer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.near_tree import NearTree, near_tree, nearest_of_leaves
from scan2fea.kernel.union_find import join, root
from scan2fea.types import FloatArray, IntArray

_FEW = 8  # neighbours of each point that are looked at before the tree is asked


def spanning_tree(points: FloatArray, tree: NearTree | None = None) -> tuple[IntArray, FloatArray]:
    """Edges (n - 1, 2) of the shortest tree over points (n, 3) and their lengths (n - 1,), shortest first, ties by their rows.

    tree : of the points, where one is there already.
    Raises InternalError for points that are not finite.
    """
    require(np.isfinite(points).all(), InternalError, "spanning_tree needs finite points")
    n = len(points)
    if n < 2:
        return np.zeros((0, 2), np.int64), np.zeros(0)
    tree = tree or near_tree(points)
    placed = replace(tree, order=np.arange(n))  # rows below count in the order of the leaves
    _, far, near = nearest_of_leaves(placed, placed, min(_FEW + 1, n), 0, placed.n_leaves)
    edges, squared = _boruvka(tree.xyz, tree.boxes, tree.levels, far, near)
    rows = np.sort(tree.order[edges], axis=1)
    length = np.sqrt(squared)
    ranked = np.argsort(length)
    same = np.diff(length[ranked]) == 0
    places = np.flatnonzero(np.append(same, False) | np.append(False, same))
    tied = ranked[places]
    ranked[places] = tied[np.lexsort((rows[tied, 1], rows[tied, 0], length[tied]))]
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
def _gap(points: FloatArray, p: int, boxes: FloatArray, node: int) -> float:
    """Squared distance from a point to a box."""
    total = 0.0
    for axis in range(3):
        away = max(boxes[node, axis] - points[p, axis], points[p, axis] - boxes[node, 3 + axis], 0.0)
        total += away * away
    return total


@jit
def _squared(points: FloatArray, p: int, q: int) -> float:
    return float((points[p, 0] - points[q, 0]) ** 2 + (points[p, 1] - points[q, 1]) ** 2 + (points[p, 2] - points[q, 2]) ** 2)


@jit
def _nearest_outside(
    points: FloatArray, p: int, bound: float, part: IntArray, of_node: IntArray, boxes: FloatArray, levels: int, nodes: IntArray, gaps: FloatArray
) -> tuple[int, float]:
    """The nearest point of another part that is nearer than `bound` (squared), or -1; nodes, gaps: room for the walk."""
    n, own, found, leaf0 = len(points), part[p], -1, (1 << levels) - 1
    nodes[0], gaps[0], top = 0, 0.0, 1
    while top > 0:
        top -= 1
        node = nodes[top]
        if gaps[top] >= bound or of_node[node] == own:
            continue
        if node >= leaf0:
            for q in range((n * (node - leaf0)) >> levels, (n * (node - leaf0 + 1)) >> levels):
                if part[q] != own:
                    d = _squared(points, p, q)
                    if d < bound:
                        bound, found = d, q
            continue
        near, far = 2 * node + 1, 2 * node + 2
        one, two = _gap(points, p, boxes, near), _gap(points, p, boxes, far)
        if two < one:
            near, far, one, two = far, near, two, one
        nodes[top], gaps[top] = far, two
        nodes[top + 1], gaps[top + 1] = near, one
        top += 2
    return found, bound


@jit
def _mark(part: IntArray, of_node: IntArray, levels: int) -> None:
    """The part that all points of each node belong to, -1 where there are several."""
    n, leaf0 = len(part), (1 << levels) - 1
    for leaf in range(leaf0 + 1):
        first, stop = (n * leaf) >> levels, (n * (leaf + 1)) >> levels
        of_node[leaf0 + leaf] = part[first]
        for q in range(first + 1, stop):
            if part[q] != part[first]:
                of_node[leaf0 + leaf] = -1
                break
    for node in range(leaf0 - 1, -1, -1):
        a, b = of_node[2 * node + 1], of_node[2 * node + 2]
        of_node[node] = a if a == b else -1


@jit
def _boruvka(points: FloatArray, boxes: FloatArray, levels: int, far: FloatArray, near: IntArray) -> tuple[IntArray, FloatArray]:
    n, few = near.shape
    parent, part, lower, next_near = np.arange(n), np.arange(n), np.zeros(n), np.zeros(n, np.int64)
    of_node = np.full(len(boxes), -1)
    nodes, gaps = np.zeros(levels + 2, np.int64), np.zeros(levels + 2)
    edges, squared = np.zeros((n - 1, 2), np.int64), np.zeros(n - 1)
    best, one, two = np.zeros(n), np.zeros(n, np.int64), np.zeros(n, np.int64)
    count = 0
    while count < n - 1:
        _mark(part, of_node, levels)
        best[:] = np.inf
        for p in range(n):
            own = part[p]
            if lower[p] >= best[own]:
                continue
            while next_near[p] < few and part[near[p, next_near[p]]] == own:
                next_near[p] += 1
            if next_near[p] < few:
                q = near[p, next_near[p]]
                d = _squared(points, p, q)
            else:
                q, d = -1, far[p, few - 1] ** 2 * (1.0 - 1e-14)  # no shorter edge leaves p, whatever the root has rounded
                if d < best[own]:
                    q, d = _nearest_outside(points, p, best[own], part, of_node, boxes, levels, nodes, gaps)
            lower[p] = d
            if q >= 0 and d < best[own]:
                best[own], one[own], two[own] = d, p, q
            if q >= 0 and d < best[part[q]]:
                best[part[q]], one[part[q]], two[part[q]] = d, q, p
        for c in range(n):
            if part[c] == c and best[c] < np.inf and join(parent, c, part[two[c]]):
                edges[count, 0], edges[count, 1], squared[count] = one[c], two[c], best[c]
                count += 1
        for p in range(n):
            part[p] = root(parent, p)
    return edges, squared
