"""A pipe with elbows as the solid a draughtsman draws: a cylinder for each run and a torus for each bend, of each skin, and two ends."""

from __future__ import annotations

from typing import Any

import numpy as np

from scan2fea.cad.live import direction, parts, pnt
from scan2fea.cad.step_occ import named, step_of_solid
from scan2fea.errors import CadError, require
from scan2fea.kernel.bends import bent
from scan2fea.kernel.outline import Outline
from scan2fea.kernel.sweep import Sweep
from scan2fea.kernel.transforms import applied
from scan2fea.types import FloatArray
from scan2fea.units import MILLIMETRES_PER_METRE

OCC_RESOLUTION_M = 1e-10  # as in brep.py
SQUARE = 1e-9  # of a unit normal: an end that leans less is square
FIRST_END, LAST_END = "END_FIRST", "END_LAST"


def bent_pipe_step(shape: Outline, sweep: Sweep) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """(STEP text, face names, face kinds) of round loops swept along runs and bends. Raises CadError where Open Cascade makes no such solid."""
    from OCP.BRepOffsetAPI import BRepOffsetAPI_MakePipe

    over = _reach(shape, sweep)
    breaks = np.array([-over, *_breaks(sweep), sweep.length_m + over])
    try:
        solid = BRepOffsetAPI_MakePipe(_spine(sweep, breaks), _profile(shape, sweep, -over)).Shape()
        if over > 0:
            solid = _cut(solid, sweep, over)
    except Exception as error:  # noqa: BLE001 - Open Cascade raises types of its own
        raise CadError(f"no solid of the pipe with elbows: {error}") from None
    text, faces = step_of_solid(solid, OCC_RESOLUTION_M)
    names, kinds = _names(solid, shape, sweep)
    require(len(faces) == len(names), CadError, f"the pipe with elbows has {len(faces)} faces instead of {len(names)}")
    return named(text, faces, names), names, kinds


def _breaks(sweep: Sweep) -> list[float]:
    """Ways along the axis at which bends begin and end."""
    return [at for bend in sweep.bends for at in (bend.start_m, bend.start_m + bend.length_m)]


def _reach(shape: Outline, sweep: Sweep) -> float:
    """How far beyond its ends the axis must go for an end that is not square."""
    slope = max(float(np.linalg.norm(normal[:2]) / abs(normal[2])) for normal in sweep.end_normals)
    return 0.0 if slope < SQUARE else 2 * slope * max(edge.radius for loop in shape.loops for edge in loop)


def _place(sweep: Sweep, along_m: FloatArray) -> FloatArray:
    """(n, 3) millimetres: the axis at ways along it."""
    local = np.column_stack([np.zeros((len(along_m), 2)), along_m])
    return applied(sweep.T_world_member, bent(sweep.bends, local)) * MILLIMETRES_PER_METRE


def _spine(sweep: Sweep, breaks: FloatArray) -> Any:
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeWire
    from OCP.GC import GC_MakeArcOfCircle

    wire, at, middle = BRepBuilderAPI_MakeWire(), _place(sweep, breaks), _place(sweep, 0.5 * (breaks[:-1] + breaks[1:]))
    for k in range(len(breaks) - 1):
        begin, end = pnt(at[k]), pnt(at[k + 1])
        is_run = k % 2 == 0
        edge = BRepBuilderAPI_MakeEdge(begin, end) if is_run else BRepBuilderAPI_MakeEdge(GC_MakeArcOfCircle(begin, pnt(middle[k]), end).Value())
        wire.Add(edge.Edge())
    return wire.Wire()


def _profile(shape: Outline, sweep: Sweep, along_m: float) -> Any:
    """The ring (or disc) across the axis."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire
    from OCP.gp import gp_Ax2, gp_Circ, gp_Pln

    origin, z = pnt(_place(sweep, np.array([along_m]))[0]), direction(sweep.T_world_member[:3, 2])
    wires = [
        BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2(origin, z), loop[0].radius * MILLIMETRES_PER_METRE)).Edge()).Wire()
        for loop in shape.loops
    ]
    face = BRepBuilderAPI_MakeFace(gp_Pln(origin, z), wires[0])
    for hole in wires[1:]:
        hole.Reverse()
        face.Add(hole)
    return face.Face()


def _cut(solid: Any, sweep: Sweep, over: float) -> Any:
    """The solid without what lies beyond its end planes: boxes beyond these are taken away, no longer than the ends were lengthened."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2
    from OCP.TopAbs import TopAbs_SOLID

    for normal, at in zip(sweep.end_normals, (0.0, sweep.length_m), strict=True):
        place, way = _end(sweep, normal, at)
        beyond = BRepPrimAPI_MakeCylinder(gp_Ax2(pnt(place), direction(way)), 1e2 * over * MILLIMETRES_PER_METRE, 4 * over * MILLIMETRES_PER_METRE)
        solid = BRepAlgoAPI_Cut(solid, beyond.Shape()).Shape()
    return parts(solid, TopAbs_SOLID)[0]


def _end(sweep: Sweep, normal: FloatArray, at: float) -> tuple[FloatArray, FloatArray]:
    """Place (mm) and outward normal of an end plane."""
    local = np.array([[0.0, 0.0, at], [*(1e-3 * normal[:2]), at + 1e-3 * normal[2]]])
    place, tip = applied(sweep.T_world_member, bent(sweep.bends, local)) * MILLIMETRES_PER_METRE
    return place, (tip - place) / np.linalg.norm(tip - place)


def _names(solid: Any, shape: Outline, sweep: Sweep) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Name and kind of each face, in the order of the shell: of a run or bend by where the face's points lie along the axis."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_Plane, GeomAbs_Torus
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopoDS import TopoDS

    radii = {loop[0].name: loop[0].radius * MILLIMETRES_PER_METRE for loop in shape.loops}
    first = _place(sweep, np.zeros(1))[0]
    last = _place(sweep, np.array([sweep.length_m]))[0]
    mids = 0.5 * (np.array([0.0, *_breaks(sweep)]) + np.array([*_breaks(sweep), sweep.length_m]))
    axis = _place(sweep, mids)
    names, kinds = [], []
    for face in parts(solid, TopAbs_FACE):
        surface = BRepAdaptor_Surface(TopoDS.Face(face))
        u = np.linspace(surface.FirstUParameter(), surface.LastUParameter(), 5)[1:-1]
        v = np.linspace(surface.FirstVParameter(), surface.LastVParameter(), 5)[1:-1]
        at = np.array([(p.X(), p.Y(), p.Z()) for p in (surface.Value(float(a), float(b)) for a in u for b in v)])
        kind = surface.GetType()
        if kind == GeomAbs_Plane:
            near = np.linalg.norm(at - first, axis=1).mean() < np.linalg.norm(at - last, axis=1).mean()
            names.append(FIRST_END if near else LAST_END)
            kinds.append("plane")
            continue
        is_bend = kind == GeomAbs_Torus
        radius = surface.Torus().MinorRadius() if is_bend else surface.Cylinder().Radius()
        skin = min(radii, key=lambda name: abs(radii[name] - radius))
        own = np.arange(len(mids)) % 2 == int(is_bend)
        piece = int(np.flatnonzero(own)[np.argmin(np.linalg.norm(axis[own] - at.mean(axis=0), axis=1))])
        names.append(f"{skin}_{'BEND' if is_bend else 'RUN'}_{piece // 2 + 1}")
        kinds.append("torus" if is_bend else "cylinder")
    return tuple(names), tuple(kinds)
