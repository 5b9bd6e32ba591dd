"""What Open Cascade finds in a STEP text: the proof that the solid is one, closed, valid and as large as its surface."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import CadError, require
from scan2fea.types import FloatArray, Value
from scan2fea.units import MILLIMETRES_PER_METRE

VOLUME_STEPS, NURBS_STEPS = 1e-10, 1e-7  # relative, between steps of the integration over one face; hundreds of patches are right to 1e-8


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadBack(Value):
    """face_centre : (f, 3) metres, face_area : (f,), in the order of the file."""

    is_valid: bool
    n_solids: int
    n_free_edges: int
    volume_m3: float
    area_m2: float
    face_centre: FloatArray
    face_area: FloatArray


def read_back(step: str) -> ReadBack:
    """Read the text with Open Cascade and measure it. Raises CadError where it cannot be read."""
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.ShapeAnalysis import ShapeAnalysis_FreeBounds
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_SHELL, TopAbs_SOLID
    from OCP.TopoDS import TopoDS

    shape = shape_of(step)
    centres, areas = [], []
    for face in parts_of_shape(shape, TopAbs_FACE):
        props = GProp_GProps()
        BRepGProp.SurfaceProperties_s(TopoDS.Face(face), props)
        at = props.CentreOfMass()
        centres.append((at.X(), at.Y(), at.Z()))
        areas.append(props.Mass())
    free = 0
    for shell in parts_of_shape(shape, TopAbs_SHELL):
        bounds = ShapeAnalysis_FreeBounds(shell)
        for wires in (bounds.GetClosedWires(), bounds.GetOpenWires()):
            free += 0 if wires.IsNull() else len(parts_of_shape(wires, TopAbs_EDGE))
    return ReadBack(
        is_valid=bool(BRepCheck_Analyzer(shape).IsValid()), n_solids=len(parts_of_shape(shape, TopAbs_SOLID)), n_free_edges=free,
        volume_m3=volume_of(shape) / MILLIMETRES_PER_METRE**3, area_m2=float(np.sum(areas)) / MILLIMETRES_PER_METRE**2,
        face_centre=np.array(centres).reshape(-1, 3) / MILLIMETRES_PER_METRE, face_area=np.array(areas) / MILLIMETRES_PER_METRE**2,
    )  # fmt: skip


def volume_of(shape: Any) -> float:
    """mm3, with sign, of the faces of a shape that is closed.

    Round faces in steps until halves agree, about the middle of the shape: of trimmed ones Open Cascade's fixed number of points misses 1e-5 of the
    volume, and another 1e-5 once the same solid has been moved. Of plane faces these points are enough.
    """
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepGProp import BRepGProp_Domain, BRepGProp_Face, BRepGProp_Vinert
    from OCP.GeomAbs import GeomAbs_BSplineSurface, GeomAbs_Plane
    from OCP.gp import gp_Pnt
    from OCP.TopAbs import TopAbs_FACE, TopAbs_VERTEX
    from OCP.TopoDS import TopoDS

    corners = [BRep_Tool.Pnt_s(TopoDS.Vertex(corner)) for corner in parts_of_shape(shape, TopAbs_VERTEX)]
    at = np.array([(p.X(), p.Y(), p.Z()) for p in corners]).reshape(-1, 3)
    middle = gp_Pnt(*((at.min(0) + at.max(0)) / 2).tolist()) if len(at) else gp_Pnt()
    total = 0.0
    for part in parts_of_shape(shape, TopAbs_FACE):
        face, loaded = TopoDS.Face(part), BRepGProp_Face(False)
        loaded.Load(face)
        kind = BRepAdaptor_Surface(face).GetType()
        steps = () if kind == GeomAbs_Plane else (NURBS_STEPS if kind == GeomAbs_BSplineSurface else VOLUME_STEPS,)
        total += float(BRepGProp_Vinert(loaded, BRepGProp_Domain(face), middle, *steps).Mass())
    return total


def box_m(step: str) -> FloatArray:
    """(2, 3) lowest and highest coordinates as Open Cascade tells them from the surfaces of the text alone; too wide for some that stand askew."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib

    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(shape_of(step), box, False, False)
    return np.array([[at.X(), at.Y(), at.Z()] for at in (box.CornerMin(), box.CornerMax())]) / MILLIMETRES_PER_METRE


def shape_of(step: str) -> Any:
    """What a STEP text holds, as `shape_of_step`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "solid.step"
        path.write_text(step, encoding="ascii")
        return shape_of_step(path)


def shape_of_step(path: Path) -> Any:
    """Everything a STEP file holds, in millimetres, as one shape of Open Cascade. Raises CadError where it cannot be read."""
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.STEPControl import STEPControl_Reader

    with silent():
        reader = STEPControl_Reader()
        require(reader.ReadFile(str(path)) == IFSelect_RetDone, CadError, "Open Cascade cannot read the STEP text: is it cut short?")
        reader.TransferRoots()
        shape = reader.OneShape()
    require(not shape.IsNull(), CadError, "Open Cascade finds no shape in the STEP text")
    return shape


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Open Cascade tells the console what it reads and writes; a library does not."""
    from OCP.Message import Message

    messenger = Message.DefaultMessenger_s()
    printers = list(messenger.Printers())
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)


def parts_of_shape(shape: Any, kind: Any) -> list[Any]:
    """The faces, edges, solids, ... of a shape."""
    from OCP.TopExp import TopExp_Explorer

    found, walk = [], TopExp_Explorer(shape, kind)
    while walk.More():
        found.append(walk.Current())
        walk.Next()
    return found
