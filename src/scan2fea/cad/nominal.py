"""A nominal part: the closed surface of the solid in a STEP file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.cad.readback import parts_of_shape, shape_of_step
from scan2fea.errors import CadError, InputError, require
from scan2fea.types import TriangleMesh
from scan2fea.units import MILLIMETRES_PER_METRE

CHORD = 1e-4  # of the size of the part: how far triangles may leave a round face
ANGLE_RAD = 0.1


def read_nominal(path: Path) -> TriangleMesh:
    """The surface of the one solid in a STEP file, metres, every face triangulated by itself (vertices on edges are not shared).

    Raises InputError for a file that cannot be read or holds other than one solid.
    """
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.TopAbs import TopAbs_FACE, TopAbs_REVERSED, TopAbs_SOLID
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    try:
        shape = shape_of_step(path)
    except CadError as error:
        raise InputError(f"{path}: is no STEP file that can be read") from error
    n_solids = len(parts_of_shape(shape, TopAbs_SOLID))
    require(n_solids == 1, InputError, f"{path}: holds {n_solids} solids; a nominal part is one")
    BRepMesh_IncrementalMesh(shape, CHORD * _size(shape), False, ANGLE_RAD, False)
    vertices: list[tuple[float, float, float]] = []
    faces: list[tuple[int, int, int]] = []
    for face in parts_of_shape(shape, TopAbs_FACE):
        at = TopLoc_Location()
        made = BRep_Tool.Triangulation_s(TopoDS.Face(face), at)
        require(made is not None, InputError, f"{path}: a face of the part cannot be triangulated")
        move, before = at.Transformation(), len(vertices) - 1  # Open Cascade counts from 1
        for k in range(1, made.NbNodes() + 1):
            p = made.Node(k).Transformed(move)
            vertices.append((p.X(), p.Y(), p.Z()))
        for k in range(1, made.NbTriangles() + 1):
            a, b, c = (before + i for i in made.Triangle(k).Get())
            faces.append((a, c, b) if face.Orientation() == TopAbs_REVERSED else (a, b, c))
    return TriangleMesh(vertices=np.array(vertices, float).reshape(-1, 3) / MILLIMETRES_PER_METRE, faces=np.array(faces, np.int64).reshape(-1, 3))


def _size(shape: Any) -> float:
    """Diagonal of the box, millimetres."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib

    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box)
    low, high = box.CornerMin(), box.CornerMax()
    return float(low.Distance(high))
