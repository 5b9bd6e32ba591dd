"""What the patches of a surface are worth: roundings of creases given up, free form told, and how far each surface may be drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scan2fea.cad.patches import Near, Patches
from scan2fea.kernel.coverage import is_unmeasured
from scan2fea.kernel.measures import extent, face_areas
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.surfaces import PLANE, Surface
from scan2fea.kernel.topology import edge_table, face_components
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

ALIKE = float(np.cos(np.radians(2.0)))  # planes turned by less are one where they lie together
MEETS = 0.94  # cosine of normals: surfaces nearer to parallel do not meet in a crease
BETWEEN = float(np.sin(np.radians(30.0)))  # farther out of the cone of its neighbours' normals a patch is no rounding between them
MOST_OF_ONE = 2.0  # the middle between two normals is their sum times 1 / (2 cos(angle / 2)): 150 degrees apart
LEAST_TOLD, MOST_TOLD = 12, 0.2  # points, and the share of them off the faces beside it, that tell a narrow face: of a crease one in 100 does
SMALL_TURN = 0.1  # of its area: the sum of the normals of a patch that goes all the way round

Told = tuple[FloatArray, IntArray, float]


def without_roundings(
    mesh: TriangleMesh, patches: Patches, reach_m: float, known: Sequence[Surface] = (), told: Told | None = None
) -> Patches:
    """Patches along creases, where the surface is rounded by the noise, given up: the smallest first, where every corner lies within reach of two
    surfaces next to it that meet at an angle there. The wall of a hole in a thin plate is near two surfaces too, but these do not meet.
    Those on `known` planes stay, and flat faces and whole turns that the points ask for.

    told : the measured points, the face of the mesh next to each, and how far a point lies off its own surface at most.
    """
    near, label = Near(mesh, 0), patches.label.copy()
    area = np.bincount(label[label >= 0], weights=near.areas[label >= 0], minlength=len(patches.surfaces))
    for number in np.argsort(area, kind="stable").tolist():
        rows = np.flatnonzero(label == number)
        if not len(rows) or area[number] > 0.02 * near.areas.sum() or any(_same_plane(patches.surfaces[number], k, reach_m) for k in known):
            continue
        if _is_rounding(near, patches.surfaces, label, rows, reach_m) and not _is_told(near, patches.surfaces, label, rows, told):
            label[rows] = -1
    kept = np.unique(label[label >= 0])
    packed = np.full(len(patches.surfaces) + 1, -1, np.int64)
    packed[kept] = np.arange(len(kept))
    return Patches(label=packed[label], surfaces=tuple(patches.surfaces[k] for k in kept))


def _same_plane(surface: Surface, known: Surface, reach: float) -> bool:
    turned = float(surface.axis @ known.axis) > ALIKE
    return surface.kind == known.kind == PLANE and turned and abs(float(known.distance(surface.point[None])[0])) <= reach


def beside(near: Near, label: IntArray, rows: IntArray) -> list[int]:
    """The surfaces next to some faces, or across free form from them."""
    inside = np.zeros(len(label), bool)
    inside[rows] = True
    front, names = rows, set()  # type: tuple[IntArray, set[int]]
    while len(front):
        front = near.ring(inside, front)
        names.update(label[front][label[front] >= 0].tolist())
        front = front[label[front] < 0]
        inside[front] = True
    return sorted(names)


def _is_rounding(near: Near, surfaces: tuple[Surface, ...], label: IntArray, rows: IntArray, reach: float) -> bool:
    """rows : the faces of one patch."""
    names = beside(near, label, rows)
    if len(names) < 2:
        return False
    used = np.unique(near.mesh.faces[rows])
    corners = near.mesh.vertices[used]
    if _depth(near, rows, used) > reach:
        return False  # wider than the noise and the spacing round any crease, however near it passes to other surfaces
    close = np.array([np.abs(surfaces[k].distance(corners)) <= reach for k in names])
    normal = np.stack([surfaces[k].normals(corners) for k in names])
    meets = np.zeros(len(corners), bool)
    for i in range(len(names)):
        for j in range(i):
            angled = np.abs(np.einsum("vc,vc->v", normal[i], normal[j])) < MEETS
            meets |= close[i] & close[j] & angled
    if not meets.all():
        return False
    if float(near.areas[rows].sum()) <= reach**2:
        return True  # smaller than a rounding is wide: what it looks at is chance
    within = names + [
        k for k in _around(near, label, rows, corners, 2 * reach) if k not in names and float(np.abs(surfaces[k].distance(corners)).min()) <= reach
    ]  # the third face of a corner need not touch what is left of its rounding
    return _is_between(near, rows, np.stack([surfaces[k].normals(corners) for k in within]))


def _is_told(near: Near, surfaces: tuple[Surface, ...], label: IntArray, rows: IntArray, told: Told | None) -> bool:
    """Whether many points of a patch lie on it and on no surface beside it: those of a rounded crease lie on one of these. Of round patches only such
    as go all the way round: less of a turn may be a fillet, which cells cannot cut.
    """
    number = int(label[rows[0]])
    whole = float(np.linalg.norm(near.areas[rows] @ near.normals[rows])) < SMALL_TURN * float(near.areas[rows].sum())
    if told is None or (surfaces[number].kind != PLANE and not whole):
        return False
    points, face, tolerance = told
    own = points[np.isin(face, rows)]
    if len(own) < LEAST_TOLD:
        return False
    off = np.min([np.abs(surfaces[k].distance(own)) for k in beside(near, label, rows)], axis=0)
    return bool(np.mean((off > tolerance) & (np.abs(surfaces[number].distance(own)) <= tolerance)) > MOST_TOLD)


def _around(near: Near, label: IntArray, rows: IntArray, corners: FloatArray, far: float) -> list[int]:
    """The other patches that come within `far` of the corners of one: a plane that goes on there, the foot of another leg, is not near."""
    from scipy.spatial import cKDTree

    inside = np.asarray(cKDTree(corners).query(near.mesh.vertices, distance_upper_bound=far)[0]) <= far
    names = np.unique(label[inside[near.mesh.faces].any(1)])
    return [k for k in names.tolist() if k >= 0 and k != label[rows[0]]]


def _depth(near: Near, rows: IntArray, used: IntArray) -> float:
    """How far the middle of some faces, whose corners are `used`, lies from their border; infinite where they have none."""
    inside = np.zeros(len(near.areas), bool)
    inside[rows] = True
    half = (3 * rows[:, None] + np.arange(3)).ravel()
    rim = near.table.edge_of[half[~inside[near.table.twin[half] // 3]]]
    if not len(rim):
        return float("inf")
    at = near.mesh.vertices
    return float(k_nearest(at[np.unique(near.table.edges[rim])], 1, at[used])[0].max())


def _is_between(near: Near, rows: IntArray, beside: FloatArray) -> bool:
    """Does the patch look between the surfaces beside it ((k, v, 3) their normals there)? A rounding does; the small end of a leg does not,
    though of walls that look opposite ways by next to 180 degrees a large enough multiple looks any way.
    """
    from scipy.optimize import lsq_linear

    own = near.areas[rows] @ near.normals[rows]
    length = float(np.linalg.norm(own))
    if length < SMALL_TURN * near.areas[rows].sum():
        return True  # looks all ways
    best = lsq_linear(beside.mean(1).T, own / length, bounds=(0.0, MOST_OF_ONE))
    return bool(np.sqrt(2 * best.cost) < BETWEEN)


def inner_faces(mesh: TriangleMesh, label: IntArray) -> BoolArray:
    """(m,) faces none of whose corners another region or free form shares."""
    table = edge_table(mesh.faces)
    border = label[table.twin // 3] != np.repeat(label, 3)
    ends = table.edges[table.edge_of[border]]
    on_border = np.zeros(len(mesh.vertices), bool)
    on_border[ends.ravel()] = True
    return np.asarray(~on_border[mesh.faces].any(1))


def smooth_share(mesh: TriangleMesh, patches: Patches) -> float:
    """Share of the length of all borders of patches along which two of them lie side by side and hardly meet at an angle: they cannot be cut with
    each other. Pieces of free form lie like this, and nowhere else do many.
    """
    table = edge_table(mesh.faces)
    own, other = np.repeat(patches.label, 3), patches.label[table.twin // 3]
    tail, head = mesh.vertices[mesh.faces.ravel()], mesh.vertices[np.roll(mesh.faces, -1, axis=1).ravel()]
    length = np.linalg.norm(head - tail, axis=1)
    open_length = float(length[(own >= 0) & (other < 0)].sum()) / 2  # the other side of the free form is a border again
    half = np.flatnonzero((own >= 0) & (other > own))
    turn = np.ones(len(half))
    pair = own[half] * len(patches.surfaces) + other[half]
    for code in np.unique(pair).tolist():
        rows = np.flatnonzero(pair == code)
        middle = (tail[half[rows]] + head[half[rows]]) / 2
        first, second = (patches.surfaces[k].normals(middle) for k in divmod(code, len(patches.surfaces)))
        turn[rows] = np.einsum("ij,ij->i", first, second)
    total = float(length[half].sum()) + open_length
    return float(length[half][turn > MEETS].sum()) / total if total else 0.0


def widened(mesh: TriangleMesh, patches: Patches, surfaces: Sequence[Surface], reach_m: float) -> list[IntArray]:
    """Of each surface the vertices of its patch and of the free form next to it that looks its way within `reach_m`: as far as it may be drawn."""
    near = Near(mesh)
    out = []
    for number, surface in enumerate(surfaces):
        inside = patches.label == number
        near.flood(inside, surface, reach_m, patches.label < 0, len(inside))
        out.append(np.unique(mesh.faces[inside]))
    return out


def free_share(mesh: TriangleMesh, patches: Patches) -> float:
    """Share of the area that lies on no surface."""
    areas = face_areas(mesh)
    return float(areas[patches.label < 0].sum() / areas.sum())


def unexplained(mesh: TriangleMesh, patches: Patches, reach_m: float, face: IntArray | None = None, density: float = 0.0) -> float:
    """Share of the area whose faces reach farther than `reach_m` from every surface next to their free-form part: not the rounding of a crease.

    face : of each measured point, and their density per m2: free form that nobody measured need not be explained.
    """
    free = np.flatnonzero(patches.label < 0)
    if not len(free):
        return 0.0
    areas, near = face_areas(mesh), Near(mesh, 0)
    n, part = face_components(mesh.faces[free])
    lost = 0.0
    count = np.zeros(len(areas), np.int64) if face is None else np.bincount(face, minlength=len(areas))
    for number in range(n):
        rows = free[part == number]
        if is_unmeasured(float(areas[rows].sum()), int(count[rows].sum()), density):
            continue
        names = np.unique(patches.label[near.of[rows]])
        names = names[names >= 0]
        corners = mesh.vertices[mesh.faces[rows]].reshape(-1, 3)
        off = np.min([np.abs(patches.surfaces[k].distance(corners)) for k in names], axis=0) if len(names) else np.full(len(corners), extent(corners))
        lost += float(areas[rows[off.reshape(-1, 3).max(1) > reach_m]].sum())
    return lost / float(areas.sum())
