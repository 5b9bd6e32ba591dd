"""How sharply a closed surface turns at its edges, seen from inside: a tet in a fold can be no wider than the fold."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.topology import edge_table
from scan2fea.types import FloatArray, IntArray, TriangleMesh


def interior_angles(mesh: TriangleMesh) -> tuple[IntArray, FloatArray]:
    """Pairs (k, 2) of faces that share an edge, and the angle (k,) in degrees of the solid between them: under 180 at a ridge, over at a valley."""
    table = edge_table(mesh.faces)
    half = np.flatnonzero(table.twin > np.arange(len(table.twin)))
    pairs = np.stack([half // 3, table.twin[half] // 3], axis=1)
    normals = face_normals(mesh)
    a, b = normals[pairs[:, 0]], normals[pairs[:, 1]]
    turn = np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b)))
    centre = mesh.vertices[mesh.faces].mean(axis=1)
    ridge = np.einsum("ij,ij->i", centre[pairs[:, 1]] - centre[pairs[:, 0]], a) < 0
    return pairs, np.asarray(np.where(ridge, 180 - turn, 180 + turn))
