"""Fairing: the new vertices of a mesh placed so that the surface goes on with the slope it comes with."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from scan2fea.kernel.topology import edge_table, vertex_faces
from scan2fea.types import BoolArray, FloatArray, IntArray


def _rings(faces: IntArray, n: int, seed: IntArray, rings: int) -> IntArray:
    """Rows of the faces within `rings` rings of the seed vertices."""
    start, at = vertex_faces(faces, n)
    vertices = np.unique(seed)
    rows = np.zeros(0, np.int64)
    for _ in range(rings):
        count = start[vertices + 1] - start[vertices]
        first = np.repeat(start[vertices] - np.concatenate([[0], np.cumsum(count)[:-1]]), count)
        rows = np.unique(at[first + np.arange(int(count.sum()))])
        vertices = np.unique(faces[rows])
    return rows


def faired(vertices: FloatArray, faces: IntArray, moving: IntArray, crease: BoolArray) -> FloatArray:
    """The vertices with those of `moving` (k,) where the umbrella of the umbrella vanishes: a thin plate that takes place and slope from its rim.

    crease : (n,) fixed vertices that carry no slope across: the surface may have an edge there.
    """
    if not len(moving):
        return vertices
    local, packed = np.unique(faces[_rings(faces, len(vertices), moving, 3)], return_inverse=True)
    own = np.searchsorted(local, moving)
    edges = edge_table(packed.reshape(-1, 3)).edges
    n = len(local)
    both = np.concatenate([edges, edges[:, ::-1]])
    share = -1.0 / np.bincount(both[:, 0], minlength=n)[both[:, 0]]
    umbrella = csr_array(coo_array((share, (both[:, 0], both[:, 1])), shape=(n, n)) + diags_array(np.ones(n)))
    bent = csr_array(diags_array(np.where(crease[local], 0.0, 1.0)) @ umbrella)
    rows = csr_array(umbrella[own] @ bent)
    fixed = np.setdiff1d(np.arange(n), own)
    right = -(rows[:, fixed] @ vertices[local[fixed]])
    out = vertices.copy()
    try:
        solved = np.asarray(splu(rows[:, own].tocsc()).solve(right)).reshape(-1, 3)
    except RuntimeError:  # exactly singular: the plain fill stays
        return out
    if np.isfinite(solved).all():
        out[moving] = solved
    return out
