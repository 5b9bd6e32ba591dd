"""Round holes through the walls of a member's solid: its faces keep their names, each hole is one more, a true cylinder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scan2fea.cad.brep import OCC_RESOLUTION_M
from scan2fea.cad.compared import faces_of, triangles_of
from scan2fea.cad.live import direction, is_valid, pnt
from scan2fea.cad.occ import solids_of
from scan2fea.cad.readback import read_back, shape_of
from scan2fea.cad.step_occ import named, step_of_solid
from scan2fea.cad.trued import order_in_file
from scan2fea.errors import CadError, require
from scan2fea.types import Brep, RoundHole, TriangleMesh, Value
from scan2fea.units import MILLIMETRES_PER_METRE

BEYOND = 0.5  # of the wall: so far the drill goes on at either side
REMOVED = 0.02  # of what the holes take out of a flat wall: what they may take more or less of a bent one
CHORDS = 0.05  # of the radius of the smallest hole: tolerance of the triangles, which leave the cylinders by less
HOLE = "HOLE"


@dataclass(frozen=True, eq=False, kw_only=True)
class Drilled(Value):
    """The solid with its holes, and its triangles, whose face_region is the face of the B-Rep."""

    brep: Brep
    mesh: TriangleMesh


def drilled(base: Brep, holes: Sequence[RoundHole]) -> Drilled:
    """A solid with round holes through its walls, HOLE_01 and so on, in their order.

    Raises CadError where a hole does not go through one wall alone, or the file does not read back as one valid solid.
    """
    names, solid = _cut(base, holes)
    text, numbers = step_of_solid(solid, OCC_RESOLUTION_M)
    found = read_back(text)
    require(found.is_valid and found.n_solids == 1 and found.n_free_edges == 0, CadError, "the drilled solid does not read back as one valid solid")
    wanted = base.volume_m3 - sum(_taken(hole) for hole in holes)
    off, limit = abs(found.volume_m3 - wanted), REMOVED * sum(_taken(hole) for hole in holes)
    require(off <= limit, CadError, f"the holes take {found.volume_m3 - wanted:.3g} m3 more or less than they hold (limit {limit:.3g})")
    mesh, face = triangles_of(solid, np.zeros(3), CHORDS * min(hole.radius_m for hole in holes))
    order = order_in_file(mesh, face, found)
    if order is None:
        raise CadError("the faces of the STEP file are not those that were drilled")
    titles = [names[k] for k in np.argsort(order)]
    kinds = dict(zip(base.face_names, base.face_kinds, strict=True))
    brep = Brep(
        step=named(text, numbers, titles), face_names=tuple(titles), face_kinds=tuple(kinds.get(name, "cylinder") for name in titles),
        region_of_face=np.arange(len(titles)), facet_of_face=np.full(len(titles), -1, np.int64), volume_m3=found.volume_m3, area_m2=found.area_m2,
        is_valid=found.is_valid, n_solids=found.n_solids, n_free_edges=found.n_free_edges, face_centre=found.face_centre, face_area=found.face_area,
    )  # fmt: skip
    return Drilled(brep=brep, mesh=replace(mesh, face_region=order[face]))


def _taken(hole: RoundHole) -> float:
    return math.pi * hole.radius_m**2 * float(np.linalg.norm(hole.through))


def _cut(base: Brep, holes: Sequence[RoundHole]) -> tuple[list[str], Any]:
    """The name of each face, and the solid."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder
    from OCP.collections import List_TopoDS_Shape
    from OCP.gp import gp_Ax2

    whole = solids_of(shape_of(base.step))[0]
    name_of = list(zip(faces_of(whole), base.face_names, strict=True))
    solid, tools = List_TopoDS_Shape(), List_TopoDS_Shape()
    solid.Append(whole)
    for number, hole in enumerate(holes):
        along = np.asarray(hole.through)
        start, length = (hole.start - BEYOND * along) * MILLIMETRES_PER_METRE, (1 + 2 * BEYOND) * float(np.linalg.norm(along)) * MILLIMETRES_PER_METRE
        drill = BRepPrimAPI_MakeCylinder(gp_Ax2(pnt(start), direction(along)), hole.radius_m * MILLIMETRES_PER_METRE, length).Shape()
        tools.Append(drill)
        name_of += [(face, f"{HOLE}_{number + 1:02d}") for face in faces_of(drill)]
    cut = BRepAlgoAPI_Cut()
    cut.SetArguments(solid)
    cut.SetTools(tools)
    cut.Build()
    require(cut.IsDone() and len(solids_of(cut.Shape())) == 1, CadError, "Open Cascade cannot drill the holes: what is left is not one solid")
    made = solids_of(cut.Shape())[0]
    require(is_valid(made), CadError, "Open Cascade finds the drilled solid invalid")
    faces = faces_of(made)
    names: list[str] = [""] * len(faces)
    for face, name in name_of:
        after = list(cut.Modified(face)) or ([] if cut.IsDeleted(face) else [face])
        for k, other in enumerate(faces):
            if any(other.IsSame(part) for part in after):
                names[k] = name
    told = len(set(names)) == len(names) and "" not in names and len(names) == len(base.face_names) + len(holes)
    require(told, CadError, f"the drilled solid has {len(names)} faces for {len(base.face_names)} and {len(holes)} holes: a hole cuts an edge")
    return names, made
