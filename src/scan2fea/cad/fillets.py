"""Rounded edges: where a ball rolls along two faces.

They are told among the patches, left out while cells are cut (a fillet touches its faces without an angle, which cannot be cut), and made again on
the solid of sharp edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scan2fea.cad.live import is_valid, parts, unique_parts
from scan2fea.cad.patches import Patches
from scan2fea.cad.readback import volume_of
from scan2fea.kernel.measures import extent, face_areas
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.surfaces import CYLINDER, PLANE, TORUS, Surface
from scan2fea.kernel.topology import edge_table
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

MEETS = 0.94  # cosine of normals: surfaces nearer to parallel have no edge to round
SQUARE = float(np.cos(np.radians(2.5)))  # a ball rolls round a cylinder on a plane that is this square to it
FITS = 90.0  # per cent of the corners of a patch that lie on the path of the ball
LONGEST = 0.5  # of the size: faces that meet farther away than this are not drawn to their edge
RANGE = (0.4, 2.5)  # times the radius of the patch: where that of the ball is sought
CORNER = 2.5  # radii: a patch between fillets no wider than this is where they meet
ON_EDGE = 1e-4  # mm: how closely an edge lies on the two surfaces that meet in it
ALIKE = 3.0  # standard deviations within which radii are one
LEAST_POINTS = 12  # to tell a fillet
OFF_BOTH = 0.3  # of the points: those of a ball lie off by up to 0.29 radii where its faces are square, half of them by more than 0.07
SAMPLES = 5  # points along an edge


@dataclass(frozen=True, eq=False, kw_only=True)
class Fillet(Value):
    """first, second : numbers of the surfaces that it touches.   radius_m, std_m : of the ball.

    sense : +1 of a rounded ridge, -1 of a filled corner.   faces : (k,) of the mesh.   reach_m : from where it leaves its faces to where these meet.
    """

    first: int
    second: int
    radius_m: float
    std_m: float
    sense: int
    faces: IntArray
    reach_m: float


def rolled(first: Surface, second: Surface, radius: float, sense: int, near: FloatArray) -> Surface | None:
    """What a ball of that radius leaves that rolls along two planes, or round a cylinder on a plane square to it; None for other pairs.

    sense : +1 the ball is in the solid, -1 outside of it.   near : (n, 3) points that it passes.
    """
    if first.kind != PLANE:
        first, second = second, first
    if first.kind != PLANE:
        return None
    away = -sense * radius  # of the middle of the ball from both surfaces, positive outside of the solid
    if second.kind == PLANE:
        axis = np.cross(first.axis, second.axis)
        length = float(np.linalg.norm(axis))
        if abs(float(first.axis @ second.axis)) > MEETS or length == 0:
            return None
        axis = axis / length
        heights = [first.axis @ first.point + away, second.axis @ second.point + away, axis @ near.mean(0)]
        point = np.linalg.solve(np.stack([first.axis, second.axis, axis]), np.array(heights))
        return Surface(kind=CYLINDER, point=point, axis=axis, radius=radius, sense=sense)
    if second.kind != CYLINDER or abs(float(first.axis @ second.axis)) < SQUARE:
        return None
    wide = second.radius + second.sense * away
    if wide <= 0:
        return None
    up = float(first.axis @ second.axis)
    height = (float((first.point - second.point) @ first.axis) + away) / up
    return Surface(kind=TORUS, point=second.point + height * second.axis, axis=second.axis, radius=wide, second=radius, sense=sense)


def _best_radius(first: Surface, second: Surface, start: float, sense: int, points: FloatArray, clip: float) -> tuple[float, float, float]:
    """(radius, its standard deviation, `FITS` percentile of the distances) of the ball that leaves the points; infinite where none rolls there."""
    from scipy.optimize import minimize_scalar

    def off(log_radius: float) -> FloatArray:
        ball = rolled(first, second, float(np.exp(log_radius)), sense, points)
        return np.full(len(points), 1e9 * clip) if ball is None else ball.distance(points)

    def cost(log_radius: float) -> float:
        return float(np.minimum(off(log_radius) ** 2, clip**2).sum())

    low, high = np.log(start * RANGE[0]), np.log(start * RANGE[1])
    grid = np.linspace(low, high, 25)
    middle = grid[int(np.argmin([cost(g) for g in grid]))]
    step = grid[1] - grid[0]
    best = float(minimize_scalar(cost, bounds=(middle - step, middle + step), method="bounded", options={"xatol": 1e-6}).x)
    left = off(best)
    slope = (off(best + 1e-4) - off(best - 1e-4)) / 2e-4
    sigma = float(np.sqrt(np.mean(np.minimum(left**2, clip**2))))
    rise = float(np.linalg.norm(slope))
    std = float(np.exp(best)) * sigma / rise if rise > 0 else np.inf
    return float(np.exp(best)), std, float(np.percentile(np.abs(left), FITS))


def without_fillets(
    mesh: TriangleMesh, patches: Patches, tolerance_m: float, points: FloatArray, face: IntArray, noise_m: float
) -> tuple[Patches, tuple[Fillet, ...]]:
    """The patches without those that a ball rolling along two others leaves, and these; pieces of one fillet are put together.

    points, face : (n, 3) measured and (n,) the face of the mesh next to each: they tell a fillet from a sharp edge that the surface has
    rounded, whose points lie on its two faces, within `noise_m`.
    """
    own, other, length = _borders(mesh, patches.label)
    surfaces, n = patches.surfaces, len(patches.surfaces)
    of_point = patches.label[face]
    area = np.bincount(patches.label[patches.label >= 0], weights=face_areas(mesh)[patches.label >= 0], minlength=n).astype(float)
    found: dict[int, tuple[int, int, float, int]] = {}
    for k in np.argsort(area, kind="stable").tolist():
        corners = mesh.vertices[np.unique(mesh.faces[patches.label == k])]
        ball = None if surfaces[k].kind == PLANE else _ball(mesh, surfaces, area, k, _beside(own, other, length, k, found), corners, tolerance_m)
        if ball is not None and _is_round(points[of_point == k], surfaces[ball[0]], surfaces[ball[1]], noise_m):
            found[k] = ball
    for k in _corners(n, own, other, length, area, found):
        found.setdefault(k, (-1, -1, 0.0, 0))
    if not found:
        return patches, ()
    kept = [k for k in range(n) if k not in found]
    packed = np.full(n + 1, -1, np.int64)
    packed[kept] = np.arange(len(kept))
    groups: dict[tuple[int, int, int], list[int]] = {}
    for k, (a, b, _, sense) in found.items():
        if sense:
            groups.setdefault((min(a, b), max(a, b), sense), []).append(k)
    fillets = [_together(mesh, patches, packed, key, members, found, tolerance_m) for key, members in groups.items()]
    return Patches(label=packed[patches.label], surfaces=tuple(surfaces[k] for k in kept)), tuple(fillets)


def renumbered(patches: Patches, before: Patches, fillets: Sequence[Fillet]) -> tuple[Patches, tuple[Fillet, ...]]:
    """Fillets with the numbers that their faces have in `patches`, which were `before` until some were given up; one that lost a face is none."""
    number = np.full(len(before.surfaces) + 1, -1, np.int64)
    number[before.label] = patches.label  # one number each: patches are kept or given up whole
    kept = [f for f in fillets if number[f.first] >= 0 and number[f.second] >= 0]
    return patches, tuple(replace(f, first=int(number[f.first]), second=int(number[f.second])) for f in kept)


def _is_round(points: FloatArray, first: Surface, second: Surface, noise: float) -> bool:
    """Do the points of a patch lie off both faces beside it? Those of a sharp edge lie on one of them, but for their noise."""
    if len(points) < LEAST_POINTS:
        return False
    off = np.minimum(np.abs(first.distance(points)), np.abs(second.distance(points)))
    return bool((off > noise).mean() > OFF_BOTH)


def _together(
    mesh: TriangleMesh, patches: Patches, packed: IntArray, pair: tuple[int, int, int], members: list[int],
    found: dict[int, tuple[int, int, float, int]], tolerance: float,
) -> Fillet:  # fmt: skip
    a, b, sense = pair
    faces = np.flatnonzero(np.isin(patches.label, members))
    points = mesh.vertices[np.unique(mesh.faces[faces])]
    first, second = patches.surfaces[a], patches.surfaces[b]
    radius, std, _ = _best_radius(first, second, float(np.median([found[k][2] for k in members])), sense, points, tolerance)
    return Fillet(
        first=int(packed[a]), second=int(packed[b]), radius_m=radius, std_m=std, sense=sense, faces=faces, reach_m=_reach(first, second, radius)
    )  # fmt: skip


def _borders(mesh: TriangleMesh, label: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Of each half-edge between two labels: that of its own side, of the other, its length."""
    table = edge_table(mesh.faces)
    own, other = np.repeat(label, 3), label[table.twin // 3]
    length = np.linalg.norm(mesh.vertices[np.roll(mesh.faces, -1, axis=1).ravel()] - mesh.vertices[mesh.faces.ravel()], axis=1)
    rows = own != other
    return own[rows], other[rows], length[rows]


def _beside(own: IntArray, other: IntArray, length: FloatArray, k: int, found: dict[int, Any]) -> list[int]:
    """The four patches with the longest borders with patch k, none of them a fillet."""
    rows = (own == k) & (other >= 0)
    if not rows.any():
        return []
    shared = np.bincount(other[rows], weights=length[rows])
    return [j for j in np.argsort(-shared, kind="stable").tolist() if shared[j] > 0 and j not in found][:4]


def _ball(
    mesh: TriangleMesh, surfaces: Sequence[Surface], area: FloatArray, k: int, beside: list[int], corners: FloatArray, tolerance: float
) -> tuple[int, int, float, int] | None:
    """(first, second, radius, sense) of the ball that leaves patch k between two of the patches beside it."""
    own = surfaces[k]
    size = extent(mesh.vertices)
    for i, a in enumerate(beside):
        for b in beside[:i]:
            start = own.second if own.kind == TORUS else own.radius
            if rolled(surfaces[a], surfaces[b], start, own.sense, corners) is None:
                continue
            radius, _, off = _best_radius(surfaces[a], surfaces[b], start, own.sense, corners, tolerance)
            if off <= tolerance and _reach(surfaces[a], surfaces[b], radius) < LONGEST * size and area[k] < area[a] + area[b]:
                return a, b, radius, own.sense
    return None


def _reach(first: Surface, second: Surface, radius: float) -> float:
    """How far from the fillet its two faces meet: of planes the length of the tangents, else the radius."""
    if first.kind == second.kind == PLANE:
        cosine = float(np.clip(first.axis @ second.axis, -1, 1))
        return radius * float(np.tan(np.arccos(cosine) / 2))
    return radius


def _corners(
    n: int, own: IntArray, other: IntArray, length: FloatArray, area: FloatArray, found: dict[int, tuple[int, int, float, int]]
) -> list[int]:
    """Patches where fillets meet: small, most of their border to fillets or to what lies on no surface, and beside two fillets at least."""
    out = []
    for k in range(n):
        rows = own == k
        next_to = {j for j in np.unique(other[rows]).tolist() if j in found}
        if k in found or len(next_to) < 2:
            continue
        open_rows = rows & ((other < 0) | np.isin(other, list(next_to)))
        widest = max(found[j][2] for j in next_to)
        if area[k] <= (CORNER * widest) ** 2 and length[open_rows].sum() > 0.5 * length[rows].sum():
            out.append(k)
    return out


def fitted_fillets(fillets: Sequence[Fillet], surfaces: Sequence[Surface], points: FloatArray, face: IntArray, clip_m: float) -> tuple[Fillet, ...]:
    """The radii from the measured points, between the faces as they are now; radii that differ by less than `ALIKE` standard deviations are made one.
    Where no ball rolls between these the radius stays as it was found.

    face : (n,) face of the mesh next to each point.   clip_m : a point farther off speaks no louder than one that far.
    """
    out = []
    for fillet in fillets:
        own = points[np.isin(face, fillet.faces)]
        if len(own) >= LEAST_POINTS:
            radius, std, _ = _best_radius(surfaces[fillet.first], surfaces[fillet.second], fillet.radius_m, fillet.sense, own, clip_m)
            fillet = replace(fillet, radius_m=radius, std_m=std) if np.isfinite(std) else fillet
        out.append(fillet)
    left = sorted((k for k, f in enumerate(out) if np.isfinite(f.std_m)), key=lambda k: (out[k].std_m, k))
    while left:
        group = [left.pop(0)]
        for k in list(left):
            weight = np.array([1 / max(out[j].std_m, 1e-12) ** 2 for j in group])
            mean = float(weight @ [out[j].radius_m for j in group] / weight.sum())
            if abs(out[k].radius_m - mean) <= ALIKE * float(np.sqrt(out[k].std_m ** 2 + 1 / weight.sum())):
                group.append(k)
                left.remove(k)
        weight = np.array([1 / max(out[j].std_m, 1e-12) ** 2 for j in group])
        mean = float(weight @ [out[j].radius_m for j in group] / weight.sum())
        for k in group:
            out[k] = replace(out[k], radius_m=mean)
    return tuple(out)


def rounded(solid: Any, fillets: Sequence[Fillet], surfaces_mm: Sequence[Surface], mesh_mm: TriangleMesh) -> Any | None:
    """The solid with its fillets, all of them; None where Open Cascade makes them in no order.

    surfaces_mm, mesh_mm : in millimetres, where the solid is; radii of `fillets` are in metres.
    """
    jobs = [(f.radius_m * 1e3, _edge_middles(solid, f, surfaces_mm, mesh_mm)) for f in fillets]
    if any(not places for _, places in jobs):
        return None
    if (made := _at_once(solid, jobs)) is not None:
        return made
    rising = sorted(range(len(jobs)), key=lambda k: jobs[k][0])
    for order in (rising, rising[::-1]):
        shape = solid
        for k in order:
            shape = None if shape is None else _at_once(shape, [jobs[k]])
        if shape is not None:
            return shape
    return None


def _at_once(solid: Any, jobs: Sequence[tuple[float, list[FloatArray]]]) -> Any | None:
    from OCP.BRepFilletAPI import BRepFilletAPI_MakeFillet
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_SOLID
    from OCP.TopoDS import TopoDS

    edges = unique_parts(solid, TopAbs_EDGE)
    middles = np.array([_along(edge)[SAMPLES // 2] for edge in edges])
    try:
        maker = BRepFilletAPI_MakeFillet(solid)
        for radius, places in jobs:
            for place in places:
                gap = np.linalg.norm(middles - place, axis=1)
                maker.Add(radius, TopoDS.Edge(edges[int(gap.argmin())]))
        maker.Build()
        if not maker.IsDone():
            return None
        made = maker.Shape()
    except Exception:  # noqa: BLE001 - Open Cascade raises types of its own for fillets that it cannot make
        return None
    solids = parts(made, TopAbs_SOLID)
    return solids[0] if len(solids) == 1 and is_valid(made) and volume_of(made) > 0 else None


def _edge_middles(solid: Any, fillet: Fillet, surfaces: Sequence[Surface], mesh: TriangleMesh) -> list[FloatArray]:
    """The middles of the edges in which the two faces of a fillet meet, beside its part of the surface."""
    from OCP.TopAbs import TopAbs_EDGE

    edges = unique_parts(solid, TopAbs_EDGE)
    samples = np.array([_along(edge) for edge in edges])
    flat = samples.reshape(-1, 3)
    on = [np.abs(surfaces[k].distance(flat)).reshape(len(edges), -1).max(1) < ON_EDGE for k in (fillet.first, fillet.second)]
    rows = np.flatnonzero(on[0] & on[1])
    if not len(rows):
        return []
    patch = mesh.vertices[np.unique(mesh.faces[fillet.faces])]
    gap = k_nearest(patch, 1, samples[rows].reshape(-1, 3))[0].reshape(len(rows), -1)
    near = np.median(gap, axis=1) < 2e3 * max(fillet.reach_m, fillet.radius_m)
    return [samples[k][SAMPLES // 2] for k in rows[near]]


def _along(edge: Any) -> FloatArray:
    """(SAMPLES, 3) points along an edge, its middle among them."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.TopoDS import TopoDS

    curve = BRepAdaptor_Curve(TopoDS.Edge(edge))
    low, high = curve.FirstParameter(), curve.LastParameter()
    at = [curve.Value(float(low + (high - low) * t)) for t in np.linspace(0.1, 0.9, SAMPLES)]
    return np.array([(p.X(), p.Y(), p.Z()) for p in at])
