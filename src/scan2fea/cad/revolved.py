"""Bodies turned about an axis, and what stands on them or is cut out of them: shells, heads of vessels, flanges, with nozzles and bolt holes."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.cad.cells import cells_of, kept_cells, margin_face
from scan2fea.cad.heads import smoothed
from scan2fea.cad.live import direction, is_valid, parts, pnt
from scan2fea.cad.meridian import Piece, corner, half_plane, is_smooth, joined, path_of, pieces_of, resampled, turns_about
from scan2fea.cad.patches import Near, Patches
from scan2fea.cad.readback import volume_of
from scan2fea.kernel.surfaces import CONE, CYLINDER, Surface
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

TURNED = 0.7  # share of the area whose normals meet the axis
FINE = 4.0  # samples of the meridian per spacing
LEAST_SPACINGS = 4.0
OTHER = 0.5  # share of a patch that lies off the meridian: it is not turned with the rest


def turned_solid(
    mesh_mm: TriangleMesh, points_mm: FloatArray, patches: Patches, surfaces_mm: list[Surface], spacing: float, noise: float, reach: float
) -> tuple[Any | None, str]:
    """The solid in millimetres, or None with the reason. points_mm : (n, 3) measured.   surfaces_mm : of the patches, fitted."""
    near = Near(mesh_mm)
    axis = _axis(near, patches, surfaces_mm)
    if axis is None:
        return None, "no cylinder or cone to turn about"
    usable = turns_about(axis, near.centres, near.smooth)
    if near.areas[usable].sum() < TURNED * near.areas.sum():
        return None, "it is not turned about one axis"
    path = path_of(mesh_mm, axis, usable)
    if path is None:
        return None, "no half-plane through the axis cuts it along one line"
    samples, measured, owner = _meridian(path, half_plane(axis, points_mm), spacing, noise)
    pieces = pieces_of(samples, noise + 0.05 * spacing, round(LEAST_SPACINGS * FINE))
    slack = 3 * noise + 0.1 * spacing
    whole = joined(pieces, samples, measured, owner, reach, slack) if pieces else None
    whole = None if whole is None else smoothed(whole, samples, measured, owner, reach, slack)
    if whole is None:
        return None, "its meridian is not made of lines and conics that meet"
    body = _revolved(axis, whole, samples)
    if body is None:
        return None, "its meridian closes no solid"
    others = _others(mesh_mm, patches, half_plane(axis, mesh_mm.vertices), samples, reach)
    if not others:
        return body, ""
    return _with_others(body, mesh_mm, patches, [(k, surfaces_mm[k]) for k in others], reach)


def _axis(near: Near, patches: Patches, surfaces: list[Surface]) -> Surface | None:
    """The cylinder (else cone) of the largest area."""
    best: tuple[float, Surface] | None = None
    for kind in (CYLINDER, CONE):
        for k, surface in enumerate(surfaces):
            area = float(near.areas[patches.label == k].sum())
            if surface.kind == kind and (best is None or area > best[0]):
                best = area, surface
        if best is not None:
            return best[1]
    return None


def _meridian(path: FloatArray, zr: FloatArray, spacing: float, noise: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Samples of the path moved to the middle of the measured points beside them; these points, and the sample each belongs to."""
    samples = resampled(path, spacing / FINE)
    closed = bool((samples[0] == samples[-1]).all())
    reach = round(FINE)
    ends = samples[:-1] if closed else samples
    tangent = np.roll(ends, -reach, axis=0) - np.roll(ends, reach, axis=0) if closed else np.gradient(samples, axis=0)
    tangent = np.vstack([tangent, tangent[:1]]) if closed else tangent
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / np.maximum(np.linalg.norm(tangent, axis=1), 1e-300)[:, None]
    distance, nearest = cKDTree(samples[: len(ends)]).query(zr)
    keep = np.asarray(distance) <= 4 * noise + 0.6 * spacing
    measured, owner = zr[keep], np.asarray(nearest, np.int64)[keep]
    off = ((measured - samples[owner]) * normal[owner]).sum(1)
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], np.arange(len(ends) + 1))
    shift = np.array([float(np.median(off[order[a:b]])) if b - a >= 5 else 0.0 for a, b in itertools.pairwise(start)])
    moved = samples.copy()
    moved[: len(ends)] += shift[:, None] * normal[: len(ends)]
    if closed:
        moved[-1] = moved[0]
    else:
        moved[[0, -1], 1] = 0.0
    return moved, measured, owner


def _revolved(axis: Surface, pieces: list[Piece], samples: FloatArray) -> Any | None:
    """The meridian's edges turned a full turn."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire
    from OCP.BRepLib import BRepLib
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1

    closed = bool((samples[0] == samples[-1]).all())
    knots = _knots(pieces, samples, closed)
    if knots is None:
        return None
    try:
        wire = BRepBuilderAPI_MakeWire()
        for piece, a, b in zip(pieces, knots[:-1], knots[1:], strict=True):
            edge = _edge(axis, piece, a, b, samples[_middle(piece, len(samples))])
            if edge is None:
                return None
            wire.Add(edge)
        if not closed:
            wire.Add(BRepBuilderAPI_MakeEdge(_in_space(axis, knots[-1]), _in_space(axis, knots[0])).Edge())
        face = BRepBuilderAPI_MakeFace(wire.Wire(), True).Face()
        solid = BRepPrimAPI_MakeRevol(face, gp_Ax1(pnt(axis.point), direction(axis.axis))).Shape()
    except Exception:  # noqa: BLE001 - Open Cascade raises types of its own
        return None
    from OCP.TopAbs import TopAbs_SOLID
    from OCP.TopoDS import TopoDS

    solids = parts(solid, TopAbs_SOLID)
    if len(solids) != 1:
        return None
    whole = TopoDS.Solid(solids[0])
    BRepLib.OrientClosedSolid_s(whole)
    return whole if is_valid(whole) and volume_of(whole) > 0 else None


def _middle(piece: Piece, n: int) -> int:
    last = piece.last if piece.last >= piece.first else piece.last + n - 1
    return ((piece.first + last) // 2) % max(n - 1, 1)


def _knots(pieces: list[Piece], samples: FloatArray, closed: bool) -> list[FloatArray] | None:
    """Where each piece begins, and where the last one ends."""
    joints: list[FloatArray] = []
    pairs = list(itertools.pairwise(pieces)) + ([(pieces[-1], pieces[0])] if closed else [])
    for a, b in pairs:
        near = samples[a.last]
        at = _smooth_joint(a, b) if is_smooth(a, b, near) else corner(a, b, near, 0.0)
        if at is None:
            return None
        joints.append(at)
    if closed:
        return [joints[-1], *joints]
    first, last = _on_axis(pieces[0], float(samples[0, 0])), _on_axis(pieces[-1], float(samples[-1, 0]))
    return None if first is None or last is None else [first, *joints, last]


def _smooth_joint(a: Piece, b: Piece) -> FloatArray | None:
    head, shell = (a, b) if a.kind == "conic" else (b, a)
    if head.kind != "conic" or shell.kind != "line":
        return None
    return np.array([-head.values[1] / (2 * head.values[2]), shell.values[2]])


def _on_axis(piece: Piece, near: float) -> FloatArray | None:
    if piece.kind == "line":
        return None if abs(piece.values[0]) < 0.1 else np.array([piece.values[2] / piece.values[0], 0.0])
    a, b, c = piece.values
    root = b * b - 4 * a * c
    if root < 0 or c == 0:
        return None
    found = [(-b + s * np.sqrt(root)) / (2 * c) for s in (1, -1)]
    return np.array([min(found, key=lambda z: abs(z - near)), 0.0])


def _in_space(axis: Surface, zr: FloatArray) -> Any:
    return pnt(axis.point + zr[0] * axis.axis + zr[1] * axis.frame()[0])


def _edge(axis: Surface, piece: Piece, a: FloatArray, b: FloatArray, through: FloatArray) -> Any | None:
    """A line, or the arc of an ellipse from a to b on the side of `through`."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
    from OCP.Convert import Convert_QuasiAngular
    from OCP.GC import GC_MakeArcOfEllipse
    from OCP.GeomConvert import GeomConvert
    from OCP.gp import gp_Ax2, gp_Elips

    if piece.kind == "line":
        return BRepBuilderAPI_MakeEdge(_in_space(axis, a), _in_space(axis, b)).Edge()
    k0, k1, k2 = piece.values
    if k2 >= 0:
        return None
    z0 = -k1 / (2 * k2)
    wide, high = np.sqrt(k0 - k1 * k1 / (4 * k2)), np.sqrt((k0 - k1 * k1 / (4 * k2)) / -k2)
    outward = axis.frame()[0]
    x = outward if wide >= high else axis.axis
    frame = gp_Ax2(_in_space(axis, np.array([z0, 0.0])), direction(np.cross(outward, axis.axis)), direction(x))
    ellipse = gp_Elips(frame, max(wide, high), min(wide, high))
    for start, end in ((a, b), (b, a)):
        arc = GC_MakeArcOfEllipse(ellipse, _in_space(axis, start), _in_space(axis, end), True).Value()
        middle = arc.Value((arc.FirstParameter() + arc.LastParameter()) / 2)
        at = half_plane(axis, np.array([[middle.X(), middle.Y(), middle.Z()]]))[0]
        if np.linalg.norm(at - through) < 0.5 * np.linalg.norm(b - a) + 1e-9:
            # as an exact rational B-spline: readers of STEP mix up the angles of turned ellipses
            return BRepBuilderAPI_MakeEdge(GeomConvert.CurveToBSplineCurve_s(arc, Convert_QuasiAngular)).Edge()
    return None


def _others(mesh: TriangleMesh, patches: Patches, zr: FloatArray, samples: FloatArray, reach: float) -> list[int]:
    """Patches that are not turned with the rest."""
    off: BoolArray = np.asarray(cKDTree(samples).query(zr)[0]) > reach
    return [k for k in range(len(patches.surfaces)) if off[np.unique(mesh.faces[patches.label == k])].mean() > OTHER]


def _with_others(
    body: Any, mesh: TriangleMesh, patches: Patches, others: list[tuple[int, Surface]], reach: float
) -> tuple[Any | None, str]:
    """The body with what stands on it or is cut out of it."""
    from OCP.TopAbs import TopAbs_FACE

    drawn = [margin_face(s, mesh.vertices[np.unique(mesh.faces[patches.label == k])], 3 * reach) for k, s in others]
    cells = cells_of([*parts(body, TopAbs_FACE), *drawn])
    found = None if cells is None else kept_cells(cells, mesh)
    return found, "" if found is not None else "what stands on the turned body closes no solid with it"
