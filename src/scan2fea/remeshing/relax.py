"""Free form drawn smooth where it gets into its own way: a spike or a pit thinner than the triangles that are to cover it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.topology import neighbour_vertices
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

STEPS = 10
RINGS = 2  # of faces round a crossing that are relaxed


def relaxed(mesh: TriangleMesh, near: BoolArray, steps: int = STEPS) -> TriangleMesh:
    """Vertices of free form among `near` (n,) drawn to the middle of their neighbours, `steps` times half the way."""
    held = ~near
    if mesh.face_region is not None:
        held[mesh.faces[mesh.face_region >= 0]] = True
    move = np.flatnonzero(~held)
    if not len(move):
        return mesh
    start, other = neighbour_vertices(mesh.faces, len(mesh.vertices))
    count = np.diff(start)[move]
    around = np.concatenate([other[start[v] : start[v + 1]] for v in move])
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    points = mesh.vertices.copy()
    for _ in range(steps):
        points[move] = 0.5 * points[move] + 0.5 * np.add.reduceat(points[around], first, axis=0) / count[:, None]
    return replace(mesh, vertices=points)


def near_faces(mesh: TriangleMesh, faces: IntArray, rings: int = RINGS) -> BoolArray:
    """(n,) True for vertices within `rings` of faces round the given ones."""
    near = np.zeros(len(mesh.vertices), bool)
    near[mesh.faces[faces]] = True
    for _ in range(rings):
        near[mesh.faces[near[mesh.faces].any(1)]] = True
    return near


def near_places(mesh: TriangleMesh, places: TriangleMesh, reach_m: float) -> BoolArray:
    """(n,) True for vertices within `reach_m` of the faces of `places`."""
    distance: FloatArray = PointToMesh(places).nearest(mesh.vertices).distance
    return np.asarray(distance <= reach_m)
