"""A nominal part: the closed surface of the solid in a STEP file, and that solid where the part was scanned."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.cad.compared import Compared, Scale
from scan2fea.cad.live import placed_by
from scan2fea.cad.readback import parts_of_shape, shape_of_step
from scan2fea.cad.trued import Trued, trued
from scan2fea.errors import CadError, InputError, require
from scan2fea.types import FloatArray, TriangleMesh
from scan2fea.units import MILLIMETRES_PER_METRE

CHORD = 1e-4  # of the size of the part: how far triangles may leave a round face
ANGLE_RAD = 0.1
FINE = 1e-3  # of the size: as if its points lay so far apart, which leaves chords of 2e-6 of the size


def read_nominal(path: Path) -> TriangleMesh:
    """The surface of the one solid in a STEP file, metres, every face triangulated by itself (vertices on edges are not shared).

    Raises InputError for a file that cannot be read or holds other than one solid.
    """
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.TopAbs import TopAbs_FACE, TopAbs_REVERSED
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    shape = _solid_of(path)
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


def placed_drawing(path: Path, T_scene_drawing: FloatArray) -> Trued:
    """The solid of a STEP file, moved: its faces in the order of the file, named, and their triangles (`face_region`). Where its text cannot be
    written again, or is no closed solid, `reason` says so. Raises InputError as `read_nominal`.
    """
    solid = _solid_of(path)
    size = _size(solid) / MILLIMETRES_PER_METRE
    middle = np.asarray(T_scene_drawing[:3, :3] @ _middle(solid) / MILLIMETRES_PER_METRE + T_scene_drawing[:3, 3])
    R, shift = T_scene_drawing[:3, :3], (T_scene_drawing[:3, 3] - middle) * MILLIMETRES_PER_METRE
    return trued(placed_by(solid, R, shift), middle, Scale(spacing_m=FINE * size, noise_m=0.0, size_m=size), (), Compared(problem=""))


def _solid_of(path: Path) -> Any:
    from OCP.TopAbs import TopAbs_SOLID

    try:
        shape = shape_of_step(path)
    except CadError as error:
        raise InputError(f"{path}: is no STEP file that can be read") from error
    solids = parts_of_shape(shape, TopAbs_SOLID)
    require(len(solids) == 1, InputError, f"{path}: holds {len(solids)} solids; a nominal part is one")
    return solids[0]


def _box(shape: Any) -> FloatArray:
    """(2, 3) lowest and highest coordinates, millimetres."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib

    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box)
    return np.array([[at.X(), at.Y(), at.Z()] for at in (box.CornerMin(), box.CornerMax())])


def _size(shape: Any) -> float:
    """Diagonal of the box, millimetres."""
    return float(np.linalg.norm(np.ptp(_box(shape), axis=0)))


def _middle(shape: Any) -> FloatArray:
    return np.asarray(_box(shape).mean(axis=0))
