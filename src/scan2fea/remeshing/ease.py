"""A surface eased where the tets inside it came out too flat: four of its vertices lie nearly in one plane there."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.quality import tet_dihedrals
from scan2fea.remeshing.folds import free_round, meshable
from scan2fea.remeshing.relax import near_faces, relaxed
from scan2fea.types import TetMesh, TriangleMesh

AIM_DEG = 12.0  # what every object reaches whose surface allows it
FLAT_DEG = AIM_DEG + 1.0


def worst_dihedral(tets: TetMesh) -> float:
    """How near a dihedral angle of the tets comes to 0 or to 180 degrees, either of which is flat; degrees."""
    angles = tet_dihedrals(tets.nodes, tets.tets)
    return float(np.minimum(angles, 180 - angles).min(initial=90.0))


def eased(mesh: TriangleMesh, tets: TetMesh, *, attempt: int) -> TriangleMesh:
    """`mesh` with the vertices of its flat `tets` drawn a little to the middle of their neighbours, farther at every `attempt` (from 0).

    Free form moves; from the second attempt on the planes next to a flat tet give way too. Needles and folds that this leaves are taken out.
    The mesh itself where nothing can move or faces would cross.
    """
    angles = tet_dihedrals(tets.nodes, tets.tets)
    flat = np.minimum(angles, 180 - angles).min(axis=1) < FLAT_DEG
    corners = np.unique(tets.nodes[np.unique(tets.tets[flat, :4])], axis=0)
    at = {tuple(v): k for k, v in enumerate(mesh.vertices.tolist())}
    vertices = np.array([at[tuple(c)] for c in corners.tolist() if tuple(c) in at], np.int64)
    faces = np.flatnonzero(np.isin(mesh.faces, vertices).any(axis=1))
    if not len(faces):
        return mesh
    loose = mesh if not attempt else free_round(mesh, faces, attempt - 1)
    smooth = relaxed(loose, near_faces(loose, faces, rings=attempt), steps=1 + attempt)
    return mesh if len(self_intersections(smooth)) else meshable(smooth)
