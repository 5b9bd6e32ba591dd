"""A solid whose faces are the patches of a surface, and whose edges run where these meet: nothing is cut.

Cells cannot cut faces that touch. Here the borders of the patches say which face meets which: surfaces that pass into each other are made to touch
(`tangency`), corners and edges are put on the surfaces (`corners`), each face is trimmed by its edges. What goes round an axis is cut in two first,
and joined at the end.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scan2fea.cad.corners import Corner, Edge, Meeting
from scan2fea.cad.extruded import Extruded
from scan2fea.cad.live import direction, is_valid, parts, pnt, solid_of_faces, unified
from scan2fea.cad.network import Network, network_of
from scan2fea.cad.occ import drawn_surface
from scan2fea.cad.roundings import MEETS
from scan2fea.cad.tangency import made_to_touch, sided, touches_of
from scan2fea.kernel.measures import face_areas
from scan2fea.kernel.polylines import length_of
from scan2fea.kernel.surfaces import CONE, CYLINDER, PLANE, SPHERE, Surface
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

EXACT = 5e-6  # mm: a line or an arc through the points of an edge
RESOLUTION = 1e-6  # mm
WALLS = 5  # rounds in which walls grow
BRIDGED = 3  # rounds in which bridges are given to what lies under them
ISLANDS = 2  # rounds in which patches inside others are given to these
MOST_FACETS = 5_000
POLES = 36  # directions tried
SMALL = 0.01  # of the area: a larger patch is no piece of a wall
LOOSE = 0.1  # of the length of all borders: more is free form in pieces
LOOSEST = 1.0  # mm that Open Cascade may widen an edge by; what is off is found when the solid is compared

_Use = tuple[int, bool, int, int]  # edge, whether it runs forward, its corners in that order


@dataclass(frozen=True, eq=False, kw_only=True)
class Traced(Value):
    """solid : None where the faces close none.   surfaces : as they were moved.   n_facets : of walls of free form.   wall : (m,) faces on these.

    loose : share of the length of all borders where two surfaces meet at no angle and do not touch.
    pieces : (m,) faces of small patches that meet others in no point, or at no angle without touching: pieces, it may be, of what is none of these.
    """

    solid: Any | None
    surfaces: tuple[Surface, ...]
    n_facets: int = 0
    loose: float
    wall: BoolArray
    pieces: BoolArray


def traced_solid(
    mesh_mm: TriangleMesh, label: IntArray, surfaces: Sequence[Surface], covariances: Sequence[FloatArray], tolerance: float, spacing: float,
    *, walls: bool = False, bridged: bool = False, parted: bool = False, free: BoolArray | None = None, exact: float = EXACT,
) -> Traced:  # fmt: skip
    """The solid of labelled faces, in millimetres. label : (m,) number of the surface of each, -1 where the nearest beside it is to be taken.

    walls : small patches whose corners or edges lie on no common point of their surfaces are walls of free form: their triangles become faces.
    Where a face comes out not valid the borders of walls on it are made even, and then, if small, it is a wall too.
    bridged : where noise lets two patches touch across a third, the faces there are the third's; what it left inside a patch becomes of that one.
    parted : where surfaces do not meet, borders of those that touch are drawn again along the line of touch.
    free : (m,) faces of free form, each a face of the solid from the start.   exact : edges nearer than this to a line or an arc are one.
    """
    wall = np.zeros(len(label), bool) if free is None else free
    area, evened, n_bridged, n_islands = face_areas(mesh_mm), False, 0, 0
    for _ in range(WALLS + BRIDGED + ISLANDS + parted):
        network = network_of(mesh_mm, label, surfaces, wall)
        touches = touches_of(mesh_mm, network, surfaces, covariances, tolerance, spacing)
        loose, apart = _loose(mesh_mm, network, surfaces, {touch.chain for touch in touches})
        n_facets = int((network.surface < 0).sum())
        if loose > LOOSE or n_facets > MOST_FACETS:
            break
        made, kept = made_to_touch(surfaces, covariances, touches, tolerance)
        network = network.halved_through(made)
        meeting = Meeting(mesh_mm, network, made, [touch.chain for touch in kept], tolerance, spacing, evened=evened)
        edges = meeting.edges()
        islands = meeting.islands(edges) if bridged and n_islands < ISLANDS else {}
        if islands:
            for region, around in islands.items():
                label = np.where(network.label == region, around, label)
            n_islands += 1
            continue
        own = network.surface[network.label]
        bridges = meeting.bridges(tolerance, edges) if bridged and n_bridged < BRIDGED else []
        if bridges:
            label, n_bridged = _without(mesh_mm, network, label, bridges), n_bridged + 1
            continue
        unmet = [names for names, _ in meeting.unmet(tolerance, edges)] if parted else []
        astray = [touch for touch in kept if any({touch.first, touch.second} <= names for names in unmet)]
        if astray:
            label, parted = sided(mesh_mm, own, network.chains, astray, made), False
            continue
        tiny = {k for k in np.unique(own[own >= 0]).tolist() if float(area[own == k].sum()) <= SMALL * float(area.sum())}
        small = tiny & meeting.missed(tolerance, edges)
        if not small or not walls:
            solid, invalid = _solid(mesh_mm, network, made, meeting, edges, exact)
            if not invalid or not walls:
                pieces = np.isin(own, sorted(tiny & (small | apart)))
                return Traced(solid=solid, surfaces=tuple(made), n_facets=n_facets, loose=loose, wall=own < 0, pieces=pieces)
            small = tiny & invalid if evened else set()
            evened = True
        wall = np.isin(own, sorted(small)) | (own < 0)
    is_free = network.surface[network.label] < 0
    return Traced(solid=None, surfaces=tuple(surfaces), loose=loose, wall=is_free, pieces=np.zeros_like(is_free))


def _solid(
    mesh: TriangleMesh, network: Network, surfaces: Sequence[Surface], meeting: Meeting, edges: Mapping[int, Edge], exact: float
) -> tuple[Any | None, set[int]]:
    """The solid, and the surfaces of faces that are not valid."""
    try:
        faces = _faces(mesh, network, surfaces, meeting, edges, exact)
    except Exception:  # noqa: BLE001 - Open Cascade raises types of its own for what it cannot draw: no solid then
        return None, set()
    invalid = {int(network.surface[region]) for region, face in faces.items() if not is_valid(face)}
    solid = solid_of_faces(list(faces.values())) if faces else None
    return None if solid is None else joined_whole(solid), invalid


def _without(mesh: TriangleMesh, network: Network, label: IntArray, bridges: Sequence[tuple[IntArray, int]]) -> IntArray:
    """Labels with the faces at the vertices of each bridge given to the surface between."""
    label = label.copy()
    for vertices, third in bridges:
        touching = np.isin(mesh.faces, vertices).any(axis=1) & (network.surface[network.label] >= 0)
        label[touching] = third
    return label


def _loose(mesh: TriangleMesh, network: Network, surfaces: Sequence[Surface], touching: Collection[int]) -> tuple[float, set[int]]:
    """The share of the length of all borders where two surfaces neither meet at an angle nor touch, and these surfaces."""
    total, loose, apart = 0.0, 0.0, set()  # type: float, float, set[int]
    for number, chain in enumerate(network.chains):
        first, second = (int(network.surface[side]) for side in (chain.left, chain.right))
        at = mesh.vertices[chain.vertices]
        length = length_of(at)
        if first == second or min(first, second) < 0:
            continue
        total += length
        turn = np.einsum("ij,ij->i", surfaces[first].normals(at), surfaces[second].normals(at))
        if number not in touching and np.median(turn) > MEETS:
            loose += length
            apart |= {first, second}
    return loose / total if total else 0.0, apart


def joined_whole(solid: Any) -> Any:
    """Halves joined, where that leaves the solid as valid as it was."""
    from OCP.TopAbs import TopAbs_SOLID

    joined = (unified(solid, balls=balls) for balls in (True, False))
    return next((whole for whole in joined if is_valid(whole) and len(parts(whole, TopAbs_SOLID)) == 1), solid)


def _faces(
    mesh: TriangleMesh, network: Network, surfaces: Sequence[Surface], meeting: Meeting, edges: Mapping[int, Edge], exact: float
) -> dict[int, Any]:
    """The face of each region; none where a region has no border that closes."""
    drawn, _ = shared_edges(edges, meeting.corners, exact)
    uses: dict[int, list[_Use]] = {k: [] for k in range(len(network.surface))}
    for number, edge in edges.items():
        chain = network.chains[number]
        uses[chain.left].append((number, True, edge.first, edge.last))
        uses[chain.right].append((number, False, edge.last, edge.first))
    out: dict[int, Any] = {}
    for region, own in uses.items():
        loops = joined_loops(own)
        if not loops:
            return {}
        if network.surface[region] < 0:
            corners = np.array([meeting.corners[use[2]].at for use in loops[0]])
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            flat = Surface(kind=PLANE, point=corners[0], axis=normal / np.linalg.norm(normal))
            out[region] = face_on(flat, corners, loops, drawn)
            continue
        used = np.unique(mesh.faces[network.label == region])
        out[region] = face_on(surfaces[network.surface[region]], mesh.vertices[used], loops, drawn)
    return out


def joined_loops(uses: Sequence[_Use]) -> list[list[_Use]]:
    """The edges of a region one after another; none where a loop stays open."""
    left, out = list(uses), []
    while left:
        loop = [left.pop(0)]
        while loop[-1][3] != loop[0][2]:
            follows = next((use for use in left if use[2] == loop[-1][3]), None)
            if follows is None:
                return []
            loop.append(follows)
            left.remove(follows)
        out.append(loop)
    return out


def shared_edges(edges: Mapping[int, Edge], corners: Mapping[int, Corner], exact: float) -> tuple[dict[int, Any], dict[int, Any]]:
    """Edges of Open Cascade that share their ends, and these by the number of the corner."""
    from OCP.BRep import BRep_Builder
    from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
    from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Vertex

    builder = BRep_Builder()
    ends: dict[int, Any] = {}
    out: dict[int, Any] = {}
    for number, corner in corners.items():
        ends[number] = TopoDS_Vertex()
        builder.MakeVertex(ends[number], pnt(corner.at), max(RESOLUTION, 2 * corner.off))
    for number, edge in edges.items():
        step = np.linalg.norm(np.diff(edge.points, axis=0), axis=1)
        curve, low, high = _curve(edge.points[np.append(True, step > 1e-7)], exact)
        shape = TopoDS_Edge()
        builder.MakeEdge(shape, curve, max(RESOLUTION, 2 * edge.off, exact if exact > EXACT else 0.0))
        builder.Add(shape, TopoDS.Vertex(ends[edge.first].Oriented(TopAbs_FORWARD)))
        builder.Add(shape, TopoDS.Vertex(ends[edge.last].Oriented(TopAbs_REVERSED)))
        builder.Range(shape, low, high)
        out[number] = shape
    return out, ends


def _curve(points: FloatArray, exact: float) -> tuple[Any, float, float]:
    """The line or arc that holds the points, else a spline through them; and its ends."""
    from OCP.collections import HArray1_gp_Pnt
    from OCP.Geom import Geom_Circle, Geom_Line
    from OCP.GeomAPI import GeomAPI_Interpolate
    from OCP.gp import gp_Ax2, gp_Circ

    across = points[-1] - points[0]
    length = float(np.linalg.norm(across))
    is_closed = length < 1e-9
    if not is_closed:
        along = (points - points[0]) @ across / length
        if np.linalg.norm(points - points[0] - along[:, None] * across / length, axis=1).max() < exact:
            return Geom_Line(pnt(points[0]), direction(across)), 0.0, length
    arc = _arc(points, exact)
    if arc is not None:
        middle, normal, radius, turn = arc
        return Geom_Circle(gp_Circ(gp_Ax2(pnt(middle), direction(normal), direction(points[0] - middle)), radius)), 0.0, turn
    used = points[:-1] if is_closed else points
    array = HArray1_gp_Pnt(1, len(used))
    for k, at in enumerate(used):
        array.SetValue(k + 1, pnt(at))
    maker = GeomAPI_Interpolate(array, is_closed, 1e-7)
    maker.Perform()
    curve = maker.Curve()
    return curve, curve.FirstParameter(), curve.LastParameter()


def _arc(points: FloatArray, exact: float) -> tuple[FloatArray, FloatArray, float, float] | None:
    """(middle, normal, radius, turn) of the arc from the first to the last of some points; None where they lie on none."""
    if len(points) < 5:
        return None
    centre = points.mean(0)
    axes = np.linalg.svd(points - centre, full_matrices=False)[2]
    if np.abs((points - centre) @ axes[2]).max() > exact:
        return None
    flat = (points - centre) @ axes[:2].T
    x, y, c = np.linalg.lstsq(np.column_stack([2 * flat, np.ones(len(flat))]), (flat**2).sum(1), rcond=None)[0]
    radius = float(np.sqrt(c + x * x + y * y))
    middle = centre + np.array([x, y]) @ axes[:2]
    if np.abs(np.linalg.norm(points - middle, axis=1) - radius).max() > exact:
        return None
    first = (points[0] - middle) / np.linalg.norm(points[0] - middle)
    normal = axes[2]
    turn = np.unwrap(np.arctan2((points - middle) @ np.cross(normal, first), (points - middle) @ first))[-1]
    if abs(turn) < 1e-6:
        return None
    return middle, normal if turn > 0 else -normal, radius, abs(float(turn))


def face_on(surface: Surface, points: FloatArray, loops: Sequence[Sequence[_Use]], edges: Mapping[int, Any]) -> Any:
    """The surface trimmed by its loops, looking out of the solid."""
    from OCP.BRep import BRep_Builder
    from OCP.ShapeFix import ShapeFix_Face
    from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
    from OCP.TopoDS import TopoDS_Face, TopoDS_Wire

    looks_in = surface.kind != PLANE and surface.sense < 0  # Open Cascade's round surfaces look away from their axis
    builder, face = BRep_Builder(), TopoDS_Face()
    builder.MakeFace(face, _geometry(surface, points), RESOLUTION)
    for loop in loops:
        wire = TopoDS_Wire()
        builder.MakeWire(wire)
        for number, forward, _, _ in reversed(loop) if looks_in else loop:
            builder.Add(wire, edges[number].Oriented(TopAbs_FORWARD if forward != looks_in else TopAbs_REVERSED))
        builder.Add(face, wire)
    fix = ShapeFix_Face(face)
    fix.FixOrientationMode = 1
    fix.SetPrecision(RESOLUTION)
    fix.SetMaxTolerance(LOOSEST)
    fix.Perform()
    out = fix.Face()
    if looks_in:
        out.Reverse()
    return out


def _geometry(surface: Surface, points: FloatArray) -> Any:
    """The surface, its seam on the side away from the points."""
    from OCP.Geom import Geom_ConicalSurface, Geom_CylindricalSurface, Geom_Plane, Geom_SphericalSurface, Geom_ToroidalSurface
    from OCP.gp import gp_Ax3, gp_Pln

    if surface.kind == PLANE:
        return Geom_Plane(gp_Pln(pnt(surface.point), direction(surface.axis)))
    if isinstance(surface, Extruded):
        height = (points - surface.point) @ surface.axis
        over = float(np.ptp(height))  # beyond what it is trimmed to
        return drawn_surface(surface.poles() + (height.min() - over) * surface.axis, surface.spline.t, 3 * over * surface.axis)
    away = surface.point - points.mean(0)
    axis = surface.axis
    if surface.kind == SPHERE:  # its poles aside of the points too, as far as they may be
        across = replace(surface, axis=away / max(float(np.linalg.norm(away)), 1e-300)).frame()
        turn = np.arange(POLES) * np.pi / POLES
        axes = np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1]
        axis = axes[int(np.abs((points - surface.point) @ axes.T).max(0).argmin())]
    away = away - (away @ axis) * axis
    away = away if np.linalg.norm(away) > 1e-6 * surface.radius else surface.frame()[0]
    frame = gp_Ax3(pnt(surface.point), direction(axis), direction(away))
    if surface.kind == SPHERE:
        return Geom_SphericalSurface(frame, surface.radius)
    if surface.kind == CYLINDER:
        return Geom_CylindricalSurface(frame, surface.radius)
    if surface.kind == CONE:
        return Geom_ConicalSurface(frame, surface.second, surface.radius)
    return Geom_ToroidalSurface(frame, surface.radius, surface.second)
