"""Rims: faces between two parallel walls, or two cylinders about one axis, that are narrower than both their creases are rounded.

What the patches have there are pieces of the roundings: planes that lean, half-rounds along the rim. That it is the rim of these walls says its
direction, square to both; the points half way between the walls lie on no other face and say where it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.cad.patches import Near, Patches
from scan2fea.cad.roundings import without_roundings
from scan2fea.cad.surfaces import CANDIDATE_RAD, CLIP
from scan2fea.kernel.measures import extent
from scan2fea.kernel.surfaces import CYLINDER, PLANE, Surface, about_axis, fitted
from scan2fea.kernel.topology import face_components
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

WIDEST = 2.0  # reaches: the roundings of both creases meet in the middle
WITHIN = 0.95  # of the vertices of a patch lie between the walls: a piece of the rim
STRIP = 1 / 3  # of the width beside each wall, at most, whose points are not asked: within the noise they may be the wall's
ALONG = float(np.cos(np.radians(30.0)))  # normals of one straight piece of a rim
SIDEWAYS = 0.3  # of a normal, along the walls: a flatter face tells no direction
LEAST_POINTS = 8
WALL_POINTS = 30  # from which a patch tells its own surface
LEANS = 4.0  # heights of the points: those of a shorter piece tell no direction
TOLD = 0.8  # of the points half way between that the pieces of a rim must hold
ROUNDS = 5


@dataclass(frozen=True, eq=False, kw_only=True)
class Rimmed(Value):
    """patches : with the rims among them.   told : of these, by number, the points (n, 3) that say where they are."""

    patches: Patches
    told: Mapping[int, FloatArray]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Pair(Value):
    """Two walls, by number. out : (n, 2) how far each vertex lies out of them."""

    walls: tuple[int, int]
    width: float
    out: FloatArray


def with_rims(mesh: TriangleMesh, patches: Patches, raw: Patches, points: FloatArray, face: IntArray, tolerance: float, reach: float) -> Rimmed:
    """The patches with every rim that two walls tell, the narrowest first; as they are where there is none.

    raw : the patches before those along creases were given up: a plane among these that lies square across from one that was kept is a wall.
    points : (n, 3) measured.   face : (n,) of the mesh, next to each.   tolerance : how far a point lies off its own surface at most.
    reach : how far the rounding of a crease may lie from its surfaces.
    """
    near = Near(mesh)
    patches = _with_walls(mesh, patches, raw, face, tolerance, WIDEST * reach)
    label, surfaces = patches.label.copy(), list(patches.surfaces)
    told: dict[int, FloatArray] = {}
    pairs = sorted(_pairs(mesh, patches, tolerance, WIDEST * reach), key=lambda p: p.width)
    noise = _noise(patches, points, face, tolerance) if pairs else tolerance
    for pair in pairs:
        for rows in _rims(near, label, surfaces, pair, tolerance, set(told)):
            found = _pieces(near, label, surfaces, pair, rows, points, face, noise)
            for own, surface, used in found:
                told[len(surfaces)] = used
                label[own] = len(surfaces)
                surfaces.append(surface)
    if not told:
        return Rimmed(patches=patches, told={})
    count = np.bincount(label[face] + 1, minlength=len(surfaces) + 1)[1:]
    area = np.bincount(label + 1, weights=near.areas, minlength=len(surfaces) + 1)[1:]
    label[np.isin(label, np.flatnonzero((count == 0) & (area <= reach**2)))] = -1  # crumbs of roundings that no point asks for
    known = [surfaces[k] for k in {*told, *(k for pair in pairs for k in pair.walls)}]
    sharp = without_roundings(mesh, Patches(label=label, surfaces=tuple(surfaces)), reach, known)  # what is left of the roundings of the rims
    number = {id(s): k for k, s in enumerate(sharp.surfaces)}
    return Rimmed(patches=sharp, told={number[id(surfaces[k])]: used for k, used in told.items() if id(surfaces[k]) in number})


def _noise(patches: Patches, points: FloatArray, face: IntArray, least: float) -> float:
    """How far a measured point lies off its own surface at most: points may be noisier than the vertices of the mesh."""
    label = patches.label[face]
    off = np.concatenate([s.distance(points[label == k]) for k, s in enumerate(patches.surfaces)])
    return max(least, 3 * 1.4826 * float(np.median(np.abs(off)))) if len(off) else least


def _with_walls(mesh: TriangleMesh, patches: Patches, raw: Patches, face: IntArray, tolerance: float, widest: float) -> Patches:
    """The patches, and the planes of `raw` that are in none and lie across from one of them."""
    label, surfaces = patches.label.copy(), list(patches.surfaces)
    count = np.bincount(raw.label[face] + 1, minlength=len(raw.surfaces) + 1)[1:]
    for k, surface in enumerate(raw.surfaces):
        rows = np.flatnonzero(raw.label == k)
        if surface.kind != PLANE or count[k] < WALL_POINTS or (patches.label[rows] >= 0).any():
            continue
        label[rows] = len(surfaces)
        surfaces.append(surface)
    every = Patches(label=label, surfaces=tuple(surfaces))
    n = len(patches.surfaces)
    across = {k for pair in _pairs(mesh, every, tolerance, widest) for k in pair.walls if min(pair.walls) < n}
    kept = [k for k in range(len(surfaces)) if k < n or k in across]
    packed = np.full(len(surfaces) + 1, -1, np.int64)
    packed[kept] = np.arange(len(kept))
    return Patches(label=packed[label], surfaces=tuple(surfaces[k] for k in kept))


def _pairs(mesh: TriangleMesh, patches: Patches, tolerance: float, widest: float) -> Iterator[_Pair]:
    own = [mesh.vertices[np.unique(mesh.faces[patches.label == k])] for k in range(len(patches.surfaces))]
    lean = [CANDIDATE_RAD / 2 + tolerance / extent(v) for v in own]  # of a wall known by its own points
    for i, a in enumerate(patches.surfaces):
        for j in range(len(patches.surfaces)):
            b = patches.surfaces[j]
            if a.kind != b.kind or i == j or float(np.linalg.norm(np.cross(a.axis, b.axis))) > lean[i] + lean[j]:
                continue
            if a.kind == PLANE and i < j and float(a.axis @ b.axis) < 0:
                width = -float(np.mean(np.append(b.distance(own[i]), a.distance(own[j]))))
            elif a.kind == CYLINDER and a.sense > 0 > b.sense and _is_about(a, b, own[j], tolerance):
                width = a.radius - b.radius
            else:
                continue
            if 0 < width <= widest:
                yield _Pair(walls=(i, j), width=width, out=np.stack([a.distance(mesh.vertices), b.distance(mesh.vertices)], axis=1))


def _is_about(outer: Surface, inner: Surface, points: FloatArray, tolerance: float) -> bool:
    """Whether the wall between two cylinders is as thick everywhere at the points of the inner one."""
    return float(np.abs(outer.distance(inner.projected(points)) + outer.radius - inner.radius).max()) <= 2 * tolerance


def _rims(near: Near, label: IntArray, surfaces: list[Surface], pair: _Pair, tolerance: float, taken: set[int]) -> list[IntArray]:
    """The faces of each rim: between the walls, on no patch that reaches beyond them, next to both."""
    faces = near.mesh.faces
    between: BoolArray = np.asarray((pair.out <= tolerance).all(axis=1))
    direction = surfaces[pair.walls[0]].axis
    free = label < 0
    for k in np.unique(label[label >= 0]).tolist():
        rows = np.flatnonzero(label == k)
        is_bore = surfaces[k].kind == CYLINDER and surfaces[pair.walls[0]].kind == PLANE and abs(float(surfaces[k].axis @ direction)) > ALONG
        if k not in pair.walls and k not in taken and not is_bore and between[np.unique(faces[rows])].mean() >= WITHIN:
            free[rows] = True
    rows = np.flatnonzero(free & between[faces].all(1))
    n, part = face_components(faces[rows]) if len(rows) else (0, rows)
    out = []
    for number in range(n):
        own = rows[part == number]
        around = _beside(near, np.flatnonzero(_beside(near, own)))  # a row of free faces that reach out of the walls may lie between
        if set(pair.walls) <= set(label[around].tolist()):
            out.append(own)
    return out


_Told = tuple[Surface, FloatArray]  # a surface, and the points that lie on it


def _pieces(
    near: Near, label: IntArray, surfaces: list[Surface], pair: _Pair, rows: IntArray, points: FloatArray, face: IntArray, tolerance: float
) -> list[tuple[IntArray, Surface, FloatArray]]:
    """The faces of a rim by surface, the surface, its points; none where surfaces square to the walls do not hold the points."""
    first, second = (surfaces[k] for k in pair.walls)
    inside = _beside(near, rows) & np.isin(label, [-1, *pair.walls])
    inside[rows] = True
    own = np.flatnonzero(inside[face])
    beside = min(tolerance, STRIP * pair.width)
    own = own[(first.distance(points[own]) < -beside) & (second.distance(points[own]) < -beside)]
    if len(own) < LEAST_POINTS:
        return []
    looks = near.smooth[rows]
    if first.kind == CYLINDER:
        way = first.axis * np.sign(float(near.areas[rows] @ (looks @ first.axis)) or 1.0)
        plane = _plane(points[own], way, None, first.distance(points[own]), tolerance)
        found = [] if plane is None else [plane]
    else:
        normal = first.axis - second.axis
        normal /= np.linalg.norm(normal)
        sideways = looks - (looks @ normal)[:, None] * normal
        found = []
        for way, parts in _alike(near, rows, sideways):
            for choice in ([np.concatenate(parts)], parts):
                own_points = [points[own[_beside(near, members)[face[own]]]] for members in choice]
                planes = [_plane(used, way, normal, first.distance(used), tolerance) for used in own_points]
                if any(plane is not None for plane in planes):
                    found += [plane for plane in planes if plane is not None]
                    break
        found = _needed(found, tolerance)
        if not _holds(found, points[own], tolerance):
            found = _round(points[own], near.smooth[face[own]], normal, tolerance)
    if not _holds(found, points[own], tolerance):
        return []
    corners = near.mesh.vertices[near.mesh.faces[rows]]
    off = np.stack([np.abs(s.distance(corners.reshape(-1, 3))).reshape(-1, 3).max(1) for s, _ in found])
    turn = np.stack([np.einsum("fc,fc->f", s.normals(corners.mean(1)), looks) for s, _ in found])
    best = np.argmin(np.where(turn > 0, off, off + extent(near.mesh.vertices)), axis=0)
    return [(rows[best == k], s, used) for k, (s, used) in enumerate(found) if (best == k).any()]


def _beside(near: Near, rows: IntArray) -> BoolArray:
    """(m,) some faces, and those next to them."""
    inside = np.zeros(len(near.areas), bool)
    inside[rows] = True
    inside[near.ring(inside, rows)] = True
    return inside


def _holds(found: list[_Told], points: FloatArray, tolerance: float) -> bool:
    return bool(found) and bool(np.mean(np.min([np.abs(s.distance(points)) for s, _ in found], axis=0) <= tolerance) >= TOLD)


def _needed(found: list[_Told], tolerance: float) -> list[_Told]:
    """Without those whose points lie on larger ones: a corner that the reconstruction rounds looks between its sides."""
    kept: list[_Told] = []
    for surface, used in sorted(found, key=lambda told: -len(told[1])):
        if not kept or np.mean(np.min([np.abs(s.distance(used)) for s, _ in kept], axis=0) <= tolerance) < WITHIN:
            kept.append((surface, used))
    return kept


def _alike(near: Near, rows: IntArray, sideways: FloatArray) -> list[tuple[FloatArray, list[IntArray]]]:
    """The straight pieces of a rim by the way they look: noise may part what is one."""
    out: list[tuple[FloatArray, list[IntArray]]] = []
    for members, way in sorted(_straight(near, rows, sideways), key=lambda found: -len(found[0])):
        home = next((parts for other, parts in out if other @ way > ALONG), None)
        if home is None:
            out.append((way, [members]))
        else:
            home.append(members)
    return out


def _straight(near: Near, rows: IntArray, sideways: FloatArray) -> Iterator[tuple[IntArray, FloatArray]]:
    """Connected faces that look one way, and that way, those first that begin at a face square to the walls.

    sideways : (k, 3) the part of the normals of the faces that lies along the walls.
    """
    length = np.linalg.norm(sideways, axis=1)
    unit, weight = np.zeros((len(near.areas), 3)), np.zeros(len(near.areas))
    unit[rows] = sideways / np.maximum(length, 1e-300)[:, None]
    weight[rows] = near.areas[rows] * length
    free: BoolArray = np.zeros(len(near.areas), bool)
    free[rows[length > SIDEWAYS]] = True
    for seed in rows[np.argsort(-length, kind="stable")].tolist():
        if not free[seed]:
            continue
        way = unit[seed]
        for _ in range(ROUNDS):
            inside: BoolArray = np.zeros(len(free), bool)
            inside[seed] = True
            front = np.array([seed])
            while len(front):
                front = near.ring(inside, front)
                front = front[free[front] & (unit[front] @ way > ALONG)]
                inside[front] = True
            mean = weight[inside] @ unit[inside]
            way = mean / np.linalg.norm(mean)
        free &= ~inside
        yield np.flatnonzero(inside), way


def _plane(points: FloatArray, way: FloatArray, normal: FloatArray | None, height: FloatArray, tolerance: float) -> _Told | None:
    """The plane square to the walls that holds some points, and these; None where they refuse that it is square, as those of a bevel do.

    normal : of the walls; None where the plane is square to `way` itself.   height : (n,) of the points, from wall to wall.
    """
    used: BoolArray = np.ones(len(points), bool)
    axis, middle = way, np.zeros(3)
    for _ in range(ROUNDS):
        if used.sum() < LEAST_POINTS:
            return None
        middle = points[used].mean(0)
        if normal is not None:
            along = np.cross(normal, way)
            t, o = (points[used] - middle) @ along, (points[used] - middle) @ way
            if np.ptp(t) > LEANS * np.ptp(height):
                axis = way - float(t @ o) / float(t @ t) * along
                axis = axis / np.linalg.norm(axis)
        off = (points - middle) @ axis
        middle = middle + float(np.median(off[used])) * axis
        used = np.abs((points - middle) @ axis) <= tolerance
    if used.sum() < max(LEAST_POINTS, TOLD * len(points)):
        return None
    off, up = (points[used] - middle) @ axis, height[used] - height[used].mean()
    sigma, spread = float(np.std(off)), float(np.linalg.norm(up))
    if abs(float(up @ off)) > CLIP * sigma * spread:
        return None
    return Surface(kind=PLANE, point=points[used].mean(0), axis=axis, rms_m=sigma), points[used]


def _round(points: FloatArray, normals: FloatArray, axis: FloatArray, tolerance: float) -> list[_Told]:
    """The cylinder square to the walls that holds the points of a whole rim, and these; none where they turn no farther than a plane's do."""
    surface = about_axis(points, normals, axis)
    free = np.array([True, True, False, False, True])  # not the axis
    for _ in range(ROUNDS):
        used = points if surface is None else points[np.abs(surface.distance(points)) <= CLIP * tolerance]
        surface = None if surface is None or len(used) < LEAST_POINTS else fitted(surface, used, free=free)
    if surface is None:
        return []
    looks = surface.normals(points)
    if float((looks @ looks[0]).min()) > ALONG:
        return []
    return [(surface, points[np.abs(surface.distance(points)) <= tolerance])]
