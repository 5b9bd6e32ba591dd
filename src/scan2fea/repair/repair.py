"""A surface made fit to bound a solid, or a plain word on what is still wrong with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import CrossingError, RepairError, require
from scan2fea.kernel.distances import signed_distance
from scan2fea.kernel.measures import area, volume
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import edge_table, face_components, surface_topology
from scan2fea.options import option
from scan2fea.repair.clean import (
    merged_vertices,
    oriented,
    parted,
    split_fans,
    taken,
    without_duplicates,
    without_fins,
    without_flat_faces,
    without_unused,
)
from scan2fea.repair.holes import HolesFilled, filled_free, least_area, without_faces
from scan2fea.repair.stitch import stitched
from scan2fea.types import IntArray, TriangleMesh, Value

ROUNDS = 6  # of cutting crossings out and filling the hole, each a ring of faces wider


@dataclass(frozen=True, kw_only=True)
class RepairOptions:
    """What repair may do."""

    fill_holes: bool = option(True, "close holes; false: an open surface is an error")
    largest_hole: float = option(0.25, "a fill with more than this share of the area is a guess, and an error", unit="share", minimum=0, maximum=1)
    small_part: float = option(0.01, "shells whose area is under this share of the largest are dropped", unit="share", minimum=0, maximum=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Repaired(Value):
    """mesh : closed, manifold, oriented outward, one shell, no crossings.   steps : what was done, in order; empty where nothing had to be.

    stages : (name, surface after it) of the steps that changed the surface, in order, for the drift ledger.
    n_holes : filled.   n_creases : led on across holes.   n_dropped_parts : small shells.   n_cut_out : faces taken out because they crossed.
    """

    mesh: TriangleMesh
    stages: tuple[tuple[str, TriangleMesh], ...] = ()
    n_creases: int = 0
    steps: tuple[str, ...] = ()
    n_holes: int = 0
    n_dropped_parts: int = 0
    n_cut_out: int = 0


def is_sound(mesh: TriangleMesh) -> bool:
    """Does the mesh bound one solid as it is?"""
    topology = surface_topology(mesh)
    return topology.is_clean and topology.n_components == 1 and volume(mesh) > 0 and not len(self_intersections(mesh))


CLEANING: tuple[tuple[str, Callable[[TriangleMesh], TriangleMesh]], ...] = (
    ("merged equal vertices", merged_vertices),
    ("dropped repeated faces", without_duplicates),
    ("dropped flat faces", without_flat_faces),
    ("took fins off", without_fins),
    ("stitched cracks", stitched),
    ("cut crowded edges and pinched vertices open", split_fans),
    ("turned faces to agree", oriented),
    ("cut edges open that two faces pass in one direction", split_fans),
    ("dropped unused vertices", without_unused),
)


def repair(mesh: TriangleMesh, options: RepairOptions = RepairOptions()) -> Repaired:
    """`mesh` itself where it is sound; else repaired. Raises RepairError that says what is left to do by hand."""
    require(len(mesh.faces) > 0, RepairError, "the mesh has no face: nothing to repair")
    require(np.isfinite(mesh.vertices).all(), RepairError, "the mesh has vertices that are not finite: export it again")
    if is_sound(mesh):
        return Repaired(mesh=mesh)
    steps: list[str] = []
    stages: list[tuple[str, TriangleMesh]] = []
    mesh = _cleaned(mesh, steps)
    require(len(mesh.faces) > 0, RepairError, "no face with an area is left: the mesh is flat or empty")
    mesh, n_dropped = _significant(mesh, options.small_part)
    if n_dropped:
        steps.append(f"dropped {n_dropped} small parts")
    if steps:
        stages.append(("clean", mesh))
    found = _closed(mesh, options)
    mesh = mesh if found is None else oriented(found.mesh)
    if found is not None:
        steps.append(f"filled {found.n_holes} holes" + (f", {found.n_creases} edges led on across them" if found.n_creases else ""))
        stages.append(("holes", mesh))
    mesh, n_cut = _uncrossed(_cleaned(mesh, steps))
    if n_cut:
        steps.append(f"cut {n_cut} crossing faces out and filled the holes")
        stages.append(("crossings", mesh))
    mesh, more = _significant(without_unused(mesh), options.small_part)
    mesh = parted(mesh)
    _require_sound(mesh)
    return Repaired(
        mesh=mesh,
        stages=tuple(stages),
        steps=tuple(steps),
        n_holes=0 if found is None else found.n_holes,
        n_creases=0 if found is None else found.n_creases,
        n_dropped_parts=n_dropped + more,
        n_cut_out=n_cut,
    )


def _cleaned(mesh: TriangleMesh, steps: list[str]) -> TriangleMesh:
    for name, step in CLEANING:
        before = mesh
        mesh = step(mesh)
        same = len(mesh.faces) == len(before.faces) and len(mesh.vertices) == len(before.vertices) and bool((mesh.faces == before.faces).all())
        if not same and name not in steps:
            steps.append(name)
    return mesh


def _significant(mesh: TriangleMesh, small: float) -> tuple[TriangleMesh, int]:
    """Only the parts with at least the share `small` of the largest one's area, and how many others there were.

    Raises RepairError where two parts or more are left: one object is one piece.
    """
    n, label = face_components(mesh.faces)
    if n == 1:
        return mesh, 0
    areas = np.array([area(taken(mesh, label == k)) for k in range(n)])
    keep = areas >= small * areas.max()
    left = int(keep.sum())
    if left > 1:
        inner, crossing = _nested(mesh, label, np.flatnonzero(keep), int(areas.argmax()))
        words = [f"{inner} of them inside the largest: cavities are not carried through"] if inner else []
        words += [f"{crossing} of them partly inside the largest: unite them first"] if crossing else []
        told = f" ({'; '.join(words)})" if words else ""
        raise RepairError(f"the surface consists of {left} separate shells of at least {small:.0%} of the largest{told}: give one file per part")
    return without_unused(taken(mesh, keep[label])), n - left


def _nested(mesh: TriangleMesh, label: IntArray, shells: IntArray, largest: int) -> tuple[int, int]:
    """How many of the other shells lie inside the largest, and how many partly, by their vertices; none where the largest is open."""
    outer = without_unused(taken(mesh, label == largest))
    if not surface_topology(outer).is_clean:
        return 0, 0
    others = [np.unique(mesh.faces[label == k]) for k in shells if k != largest]
    inside = [float((signed_distance(mesh.vertices[rows], outer) < 0).mean()) for rows in others]
    return sum(share == 1 for share in inside), sum(0 < share < 1 for share in inside)


def _closed(mesh: TriangleMesh, options: RepairOptions) -> HolesFilled | None:
    """The mesh with its holes filled; None where it has none. Raises RepairError where filling is not wanted or would be a guess."""
    n_open = surface_topology(mesh).n_boundary_edges
    if not n_open:
        return None
    require(options.fill_holes, RepairError, f"the surface is open: {n_open} edges belong to one face only; allow repair.fill_holes or close it")
    share = least_area(mesh) / area(mesh)
    require(
        share <= options.largest_hole,
        RepairError,
        f"closing the surface would invent at least {share:.0%} of its area (limit repair.largest_hole = {options.largest_hole:.0%}): "
        "scan the open sides",
    )
    return filled_free(mesh)


def _uncrossed(mesh: TriangleMesh) -> tuple[TriangleMesh, int]:
    """Crossing faces, and those at holes that could not be filled, cut out and the holes filled: with a wider ring round them in each round.

    And how many faces were cut out.
    """
    count = 0
    for rings in range(1, ROUNDS + 1):
        table = edge_table(mesh.faces)
        drop = np.zeros(len(mesh.faces), bool)
        drop[np.unique(self_intersections(mesh))] = True
        drop[np.flatnonzero(table.count[table.edge_of] == 1) // 3] = True
        if not drop.any():
            break
        for _ in range(rings):
            near = np.zeros(len(mesh.vertices), bool)
            near[mesh.faces[drop]] = True
            drop |= near[mesh.faces].any(1)
        if drop.mean() > 0.5:
            break
        count += int(drop.sum())
        mesh = _largest(without_unused(split_fans(without_faces(mesh, drop))))
        mesh = oriented(filled_free(mesh).mesh)
    return mesh, count


def _largest(mesh: TriangleMesh) -> TriangleMesh:
    n, label = face_components(mesh.faces)
    if n == 1:
        return mesh
    areas = [area(taken(mesh, label == k)) for k in range(n)]
    return without_unused(taken(mesh, label == int(np.argmax(areas))))


def _require_sound(mesh: TriangleMesh) -> None:
    """Raise RepairError that names what is still wrong."""
    t = surface_topology(mesh)
    faults = [
        (t.n_boundary_edges, "open edges"),
        (t.n_nonmanifold_edges, "edges of more than two faces"),
        (t.n_repeated_directed_edges, "edges whose faces disagree on the outside"),
        (t.n_pinched_vertices, "vertices where the surface touches itself"),
        (t.n_degenerate_faces, "faces without area"),
    ]
    told = ", ".join(f"{count} {what}" for count, what in faults if count)
    require(not told, CrossingError, f"the surface does not bound a solid after repair: {told}; repair it by hand or reconstruct it from its points")
    require(t.n_components == 1, RepairError, f"the surface consists of {t.n_components} shells: give one file per part")
    crossing = len(self_intersections(mesh))
    require(not crossing, CrossingError, f"{crossing} pairs of faces still cross after repair: repair it by hand or reconstruct it from its points")
    require(volume(mesh) > 0, RepairError, "the surface encloses no volume")
