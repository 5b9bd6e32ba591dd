"""Patches made to agree with the measured points: those that these do not ask for joined or given up, those that hold too few of them grown.

The reconstruction rounds creases over a spacing, and what is left between two of them comes in pieces: two cylinders for one, a cylinder along a rim,
a plane where a hole begins, an eighth of a hole and free form. The points are not rounded: a piece whose points all lie on its neighbours is none,
and what lies on no neighbour is of the piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.cad.bores import bore
from scan2fea.cad.patches import GROW_COSINE, Near, Patches
from scan2fea.cad.resting import LEAST_POINTS
from scan2fea.cad.roundings import beside, inner_faces
from scan2fea.cad.surfaces import CLIP, Fit, fit_to_points, simplest
from scan2fea.kernel.coverage import EXPECTED, is_unmeasured
from scan2fea.kernel.measures import extent, face_areas
from scan2fea.kernel.surfaces import PLANE, Surface
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

ENOUGH = 30  # points from which a patch tells its own surface
EXPLAINED = 0.95  # share of the points of a patch that lie on its neighbours: the rest is what a normal law clips, and chance
PASSES = 5  # over all patches
WIDE = 0.02  # of the area: larger patches are no rounded creases


def asked_for(mesh: TriangleMesh, patches: Patches, used: FloatArray, face: IntArray, density: float = 0.0) -> Patches:
    """The patches without those that the points do not ask for, or that nobody measured: the wall of a hole that is an unseen place.

    used : (n, 3) measured.   face : (n,) the face of the mesh next to each.   density : of these, per m2; 0 where they need not lie everywhere.
    """
    label = _measured(mesh, patches, face, density)
    size = extent(mesh.vertices)
    fits = _fits(mesh, patches, used, face, size)
    told = [f.sigma_m for f in fits if f is not None]
    if not told:
        return patches
    noise = float(np.median(told))
    surfaces = [s if f is None or f.sigma_m > 2 * noise else f.surface for s, f in zip(patches.surfaces, fits, strict=True)]
    near = Near(mesh, 0)
    out = list(patches.surfaces)
    count = np.bincount(label[face] + 1, minlength=len(surfaces) + 1)[1:]
    for _ in range(PASSES):  # what has become one may hold the points of a third
        before = label.copy()
        label, surfaces, out = _told_apart(near, label, surfaces, out, used, face, noise, size, is_sharp=density == 0.0)
        if (label == before).all():
            break
    for number in np.flatnonzero((np.bincount(label[face] + 1, minlength=len(out) + 1)[1:] < ENOUGH) & (count > 0)).tolist():
        grown = _regrown(near, number, label, surfaces, used, face, noise, size) if out[number].kind != PLANE and (label == number).any() else None
        if grown is not None:
            surfaces[number], label[grown[1]] = grown[0], number
            out[number] = grown[0]
    kept = np.unique(label[label >= 0])
    packed = np.full(len(surfaces) + 1, -1, np.int64)
    packed[kept] = np.arange(len(kept))
    return Patches(label=packed[label], surfaces=tuple(out[k] for k in kept))


def _told_apart(
    near: Near, label: IntArray, surfaces: list[Surface], out: list[Surface], used: FloatArray, face: IntArray, noise: float, size_m: float,
    *, is_sharp: bool,
) -> tuple[IntArray, list[Surface], list[Surface]]:  # fmt: skip
    """Labels and surfaces (as fitted to the points, and as to be drawn) once over all patches, the smallest first: one whose points lie on its
    neighbours is none, one that is the same surface as a neighbour is joined with it.

    is_sharp : the points are the corners of the faces. A plane one triangle wide among planes then has all of them, but not its middle, on these.
    """
    label, surfaces, out = label.copy(), list(surfaces), list(out)
    area = np.bincount(label[label >= 0], weights=near.areas[label >= 0], minlength=len(surfaces))
    count = np.bincount(label[face] + 1, minlength=len(surfaces) + 1)[1:]
    for number in np.argsort(count, kind="stable").tolist():
        rows = np.flatnonzero(label == number)
        if not count[number] or not len(rows):
            continue
        names = [k for k in beside(near, label, rows) if count[k] > count[number] or (count[k] == count[number] and k > number)]
        own = used[label[face] == number]
        if not names:
            continue
        is_wide = area[number] > WIDE * near.areas.sum()
        around = [surfaces[k] for k in names]
        if is_sharp and not is_wide and all(s.kind == PLANE for s in (surfaces[number], *around)):
            own = np.concatenate([own, near.centres[rows]])
        lies = not is_wide and np.mean(_off(around, own) <= CLIP * noise) >= EXPLAINED
        alike = [k for k in names if surfaces[k].kind == surfaces[number].kind]
        same = alike if lies else [k for k in names if not is_wide or _are_round(surfaces, number, k)]
        other, joined = _joined(number, same, names, surfaces, own, used, label[face], noise, size_m)
        if joined is not None:
            label[rows], surfaces[other], out[other] = other, joined, joined
        elif lies:
            label[rows] = -1
    return label, surfaces, out


def _measured(mesh: TriangleMesh, patches: Patches, face: IntArray, density: float) -> IntArray:
    """(m,) labels without the round patches that have no points, nor those beside them that are too small to have any (the tip of a drill).

    Of planes the one that an object stands on has none either.
    """
    label = patches.label.copy()
    area = np.bincount(label[label >= 0], weights=face_areas(mesh)[label >= 0], minlength=len(patches.surfaces))
    count = np.bincount(label[face] + 1, minlength=len(patches.surfaces) + 1)[1:]
    for k, surface in enumerate(patches.surfaces):
        if surface.kind != PLANE and is_unmeasured(float(area[k]), int(count[k]), density):
            rows = np.flatnonzero(label == k)
            tips = [j for j in beside(Near(mesh, 0), label, rows) if not count[j] and area[j] * density < EXPECTED]
            label[np.isin(label, [k, *tips])] = -1
    return label


def _fits(mesh: TriangleMesh, patches: Patches, used: FloatArray, face: IntArray, size_m: float) -> list[Fit | None]:
    """Each patch by its points away from borders, None where they are few."""
    inner = inner_faces(mesh, patches.label)[face]
    flat = [s.axis for s in patches.surfaces if s.kind == PLANE]
    label = patches.label[face]
    out = []
    for k, surface in enumerate(patches.surfaces):
        rows = np.flatnonzero((label == k) & inner)
        rows = rows if len(rows) >= ENOUGH else np.flatnonzero(label == k)
        out.append(simplest(surface, used[rows], size_m, flat) if len(rows) >= ENOUGH else None)
    return out


def _joined(
    number: int, others: Sequence[int], names: Sequence[int],
    surfaces: Sequence[Surface], every: FloatArray, used: FloatArray, label: IntArray, noise: float, size_m: float,
) -> tuple[int, Surface | None]:  # fmt: skip
    """The one of `others` with which a patch is one surface of that one's kind, which leaves no more than the noise in the points of both; and that.

    every : (k, 3) points of the patch.   names : all that are beside it. Points that lie on planes beside them, and of two planes those on what is
    round beside them, say nothing of it.
    """
    for other in others:
        flat = surfaces[number].kind == surfaces[other].kind == PLANE
        beyond = [surfaces[k] for k in names if (surfaces[k].kind != PLANE) == flat and k != other]
        own, their = (p[_off(beyond, p) > CLIP * noise] for p in (every, used[label == other]))
        if not _are_round(surfaces, number, other) and 2 * len(own) < len(every):
            continue  # most of it tells nothing
        found = fit_to_points(surfaces[other], np.concatenate([own, their]), size_m) if len(own) + len(their) >= ENOUGH else None
        if found is None or any(np.mean(found.surface.distance(p) ** 2 <= (CLIP * noise) ** 2) < EXPLAINED for p in (own, their) if len(p)):
            continue  # of a large and a small one a fit alone would clip the small
        if found.sigma_m**2 <= noise**2 * (1 + 3 * np.sqrt(2 / len(found.points))):
            return other, found.surface
    return -1, None


def _are_round(surfaces: Sequence[Surface], first: int, second: int) -> bool:
    return surfaces[first].kind != PLANE and surfaces[first].kind == surfaces[second].kind


def _regrown(
    near: Near, number: int, label: IntArray, surfaces: Sequence[Surface], used: FloatArray, face: IntArray, noise: float, size_m: float
) -> tuple[Surface, IntArray] | None:
    """A round patch with few points, of which the rest is free form, fitted to all points there that lie on no neighbour; and the faces of the free
    form that are nearest to it. None where none of its kind, nor a cylinder square to a plane beside it, holds the points.
    """
    rows = np.flatnonzero(label == number)
    names = beside(near, label, rows)
    around = _with_free_form(near, label, rows)
    own = used[around[face]]
    own = own[_off([surfaces[k] for k in names], own) > CLIP * noise]
    if len(own) < LEAST_POINTS:
        return None
    square = [bore(surfaces[k].axis, own) for k in names if surfaces[k].kind == PLANE]
    starts = [surfaces[number], *(replace(s, sense=surfaces[number].sense) for s in square if s is not None)]
    found = [f for s in starts if (f := fit_to_points(s, own, size_m)) is not None and len(f.points) >= 0.9 * len(own)]
    best = min(found, key=lambda f: f.sigma_m, default=None)
    if best is None or best.sigma_m > 2 * noise:
        return None
    free = np.flatnonzero(around & (label < 0))
    own_off = np.abs(best.surface.distance(near.centres[free]))
    other = _off([surfaces[k] for k in names], near.centres[free])
    facing = np.einsum("ij,ij->i", best.surface.normals(near.centres[free]), near.smooth[free]) > GROW_COSINE
    return best.surface, free[facing & (own_off < other)]


def _off(surfaces: Sequence[Surface], points: FloatArray) -> FloatArray:
    """(n,) distance of each point to the nearest of some surfaces, infinite without any."""
    return np.min([np.abs(s.distance(points)) for s in surfaces], axis=0) if surfaces else np.full(len(points), np.inf)


def _with_free_form(near: Near, label: IntArray, rows: IntArray) -> BoolArray:
    """(m,) some faces and the free form that joins them."""
    inside = np.zeros(len(label), bool)
    inside[rows] = True
    front = rows
    while len(front):
        front = near.ring(inside, front)
        front = front[label[front] < 0]
        inside[front] = True
    return inside
