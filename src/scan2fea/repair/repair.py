"""A surface made fit to bound a solid, or a plain word on what is still wrong with it."""

from __future__ import annotations

from dataclasses import dataclass

from scan2fea.errors import RepairError, require
from scan2fea.kernel.measures import volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import surface_topology
from scan2fea.options import option
from scan2fea.repair.clean import merged_vertices, oriented, split_fans, without_duplicates, without_flat_faces, without_unused
from scan2fea.types import TriangleMesh, Value


@dataclass(frozen=True, kw_only=True)
class RepairOptions:
    """What repair may do."""

    small_part: float = option(0.01, "shells whose volume is under this share of the largest are dropped", unit="share", minimum=0, maximum=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Repaired(Value):
    """mesh : closed, manifold, oriented outward, one shell, no crossings.   steps : what was done, in order; empty where nothing had to be."""

    mesh: TriangleMesh
    steps: tuple[str, ...]


def is_sound(mesh: TriangleMesh) -> bool:
    """Does the mesh bound one solid as it is?"""
    topology = surface_topology(mesh)
    return topology.is_clean and topology.n_components == 1 and volume(mesh) > 0 and not len(self_intersections(mesh))


def repair(mesh: TriangleMesh, options: RepairOptions = RepairOptions()) -> Repaired:
    """`mesh` itself where it is sound; else repaired. Raises RepairError that says what is left."""
    require(len(mesh.faces) > 0, RepairError, "the mesh has no face: nothing to repair")
    if is_sound(mesh):
        return Repaired(mesh=mesh, steps=())
    steps = []
    for name, step in (
        ("merged equal vertices", merged_vertices),
        ("dropped repeated faces", without_duplicates),
        ("dropped flat faces", without_flat_faces),
        ("cut crowded edges and pinched vertices open", split_fans),
        ("turned faces outward", oriented),
        ("dropped unused vertices", without_unused),
    ):
        before = mesh
        mesh = step(mesh)
        if mesh.faces is not before.faces and (len(mesh.faces) != len(before.faces) or (mesh.faces != before.faces).any()):
            steps.append(name)
    topology = surface_topology(mesh)
    require(topology.is_closed, RepairError, f"the surface is open: {topology.n_boundary_edges} edges belong to one face only")
    require(topology.is_clean, RepairError, f"the surface does not bound a solid: {topology}")
    require(topology.n_components == 1, RepairError, f"the surface consists of {topology.n_components} shells")
    crossing = self_intersections(mesh)
    require(not len(crossing), RepairError, f"{len(crossing)} pairs of faces cross")
    return Repaired(mesh=mesh, steps=tuple(steps))
