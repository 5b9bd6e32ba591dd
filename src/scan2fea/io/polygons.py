"""Polygons of a mesh file to triangles."""

from __future__ import annotations

import numpy as np

from scan2fea.types import IntArray


def triangulated(corners: IntArray, counts: IntArray) -> IntArray:
    """(m, 3) triangles of polygons given one after the other; each is cut from its first corner, those under three corners are left out.

    corners : vertex numbers of all polygons in a row.   counts : (p,) corners of each.
    """
    start = np.cumsum(counts) - counts
    pieces = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), pieces)
    k = np.arange(len(polygon)) - np.repeat(np.cumsum(pieces) - pieces, pieces)  # number of the triangle within its polygon
    first = start[polygon]
    return np.stack([corners[first], corners[first + k + 1], corners[first + k + 2]], axis=1).astype(np.int64).reshape(-1, 3)
