"""A surface that crosses or touches itself, replaced by the boundary of tets that fTetWild finds inside it (Hu et al. 2020).

fTetWild decides what is inside by the winding number and moves the surface by less than an envelope: walls thinner than two envelopes do not come
through. It takes from a second to minutes, so it is the last way.
"""

from __future__ import annotations

import numpy as np

from scan2fea.errors import MeshingError, require
from scan2fea.kernel.measures import extent
from scan2fea.tetmeshing.child import run_worker
from scan2fea.tetmeshing.fill import FillOptions
from scan2fea.tetmeshing.tets import boundary_of
from scan2fea.types import TriangleMesh

ENVELOPE = 1e-3  # of the diagonal: what fTetWild's authors take


def new_boundary(mesh: TriangleMesh, options: FillOptions = FillOptions()) -> TriangleMesh:
    """A surface that bounds tets, within ENVELOPE of `mesh` (any triangles). Raises MeshingError where there is none within the limits."""
    centre, size = (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2, extent(mesh.vertices)
    job = {"kind": "dirty", "vertices": (mesh.vertices - centre) / size, "faces": mesh.faces, "envelope": ENVELOPE}
    got = run_worker(job, time_limit_s=options.time_limit_s, memory_limit_gib=options.memory_limit_gib)
    require(len(got["tets"]) > 0, MeshingError, "fTetWild finds nothing inside the surface")
    used, packed = np.unique(boundary_of(got["tets"]), return_inverse=True)
    return TriangleMesh(vertices=got["nodes"][used] * size + centre, faces=packed.reshape(-1, 3).astype(np.int64))
