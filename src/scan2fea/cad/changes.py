"""The changes of kernel.construction on Open Cascade solids: cut by planes, bent as a whole, dented on one side."""

from __future__ import annotations

from typing import Any

import numpy as np

from scan2fea.cad.deform import Deformation
from scan2fea.cad.occ import RESOLUTION_MM, box_of, direction, parts, point, solids_of
from scan2fea.errors import CadError, require
from scan2fea.kernel.construction import Bend, Carved, Change, Dented, around, bent
from scan2fea.types import FloatArray
from scan2fea.units import MILLIMETRES_PER_METRE

BENT_TOLERANCE = 1e-11  # of the size of the solid


def changed(solid: Any, change: Change) -> Any:
    """The solid after one change. Raises CadError where Open Cascade makes no single solid of it."""
    if isinstance(change, Carved):
        return _carved(solid, change)
    return _dented(solid, change) if isinstance(change, Dented) else _bent(solid, change)


def _carved(solid: Any, change: Carved) -> Any:
    """Less the common part of half spaces, each a box larger than the solid."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Cut

    low, high = box_of(solid)
    reach = 4 * float(np.linalg.norm(high - low)) + float(np.abs([low, high]).max())
    tool = None
    for normal, offset in zip(change.normals, change.offsets * MILLIMETRES_PER_METRE, strict=True):
        half = _half_space(normal, float(offset), (low + high) / 2, reach)
        tool = half if tool is None else BRepAlgoAPI_Common(tool, half).Shape()
    cut = BRepAlgoAPI_Cut(solid, tool)
    require(cut.IsDone(), CadError, "Open Cascade cannot cut the solid")
    return _one(cut.Shape(), "the cut")


def _half_space(normal: FloatArray, offset: float, near: FloatArray, reach: float) -> Any:
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Ax2

    length = float(np.linalg.norm(normal))
    unit = normal / length
    side = np.cross(unit, np.eye(3)[int(np.argmin(np.abs(unit)))])
    side /= np.linalg.norm(side)
    foot = near + (offset / length - near @ unit) * unit
    corner = foot - reach / 2 * (side + np.cross(unit, side))
    return BRepPrimAPI_MakeBox(gp_Ax2(point(corner), direction(unit), direction(side)), reach, reach, reach).Shape()


def _one(shape: Any, what: str) -> Any:
    solids = solids_of(shape)
    require(len(solids) == 1, CadError, f"{what} leaves {len(solids)} solids")
    return solids[0]


def _bent(solid: Any, bend: Bend) -> Any:
    from OCP.TopAbs import TopAbs_FACE

    low, high = box_of(solid)
    tolerance = BENT_TOLERANCE * float(np.linalg.norm(high - low))
    deformation = Deformation(lambda p: bent(p / MILLIMETRES_PER_METRE, bend) * MILLIMETRES_PER_METRE, tolerance)
    return _solid([deformation.face(face) for face in parts(solid, TopAbs_FACE)])


def _dented(solid: Any, dent: Dented) -> Any:
    """Faces are first parted along the cylinder of the dent; those inside, within reach, are moved, everything else stays as it is.

    Raises CadError where a face gives way in part only: what it becomes there is no surface that could be written down.
    """
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_VERTEX
    from OCP.TopoDS import TopoDS

    low, high = box_of(solid)
    faces = _parted(solid, dent)
    states = [_yields(TopoDS.Face(face), dent) for face in faces]

    def move(p: FloatArray) -> FloatArray:
        share, _ = around(p / MILLIMETRES_PER_METRE, dent)
        return np.asarray(p + (dent.depth_m * MILLIMETRES_PER_METRE * share**2)[:, None] * dent.axis)

    deformation = Deformation(move, BENT_TOLERANCE * float(np.linalg.norm(high - low)))
    for face, is_moved in zip(faces, states, strict=True):
        if not is_moved:
            for edge in parts(face, TopAbs_EDGE):
                deformation.keep(TopoDS.Edge(edge), parts(edge, TopAbs_VERTEX))
    require(any(states), CadError, "no face gives way to the dent as a whole")
    return _unified(_solid([deformation.face(face) if is_moved else face for face, is_moved in zip(faces, states, strict=True)]))


def _unified(solid: Any) -> Any:
    """Parts of one plane or cylinder that the parting left apart, as one face again."""
    from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain

    unify = ShapeUpgrade_UnifySameDomain(solid, True, True, False)
    unify.Build()
    return _one(unify.Shape(), "joining the faces around the dent")


def _parted(solid: Any, dent: Dented) -> list[Any]:
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Splitter
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder
    from OCP.collections import List_TopoDS_Shape
    from OCP.GeomAbs import GeomAbs_Cylinder
    from OCP.gp import gp_Ax2
    from OCP.TopAbs import TopAbs_FACE, TopAbs_SHELL
    from OCP.TopoDS import TopoDS

    # right through the solid, so that no face is cut into but not off, of which a part would give way
    low, high = box_of(solid)
    reach = 2 * float(np.linalg.norm(high - low)) + float(np.abs(dent.at * MILLIMETRES_PER_METRE - (low + high) / 2).max())
    frame = gp_Ax2(point(dent.at * MILLIMETRES_PER_METRE - reach * dent.axis), direction(dent.axis))
    drum = BRepPrimAPI_MakeCylinder(frame, dent.radius_m * MILLIMETRES_PER_METRE, 2 * reach).Shape()
    wall = [face for face in parts(drum, TopAbs_FACE) if BRepAdaptor_Surface(TopoDS.Face(face)).GetType() == GeomAbs_Cylinder]
    splitter, whole, tools = BRepAlgoAPI_Splitter(), List_TopoDS_Shape(), List_TopoDS_Shape()
    whole.Append(parts(solid, TopAbs_SHELL)[0])
    tools.Append(wall[0])
    splitter.SetArguments(whole)
    splitter.SetTools(tools)
    splitter.Build()
    require(splitter.IsDone(), CadError, "Open Cascade cannot part the faces around the dent")
    return parts(splitter.Shape(), TopAbs_FACE)


def _yields(face: Any, dent: Dented) -> bool:
    """Does the dent move this face, which lies in its cylinder or beside it? Told from places within it.

    Raises CadError where only part of it gives way.
    """
    from OCP.BRep import BRep_Tool
    from OCP.BRepClass import BRepClass_FaceClassifier
    from OCP.BRepTools import BRepTools
    from OCP.gp import gp_Pnt2d
    from OCP.TopAbs import TopAbs_IN

    u0, u1, v0, v1 = BRepTools.UVBounds_s(face)
    surface, inside = BRep_Tool.Surface_s(face), []
    for u in u0 + (u1 - u0) * np.linspace(0.01, 0.99, 25):
        for v in v0 + (v1 - v0) * np.linspace(0.013, 0.987, 25):
            if BRepClass_FaceClassifier(face, gp_Pnt2d(float(u), float(v)), RESOLUTION_MM).State() == TopAbs_IN:
                p = surface.Value(float(u), float(v))
                inside.append((p.X(), p.Y(), p.Z()))
    require(len(inside) > 0, CadError, "a face beside the dent is too narrow to tell whether it gives way")
    share, along = around(np.array(inside).reshape(-1, 3) / MILLIMETRES_PER_METRE, dent)
    gives_way = (share > 1e-9) & (np.abs(along) <= dent.reach_m)
    says = "a face of the solid gives way to the dent in part only: it leaves its reach"
    require(not gives_way.any() or bool(gives_way.all()), CadError, says)
    return bool(gives_way.any())


def _solid(faces: list[Any]) -> Any:
    from OCP.BRep import BRep_Builder
    from OCP.BRepLib import BRepLib
    from OCP.TopoDS import TopoDS_Shell, TopoDS_Solid

    builder, shell, solid = BRep_Builder(), TopoDS_Shell(), TopoDS_Solid()
    builder.MakeShell(shell)
    for face in faces:
        builder.Add(shell, face)
    shell.Closed(True)
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    BRepLib.OrientClosedSolid_s(solid)
    return solid
