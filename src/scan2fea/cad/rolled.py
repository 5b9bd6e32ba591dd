"""Rings and balls that segmentation leaves in pieces: a rounded edge that bends comes as a row of cylinders, the ball in a corner as one more.

A torus is begun at a cylinder and its neighbours (its tube has the radius of the cylinder) and grown over all that is round there; it stands where it
swallows two patches or more and cuts off little of others. A cylinder that a ball explains as well with one unknown less is a ball.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.cad.competing import competed
from scan2fea.cad.mixed import CHI_MEDIAN, DOUBT, unmixed
from scan2fea.cad.patches import GROW_COSINE, Near, Patches, is_bent
from scan2fea.kernel.surfaces import CONE, CYLINDER, FREEDOMS, PLANE, SPHERE, TORUS, Surface, fit_surface, fitted
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

SMOOTH = 0.94  # cosine of normals across a border that is no crease
ROUNDS = 4  # of growing
SWALLOWED = 0.8  # of the area of a patch that is gone
CUT_OFF = 0.1  # of the area of the torus, that of patches which it takes a part of
GAINED = 1.2  # times the area of the patch that it began with
SLIMMEST = 0.98  # radius of the tube over that of the ring: fatter ones are apples
LEAST_CORNERS = 12


def with_rings_and_balls(mesh: TriangleMesh, patches: Patches, tolerance_m: float) -> Patches:
    """The patches with tori put together from their pieces, and balls that came as cylinders."""
    near = Near(mesh)
    label, surfaces = _with_rings(near, patches.label.copy(), list(patches.surfaces), tolerance_m)
    label, surfaces = _with_balls(near, label, surfaces)
    label, surfaces = _with_balls(near, *unmixed(near, label, surfaces, tolerance_m))
    kept = np.unique(label[label >= 0])
    packed = np.full(len(surfaces) + 1, -1, np.int64)
    packed[kept] = np.arange(len(kept))
    return Patches(label=packed[label], surfaces=tuple(surfaces[k] for k in kept))


def _with_rings(near: Near, label: IntArray, surfaces: list[Surface], tolerance: float) -> tuple[IntArray, list[Surface]]:
    area = np.bincount(label[label >= 0], weights=near.areas[label >= 0], minlength=len(surfaces))
    beside = _beside(near, label, surfaces)
    begun = np.argsort(-area, kind="stable").tolist()
    for k in begun:  # and from each ring that is found: noise can leave it in two
        group = [j for j in beside.get(k, []) if (label == j).any()]
        if surfaces[k].kind not in (CYLINDER, TORUS) or not (label == k).any() or not group:
            continue
        alike = [j for j, s in enumerate(surfaces) if s.kind != PLANE and s.sense == surfaces[k].sense]
        free = (label < 0) | np.isin(label, alike)
        found = _ring(near, np.flatnonzero(np.isin(label, [k, *group])), free, surfaces[k], tolerance)
        bent_other = [] if found is None else _saddles(near, label, surfaces, found[1], tolerance)
        if found is not None and bent_other:
            found = _ring(near, found[0], free | np.isin(label, bent_other), found[1], tolerance)
        if found is None:
            continue
        rows, ring = found
        left = np.bincount(label[label >= 0], weights=near.areas[label >= 0], minlength=len(surfaces))
        taken = np.bincount(label[rows][label[rows] >= 0], weights=near.areas[rows][label[rows] >= 0], minlength=len(surfaces))
        whole = taken > SWALLOWED * left
        total = float(near.areas[rows].sum())
        if not whole[k] or whole.sum() < 2 or total < GAINED * area[k] or taken[~whole].sum() > CUT_OFF * total:
            continue
        label[np.isin(label, np.flatnonzero(whole))] = -1
        label[rows] = len(surfaces)
        begun.append(len(surfaces))
        surfaces.append(ring)
        area = np.append(area, total)
        beside = _beside(near, label, surfaces)
    return label, surfaces


def _beside(near: Near, label: IntArray, surfaces: list[Surface]) -> dict[int, list[int]]:
    """Of each round patch the round ones beside it that it passes into without an angle."""
    own, other = np.repeat(label, 3), label[near.of].ravel()
    turn = np.einsum("ij,ij->i", near.smooth[np.repeat(np.arange(len(label)), 3)], near.smooth[near.of.ravel()])
    out: dict[int, list[int]] = {}
    rows = np.flatnonzero((own >= 0) & (other >= 0) & (own != other))
    pairs, which = np.unique(np.stack([own[rows], other[rows]], axis=1), axis=0, return_inverse=True)
    for row, (a, b) in enumerate(pairs.tolist()):
        are_round = surfaces[a].kind != PLANE and surfaces[b].kind != PLANE and surfaces[a].sense == surfaces[b].sense
        if are_round and np.median(turn[rows[which.ravel() == row]]) > SMOOTH:
            out.setdefault(a, []).append(b)
    return out


def _ring(near: Near, rows: IntArray, free: BoolArray, like: Surface, tolerance: float) -> tuple[IntArray, Surface] | None:
    """The faces of a torus that begins as some faces, and the torus."""
    ring: Surface | None = None
    for trial in range(ROUNDS):
        corners, normals = near.corners(rows)
        start = ring or _first_torus(corners, normals, like)
        ring = None if start is None else fitted(start, corners)
        if ring is None or ring.second >= SLIMMEST * ring.radius:
            return None
        lies = _lies(near, rows, ring, tolerance)
        if not lies.any():
            return None
        inside = np.zeros(len(near.areas), bool)
        inside[rows[lies]] = True
        near.flood(inside, ring, tolerance, free, len(inside))
        more = np.flatnonzero(inside)
        if trial and len(more) <= 1.01 * len(rows):
            return more, ring
        rows = more
    return rows, ring if ring is not None else like


def _lies(near: Near, rows: IntArray, surface: Surface, tolerance: float) -> BoolArray:
    """Which faces have all corners on the surface and look its way."""
    off = np.abs(surface.distance(near.mesh.vertices[near.mesh.faces[rows]].reshape(-1, 3))).reshape(-1, 3).max(1)
    return np.asarray((off <= tolerance) & (np.einsum("ij,ij->i", surface.normals(near.centres[rows]), near.smooth[rows]) > GROW_COSINE))


def _saddles(near: Near, label: IntArray, surfaces: list[Surface], ring: Surface, tolerance: float) -> list[int]:
    """Round patches of the other sense of which most lies on a ring: its inner half is a saddle, whose pieces may come as bent either way."""
    rows = np.flatnonzero(label >= 0)
    on = rows[_lies(near, rows, ring, tolerance)]
    share = [np.bincount(label[r], weights=near.areas[r], minlength=len(surfaces)) for r in (on, rows)]
    return [j for j, s in enumerate(surfaces) if s.kind != PLANE and s.sense != ring.sense and share[0][j] > SWALLOWED * share[1][j]]


def _first_torus(points: FloatArray, normals: FloatArray, like: Surface) -> Surface | None:
    """A tube of the radius of a cylinder: its middle line, that far within the points, is a circle."""
    tube = like.second if like.kind == TORUS else like.radius
    line = points - like.sense * tube * normals
    middle = line.mean(0)
    turned = np.linalg.eigh((line - middle).T @ (line - middle))[1]
    e = turned[:, 1:].T
    flat = (line - middle) @ e.T
    matrix = np.column_stack([2 * flat, np.ones(len(flat))])
    if np.linalg.matrix_rank(matrix) < 3:
        return None
    x, y, c = np.linalg.lstsq(matrix, (flat**2).sum(1), rcond=None)[0]
    radius = float(np.sqrt(max(c + x * x + y * y, 0.0)))
    return replace(like, kind=TORUS, point=middle + np.array([x, y]) @ e, axis=turned[:, 0], radius=radius, second=tube)


def _with_balls(near: Near, label: IntArray, surfaces: list[Surface]) -> tuple[IntArray, list[Surface]]:
    """Cylinders of which a ball leaves less n log(variance) + k log(n), and the faces shared out again.

    What is left of a ball between three rounds is too little to tell (22 corners, 0.07 and 0.06 mm off): where the cylinder is not far ahead, both
    are led on until each has the faces that are its own, and what leaves less in all faces stays.
    """
    changed, doubtful = False, []
    for k, surface in enumerate(surfaces):
        rows = np.flatnonzero(label == k)
        if surface.kind not in (CYLINDER, CONE) or len(rows) < LEAST_CORNERS:
            continue
        corners, normals = near.corners(rows)
        ball = fit_surface(SPHERE, corners, normals)
        if ball is None or ball.sense != surface.sense or not is_bent(near, rows, ball):
            continue
        n, floor = len(corners), _floor(corners)
        both = ball, fitted(surface, corners) or surface
        cost = [n * np.log(float(np.mean(s.distance(corners) ** 2)) + floor) + FREEDOMS[s.kind] * np.log(n) for s in both]
        if cost[0] < cost[1]:
            surfaces[k], changed = ball, True
        elif cost[0] < cost[1] + DOUBT:
            doubtful.append((k, ball))
    if not changed and not doubtful:
        return label, surfaces
    label, surfaces = competed(near.mesh, near.of, near.smooth, label, surfaces)
    for k, ball in doubtful:
        other = competed(near.mesh, near.of, near.smooth, label, [ball if j == k else s for j, s in enumerate(surfaces)])
        if other[1][k].kind == SPHERE and _left(near, *other, surfaces, label) < _left(near, label, surfaces, surfaces, label):
            label, surfaces = other
    return label, surfaces


def _left(near: Near, label: IntArray, surfaces: list[Surface], first: list[Surface], of: IntArray) -> float:
    """What surfaces leave in all their faces, over the variance that the `first` ones leave with their labels `of`, and k log(n); six faces meet at a
    vertex.
    """
    variance = float(np.median(_off(near, of, first)[of >= 0] ** 2)) / CHI_MEDIAN + _floor(near.mesh.vertices)
    n = len(near.mesh.vertices)
    return float((_off(near, label, surfaces) ** 2).sum()) / variance / 6 + sum(FREEDOMS[s.kind] for s in surfaces) * float(np.log(n))


def _off(near: Near, label: IntArray, surfaces: list[Surface]) -> FloatArray:
    """(m, 3) distance of the corners of each face to its surface, 0 of faces without."""
    out = np.zeros((len(label), 3))
    for k, surface in enumerate(surfaces):
        rows = label == k
        if rows.any():
            out[rows] = surface.distance(near.mesh.vertices[near.mesh.faces[rows]].reshape(-1, 3)).reshape(-1, 3)
    return out


def _floor(points: FloatArray) -> float:
    """The variance that rounding leaves."""
    return (1e-9 * float(np.linalg.norm(np.ptp(points, axis=0)))) ** 2
