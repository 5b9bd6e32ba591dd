"""Which faces of a surface lie on which plane, cylinder, cone or sphere: every kind grown from seeds, the largest kept, the simplest of equals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.cad.competing import competed
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.surface_fit import flood
from scan2fea.kernel.surfaces import CONE, CYLINDER, PLANE, SPHERE, Surface, fit_surface, fitted
from scan2fea.kernel.topology import edge_table, face_components
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

SEED_WAVES = 4  # rings of faces round a seed for the first fit
LEAST_FACES = 8
GROW_COSINE = float(np.cos(np.radians(30.0)))  # smoothed normals of an edge of the mesh turn by up to half its dihedral angle
FLAT_RAD = 0.15  # normals that turn by less over a whole region are those of a plane as far as noise lets tell
SIMPLER = 0.93  # a simpler kind wins with this share of the area of the largest
KINDS = (PLANE, CYLINDER, SPHERE, CONE)
FAILED_WAVES = 2  # rings round a seed without a surface that are not tried again


@dataclass(frozen=True, eq=False, kw_only=True)
class Patches(Value):
    """label : (m,) number of the surface of each face, -1 free form.   surfaces : one per number, as fitted to the vertices."""

    label: IntArray
    surfaces: tuple[Surface, ...]


class Near:
    """Neighbours of the faces of a closed manifold mesh, their areas, and normals averaged over rings."""

    def __init__(self, mesh: TriangleMesh, rounds: int = 2) -> None:
        self.mesh = mesh
        self.plain = np.array(mesh.vertices, float), np.array(mesh.faces, np.int64)  # as the kernels want them
        self.table = edge_table(mesh.faces)
        self.of = self.table.twin.reshape(-1, 3) // 3
        self.areas = face_areas(mesh)
        self.normals = face_normals(mesh)
        smooth = self.normals
        for _ in range(rounds):
            stacked = np.concatenate([smooth[:, None], smooth[self.of]], axis=1)
            weight = np.concatenate([self.areas[:, None], self.areas[self.of]], axis=1)
            # neighbours across a crease say nothing of this face
            weight = weight * (np.einsum("fc,fkc->fk", smooth, stacked) > 0.5)
            smooth = (stacked * weight[..., None]).sum(1)
            smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-300)
        self.smooth = smooth
        self.centres = mesh.vertices[mesh.faces].mean(1)

    def ring(self, inside: BoolArray, front: IntArray) -> IntArray:
        """Faces next to `front` that are not yet inside."""
        near = np.unique(self.of[front])
        return np.asarray(near[~inside[near]])

    def flood(self, inside: BoolArray, surface: Surface, tolerance: float, free: BoolArray, most: int) -> bool:
        """Spread `inside` over free neighbours that lie on the surface, until they are more than `most`; was there more to come?"""
        code, packed = surface.packed()
        mesh = self.plain
        return flood(
            code, packed, float(surface.sense), tolerance, GROW_COSINE, *mesh, self.of, self.centres, self.smooth, free, inside, most
        )  # fmt: skip

    def corners(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """The corners of some faces, and the mean normal of these faces there."""
        used, index = np.unique(self.mesh.faces[rows], return_inverse=True)
        normals = np.stack([np.bincount(index.ravel(), weights=np.repeat(self.smooth[rows, k], 3)) for k in range(3)], axis=1).astype(float)
        return self.mesh.vertices[used], normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)

    def around(self, seed: int, free: BoolArray, waves: int = SEED_WAVES) -> IntArray:
        """The free faces within some rings of a seed that turn gradually."""
        inside = np.zeros(len(self.areas), bool)
        inside[seed] = True
        front = np.array([seed])
        for _ in range(waves):
            front = self.ring(inside, front)
            front = front[free[front] & (self.smooth[front] @ self.smooth[seed] > 0.3)]
            inside[front] = True
        return np.flatnonzero(inside)


def segmented(mesh: TriangleMesh, tolerance_m: float, known: Sequence[Surface] = ()) -> Patches:
    """The surfaces of a closed manifold mesh whose vertices lie within `tolerance_m` of them. Planes of `mesh.face_region` are believed.

    known : surfaces that are taken before any other, wherever faces lie on them.
    """
    near = Near(mesh)
    label, surfaces = _given(mesh, near)
    for surface in known:
        free = np.flatnonzero(label < 0)
        label[free[_fits(near, free, surface, tolerance_m)]] = len(surfaces)
        surfaces.append(surface)
    n_known = len(surfaces)
    turn = 1 - np.einsum("fc,fkc->fk", near.smooth, near.smooth[near.of]).min(1)
    tried = np.zeros(len(mesh.faces), bool)
    for seed in np.argsort(turn, kind="stable").tolist():
        if label[seed] >= 0 or tried[seed]:
            continue
        found = _best(near, seed, label < 0, tolerance_m)
        if found is None:
            tried[near.around(seed, label < 0, FAILED_WAVES)] = True
            continue
        rows, surface = found
        label[rows] = len(surfaces)
        surfaces.append(surface)
    return _merged(near, label, surfaces, tolerance_m, n_known)


def _given(mesh: TriangleMesh, near: Near) -> tuple[IntArray, list[Surface]]:
    """The planes of the remeshing, one per region."""
    label = np.full(len(mesh.faces), -1, np.int64)
    surfaces: list[Surface] = []
    if mesh.face_region is None:
        return label, surfaces
    for region in np.unique(mesh.face_region[mesh.face_region >= 0]).tolist():
        rows = np.flatnonzero(mesh.face_region == region)
        fit = fit_surface(PLANE, mesh.vertices[np.unique(mesh.faces[rows])], near.normals[rows])
        if fit is not None:
            label[rows] = len(surfaces)
            surfaces.append(fit)
    return label, surfaces


def _best(near: Near, seed: int, free: BoolArray, tolerance: float) -> tuple[IntArray, Surface] | None:
    """The largest region that a surface of any kind grows to from a seed."""
    start = near.around(seed, free)
    if len(start) < LEAST_FACES:
        return None
    found = {kind: region for kind in KINDS if (region := _grown(near, start, free, kind, tolerance)) is not None}
    if not found:
        return None
    largest = max((region[0] for region in found.values()), key=lambda rows: float(near.areas[rows].sum()))
    for kind in KINDS:  # few faces hardly bend: what noise hides there (a cone from a ball) the largest region tells
        wider = _grown(near, largest, free, kind, tolerance) if len(largest) > 2 * len(start) else None
        if wider is not None and (kind not in found or near.areas[wider[0]].sum() > near.areas[found[kind][0]].sum()):
            found[kind] = wider
    area = {kind: float(near.areas[region[0]].sum()) for kind, region in found.items()}
    return next(found[kind] for kind in KINDS if kind in found and area[kind] >= SIMPLER * max(area.values()))


def _fit(near: Near, rows: IntArray, kind: str, start: Surface | None) -> Surface | None:
    """The surface of the vertices of some faces, each vertex with the mean normal of its faces there."""
    points, normals = near.corners(rows)
    return fit_surface(kind, points, normals) if start is None else fitted(start, points)


def _fits(near: Near, rows: IntArray, surface: Surface, tolerance: float) -> BoolArray:
    """Which faces have all corners on the surface and look its way."""
    corners = near.mesh.vertices[near.mesh.faces[rows]]
    off = np.abs(surface.distance(corners.reshape(-1, 3))).reshape(-1, 3).max(1)
    facing = np.einsum("ij,ij->i", surface.normals(near.centres[rows]), near.smooth[rows])
    return np.asarray((off <= tolerance) & (facing > GROW_COSINE))


def _grown(near: Near, start: IntArray, free: BoolArray, kind: str, tolerance: float) -> tuple[IntArray, Surface] | None:
    """Grow, fit again, until nothing is gained. None where the kind does not hold the start, or bends too little to be told from a plane."""
    surface = _fit(near, start, kind, None)
    size = 0
    rows = start
    for _ in range(40):
        if surface is None:
            return None
        kept = start[_fits(near, start, surface, tolerance)]
        if len(kept) < 0.6 * len(start):
            return None
        inside = np.zeros(len(near.areas), bool)
        inside[kept] = True
        more = near.flood(inside, surface, tolerance, free, 2 * max(size, len(start)))
        rows = np.flatnonzero(inside)
        if len(rows) <= 1.01 * size and not more:
            break
        size = max(size, len(rows))
        # few faces round a seed hardly bend: the first guess is made again while the region is small
        again = _fit(near, rows, kind, None)
        surface = again if again is not None else _fit(near, rows, kind, surface)
    if surface is None or len(rows) < LEAST_FACES or not is_bent(near, rows, surface):
        return None
    return rows, surface


def is_bent(near: Near, rows: IntArray, surface: Surface) -> bool:
    """Does a round surface turn enough to be one?"""
    if surface.kind == PLANE:
        return True
    normals = surface.normals(near.centres[rows])
    spread = np.linalg.svd(normals - normals.mean(0), compute_uv=False) / np.sqrt(len(rows))
    least = spread[0] if surface.kind == CYLINDER else spread[1]
    if surface.kind == CONE:
        return bool(spread[0] > FLAT_RAD and abs(surface.second) > np.radians(2.0))
    return bool(least > FLAT_RAD / 2)


def _merged(near: Near, label: IntArray, surfaces: list[Surface], tolerance: float, n_known: int) -> Patches:
    """Regions that are one surface joined, stray faces given to a neighbour they lie on, pieces that do not touch numbered apart.

    n_known : surfaces, the first ones, that were given.
    """
    label = label.copy()
    _join(near, label, surfaces, tolerance)
    label, surfaces = competed(near.mesh, near.of, near.smooth, label, surfaces, n_known)
    _join(near, label, surfaces, tolerance)
    for _ in range(12):
        front = np.flatnonzero((label < 0) & (label[near.of] >= 0).any(1))
        changed = False
        for side in range(3):
            k = label[near.of[front, side]]
            for number in np.unique(k[k >= 0]).tolist():
                rows = front[(k == number) & (label[front] < 0)]
                take = rows[_fits(near, rows, surfaces[number], tolerance)] if len(rows) else rows
                label[take] = number
                changed |= bool(len(take))
        if not changed:
            break
    same = label[near.table.twin // 3] == np.repeat(label, 3)
    joined = np.zeros(len(near.table.edges), bool)
    joined[near.table.edge_of[same]] = True
    _, part = face_components(near.mesh.faces, joined)
    out = np.full(len(label), -1, np.int64)
    kept: list[Surface] = []
    for piece in np.unique(part[label >= 0]).tolist():
        rows = np.flatnonzero(part == piece)
        if len(rows) >= 2:
            out[rows] = len(kept)
            kept.append(surfaces[label[rows[0]]])
    return Patches(label=out, surfaces=tuple(kept))


def _join(near: Near, label: IntArray, surfaces: list[Surface], tolerance: float) -> None:
    """Neighbouring regions of one surface become one, where the larger's surface (or one through both) holds the smaller."""
    while True:
        a, b = label[near.table.twin // 3], np.repeat(label, 3)
        pairs = np.unique(np.stack([a, b], axis=1)[(a < b) & (a >= 0)], axis=0)
        done = True
        for i, j in pairs.tolist():
            big, small = (i, j) if near.areas[label == i].sum() >= near.areas[label == j].sum() else (j, i)
            rows = np.flatnonzero(label == small)
            if _fits(near, rows, surfaces[big], tolerance).mean() < 0.9:
                continue
            label[rows] = big
            both = _fit(near, np.flatnonzero(label == big), surfaces[big].kind, surfaces[big])
            surfaces[big] = both if both is not None else surfaces[big]
            done = False
            break
        if done:
            return
