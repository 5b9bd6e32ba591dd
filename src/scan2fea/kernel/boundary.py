"""The surface of a tetrahedral mesh as a surface of its own."""

from __future__ import annotations

import numpy as np

from scan2fea.types import TetMesh, TriangleMesh


def boundary_surface(tets: TetMesh) -> TriangleMesh:
    """Corner triangles of the boundary with vertices numbered anew; face_region is the CAD face of each."""
    corners = tets.boundary[:, :3]
    used, packed = np.unique(corners, return_inverse=True)
    return TriangleMesh(vertices=tets.nodes[used], faces=packed.reshape(-1, 3).astype(np.int64), face_region=tets.face_tag)
