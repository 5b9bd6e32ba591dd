"""The drift ledger: what each step that moved geometry did to volume, walls and the distance to the points."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import volume
from scan2fea.kernel.thickness import places_on, thickness_at
from scan2fea.kernel.topology import edge_table, surface_topology
from scan2fea.pipeline.part import Made
from scan2fea.types import TriangleMesh


def moved(made: Made, step: str, mesh: TriangleMesh) -> None:
    """`mesh` is the surface from now on; what the step did to it is entered in the drift ledger."""
    made.surface = mesh
    if not len(mesh.faces):
        return
    if made.places is None:
        made.places = places_on(mesh)
    made.thickness.append(thickness_at(mesh, made.places))
    made.handles.append(surface_topology(mesh).n_handles)
    known = made.thickness[-1][np.isfinite(made.thickness[-1])]
    distance = PointToMesh(mesh).nearest(made.part.scan.cloud.points).distance
    thickness = float(np.median(known)) if len(known) else np.nan
    enclosed = volume(mesh) if (edge_table(mesh.faces).count > 1).all() else np.nan  # an open surface encloses nothing
    made.drift.append({"step": step, "volume_m3": enclosed, "thickness_m": thickness, "p95_m": float(np.percentile(distance, 95))})
