"""A solid from its surfaces: every face drawn too large, space cut into cells by them, the cells inside the scanned surface kept.

BOPAlgo_MakerVolume cuts; whether a cell is solid is asked of the triangle mesh at points inside it. Borders need not be known beforehand: edges come
out where the surfaces meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from scan2fea.cad.live import direction, joined_triangles, key, parts, pnt, solid_of_faces, tessellated, unified
from scan2fea.cad.readback import volume_of
from scan2fea.cad.tangent import Limit
from scan2fea.kernel.distances import signed_distance
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.surfaces import CYLINDER, PLANE, SPHERE, Surface
from scan2fea.types import FloatArray, TriangleMesh

FULL_TURN = 2 * np.pi
WHOLE = 1.7 * np.pi  # a cylinder seen over more than this much of its turn is drawn whole
PROBES = 24  # chords through a cell, at whose middles it is asked whether they are inside
ALIGNED = 1 - 1e-9  # cosine: a limit runs along a side of the face
CELL_SHARE = 1e-7  # of the volume: smaller cells follow the majority of nothing and are dropped


def cell_solid(
    surfaces: Sequence[Surface],
    patches: Sequence[FloatArray],
    margins_mm: Sequence[float],
    mesh_mm: TriangleMesh,
    limits: Sequence[Sequence[Limit]] | None = None,
    sheets: Sequence[Any] = (),
) -> Any | None:
    """The solid bounded by the surfaces and sheets, or None where the cells do not make one.

    surfaces : in millimetres.   patches : (n, 3) points of the region each was fitted to.   margins_mm : how far each face is drawn beyond them.
    limits : lines at which a face ends all the same, since another touches it there.
    """
    every = zip(surfaces, patches, margins_mm, limits or [()] * len(surfaces), strict=True)
    try:
        drawn = [margin_face(s, p, m, e) for k, (s, p, m, e) in enumerate(every) if not _is_drawn(s, surfaces[:k])]
    except Exception:  # noqa: BLE001 - Open Cascade raises types of its own for what it cannot draw: no solid then
        return None
    cells = cells_of([*drawn, *sheets])
    return None if cells is None else kept_cells(cells, mesh_mm)


def cells_of(faces: Sequence[Any]) -> Any | None:
    """Space cut by the faces; None where Open Cascade reports errors."""
    try:
        return _cells(faces)
    except Exception:  # noqa: BLE001 - as above, for what it cannot intersect
        return None


def _cells(faces: Sequence[Any]) -> Any | None:
    from OCP.BOPAlgo import BOPAlgo_MakerVolume

    maker = BOPAlgo_MakerVolume()
    for face in faces:
        maker.AddArgument(face)
    maker.SetIntersect(True)
    maker.SetAvoidInternalShapes(True)
    maker.SetRunParallel(False)
    maker.Perform()
    return None if maker.HasErrors() else maker.Shape()


def margin_face(surface: Surface, points: FloatArray, margin: float, limits: Sequence[Limit] = ()) -> Any:
    """A face of the surface over the region of its points and `margin` beyond, as far as its limits let it."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.gp import gp_Ax3, gp_Cone, gp_Cylinder, gp_Pln, gp_Sphere

    if surface.kind == SPHERE:
        ball = gp_Sphere(gp_Ax3(pnt(surface.point), direction(np.array([0.0, 0.0, 1.0]))), surface.radius)
        return BRepBuilderAPI_MakeFace(ball, 0.0, FULL_TURN, -np.pi / 2, np.pi / 2).Face()
    x = limits[0].inward if limits and surface.kind == PLANE else _across(surface, points)
    frame = gp_Ax3(pnt(surface.point), direction(surface.axis), direction(x))
    u, v = (points - surface.point) @ x, (points - surface.point) @ np.cross(surface.axis, x)
    if surface.kind == PLANE:
        wide = [float(u.min() - margin), float(u.max() + margin), float(v.min() - margin), float(v.max() + margin)]
        return BRepBuilderAPI_MakeFace(gp_Pln(frame), *_ended(wide, surface, x, limits)).Face()
    h = (points - surface.point) @ surface.axis
    turn = np.arctan2(v, u)  # measured from the middle of the region: x points there
    reach = margin / max(surface.radius, margin)
    whole = np.ptp(turn) + 2 * reach > WHOLE
    low, high = (0.0, FULL_TURN) if whole else (float(turn.min() - reach), float(turn.max() + reach))
    bottom, top = float(h.min() - margin), float(h.max() + margin)
    if surface.kind == CYLINDER and limits:
        low, high = _arc(surface, x, float(turn.min() - reach), float(turn.max() + reach), limits)
    if surface.kind == CYLINDER:
        return BRepBuilderAPI_MakeFace(gp_Cylinder(frame, surface.radius), low, high, bottom, top).Face()
    apex = -surface.radius / np.tan(surface.second)  # height at which the cone ends
    if surface.second > 0:
        bottom = max(bottom, apex)
    else:
        top = min(top, apex)
    slant = np.cos(surface.second)
    return BRepBuilderAPI_MakeFace(gp_Cone(frame, surface.second, surface.radius), low, high, bottom / slant, top / slant).Face()


def _ended(wide: list[float], surface: Surface, x: FloatArray, limits: Sequence[Limit]) -> list[float]:
    """The rectangle of a plane (least and most along x, and square to it) cut off at the limits that run along one of its sides."""
    out = list(wide)
    for axis, side in ((0, x), (2, np.cross(surface.axis, x))):
        for limit in limits:
            along, at = float(limit.inward @ side), float((limit.at - surface.point) @ side)
            if along > ALIGNED:
                out[axis] = max(out[axis], at)
            elif along < -ALIGNED:
                out[axis + 1] = min(out[axis + 1], at)
    return out


def _arc(surface: Surface, x: FloatArray, low: float, high: float, limits: Sequence[Limit]) -> tuple[float, float]:
    """The turn of a cylinder, from the middle x of its region, cut off at the limits."""
    y = np.cross(surface.axis, x)
    for limit in limits:
        at = float(np.arctan2((limit.at - surface.point) @ y, (limit.at - surface.point) @ x))
        low, high = (at, high) if at < 0 else (low, at)
    return low, high


def _is_drawn(surface: Surface, before: Sequence[Surface]) -> bool:
    """Whether the same whole sphere is there already: twice, its seams would cut it into more faces."""
    return surface.kind == SPHERE and any(
        other.kind == SPHERE and bool((other.point == surface.point).all()) and other.radius == surface.radius for other in before
    )


def _across(surface: Surface, points: FloatArray) -> FloatArray:
    """A direction square to the axis: a side of the least rectangle round a plane region, the middle of a round one."""
    e = surface.frame()
    flat = (points - surface.point) @ e.T
    if surface.kind == PLANE:
        return np.asarray(_side(flat) @ e)
    unit = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-300)
    middle = unit.mean(0)
    if np.linalg.norm(middle) < 1e-3:
        middle = np.array([1.0, 0.0])
    return np.asarray(middle / np.linalg.norm(middle) @ e)


def _side(flat: FloatArray) -> FloatArray:
    """(2,) the long side of the least rectangle round points of a plane: one side of it lies along their hull (Freeman, Shapira 1975).

    The direction of the largest spread is any for a square, whose face then reaches through its neighbours' far sides.
    """
    try:
        corners = flat[ConvexHull(flat).vertices]
    except QhullError:  # all on one line
        return np.array([1.0, 0.0])
    along = np.roll(corners, -1, axis=0) - corners
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    size = np.stack([np.ptp(corners @ along.T, axis=0), np.ptp(corners @ across.T, axis=0)])
    best = int(np.argmin(size[0] * size[1]))
    return np.asarray(along[best] if size[0, best] >= size[1, best] else across[best])


def kept_cells(cells: Any, mesh_mm: TriangleMesh) -> Any | None:
    """The union of the cells inside the mesh: the faces that have one of them on one side only."""
    from OCP.TopAbs import TopAbs_FACE, TopAbs_SOLID

    solids = parts(cells, TopAbs_SOLID)
    if not solids:
        return None
    tessellated(cells, 0.002 * float(np.linalg.norm(np.ptp(mesh_mm.vertices, axis=0))))
    inside = [s for s, is_in in zip(solids, are_inside(solids, mesh_mm), strict=True) if is_in]
    used: dict[int, list[Any]] = {}
    for solid in inside:
        for face in parts(solid, TopAbs_FACE):
            used.setdefault(key(face), []).append(face)
    border = [faces[0] for faces in used.values() if len(faces) == 1]
    if not border:
        return None
    found = solid_of_faces(border)
    return None if found is None else unified(found)


def are_inside(cells: Sequence[Any], mesh_mm: TriangleMesh) -> list[bool]:
    """Whether most of each cell lies inside the mesh: asked at the middles of chords that start anywhere on its faces, of all cells together."""
    middles = [_middles(cell) for cell in cells]
    of = np.repeat(np.arange(len(cells)), [len(m) for m in middles])
    depth = -signed_distance(np.concatenate(middles), mesh_mm)
    return [bool(total > 0) for total in np.bincount(of, weights=depth, minlength=len(cells))]


def _middles(cell: Any) -> FloatArray:
    """(k, 3) middles of PROBES chords or fewer; none of a cell without volume."""
    from OCP.TopAbs import TopAbs_FACE

    none = np.zeros((0, 3))
    hull, _ = joined_triangles(parts(cell, TopAbs_FACE))
    if len(hull.faces) < 4 or volume_of(cell) <= 0:
        return none
    a, b, c = (hull.vertices[hull.faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    good = area > 0
    share = np.cumsum(area[good]) / area[good].sum()
    rng = np.random.default_rng(0)
    row = np.flatnonzero(good)[np.searchsorted(share, (np.arange(PROBES) + 0.5) / PROBES)]
    s, t = np.sqrt(rng.random(PROBES)), rng.random(PROBES)
    start = (1 - s)[:, None] * a[row] + (s * (1 - t))[:, None] * b[row] + (s * t)[:, None] * c[row]
    inward = -cross[row] / area[row][:, None]
    step = 1e-7 * float(np.linalg.norm(np.ptp(hull.vertices, axis=0)))
    length, hit = first_hits(scene_of(hull), start + step * inward, inward)
    ok = (hit >= 0) & np.isfinite(length)
    return np.asarray(start[ok] + (step + length[ok] / 2)[:, None] * inward[ok])
