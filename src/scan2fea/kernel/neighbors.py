"""Nearest neighbours, and the parts of a cloud that hang together."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.near_tree import LEAF, NearTree, box_gap, near_tree, nearest_of_leaves
from scan2fea.kernel.union_find import join, root
from scan2fea.types import FloatArray, IntArray

_BLOCK = 200_000  # queries at once


def k_nearest(points: FloatArray, k: int, queries: FloatArray | None = None, tree: NearTree | None = None) -> tuple[FloatArray, IntArray]:
    """The k points nearest to each query, nearest first.

    points : (n, d).   queries : (m, d), or None for the points themselves; then each point finds itself first (distance 0), except
    that equal points may come in any order. In space (d = 3) those equally far come by row.   tree : of the points, where one is there already.

    Returns distances (m, j) and indices (m, j) into `points`, j = min(k, n). Raises InternalError if there is no point or k < 1.
    """
    require(len(points) > 0 and k >= 1, InternalError, f"k_nearest needs at least one point and k >= 1, got {len(points)} points, k = {k}")
    j = min(k, len(points))
    if points.shape[1] != 3:
        found = cKDTree(points).query(points if queries is None else queries, k=[*range(1, j + 1)], workers=1)
        return np.asarray(found[0], float), np.asarray(found[1], np.int64)
    m = len(points) if queries is None else len(queries)
    distance, near = np.zeros((m, j)), np.zeros((m, j), np.int64)
    for rows, far, which in nearest_in_blocks(points, j, queries, tree):
        distance[rows], near[rows] = far, which
    return distance, near


def nearest_in_blocks(
    points: FloatArray, k: int, queries: FloatArray | None = None, tree: NearTree | None = None
) -> Iterator[tuple[IntArray, FloatArray, IntArray]]:
    """As `k_nearest` in space, for k up to the number of points, some queries after the other: their rows, distances and indices of their nearest.

    Queries of one block lie together, and their lists alone are held: those of all points of a large cloud would take more than the cloud.
    """
    tree = tree or near_tree(points)
    asked = tree
    if queries is not None:
        if len(queries) == 0:
            return
        # a leaf of queries that lie far apart would be wide, and the walk shared no more
        asked = near_tree(queries, max(1, min(LEAF, LEAF * len(queries) // len(points))))
    step = max(1, asked.n_leaves * _BLOCK // len(asked.order))
    for first in range(0, asked.n_leaves, step):
        yield nearest_of_leaves(tree, asked, k, first, min(first + step, asked.n_leaves))


def radius_components(points: FloatArray, radius_m: float, tree: NearTree | None = None) -> IntArray:
    """Label the connected components of the graph that joins points whose distance is at most `radius_m`.

    points : (n, 3).   Returns labels (n,) int64 from 0, numbered in the order in which a component's first point comes. Near-linear
    in n: parts of the tree that hang together already are not looked into again.   tree : of the points, where one is there already.
    Raises InternalError unless the radius is positive and finite.
    """
    require(0 < radius_m < math.inf, InternalError, f"radius_components needs a positive radius, got {radius_m}")
    if len(points) == 0:
        return np.zeros(0, np.int64)
    tree = tree or near_tree(points)
    return _components(tree.order, tree.xyz, tree.boxes, tree.levels, float(radius_m))


@jit
def _components(order: IntArray, xyz: FloatArray, boxes: FloatArray, levels: int, radius: float) -> IntArray:
    n, leaf0, limit = len(xyz), (1 << levels) - 1, radius * radius
    parent = np.arange(n)
    one = np.full(len(boxes), -1)  # a point of each node whose points hang together, as far as known
    for leaf in range(leaf0 + 1):
        _join_leaves(xyz, parent, limit, (n * leaf) >> levels, (n * (leaf + 1)) >> levels, (n * leaf) >> levels, (n * (leaf + 1)) >> levels)
        one[leaf0 + leaf] = _one_root(parent, (n * leaf) >> levels, (n * (leaf + 1)) >> levels)
    for node in range(leaf0 - 1, -1, -1):
        one[node] = _same(parent, one[2 * node + 1], one[2 * node + 2])
    stack = np.empty(levels + 2, np.int64)
    for leaf in range(leaf0 + 1):
        a, b, own = (n * leaf) >> levels, (n * (leaf + 1)) >> levels, leaf0 + leaf
        stack[0], top = 0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if box_gap(boxes, own, boxes, node) > limit or _same(parent, one[own], one[node]) >= 0:
                continue
            if node < leaf0:
                stack[top], stack[top + 1] = 2 * node + 2, 2 * node + 1
                top += 2
            elif node > own:  # the pairs with earlier leaves are done
                other = node - leaf0
                _join_leaves(xyz, parent, limit, a, b, (n * other) >> levels, (n * (other + 1)) >> levels)
                one[own] = _one_root(parent, a, b)
        node = own
        while node > 0 and one[node] >= 0:
            node = (node - 1) // 2
            one[node] = _same(parent, one[2 * node + 1], one[2 * node + 2])
    return _numbered(parent, order)


@jit
def _join_leaves(xyz: FloatArray, parent: IntArray, limit: float, a: int, b: int, c: int, d: int) -> None:
    """Join the points a to b - 1 with those of c to d - 1 that are near enough."""
    for p in range(a, b):
        for q in range(max(c, p + 1), d):
            u, v, w = xyz[p, 0] - xyz[q, 0], xyz[p, 1] - xyz[q, 1], xyz[p, 2] - xyz[q, 2]
            if u * u + v * v + w * w <= limit and parent[p] != parent[q]:
                join(parent, p, q)


@jit
def _one_root(parent: IntArray, a: int, b: int) -> int:
    """The point a if the points a to b - 1 hang together, else -1."""
    first = root(parent, a)
    for p in range(a + 1, b):
        if root(parent, p) != first:
            return -1
    return a


@jit
def _same(parent: IntArray, p: int, q: int) -> int:
    """p if two points, neither of them -1, hang together, else -1."""
    return p if p >= 0 and q >= 0 and root(parent, p) == root(parent, q) else -1


@jit
def _numbered(parent: IntArray, order: IntArray) -> IntArray:
    """Labels from 0 in the order in which a component's first row comes; `parent` counts in `order`."""
    n = len(order)
    place, label_of_root, labels = np.empty(n, np.int64), np.full(n, -1), np.zeros(n, np.int64)
    for p in range(n):
        place[order[p]] = p
    n_labels = 0
    for row in range(n):
        r = root(parent, place[row])
        if label_of_root[r] < 0:
            label_of_root[r] = n_labels
            n_labels += 1
        labels[row] = label_of_root[r]
    return labels


@jit
def slot_of(i: np.int64, j: np.int64, k: np.int64, cells: IntArray, table: IntArray) -> np.int64:
    """Row of the open-addressing table that holds cell (i, j, k), or the empty row where it would go."""
    mask = len(table) - 1
    slot = (i * 73856093) ^ (j * 19349663) ^ (k * 83492791)
    slot = (slot ^ (slot >> 15)) & mask
    while True:
        c = table[slot]
        if c < 0 or (cells[c, 0] == i and cells[c, 1] == j and cells[c, 2] == k):
            return slot
        slot = (slot + 1) & mask


@jit
def sorted_into_cells(points: FloatArray, low: FloatArray, edge: float) -> tuple[IntArray, IntArray, IntArray, IntArray, IntArray]:
    """Cell of each point (n,), index triple of each cell, hash table, and the points in order of their cells with each cell's start."""
    n = len(points)
    size = 16
    while size < 2 * n:
        size *= 2
    table = np.full(size, -1, np.int64)
    cells = np.zeros((n, 3), np.int64)
    cell_of = np.zeros(n, np.int64)
    n_cells = 0
    for p in range(n):
        i = np.int64(math.floor((points[p, 0] - low[0]) / edge))
        j = np.int64(math.floor((points[p, 1] - low[1]) / edge))
        k = np.int64(math.floor((points[p, 2] - low[2]) / edge))
        slot = slot_of(i, j, k, cells, table)
        if table[slot] < 0:
            table[slot] = n_cells
            cells[n_cells, 0], cells[n_cells, 1], cells[n_cells, 2] = i, j, k
            n_cells += 1
        cell_of[p] = table[slot]
    start = np.zeros(n_cells + 1, np.int64)
    for p in range(n):
        start[cell_of[p] + 1] += 1
    for c in range(n_cells):
        start[c + 1] += start[c]
    order = np.zeros(n, np.int64)
    filled = start[:-1].copy()
    for p in range(n):
        order[filled[cell_of[p]]] = p
        filled[cell_of[p]] += 1
    return cell_of, cells[:n_cells], table, order, start
