"""Walls that lie on no plane, cylinder, cone or sphere, as sheets of triangles that cells are cut by like any face.

A sheet is the surface there, led a little way through the true faces beside it: its outermost corners are moved beyond them, and those next to these
kept on the wall's own side, so that it crosses each of them once, within its last row of triangles, at an angle or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from scan2fea.cad.live import pnt
from scan2fea.cad.patches import Near, Patches
from scan2fea.cad.roundings import MEETS, beside
from scan2fea.kernel.surfaces import CYLINDER, PLANE, Surface
from scan2fea.kernel.topology import edge_table, face_components
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

MOST_TRIANGLES = 1_500  # of all sheets: 2,000 take 10 CPU s to cut with
MOST_AREA = 0.5  # of the surface: a body that is mostly free form is one
RINGS = 2  # next to the border, whose corners are kept on the wall's side
STEPS = 4  # of Newton's iteration to the place beyond round faces
TOUCHES = 1e-6  # relative
FLATTER = float(np.cos(np.radians(30.0)))
FACET = "facet"
SMOOTH_SHARE = 0.5  # of a border between two patches, without an angle: they cannot be cut with each other


def walls_of(mesh: TriangleMesh, patches: Patches, reach: float) -> list[IntArray]:
    """The faces of each wall: patches that lie side by side without an angle and do not touch exactly, free form that reaches farther than `reach`
    from every surface beside it, small patches that pass into these, and the strip around.
    """
    near = Near(mesh, 0)
    label = patches.label.copy()
    dropped = np.zeros(len(label), bool)
    more = np.isin(label, sorted(_smooth_groups(mesh, patches)))
    while True:
        dropped |= more
        label[more] = -1
        is_wall = dropped | _far(near, label, patches.surfaces, reach)
        more = _pieces(near, label, patches.surfaces, is_wall)
        if not more.any():
            break
    edge = float(np.median(np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)))
    for _ in range(RINGS + int(np.ceil(reach / edge)) if is_wall.any() else 0):
        is_wall |= (label < 0) & is_wall[near.of].any(1)
    rows = np.flatnonzero(is_wall)
    n, part = face_components(mesh.faces[rows]) if len(rows) else (0, rows)
    return [rows[part == number] for number in range(n)]


def beyond(mesh: TriangleMesh, patches: Patches, reach: float) -> BoolArray:
    """(m,) faces of free form that reaches farther than `reach` from every surface beside it."""
    return _far(Near(mesh, 0), patches.label, patches.surfaces, reach)


def _far(near: Near, label: IntArray, surfaces: Sequence[Surface], reach: float) -> BoolArray:
    """(m,) faces on no surface with a corner farther than `reach` from each that is beside their part of the free form."""
    out = np.zeros(len(label), bool)
    free = np.flatnonzero(label < 0)
    n, part = face_components(near.mesh.faces[free]) if len(free) else (0, free)
    for number in range(n):
        rows = free[part == number]
        corners = near.mesh.vertices[near.mesh.faces[rows]].reshape(-1, 3)
        names = beside(near, label, rows)
        off = np.min([np.abs(surfaces[k].distance(corners)) for k in names], axis=0) if names else np.full(len(corners), np.inf)
        out[rows[off.reshape(-1, 3).max(1) > reach]] = True
    return out


def _pieces(near: Near, label: IntArray, surfaces: Sequence[Surface], is_wall: BoolArray) -> BoolArray:
    """(m,) faces of the patches smaller than the walls that pass into these without an angle along most of their border: pieces of them."""
    out = np.zeros(len(is_wall), bool)
    area = float(near.areas[is_wall].sum())
    for k, surface in enumerate(surfaces):
        rows = np.flatnonzero(label == k)
        if not len(rows) or near.areas[rows].sum() > area:
            continue
        beyond = near.of[rows]
        border = label[beyond] != k
        free = border & (label[beyond] < 0)
        at = beyond[free]
        if len(at) and (np.einsum("ij,ij->i", surface.normals(near.centres[at]), near.normals[at]) > FLATTER).sum() > SMOOTH_SHARE * border.sum():
            out[rows] = True
    return out


def _touch_exactly(a: Surface, b: Surface) -> bool:
    """Whether a cylinder was made to touch a plane: faces that end there on both sides can be cut."""
    flat, round_one = (a, b) if a.kind == PLANE else (b, a)
    if (flat.kind, round_one.kind) != (PLANE, CYLINDER):
        return False
    height = abs(float((round_one.point - flat.point) @ flat.axis))
    return abs(height - round_one.radius) <= TOUCHES * round_one.radius and abs(float(round_one.axis @ flat.axis)) < TOUCHES


def _smooth_groups(mesh: TriangleMesh, patches: Patches) -> set[int]:
    """Patches with a neighbour that they pass into without an angle along most of their common border, though they were not made to touch."""
    table = edge_table(mesh.faces)
    own, other = np.repeat(patches.label, 3), patches.label[table.twin // 3]
    tail, head = mesh.vertices[mesh.faces.ravel()], mesh.vertices[np.roll(mesh.faces, -1, axis=1).ravel()]
    half = np.flatnonzero((own >= 0) & (other > own))
    length = np.linalg.norm(head - tail, axis=1)[half]
    code = own[half] * len(patches.surfaces) + other[half]
    out: set[int] = set()
    for pair in np.unique(code).tolist():
        a, b = divmod(pair, len(patches.surfaces))
        rows = code == pair
        middle = (tail[half[rows]] + head[half[rows]]) / 2
        turn = np.einsum("ij,ij->i", patches.surfaces[a].normals(middle), patches.surfaces[b].normals(middle))
        is_smooth = length[rows][turn > MEETS].sum() > SMOOTH_SHARE * length[rows].sum()
        if is_smooth and not _touch_exactly(patches.surfaces[a], patches.surfaces[b]):
            out |= {a, b}
    return out


def without_walls(patches: Patches, walls: Sequence[IntArray]) -> Patches:
    """The patches that are on no wall."""
    label = patches.label.copy()
    for rows in walls:
        label[rows] = -1
    kept = np.unique(label[label >= 0])
    packed = np.full(len(patches.surfaces) + 1, -1, np.int64)
    packed[kept] = np.arange(len(kept))
    return Patches(label=packed[label], surfaces=tuple(patches.surfaces[k] for k in kept))


def sheet(mesh_mm: TriangleMesh, rows: IntArray, label: IntArray, surfaces: Sequence[Surface], tolerance: float, reach: float) -> TriangleMesh:
    """The triangles of a wall, led through the surfaces beside it. label : of all faces, -1 on walls.   surfaces : in millimetres."""
    near = Near(mesh_mm, 0)
    at = np.array(mesh_mm.vertices, float)
    inside = np.zeros(len(mesh_mm.faces), bool)
    inside[rows] = True
    own, outside = np.zeros(len(at), bool), np.zeros(len(at), bool)
    own[mesh_mm.faces[inside].ravel()] = True
    outside[mesh_mm.faces[~inside].ravel()] = True
    names = beside(near, np.where(inside, -2, label), rows)
    border = own & outside
    side: dict[int, tuple[BoolArray, float]] = {}
    for k in names:
        touched = np.zeros(len(at), bool)
        touched[mesh_mm.faces[label == k].ravel()] = True
        loose = border & ~_touched_by_any(mesh_mm, label)
        off = np.abs(surfaces[k].distance(at))
        mine = border & (touched & (off <= 2 * tolerance + reach) | (loose & (off <= reach)) | (off <= tolerance))
        ring = _rings(mesh_mm, inside, mine) & ~border
        if mine.any() and ring.any():
            side[k] = mine, float(np.sign(surfaces[k].distance(at[ring]).sum()) or 1.0)
    _closed(mesh_mm.faces[inside], border, side)
    for _ in range(STEPS):
        _pushed(at, side, surfaces, tolerance)
    for k, (mine, sign) in side.items():
        own_side = np.flatnonzero(_rings(mesh_mm, inside, mine) & ~border)
        short = np.maximum(tolerance / 3 - sign * surfaces[k].distance(at[own_side]), 0.0)
        at[own_side] += (sign * short)[:, None] * surfaces[k].normals(at[own_side])
    used, packed = np.unique(mesh_mm.faces[inside], return_inverse=True)
    return TriangleMesh(vertices=at[used], faces=packed.reshape(-1, 3).astype(np.int64))


def _closed(faces: IntArray, border: BoolArray, side: dict[int, tuple[BoolArray, float]]) -> None:
    """Both ends of each edge at the border of a sheet are to lie beyond one surface; where they have none in common, beyond all that either has."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, uses = np.unique(edges, axis=0, return_counts=True)
    edges = edges[(uses == 1) & border[edges].all(1)]
    if not side or not len(edges):
        return
    masks = np.array([mine for mine, _ in side.values()])
    for _ in range(STEPS):
        apart = ~(masks[:, edges[:, 0]] & masks[:, edges[:, 1]]).any(0)
        if not apart.any():
            break
        for a, b in edges[apart].tolist():
            masks[:, a] = masks[:, b] = masks[:, a] | masks[:, b]
    for mine, mask in zip((mine for mine, _ in side.values()), masks, strict=True):
        mine[:] = mask


def _touched_by_any(mesh: TriangleMesh, label: IntArray) -> BoolArray:
    out = np.zeros(len(mesh.vertices), bool)
    out[mesh.faces[label >= 0].ravel()] = True
    return out


def _rings(mesh: TriangleMesh, inside: BoolArray, start: BoolArray) -> BoolArray:
    """(n,) corners of the wall within RINGS of some."""
    found = start.copy()
    faces = mesh.faces[inside]
    for _ in range(RINGS):
        found[faces[found[faces].any(1)].ravel()] = True
    return found


def _pushed(at: FloatArray, side: dict[int, tuple[BoolArray, float]], surfaces: Sequence[Surface], beyond: float) -> None:
    """Move every corner of the border by the shortest way to where it lies `beyond` the surfaces that it borders on."""
    for v in np.flatnonzero(np.any([mine for mine, _ in side.values()], axis=0) if side else np.zeros(0, bool)).tolist():
        ks = [k for k, (mine, _) in side.items() if mine[v]]
        normal = np.array([surfaces[k].normals(at[v : v + 1])[0] for k in ks])
        short = np.array([-side[k][1] * beyond - surfaces[k].distance(at[v : v + 1])[0] for k in ks])
        at[v] += np.linalg.lstsq(normal, short, rcond=0.1)[0]


def sewn_sheet(found: TriangleMesh) -> Any:
    """The plane faces of the triangles, edges shared."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakePolygon, BRepBuilderAPI_Sewing

    sewing = BRepBuilderAPI_Sewing(1e-6)
    for corners in found.vertices[found.faces]:
        if np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) > 0:
            sewing.Add(BRepBuilderAPI_MakeFace(BRepBuilderAPI_MakePolygon(*(pnt(c) for c in corners), True).Wire(), True).Face())
    sewing.Perform()
    return sewing.SewedShape()


def as_facet(found: Surface, drawn: Sequence[Surface]) -> Surface:
    """What a face lies on; a plane that is none of those drawn is a facet of a wall."""
    if found.kind != PLANE:
        return found
    for other in drawn:
        same = other.kind == PLANE and abs(abs(float(other.axis @ found.axis)) - 1) < 1e-9
        if same and abs(float((found.point - other.point) @ other.axis)) < 1e-6 * max(1.0, float(np.abs(found.point).max())):
            return found
    return replace(found, kind=FACET)
