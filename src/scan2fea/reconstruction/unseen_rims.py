"""Holes whose rims nobody saw: a gap in the scan of both faces of a wall comes out as a hole that hides little volume.

The rim of a hole that was scanned has points of its own, or sight lines pass it. Holes of rims that have neither are counted by the handles that the
surface lacks without these rims. A rim beside another wall of the part is closed by that wall, which has no points there either: wide faces that
touch a rim are of the same gap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.kernel.measures import face_areas
from scan2fea.kernel.topology import corner_fans, edge_table, face_components, surface_topology
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.wall_ends import Stretch
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, TriangleMesh

UNSEEN_RIMS = "holes with rims that nobody saw"
WIDE = 1.5  # points due on a face: one in 25 is wider where points are scattered evenly
UNPROVED = 0.5  # of the area of a rim without points: with more of it passed by sight lines it is one


def unseen_rims(mesh: TriangleMesh, every: Sequence[Stretch], due: FloatArray | None = None) -> tuple[Check, ...]:
    """How many holes of a closed surface go with the ends of walls without points past most of which no line passes? None where it has no holes.

    every : those ends.   due : (m,) points due on each face.   The faces beside a rim are left out too: single points in a gap part it.
    """
    areas = face_areas(mesh)
    rims = [stretch.faces for stretch in every if areas[stretch.faces] @ np.isinf(stretch.slack_m) > UNPROVED * areas[stretch.faces].sum()]
    n_handles = surface_topology(mesh).n_handles if rims else 0
    if not n_handles:
        return ()
    off = np.concatenate(rims)
    wide = np.zeros(len(areas), bool) if due is None else due > WIDE
    while len(more := np.setdiff1d(np.flatnonzero(wide & _beside(mesh.faces, off)), off)):
        off = np.concatenate([off, more])
    n = n_handles - handles(mesh.faces[~_beside(mesh.faces, off)])
    where = around(mesh.vertices[mesh.faces[off]].mean(axis=1))
    says = f"{n} holes go through walls where no point lies on their rims and no sight line passes{where}: holes, or not scanned; scan there too"
    return (at_most(UNSEEN_RIMS, float(n), 0.0, says),)


def handles(faces: IntArray) -> int:
    """Holes that go through a surface with borders, where each of these is closed by a disc (V - E + F + B = 2 C - 2 G)."""
    if not len(faces):
        return 0
    table = edge_table(faces)
    fan = corner_fans(faces, table)
    open_edges = np.flatnonzero(table.count[table.edge_of] == 1)
    ends = np.stack([fan[open_edges], fan[open_edges // 3 * 3 + (open_edges + 1) % 3]], axis=1)
    n_borders = len(np.unique(_joined(int(fan.max()) + 1, ends)[ends[:, 0]]))
    euler = int(fan.max()) + 1 - len(table.edges) + len(faces)
    return (2 * face_components(faces)[0] - n_borders - euler) // 2


def _beside(faces: IntArray, off: IntArray) -> BoolArray:
    """(m,) faces with a corner of one of those that are left out."""
    touched = np.zeros(int(faces.max()) + 1, bool)
    touched[faces[off]] = True
    return np.asarray(touched[faces].any(axis=1))


def _joined(n: int, pairs: IntArray) -> IntArray:
    """(n,) which of n are joined by pairs (k, 2): the number of its set."""
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1])
