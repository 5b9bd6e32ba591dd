"""What is measured of a mesh for the thesis's tables: shape of its triangles, shells, borders, crossings, volume, wall, whether it is a solid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.measures import volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.quality import triangle_quality
from scan2fea.kernel.thickness import median_thickness
from scan2fea.kernel.topology import SurfaceTopology, surface_topology
from scan2fea.types import TriangleMesh

QUALITIES = ("Q1", "Q2", "Q3", "Q4", "Q5")


@dataclass(frozen=True, kw_only=True)
class Measured:
    """q : least Q1, Q2 (as printed), Q3, Q4, Q5 of all triangles.   q2_corrected : r / lmax, see docs/meshing.md.

    n_shells : "bounded surfaces".   n_half_edges : of one face only.   n_crossings : pairs of faces.   volume_m3, wall_m : None where the surface
    encloses nothing.   reason : why it does not bound one solid, empty where it does.
    """

    q: tuple[float, ...]
    q2_corrected: float
    n_faces: int
    n_shells: int
    n_half_edges: int
    n_crossings: int
    volume_m3: float | None
    wall_m: float | None
    reason: str

    @property
    def converts(self) -> bool:
        return not self.reason


def measured(mesh: TriangleMesh) -> Measured:
    """All of it. The crossing test is exact."""
    quality = triangle_quality(mesh.vertices, mesh.faces)
    topology = surface_topology(mesh)
    n_crossings = len(self_intersections(mesh))
    encloses = topology.is_closed and topology.is_oriented
    size = volume(mesh) if encloses else None
    return Measured(
        q=tuple(float(np.min(quality[name])) for name in QUALITIES),
        q2_corrected=float(np.min(quality["Q2_corrected"])),
        n_faces=len(mesh.faces),
        n_shells=topology.n_components,
        n_half_edges=topology.n_boundary_edges,
        n_crossings=n_crossings,
        volume_m3=size,
        wall_m=median_thickness(mesh) if encloses else None,
        reason=_reason(topology, n_crossings, size),
    )


def _reason(t: SurfaceTopology, n_crossings: int, volume_m3: float | None) -> str:
    faults = (
        (t.n_boundary_edges, "open edges"),
        (t.n_nonmanifold_edges, "edges of more than two faces"),
        (t.n_repeated_directed_edges, "edges whose faces disagree on the outside"),
        (t.n_pinched_vertices, "vertices where the surface touches itself"),
        (t.n_degenerate_faces, "faces without area"),
        (t.n_components if t.n_components > 1 else 0, "shells"),
        (n_crossings, "pairs of crossing faces"),
    )
    said = [f"{count:,} {what}" for count, what in faults if count]
    if not said and (volume_m3 is None or volume_m3 <= 0):
        said = ["it encloses no volume"]
    return ", ".join(said)
