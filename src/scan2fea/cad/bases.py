"""The bases of kernel.construction as Open Cascade solids with true faces, in millimetres, in the frame of the shape."""

from __future__ import annotations

from typing import Any

import numpy as np

from scan2fea.cad.bezier import patch
from scan2fea.cad.brep import to_brep
from scan2fea.cad.occ import RESOLUTION_MM, bezier_curve, bezier_surface, direction, point, solids_of
from scan2fea.cad.prism import prism_brep
from scan2fea.cad.readback import shape_of
from scan2fea.errors import CadError, require
from scan2fea.kernel.construction import Base, Hole, Plain, Star, Stroke, Swept, Turned, star_points
from scan2fea.kernel.outline import outline
from scan2fea.kernel.sweep import Sweep
from scan2fea.types import FloatArray
from scan2fea.units import MILLIMETRES_PER_METRE

STAR_TOLERANCE = 1e-9  # of its radius: how far the patches of a star may stray
_AXES = np.eye(3)
_SIDES = [  # of a cube: outward normal, and the two directions along it, right-handed
    (sign * _AXES[k], _AXES[(k + 1) % 3], sign * _AXES[(k + 2) % 3]) for k in range(3) for sign in (1.0, -1.0)
]


def base_shape(base: Base) -> Any:
    """The solid of a base. Raises CadError where Open Cascade makes none."""
    if isinstance(base, Turned):
        return _turned(base)
    if isinstance(base, Swept):
        return shape_of(prism_brep(outline(base.family, base.values, base.fillet_m), straight(np.eye(4), base.length_m)).step)
    if isinstance(base, Plain):
        return _drilled(shape_of(to_brep(base.mesh).step), base.holes)
    return _star(base)


def straight(T_world_shape: FloatArray, length_m: float) -> Sweep:
    """The way of a section along z of the shape."""
    ends = np.array([[0.0, 0, -1], [0, 0, 1]])
    return Sweep(T_world_member=T_world_shape, length_m=length_m, bow=np.zeros((2, 0)), twist=np.zeros(0), end_normals=ends)


def _turned(base: Turned) -> Any:
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt

    closing = Stroke(start=base.profile[-1].end, end=base.profile[0].start)
    wire = BRepBuilderAPI_MakeWire()
    for stroke in (*base.profile, closing):
        wire.Add(_edge(stroke))
    require(wire.IsDone(), CadError, "the profile of the solid of revolution does not close")
    face = BRepBuilderAPI_MakeFace(wire.Wire(), True).Face()
    return BRepPrimAPI_MakeRevol(face, gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1))).Shape()


def _edge(stroke: Stroke) -> Any:
    """In the half plane y = 0, x = radius. Arcs of ellipses as rational quadratic Bezier curves, which they are exactly: a surface of revolution over
    a whole ellipse covers itself twice, and Open Cascade then reads its faces back wrongly.
    """
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
    from OCP.gp import gp_Ax2, gp_Circ

    ends = [point(_at(end)) for end in (stroke.start, stroke.end)]
    if stroke.centre is None or stroke.semi_axes is None:
        return BRepBuilderAPI_MakeEdge(*ends).Edge()
    arms = [(end - stroke.centre) / stroke.semi_axes for end in (stroke.start, stroke.end)]  # of the unit circle
    if stroke.semi_axes[0] == stroke.semi_axes[1]:  # about an axis through its centre it makes a sphere
        way = np.array([0.0, -1.0 if stroke.end[1] > stroke.start[1] else 1.0, 0.0])
        frame = gp_Ax2(point(_at(stroke.centre)), direction(way), direction(np.array([-1.0, 0, 0])))
        return BRepBuilderAPI_MakeEdge(gp_Circ(frame, float(stroke.semi_axes[0]) * MILLIMETRES_PER_METRE), *ends).Edge()
    middle = (arms[0] + arms[1]) / 2
    weight = float(np.linalg.norm(middle))  # cosine of half the angle
    corner = stroke.centre + stroke.semi_axes * middle / weight**2
    control = np.stack([_at(stroke.start), _at(corner), _at(stroke.end)])
    return BRepBuilderAPI_MakeEdge(bezier_curve(control, 0.0, 1.0, np.array([1.0, weight, 1.0])), *ends).Edge()


def _at(place: FloatArray) -> FloatArray:
    return np.array([place[0], 0.0, place[1]]) * MILLIMETRES_PER_METRE


def _drilled(solid: Any, holes: tuple[Hole, ...]) -> Any:
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2

    for hole in holes:
        depth = float(np.linalg.norm(hole.through)) * MILLIMETRES_PER_METRE
        start = (hole.start - hole.through / 2) * MILLIMETRES_PER_METRE
        tool = BRepPrimAPI_MakeCylinder(gp_Ax2(point(start), direction(hole.through)), hole.radius_m * MILLIMETRES_PER_METRE, 2 * depth).Shape()
        cut = BRepAlgoAPI_Cut(solid, tool)
        require(cut.IsDone() and len(solids_of(cut.Shape())) == 1, CadError, "Open Cascade cannot drill a hole into the solid")
        solid = solids_of(cut.Shape())[0]
    return solid


def _star(base: Star) -> Any:
    """Six patches over the sides of a cube, parameters the tangents' angles; borders meet because both sides fit the same places."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Sewing
    from OCP.BRepLib import BRepLib
    from OCP.TopoDS import TopoDS

    sew = BRepBuilderAPI_Sewing(10 * RESOLUTION_MM)
    size = abs(base.radius.get((0, 0, 0), 1.0)) * MILLIMETRES_PER_METRE
    for normal, right, up in _SIDES:

        def at(u: FloatArray, v: FloatArray, n: FloatArray = normal, r: FloatArray = right, w: FloatArray = up) -> FloatArray:
            x, y = (np.tan(np.pi / 4 * (2 * s - 1)) for s in (u, v))
            way = n + x[:, None] * r + y[:, None] * w
            return star_points(base.radius, way / np.linalg.norm(way, axis=1, keepdims=True)) * MILLIMETRES_PER_METRE

        surface = bezier_surface(patch(at, STAR_TOLERANCE * size), (0.0, 1.0), (0.0, 1.0))
        sew.Add(BRepBuilderAPI_MakeFace(surface, RESOLUTION_MM).Face())
    sew.Perform()
    solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell(sew.SewedShape())).Solid()
    BRepLib.OrientClosedSolid_s(solid)
    return solid
