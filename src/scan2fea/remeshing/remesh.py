"""From the surface of a reconstruction to one that a mesher can use: planes made flat, creases straight, triangles of one size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.errors import MeshingError, require
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import extent, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.topology import surface_topology
from scan2fea.options import option
from scan2fea.remeshing.isotropic import Guide, closed, crease_guide, isotropic, opened, sharp_edges
from scan2fea.remeshing.sizing import edge_goal
from scan2fea.types import TriangleMesh, Value

EDGE_SPACINGS = 2.0
CREASE_DEG = 40.0


@dataclass(frozen=True, kw_only=True)
class RemeshOptions:
    """How the surface is made fit for finite elements."""

    edge_m: float | None = option(None, "edge length of the triangles; from the data: twice the point spacing", unit="m", minimum=0)
    max_faces: int = option(16_000, "edges are made longer where the surface would take more faces than this", unit="faces", minimum=100)
    rounds: int = option(6, "rounds of split, collapse, flip and smooth; 0 leaves the triangles as they are", unit="rounds", minimum=0, maximum=50)


@dataclass(frozen=True, eq=False, kw_only=True)
class Remeshed(Value):
    """mesh : closed, manifold, free of crossings; face_region numbers the planes, -1 is free form.   planes : one per region.

    n_taken_back : rounds undone because faces crossed.   volume_drift : relative change of volume.   moved_p95_m, moved_max_m : of the old vertices
    from the new surface.
    """

    mesh: TriangleMesh
    planes: tuple[Plane, ...]
    n_taken_back: int
    edge_m: float
    volume_drift: float
    moved_p95_m: float
    moved_max_m: float


def remesh(mesh: TriangleMesh, options: RemeshOptions = RemeshOptions(), *, spacing_m: float, sigma_m: float) -> Remeshed:
    """A surface of well shaped triangles that follows `mesh` within its noise.

    spacing_m, sigma_m : of the points the surface was made from. Raises MeshingError if `mesh` is not closed, manifold and free of crossings.
    """
    require(surface_topology(mesh).is_clean, MeshingError, "remeshing needs a closed manifold surface: repair it first")
    require(not len(self_intersections(mesh)), MeshingError, "remeshing needs a surface whose faces do not cross: repair it first")
    planes: tuple[Plane, ...] = ()
    flat = mesh
    edge = options.edge_m if options.edge_m else EDGE_SPACINGS * spacing_m
    is_sharp = sharp_edges(flat, CREASE_DEG if sigma_m < 0.01 * spacing_m else 180.0)
    goal = edge_goal(flat, is_sharp, edge, min(spacing_m, edge), options.max_faces)
    guide = Guide(
        surface=PointToMesh(flat),
        creases=crease_guide(flat, is_sharp),
        planes=dict(enumerate(planes)),
        drift_m=max(sigma_m, 0.3 * spacing_m),
    )
    work, taken_back = isotropic(opened(flat, is_sharp, goal), guide, options.rounds)
    result = closed(work)
    moved = PointToMesh(result).nearest(mesh.vertices).distance
    return Remeshed(
        mesh=result,
        planes=planes,
        n_taken_back=taken_back,
        edge_m=float(np.median(goal)),
        volume_drift=volume(result) / volume(mesh) - 1,
        moved_p95_m=float(np.percentile(moved, 95)),
        moved_max_m=float(moved.max()),
    )


def size_of(mesh: TriangleMesh) -> float:
    """Diagonal of the box around the mesh, metres."""
    return extent(mesh.vertices)
