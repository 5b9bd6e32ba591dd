"""A tree of boxes over triangles: the one search structure for nearest faces and for crossings.

A complete binary tree in the order of a Morton curve: node i has the children 2 i + 1 and 2 i + 2, the last 2^d nodes are leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.types import FloatArray, IntArray, Value

LEAF = 4  # triangles per leaf, about


@dataclass(frozen=True, eq=False, kw_only=True)
class FaceTree(Value):
    """corners : (m, 3, 3) in tree order.   face : (m,) number of each in the caller's order.   boxes : (k, 6) lower and upper corners.

    start : (leaves + 1,) first triangle of each leaf.
    """

    corners: FloatArray
    face: IntArray
    boxes: FloatArray
    start: IntArray


def _spread(x: IntArray) -> IntArray:
    """Each bit of 21 moved to every third place (Morton 1966)."""
    x = (x | x << 32) & 0x1F00000000FFFF
    x = (x | x << 16) & 0x1F0000FF0000FF
    x = (x | x << 8) & 0x100F00F00F00F00F
    x = (x | x << 4) & 0x10C30C30C30C30C3
    return (x | x << 2) & 0x1249249249249249


def morton_order(points: FloatArray) -> IntArray:
    """(n,) order of (n, 3) points along a Morton curve; ties in the given order."""
    low = points.min(0)
    side = float((points.max(0) - low).max()) or 1.0
    cell = np.minimum((points - low) / side * (1 << 21), (1 << 21) - 1).astype(np.int64)
    return np.argsort(_spread(cell[:, 0]) << 2 | _spread(cell[:, 1]) << 1 | _spread(cell[:, 2]), kind="stable").astype(np.int64)


def face_tree(corners: FloatArray) -> FaceTree:
    """The tree over (m, 3, 3) triangles, m > 0; degenerate triangles (segments, points) are fine."""
    order = morton_order((corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3)
    tri = np.ascontiguousarray(corners[order])
    depth = max(0, int(np.ceil(np.log2(max(len(tri) / LEAF, 1)))))
    leaves = 1 << depth
    start = len(tri) * np.arange(leaves + 1) // leaves
    a, b, c = tri[:, 0], tri[:, 1], tri[:, 2]  # a reduction over three corners would take ten times as long
    low = np.minimum.reduceat(np.minimum(np.minimum(a, b), c), start[:-1])
    high = np.maximum.reduceat(np.maximum(np.maximum(a, b), c), start[:-1])
    levels = [np.concatenate([low, high], axis=1)]
    while len(levels[0]) > 1:
        below = levels[0]
        levels.insert(0, np.concatenate([np.minimum(below[::2, :3], below[1::2, :3]), np.maximum(below[::2, 3:], below[1::2, 3:])], axis=1))
    return FaceTree(corners=tri, face=order, boxes=np.concatenate(levels), start=start.astype(np.int64))
