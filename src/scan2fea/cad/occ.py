"""Small steps of Open Cascade that several files of this room need. Lengths are millimetres here; live objects never leave the room."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np

from scan2fea.cad.readback import parts_of_shape, silent
from scan2fea.cad.step_text import HEADER, PRODUCT_NAME
from scan2fea.errors import CadError, require
from scan2fea.types import FloatArray

RESOLUTION_MM = 1e-7  # Precision::Confusion


def point(at: FloatArray) -> Any:
    from OCP.gp import gp_Pnt

    return gp_Pnt(float(at[0]), float(at[1]), float(at[2]))


def direction(along: FloatArray) -> Any:
    from OCP.gp import gp_Dir

    return gp_Dir(float(along[0]), float(along[1]), float(along[2]))


def bezier_curve(control: FloatArray, first: float, last: float, weight: FloatArray | None = None) -> Any:
    """A curve of one Bezier piece, rational with (n,) weights, with its parameter from first to last."""
    from OCP.collections import Array1_double, Array1_gp_Pnt, Array1_int
    from OCP.Geom import Geom_BSplineCurve

    n = len(control)
    poles, knots, times = Array1_gp_Pnt(1, n), Array1_double(1, 2), Array1_int(1, 2)
    for i, at in enumerate(control):
        poles.SetValue(i + 1, point(at))
    for k, value in enumerate((first, last)):
        knots.SetValue(k + 1, value)
        times.SetValue(k + 1, n)
    if weight is None:
        return Geom_BSplineCurve(poles, knots, times, n - 1)
    weights = Array1_double(1, n)
    for i, value in enumerate(weight):
        weights.SetValue(i + 1, float(value))
    return Geom_BSplineCurve(poles, weights, knots, times, n - 1)


def bezier_surface(control: FloatArray, u: tuple[float, float], v: tuple[float, float]) -> Any:
    """A surface of one Bezier patch with its parameters over u and v."""
    from OCP.collections import Array1_double, Array1_int, Array2_gp_Pnt
    from OCP.Geom import Geom_BSplineSurface

    p, q = control.shape[:2]
    poles = Array2_gp_Pnt(1, p, 1, q)
    for i in range(p):
        for j in range(q):
            poles.SetValue(i + 1, j + 1, point(control[i, j]))
    knots, times = [], []
    for ends, n in ((u, p), (v, q)):
        knot, mult = Array1_double(1, 2), Array1_int(1, 2)
        for k, value in enumerate(ends):
            knot.SetValue(k + 1, value)
            mult.SetValue(k + 1, n)
        knots.append(knot)
        times.append(mult)
    return Geom_BSplineSurface(poles, *knots, *times, p - 1, q - 1)


def bspline_curve(control: FloatArray, spans: int, degree: int) -> Any:
    """A curve over [0, 1] of (spans + degree, 3) control points, its knots even and clamped."""
    from OCP.collections import Array1_gp_Pnt
    from OCP.Geom import Geom_BSplineCurve

    poles = Array1_gp_Pnt(1, len(control))
    for i, at in enumerate(control):
        poles.SetValue(i + 1, point(at))
    return Geom_BSplineCurve(poles, *_even_knots(spans, degree), degree)


def bspline_surface(control: FloatArray, spans: int, degree: int) -> Any:
    """A surface over [0, 1] x [0, 1] of (spans + degree)^2 control points, its knots even and clamped either way."""
    from OCP.collections import Array2_gp_Pnt
    from OCP.Geom import Geom_BSplineSurface

    n = control.shape[0]
    poles = Array2_gp_Pnt(1, n, 1, n)
    for i in range(n):
        for j in range(n):
            poles.SetValue(i + 1, j + 1, point(control[i, j]))
    knots, times = _even_knots(spans, degree)
    return Geom_BSplineSurface(poles, knots, knots, times, times, degree, degree)


def _even_knots(spans: int, degree: int) -> tuple[Any, Any]:
    from OCP.collections import Array1_double, Array1_int

    knots, times = Array1_double(1, spans + 1), Array1_int(1, spans + 1)
    for k in range(spans + 1):
        knots.SetValue(k + 1, k / spans)
        times.SetValue(k + 1, degree + 1 if k in (0, spans) else 1)
    return knots, times


def drawn_surface(control: FloatArray, knots: FloatArray, along: FloatArray) -> Any:
    """The B-spline surface of a curve, (n, 3) poles over (n + degree + 1,) clamped knots, drawn along a vector.

    Not Open Cascade's surface of linear extrusion: over that one it integrates without regard to knots, and volumes come out a per cent wrong.
    """
    from OCP.collections import Array1_double, Array1_int, Array2_gp_Pnt
    from OCP.Geom import Geom_BSplineSurface

    values, counts = np.unique(knots, return_counts=True)
    poles, knot, times = Array2_gp_Pnt(1, len(control), 1, 2), Array1_double(1, len(values)), Array1_int(1, len(values))
    for i, at in enumerate(control):
        poles.SetValue(i + 1, 1, point(at))
        poles.SetValue(i + 1, 2, point(at + along))
    for k, (value, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True)):
        knot.SetValue(k + 1, value)
        times.SetValue(k + 1, count)
    ends, twice = Array1_double(1, 2), Array1_int(1, 2)
    for k, value in enumerate((0.0, float(np.linalg.norm(along)))):
        ends.SetValue(k + 1, value)
        twice.SetValue(k + 1, 2)
    return Geom_BSplineSurface(poles, knot, ends, times, twice, len(knots) - len(control) - 1, 1)


def moved(shape: Any, T_world_shape: FloatArray) -> Any:
    """The shape in the world. T_world_shape : (4, 4), metres."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.gp import gp_Trsf

    T = np.array(T_world_shape, float)
    if np.array_equal(T, np.eye(4)):
        return shape
    T[:3, 3] *= 1e3
    motion = gp_Trsf()
    motion.SetValues(*T[:3].ravel().tolist())
    return BRepBuilderAPI_Transform(shape, motion, True).Shape()


def parts(shape: Any, kind: Any, *, unique: bool = True) -> list[Any]:
    """The faces, edges, ... of a shape in order; an edge that two faces share once, unless `unique` is off."""
    found: list[Any] = []
    for part in parts_of_shape(shape, kind):
        if not unique or not any(part.IsSame(one) for one in found):
            found.append(part)
    return found


def solids_of(shape: Any) -> list[Any]:
    from OCP.TopAbs import TopAbs_SOLID

    return parts(shape, TopAbs_SOLID)


def box_of(shape: Any) -> tuple[FloatArray, FloatArray]:
    """Low and high corner of a box around the shape, millimetres."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib

    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box)
    low, high = box.CornerMin(), box.CornerMax()
    return np.array([low.X(), low.Y(), low.Z()]), np.array([high.X(), high.Y(), high.Z()])


def step_of(shape: Any) -> str:
    """STEP text of one solid (AP214, millimetres), the same on every run: Open Cascade's entities under our header, without date and counters."""
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    out = io.BytesIO()
    with silent():
        writer = STEPControl_Writer()
        Interface_Static.SetCVal_s("write.step.product.name", PRODUCT_NAME)
        is_done = writer.Transfer(shape, STEPControl_AsIs) == IFSelect_RetDone and writer.WriteStream(out) == IFSelect_RetDone
    require(is_done, CadError, "Open Cascade cannot write the solid as STEP")
    text = out.getvalue().decode("ascii")
    text = HEADER.format(description="scan2fea solid", name="model.step") + text[text.index("DATA;\n") + 6 :]
    return re.sub(rf"'{PRODUCT_NAME} \d+'", f"'{PRODUCT_NAME}'", text)
