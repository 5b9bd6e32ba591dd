"""Does the surface bound a solid, and would a solver take the tets? Every figure comes from the kernel; here it meets its limit."""

from __future__ import annotations

import math

from scan2fea.kernel.measures import tet_volumes, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.quality import tet_quality
from scan2fea.kernel.topology import surface_topology
from scan2fea.types import Brep, Check, TetMesh, TriangleMesh
from scan2fea.verification.limits import above, at_most, holds


def surface_checks(mesh: TriangleMesh) -> tuple[Check, ...]:
    """Closed, manifold, oriented, free of crossings, one piece, outward."""
    topology = surface_topology(mesh)
    return (
        at_most("surface.boundary_edges", topology.n_boundary_edges),
        at_most("surface.nonmanifold_edges", topology.n_nonmanifold_edges + topology.n_repeated_directed_edges),
        at_most("surface.pinched_vertices", topology.n_pinched_vertices),
        at_most("surface.self_intersections", len(self_intersections(mesh))),
        at_most("surface.components", topology.n_components),
        above("surface.volume", volume(mesh)),
    )


def tet_checks(tets: TetMesh, surface_volume_m3: float | None = None) -> tuple[Check, ...]:
    """Positive, not too flat, Jacobian positive at nodes and Gauss points; the volume is that inside the surface where one is given."""
    quality = tet_quality(tets.nodes, tets.tets)
    volumes = tet_volumes(tets.nodes, tets.tets)
    checks = [
        at_most("tets.nonpositive", int((volumes <= 0).sum())),
        above("tets.min_dihedral", float(quality["min_dihedral_deg"].min(initial=math.inf))),
        at_most("tets.max_dihedral", float(quality["max_dihedral_deg"].max(initial=-math.inf))),
        above("tets.scaled_jacobian", float(quality["scaled_jacobian"].min(initial=math.inf))),
    ]
    if surface_volume_m3 is not None:
        checks.append(at_most("tets.volume", relative(float(volumes.sum()), surface_volume_m3)))
    return tuple(checks)


def brep_checks(brep: Brep, surface_volume_m3: float) -> tuple[Check, ...]:
    """One valid closed solid of the surface's volume."""
    sound = brep.is_valid and brep.n_solids == 1 and brep.n_free_edges == 0
    told = f"{brep.n_solids} solids, {brep.n_free_edges} free edges, {'valid' if brep.is_valid else 'not valid'}"
    return (holds("cad.valid", sound, told), at_most("cad.volume", relative(brep.volume_m3, surface_volume_m3)))


def relative(value: float, reference: float) -> float:
    """|value / reference - 1|, nan where the reference is zero."""
    return abs(value / reference - 1) if reference else math.nan
