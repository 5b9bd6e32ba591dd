"""Faces of a drawing from its own triangles, whose corners lie on the true surfaces to the last digits: there is no noise to be guessed.

Triangles of one plane are a facet. A cylinder, ball, cone or ring is begun at facets side by side that turn a little, through their corners, and
grown over all facets beside it whose corners lie on it and that are no wider than a step of a curve. What lies on none and bends into nothing else
that lies on none is a plane.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from scan2fea.cad.patches import Patches
from scan2fea.kernel.measures import extent, face_areas, face_normals
from scan2fea.kernel.planar_regions import planar_regions
from scan2fea.kernel.surfaces import CONE, CYLINDER, FREEDOMS, PLANE, SPHERE, TORUS, Surface, fit_surface, fitted
from scan2fea.kernel.topology import edge_table
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

EXACT = 2e-7  # of the size and place: corners of a drawing lie nearer to its surfaces (numbers of four bytes are good to 1e-7)
STEP_DEG = 32.0  # a curve is cut into steps of less
STRAIGHT = 1e-4  # radians
SHARP_DEG = 20.0  # facets of a free form turn by less
BENT = 0.2  # share of the border of a facet without a surface where it turns to others without one: the last strip of a free form has 0.25 and more
LEAST_FACETS = 3  # two lie on the cylinder of any two edges
EVIDENCE = 5  # corners beyond the freedoms of a surface: three strips in thirty of a free wall lie on a cylinder
MOST_TRIANGLES = 20_000
MOST_FAILED = 6_000  # times that a facet begins nothing: a free form
KINDS = (CYLINDER, CONE, SPHERE, TORUS)


class _Facets:
    """The planar pieces of a mesh, numbered by `label` (m,): their corners, normals, centres and areas, and what is across their edges."""

    def __init__(self, mesh: TriangleMesh) -> None:
        regions = planar_regions(mesh).label
        alone = np.flatnonzero(regions < 0)
        named = regions.copy()
        named[alone] = regions.max(initial=-1) + 1 + np.arange(len(alone))
        self.label = np.unique(named, return_inverse=True)[1].ravel()
        n = int(self.label.max()) + 1
        self.points, self.area = mesh.vertices, np.bincount(self.label, weights=face_areas(mesh), minlength=n)
        weighted = face_normals(mesh) * face_areas(mesh)[:, None]
        normal = np.stack([np.bincount(self.label, weights=weighted[:, k], minlength=n) for k in range(3)], axis=1).astype(float)
        self.normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        table = edge_table(mesh.faces)
        own, other = np.repeat(self.label, 3), self.label[table.twin // 3]
        ends = table.edges[table.edge_of]
        length = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
        turn = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", self.normal[own], self.normal[other]), -1.0, 1.0)))
        border = own != other
        self.own, self.other, self.length, self.turn = own[border], other[border], length[border], turn[border]
        self.corners = _corners(mesh, own, border)
        self.centre = np.array([mesh.vertices[c].mean(0) for c in self.corners])
        self.beside: list[list[int]] = [[] for _ in range(n)]
        for a, b in np.unique(np.stack([self.own, self.other], axis=1)[self.turn < STEP_DEG], axis=0).tolist():
            self.beside[a].append(b)

    def ring(self, rows: Collection[int], free: BoolArray) -> list[int]:
        """Some facets and the free ones beside them."""
        return sorted({*rows, *(b for a in rows for b in self.beside[a] if free[b])})

    def vertices(self, rows: Collection[int]) -> IntArray:
        return np.unique(np.concatenate([self.corners[k] for k in rows]))


def _corners(mesh: TriangleMesh, own: IntArray, border: BoolArray) -> list[IntArray]:
    """Of each facet the vertices where its border turns: one between two of these lies on a chord, and not on what was drawn."""
    tail, head = mesh.faces.ravel()[border], np.roll(mesh.faces, -1, axis=1).ravel()[border]
    way = mesh.vertices[head] - mesh.vertices[tail]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    comes, goes = np.lexsort([head, own[border]]), np.lexsort([tail, own[border]])
    place = np.stack([own[border][goes], tail[goes]], axis=1)
    once = np.ones(len(place), bool)
    same = (place[1:] == place[:-1]).all(1)
    once[1:] &= ~same
    once[:-1] &= ~same
    straight = once & (np.linalg.norm(way[comes] - way[goes], axis=1) < STRAIGHT)
    kept = np.unique(place[~straight], axis=0)
    return np.split(kept[:, 1], np.flatnonzero(np.diff(kept[:, 0])) + 1)


def drawn_patches(mesh: TriangleMesh) -> Patches:
    """The surfaces of a closed manifold mesh that was drawn, -1 for what bends and lies on none; no surface where the mesh is none, or too large."""
    if len(mesh.faces) > MOST_TRIANGLES:
        return Patches(label=np.full(len(mesh.faces), -1, np.int64), surfaces=())
    facets = _Facets(mesh)
    tolerance = EXACT * max(extent(mesh.vertices), float(np.abs(mesh.vertices).max()))
    owner = np.full(len(facets.corners), -1, np.int64)
    surfaces: list[Surface] = []
    failed: set[tuple[str, int]] = set()
    while found := _candidates(facets, owner < 0, failed, tolerance):
        for rows, surface in found:  # what more corners ask for comes first
            if (owner[rows] < 0).all():
                owner[rows] = len(surfaces)
                surfaces.append(surface)
    for rows, plane in _planes(facets, owner, tolerance):
        owner[rows] = len(surfaces)
        surfaces.append(plane)
    return Patches(label=owner[facets.label], surfaces=tuple(surfaces))


def _candidates(facets: _Facets, free: BoolArray, failed: set[tuple[str, int]], tolerance: float) -> list[tuple[list[int], Surface]]:
    """Surfaces begun at free facets, of each kind at those that are on none of it so far; those of most corners first, the simplest of equals.

    failed : facets that began none of a kind, entered here: nor will they with less around them. A row of facets round an axis is on a cone and on a
    ball, whatever turned surface it is of: the kinds do not hide each other.
    """
    found: list[tuple[list[int], Surface]] = []
    for kind in KINDS:
        covered = ~free
        for seed in np.argsort([-len(b) for b in facets.beside], kind="stable").tolist():
            if covered[seed] or (kind, seed) in failed or not facets.beside[seed] or len(failed) > MOST_FAILED:
                continue
            best = _best(facets, kind, seed, free, tolerance)
            if best is None:
                failed.add((kind, seed))
                continue
            covered[best[0]] = True
            found.append(best)
    return sorted(found, key=lambda f: -len(facets.vertices(f[0])))


def _planes(facets: _Facets, owner: IntArray, tolerance: float) -> list[tuple[list[int], Surface]]:
    """The facets without a surface, those of one plane together, that do not bend into others without one."""
    group = np.full(len(owner), -1, np.int64)
    found: list[tuple[list[int], Surface]] = []
    for k in np.argsort(-facets.area, kind="stable").tolist():
        if owner[k] >= 0 or group[k] >= 0:
            continue
        flat = Surface(kind=PLANE, point=facets.centre[k], axis=facets.normal[k])
        rows, plane = _spread(facets, [k], flat, (owner < 0) & (group < 0), tolerance) or ([k], flat)
        group[rows] = len(found)
        found.append((rows, plane))
    own, other = group[facets.own], group[facets.other]
    border = (own >= 0) & (own != other)
    total = np.bincount(own[border], weights=facets.length[border], minlength=len(found))
    bends = border & (other >= 0) & (facets.turn < SHARP_DEG)
    bent = np.bincount(own[bends], weights=facets.length[bends], minlength=len(found))
    return [found[k] for k in np.flatnonzero(bent <= BENT * total).tolist()]


def _best(facets: _Facets, kind: str, seed: int, free: BoolArray, tolerance: float) -> tuple[list[int], Surface] | None:
    """The surface of a kind begun at a facet that most corners ask for."""
    best: tuple[list[int], Surface] | None = None
    for rows in _starts(facets, kind, seed, free):
        if best is not None and set(rows) <= set(best[0]):
            continue
        grown = _grown(facets, rows, kind, free, tolerance)
        if grown is not None and (best is None or len(facets.vertices(grown[0])) > len(facets.vertices(best[0]))):
            best = grown
    return best


def _evidence(facets: _Facets, rows: list[int], surface: Surface) -> int:
    """Corners that lie on a surface beyond those that any such surface can be laid through."""
    return len(facets.vertices(rows)) - FREEDOMS[surface.kind]


def _starts(facets: _Facets, kind: str, seed: int, free: BoolArray) -> list[list[int]]:
    """Facets around a seed that may tell a surface of a kind."""
    near = [k for k in facets.beside[seed] if free[k]]
    once = facets.ring([seed], free)
    if kind == CONE:
        return [*(sorted((seed, a, b)) for i, a in enumerate(near) for b in near[i + 1 :]), once]
    twice = facets.ring(once, free)
    if kind == TORUS:
        return [once, twice]
    pairs = [sorted((seed, k)) for k in near]
    return [*pairs, once, twice] if kind == CYLINDER else [*pairs, once]


def _grown(facets: _Facets, rows: list[int], kind: str, free: BoolArray, tolerance: float) -> tuple[list[int], Surface] | None:
    """The surface through the corners of some facets, and all facets that it grows to; None where there is none, or no more than chance gives."""
    first = _first(facets, rows, kind)
    found = None if first is None else _spread(facets, rows, first, free, tolerance)
    return found if found is not None and len(found[0]) >= LEAST_FACETS and _evidence(facets, *found) >= EVIDENCE else None


def _spread(facets: _Facets, rows: list[int], start: Surface, free: BoolArray, tolerance: float) -> tuple[list[int], Surface] | None:
    """Some facets and the free ones beside them that lie on one surface with them, which is fitted again as they become more."""
    surface: Surface | None = start
    while True:
        surface = None if surface is None else fitted(surface, facets.points[facets.vertices(rows)])
        if surface is None or not all(_lies(facets, k, surface, tolerance) for k in rows):
            return None
        inside, front = set(rows), rows
        while front:
            front = [k for k in facets.ring(front, free) if k not in inside and _lies(facets, k, surface, tolerance)]
            inside.update(front)
        if len(inside) == len(rows):
            return rows, surface
        rows = sorted(inside)


def _lies(facets: _Facets, k: int, surface: Surface, tolerance: float) -> bool:
    """Whether a facet has its corners on a surface, and is no wider than a step: neither its corners look another way than it, nor is its middle
    farther off than that of a chord. The disk that a ring touches has its corners on it too.
    """
    corners = facets.points[facets.corners[k]]
    if float(np.abs(surface.distance(corners)).max()) > tolerance:
        return False
    half = np.radians(STEP_DEG / 2**0.5)
    middle = corners.mean(0)
    sag = float(np.abs(surface.distance(middle[None]))[0])
    is_narrow = sag <= np.tan(half / 2) * float(np.linalg.norm(corners - middle, axis=1).max()) + tolerance
    return is_narrow and bool((surface.normals(corners) @ facets.normal[k]).min() > np.cos(half))


def _first(facets: _Facets, rows: list[int], kind: str) -> Surface | None:
    """A surface near some facets."""
    centre, normal = facets.centre[rows], facets.normal[rows]
    if kind == CYLINDER:
        return _tube(facets, rows)
    if kind == TORUS:
        return _ring(facets, rows) if len(rows) >= 6 else None
    if kind == SPHERE:
        return _ball(facets, rows)
    return fit_surface(kind, centre, normal)


def _circle(flat: FloatArray) -> tuple[FloatArray, float] | None:
    """(middle, radius) of a circle or ball through points (n, 2 or 3)."""
    origin = flat.mean(0)
    q = flat - origin
    scale = float(np.abs(q).max(initial=0.0)) or 1.0
    found, _, rank, values = np.linalg.lstsq(np.column_stack([2 * q / scale, np.ones(len(q))]), (q**2).sum(1) / scale**2, rcond=1e-9)
    if rank < q.shape[1] + 1 or values[-1] < 1e-6 * values[0]:
        return None
    middle = scale * found[:-1]
    return origin + middle, float(np.sqrt(max(found[-1] * scale**2 + middle @ middle, 0.0)))


def _sense(points: FloatArray, normals: FloatArray, away: FloatArray) -> int:
    return 1 if float(np.einsum("ij,ij->i", away, normals).sum()) > 0 else -1


def _ball(facets: _Facets, rows: list[int]) -> Surface | None:
    used = facets.points[facets.vertices(rows)]
    found = _circle(used) if len(used) > 4 else None
    if found is None:
        return None
    centre, radius = found
    sense = _sense(facets.centre[rows], facets.normal[rows], facets.centre[rows] - centre)
    return Surface(kind=SPHERE, point=centre, axis=np.array([0.0, 0.0, 1.0]), radius=radius, sense=sense)


def _tube(facets: _Facets, rows: list[int]) -> Surface | None:
    """The cylinder square to the normals of facets, through their corners."""
    axis = np.linalg.eigh(facets.normal[rows].T @ facets.normal[rows])[1][:, 0]
    blank = Surface(kind=CYLINDER, point=facets.centre[rows].mean(0), axis=axis)
    e = blank.frame()
    used = facets.points[facets.vertices(rows)]
    found = _circle((used - blank.point) @ e.T)
    if found is None:
        return None
    middle, radius = found
    point = blank.point + middle @ e
    away = facets.centre[rows] - point
    sense = _sense(facets.centre[rows], facets.normal[rows], away - np.outer(away @ axis, axis))
    return replace(blank, point=point, radius=radius, sense=sense)


def _ring(facets: _Facets, rows: list[int]) -> Surface | None:
    """The torus whose axis the normals of facets pass, through their corners in the half-plane of that axis."""
    middle = facets.centre[rows].mean(0)
    size = float(np.abs(facets.centre[rows] - middle).max())
    centre, normal = (facets.centre[rows] - middle) / size, facets.normal[rows]
    # a line (c, n) meets the axis through p along a: n . (a x (c - p)) = 0, or a . (c x n) + (p x a) . n = 0
    values, vectors = np.linalg.eigh((lines := np.column_stack([np.cross(centre, normal), normal])).T @ lines)
    if values[1] < 1e-9 * values[-1]:
        return None
    axis, moment = vectors[:3, 0], vectors[3:, 0]
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return None
    axis, moment = axis / length, moment / length
    point = middle + size * np.cross(axis, moment)
    blank = Surface(kind=TORUS, point=point, axis=axis)
    used = facets.points[facets.vertices(rows)] - point
    h = used @ axis
    rho = np.linalg.norm(used - h[:, None] * axis, axis=1)
    found = _circle(np.column_stack([rho, h]))
    if found is None or found[0][0] <= found[1]:
        return None
    (radius, lift), tube = found
    centres = facets.centre[rows] - point - lift * axis
    level = centres @ axis
    out = centres - level[:, None] * axis
    away = centres - radius * out / np.linalg.norm(out, axis=1, keepdims=True)
    return replace(
        blank, point=point + lift * axis, radius=float(radius), second=tube, sense=_sense(facets.centre[rows], normal, away)
    )  # fmt: skip
