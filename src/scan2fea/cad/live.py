"""Small steps with Open Cascade that several files here share; shapes live in millimetres around a local centre."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from scan2fea.kernel.neighbors import radius_components
from scan2fea.kernel.surfaces import CONE, CYLINDER, PLANE, SPHERE, TORUS, Surface
from scan2fea.types import FloatArray, IntArray, TriangleMesh


def parts(shape: Any, kind: Any) -> list[Any]:
    """All sub-shapes of a kind, each once per use."""
    from OCP.TopExp import TopExp_Explorer

    found, walk = [], TopExp_Explorer(shape, kind)
    while walk.More():
        found.append(walk.Current())
        walk.Next()
    return found


def unique_parts(shape: Any, kind: Any) -> list[Any]:
    """All sub-shapes of a kind, each once."""
    seen: dict[int, list[Any]] = {}
    out = []
    for part in parts(shape, kind):
        bucket = seen.setdefault(key(part), [])
        if not any(part.IsSame(other) for other in bucket):
            bucket.append(part)
            out.append(part)
    return out


def key(shape: Any) -> int:
    """A number that is equal for uses of one sub-shape, whichever way they run."""
    from OCP.TopAbs import TopAbs_FORWARD

    return hash(shape.Oriented(TopAbs_FORWARD))


def pnt(p: FloatArray) -> Any:
    from OCP.gp import gp_Pnt

    return gp_Pnt(*(float(x) for x in p))


def direction(v: FloatArray) -> Any:
    from OCP.gp import gp_Dir

    return gp_Dir(*(float(x) for x in v))


def is_valid(shape: Any) -> bool:
    from OCP.BRepCheck import BRepCheck_Analyzer

    return bool(BRepCheck_Analyzer(shape).IsValid())


def moved_by(shape: Any, shift_mm: FloatArray) -> Any:
    """A copy elsewhere."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.gp import gp_Trsf, gp_Vec

    step = gp_Trsf()
    step.SetTranslation(gp_Vec(*(float(x) for x in shift_mm)))
    return BRepBuilderAPI_Transform(shape, step, True).Shape()


def placed_by(shape: Any, R: FloatArray, shift_mm: FloatArray) -> Any:
    """A copy turned and moved: x -> R x + shift."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.gp import gp_Trsf

    step = gp_Trsf()
    step.SetValues(*(float(x) for row in np.column_stack([R, shift_mm]) for x in row))
    return BRepBuilderAPI_Transform(shape, step, True).Shape()


def tessellated(shape: Any, chord_mm: float, angle_rad: float = 0.35) -> None:
    """Give every face triangles; neighbours share the points of their edge."""
    from OCP.BRepMesh import BRepMesh_IncrementalMesh

    BRepMesh_IncrementalMesh(shape, chord_mm, False, angle_rad, False)


def without_triangles(shape: Any) -> Any:
    """The same shape, to be given new ones: Open Cascade keeps what is finer than asked for."""
    from OCP.BRepTools import BRepTools

    BRepTools.Clean_s(shape)
    return shape


def as_splines(shape: Any) -> Any:
    """The same shape with every surface as a B-spline, its faces in the same order."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert

    return BRepBuilderAPI_NurbsConvert(shape, True).Shape()


def face_triangles(face: Any) -> tuple[FloatArray, IntArray]:
    """(n, 3) points and (m, 3) triangles of a tessellated face, outward."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_REVERSED
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    where = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(TopoDS.Face(face), where)
    if mesh is None:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    trsf = where.Transformation()
    nodes = [mesh.Node(k + 1).Transformed(trsf) for k in range(mesh.NbNodes())]
    points = np.array([(p.X(), p.Y(), p.Z()) for p in nodes]).reshape(-1, 3)
    triangles = np.array([mesh.Triangle(k + 1).Get() for k in range(mesh.NbTriangles())], np.int64).reshape(-1, 3) - 1
    if face.Orientation() == TopAbs_REVERSED:
        triangles = triangles[:, ::-1]
    return points, np.ascontiguousarray(triangles)


def joined_triangles(faces: Sequence[Any], within: float = 0.0) -> tuple[TriangleMesh, IntArray]:
    """The triangles of several faces, equal points merged, in millimetres; and the face each came from.

    within : points of different faces nearer than this are one too: each face has its own place for an edge that it follows to its tolerance.
    """
    points, triangles, owner, n = [], [], [], 0
    for number, face in enumerate(faces):
        p, t = face_triangles(face)
        points.append(p)
        triangles.append(t + n)
        owner.append(np.full(len(t), number, np.int64))
        n += len(p)
    every = np.concatenate(points) if points else np.zeros((0, 3))
    _, first, index = np.unique(np.round(every, 6), axis=0, return_index=True, return_inverse=True)
    if within > 0.0 and len(first):
        group = radius_components(every[first], within)
        _, lowest = np.unique(group, return_index=True)
        first, index = first[lowest], group[index.ravel()]
    flat = index.ravel()[np.concatenate(triangles)] if triangles else np.zeros((0, 3), np.int64)
    good = (flat[:, 0] != flat[:, 1]) & (flat[:, 1] != flat[:, 2]) & (flat[:, 0] != flat[:, 2])
    return TriangleMesh(vertices=every[first], faces=np.ascontiguousarray(flat[good])), np.concatenate(owner)[good]


def surface_of(face: Any) -> Surface:
    """What a face lies on; of kind "revolution" or "free" where it is none of the kinds of kernel.surfaces."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_Cone, GeomAbs_Cylinder, GeomAbs_Plane, GeomAbs_Sphere, GeomAbs_SurfaceOfRevolution, GeomAbs_Torus
    from OCP.TopAbs import TopAbs_REVERSED
    from OCP.TopoDS import TopoDS

    def xyz(v: Any) -> FloatArray:
        return np.array([v.X(), v.Y(), v.Z()])

    found = BRepAdaptor_Surface(TopoDS.Face(face))
    sense = -1 if face.Orientation() == TopAbs_REVERSED else 1
    kind = found.GetType()
    if kind == GeomAbs_Plane:
        plane = found.Plane()
        return Surface(kind=PLANE, point=xyz(plane.Location()), axis=sense * xyz(plane.Axis().Direction()))
    if kind == GeomAbs_Cylinder:
        c = found.Cylinder()
        return Surface(kind=CYLINDER, point=xyz(c.Location()), axis=xyz(c.Axis().Direction()), radius=c.Radius(), sense=sense)
    if kind == GeomAbs_Cone:
        c = found.Cone()
        return Surface(kind=CONE, point=xyz(c.Location()), axis=xyz(c.Axis().Direction()), radius=c.RefRadius(), second=c.SemiAngle(), sense=sense)
    if kind == GeomAbs_Sphere:
        s = found.Sphere()
        return Surface(kind=SPHERE, point=xyz(s.Location()), axis=np.array([0.0, 0.0, 1.0]), radius=s.Radius(), sense=sense)
    if kind == GeomAbs_Torus:
        t = found.Torus()
        tube = t.MinorRadius()
        return Surface(kind=TORUS, point=xyz(t.Location()), axis=xyz(t.Axis().Direction()), radius=t.MajorRadius(), second=tube, sense=sense)
    if kind == GeomAbs_SurfaceOfRevolution:
        axis = found.AxeOfRevolution()
        return Surface(kind="revolution", point=xyz(axis.Location()), axis=xyz(axis.Direction()), sense=sense)
    return Surface(kind="nurbs", point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), sense=sense)


def solid_of_faces(faces: Sequence[Any]) -> Any | None:
    """One solid of faces that share their edges; None where they do not close one shell."""
    from OCP.BRep import BRep_Builder, BRep_Tool
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid
    from OCP.BRepLib import BRepLib
    from OCP.TopoDS import TopoDS_Shell

    shell, builder = TopoDS_Shell(), BRep_Builder()
    builder.MakeShell(shell)
    for face in faces:
        builder.Add(shell, face)
    shell.Closed(BRep_Tool.IsClosed_s(shell))
    if not shell.Closed():
        return None
    solid = BRepBuilderAPI_MakeSolid(shell).Solid()
    BRepLib.OrientClosedSolid_s(solid)
    return solid


def unified(shape: Any, *, balls: bool = True) -> Any:
    """Pieces of one surface made one face, pieces of one curve one edge; of balls only with `balls`: a pole of the whole may lie on its border.

    The shape itself is left as it is: Open Cascade changes what it is given.
    """
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
    from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE

    before, n = shape, len(parts(shape, TopAbs_FACE))
    while True:  # once can leave halves (a shaft with a keyway: 3 of 12 ways that it may stand), which the next time joins
        copied = BRepBuilderAPI_Copy(before).Shape()
        merger = ShapeUpgrade_UnifySameDomain(copied, True, True, False)
        for face in () if balls else parts(copied, TopAbs_FACE):
            for edge in parts(face, TopAbs_EDGE) if surface_of(face).kind == SPHERE else ():
                merger.KeepShape(edge)
        try:
            merger.Build()
        except Exception:  # noqa: BLE001 - Open Cascade raises types of its own; the pieces stay, as good a solid
            return before
        before = merger.Shape()
        n_left = len(parts(before, TopAbs_FACE))
        if n_left >= n:
            return before
        n = n_left


def silence() -> None:
    """No banner on standard output: a library never prints."""
    from OCP.Message import Message

    messenger = Message.DefaultMessenger_s()
    for printer in list(messenger.Printers()):
        messenger.RemovePrinter(printer)
