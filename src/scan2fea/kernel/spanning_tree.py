"""The Euclidean minimum spanning tree of a cloud: what single linkage is made of (Gower and Ross 1969), without all pairs.

Boruvka's rounds (1926): in each round every part finds the shortest edge that leaves it. The nearest few of each point serve most of them; a point
that that has all of these in its own part asks a tree of boxes (Bentley 1975), with the others of its leaf. A box that lies wholly in that part, or
farther than what the part already has, is passed over; the distance that a point found, or did not beat, stays a lower bound in later rounds, as
the points outside its part only become fewer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.near_tree import NearTree, near_tree, nearest_of_leaves
from scan2fea.kernel.union_find import join, root
from scan2fea.types import BoolArray, FloatArray, IntArray

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
def _squared(points: FloatArray, p: int, q: int) -> float:
    return float((points[p, 0] - points[q, 0]) ** 2 + (points[p, 1] - points[q, 1]) ** 2 + (points[p, 2] - points[q, 2]) ** 2)


@jit
def _box_gap(box: FloatArray, boxes: FloatArray, node: int) -> float:
    """Squared distance of two boxes."""
    total = 0.0
    for axis in range(3):
        away = max(boxes[node, axis] - box[3 + axis], box[axis] - boxes[node, 3 + axis], 0.0)
        total += away * away
    return total


@jit
def _outside_together(
    points: FloatArray,
    asking: IntArray,
    bound: float,
    part: IntArray,
    of_node: IntArray,
    boxes: FloatArray,
    levels: int,
    nodes: IntArray,
    gaps: FloatArray,
) -> tuple[int, int, float]:
    """Ends and square of the shortest edge from one of the asking points (m,) to another part than theirs; -1, -1 where none is below `bound`."""
    n, own, leaf0 = len(points), part[asking[0]], (1 << levels) - 1
    box, p, q = np.empty(6), -1, -1
    for axis in range(3):
        box[axis], box[3 + axis] = np.inf, -np.inf
        for i in range(len(asking)):
            box[axis] = min(box[axis], points[asking[i], axis])
            box[3 + axis] = max(box[3 + axis], points[asking[i], axis])
    nodes[0], gaps[0], top = 0, 0.0, 1
    while top > 0:
        top -= 1
        node = nodes[top]
        if gaps[top] >= bound or of_node[node] == own:
            continue
        if node >= leaf0:
            for other in range((n * (node - leaf0)) >> levels, (n * (node - leaf0 + 1)) >> levels):
                if part[other] != own:
                    for i in range(len(asking)):
                        d = _squared(points, asking[i], other)
                        if d < bound:
                            p, q, bound = asking[i], other, d
            continue
        near, far = 2 * node + 1, 2 * node + 2
        one, two = _box_gap(box, boxes, near), _box_gap(box, boxes, far)
        if two < one:
            near, far, one, two = far, near, two, one
        nodes[top], gaps[top] = far, two
        nodes[top + 1], gaps[top + 1] = near, one
        top += 2
    return p, q, bound


@jit
def _parts_of_nodes(part: IntArray, n_nodes: int, levels: int) -> IntArray:
    """The part that all points of each node belong to, -1 where there are several."""
    n, leaf0, of_node = len(part), (1 << levels) - 1, np.full(n_nodes, -1)
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
    return of_node


@jit
def _offer(best: FloatArray, one: IntArray, two: IntArray, part: int, d: float, p: int, q: int) -> None:
    """The edge from p, of that part, to q, if it is shorter (squared) than what the part has."""
    if d < best[part]:
        best[part], one[part], two[part] = d, p, q


@jit
def _ask_near(
    points: FloatArray, near: IntArray, next_near: IntArray, lower: FloatArray, part: IntArray, best: FloatArray, one: IntArray, two: IntArray
) -> None:
    """Offer to each part the edges to the nearest few neighbours: what they give bounds the walks of those that have none left."""
    few = near.shape[1]
    for p in range(len(points)):
        own = part[p]
        if lower[p] >= best[own]:
            continue
        while next_near[p] < few and part[near[p, next_near[p]]] == own:
            next_near[p] += 1
        if next_near[p] < few:
            q = near[p, next_near[p]]
            lower[p] = _squared(points, p, q)
            _offer(best, one, two, own, lower[p], p, q)
            _offer(best, one, two, part[q], lower[p], q, p)


@jit
def _ask_far(
    points: FloatArray,
    boxes: FloatArray,
    levels: int,
    asks: BoolArray,
    lower: FloatArray,
    part: IntArray,
    best: FloatArray,
    one: IntArray,
    two: IntArray,
) -> None:
    """Offer to each part the shortest edges of the points that ask (n,) and could shorten what it has; those of one leaf and part at once."""
    n, of_node = len(points), _parts_of_nodes(part, len(boxes), levels)
    nodes, gaps = np.zeros(levels + 2, np.int64), np.zeros(levels + 2)
    asking = np.zeros((n >> levels) + 2, np.int64)
    for leaf in range(1 << levels):
        m, last = 0, (n * (leaf + 1)) >> levels
        for p in range((n * leaf) >> levels, last):
            own = part[p]
            if asks[p] and lower[p] < best[own]:
                asking[m] = p
                m += 1
            if m > 0 and (p == last - 1 or part[p + 1] != part[asking[0]]):
                own = part[asking[0]]
                q, r, d = _outside_together(points, asking[:m], best[own], part, of_node, boxes, levels, nodes, gaps)
                lower[asking[:m]] = d
                if r >= 0:
                    _offer(best, one, two, own, d, q, r)
                    _offer(best, one, two, part[r], d, r, q)
                m = 0


@jit
def _boruvka(points: FloatArray, boxes: FloatArray, levels: int, far: FloatArray, near: IntArray) -> tuple[IntArray, FloatArray]:
    n, few = near.shape
    parent, part, lower, next_near = np.arange(n), np.arange(n), np.zeros(n), np.zeros(n, np.int64)
    edges, squared = np.zeros((n - 1, 2), np.int64), np.zeros(n - 1)
    best, one, two, asks = np.zeros(n), np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n, np.bool_)
    count = 0
    while count < n - 1:
        best[:] = np.inf
        _ask_near(points, near, next_near, lower, part, best, one, two)
        for p in range(n):
            if next_near[p] == few and not asks[p]:
                asks[p] = True
                lower[p] = max(lower[p], far[p, few - 1] ** 2 * (1.0 - 1e-14))  # no shorter edge leaves p, whatever the root has rounded
        _ask_far(points, boxes, levels, asks, lower, part, best, one, two)
        for c in range(n):
            if part[c] == c and best[c] < np.inf and join(parent, c, part[two[c]]):
                edges[count, 0], edges[count, 1], squared[count] = one[c], two[c], best[c]
                count += 1
        for p in range(n):
            part[p] = root(parent, p)
    return edges, squared
