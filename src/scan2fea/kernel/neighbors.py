"""Nearest neighbours, and the parts of a cloud that hang together."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.union_find import join, root
from scan2fea.types import FloatArray, IntArray

# Cells of edge r/sqrt(3) have a diagonal of r: all points of one cell are joined untested. The hair below 1 keeps that true under
# rounding; two cells apart can still be nearer than r (gap 1 * r/sqrt(3)), three cannot (gap 2 * r/sqrt(3) > r).
_FEW, _LEAF = 8, 16
_DIAGONAL_CELL = (1.0 - 1e-9) / math.sqrt(3.0)


def k_nearest(points: FloatArray, k: int, queries: FloatArray | None = None) -> tuple[FloatArray, IntArray]:
    """The k points nearest to each query, nearest first.

    points : (n, 3).   queries : (m, 3), or None for the points themselves; then each point finds itself first (distance 0), except
    that equal points may come in any order.

    Returns distances (m, j) and indices (m, j) into `points`, j = min(k, n). Raises InternalError if there is no point or k < 1.
    """
    require(len(points) > 0 and k >= 1, InternalError, f"k_nearest needs at least one point and k >= 1, got {len(points)} points, k = {k}")
    j = min(k, len(points))
    many = queries is None or len(queries) * _FEW > len(points)
    tree = cKDTree(points, leafsize=_LEAF, balanced_tree=many, compact_nodes=many)  # for few queries the tree is half the work: a quick one will do
    found = tree.query(points if queries is None else queries, k=[*range(1, j + 1)], workers=1)
    return np.asarray(found[0], float), np.asarray(found[1], np.int64)


def radius_components(points: FloatArray, radius_m: float) -> IntArray:
    """Label the connected components of the graph that joins points whose distance is at most `radius_m`.

    points : (n, 3).   Returns labels (n,) int64 from 0, numbered in the order in which a component's first point comes. Near-linear
    in n: points sorted into cells that need no test inside, then cell against cell until the first pair is found.
    Raises InternalError unless the radius is positive and finite.
    """
    require(0 < radius_m < math.inf, InternalError, f"radius_components needs a positive radius, got {radius_m}")
    if len(points) == 0:
        return np.zeros(0, np.int64)
    xyz = np.ascontiguousarray(points, float)
    return _components(xyz, xyz.min(axis=0), float(radius_m), radius_m * _DIAGONAL_CELL, _half_neighbourhood())


def _half_neighbourhood() -> IntArray:
    """(62, 3) offsets to the cells up to two away, one of each opposite pair, nearest first: near cells join most, which saves the far tests."""
    grid = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    half = grid[63:]  # row 62 is (0, 0, 0); rows after it are the opposites of rows before it
    gap = (np.maximum(np.abs(half) - 1, 0) ** 2).sum(axis=1) * 100 + (half**2).sum(axis=1)
    return half[np.argsort(gap, kind="stable")].astype(np.int64)


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
def _touch(points: FloatArray, order: IntArray, a0: int, a1: int, b0: int, b1: int, radius: float) -> bool:
    """True if any point of one cell is within `radius` of any point of the other."""
    for a in range(a0, a1):
        p = order[a]
        for b in range(b0, b1):
            q = order[b]
            d = (points[p, 0] - points[q, 0]) ** 2 + (points[p, 1] - points[q, 1]) ** 2 + (points[p, 2] - points[q, 2]) ** 2
            if d <= radius * radius:
                return True
    return False


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


@jit
def _components(points: FloatArray, low: FloatArray, radius: float, edge: float, offsets: IntArray) -> IntArray:
    cell_of, cells, table, order, start = sorted_into_cells(points, low, edge)
    n_cells = len(cells)
    parent = np.arange(n_cells)
    for o in range(len(offsets)):
        for c in range(n_cells):
            other = table[slot_of(cells[c, 0] + offsets[o, 0], cells[c, 1] + offsets[o, 1], cells[c, 2] + offsets[o, 2], cells, table)]
            if other < 0:
                continue
            is_apart = root(parent, c) != root(parent, other)
            if is_apart and _touch(points, order, start[c], start[c + 1], start[other], start[other + 1], radius):
                join(parent, c, other)
    label_of_root = np.full(n_cells, -1, np.int64)
    labels = np.zeros(len(points), np.int64)
    n_labels = 0
    for p in range(len(points)):
        r = root(parent, cell_of[p])
        if label_of_root[r] < 0:
            label_of_root[r] = n_labels
            n_labels += 1
        labels[p] = label_of_root[r]
    return labels
