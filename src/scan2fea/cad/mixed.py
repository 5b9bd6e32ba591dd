"""Patches that hold two surfaces, and balls in free form: what the noise of all patches tells once these are known.

Growing takes the largest region that one surface holds within three deviations. Where a ball of 4 mm passes into a round beside it, a cone along both
is larger than either and leaves 0.17 mm where all else leaves 0.10 (206 corners: 18 deviations of a variance); and a ball between three rounds may
be too small for any seed.
"""

from __future__ import annotations

import numpy as np

from scan2fea.cad.competing import LEAST_CORNERS, competed
from scan2fea.cad.patches import KINDS, LEAST_FACES, Near, is_bent
from scan2fea.kernel.surfaces import CONE, FREEDOMS, SPHERE, Surface, fit_surface, fitted
from scan2fea.kernel.topology import face_components
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

DEVIATIONS = 3.0  # of a variance, beyond which a patch holds more than one surface
SHARES = (0.25, 0.5, 0.75)  # of the faces in the first of two halves that the search begins with
DOUBT = 10.0  # twice the logarithm of odds below which they are not very strong (Kass and Raftery 1995, section 3.2)
LEAST = 0.1  # of the tolerance: with less noise it is 2 % of the spacing, and nothing hides within that
CHI_MEDIAN = 0.4549  # of squared normal deviates of unit variance, the median


def unmixed(near: Near, label: IntArray, surfaces: list[Surface], tolerance: float) -> tuple[IntArray, list[Surface]]:
    """Labels and surfaces once no patch is explained much better by two, and no part of the free form is a ball.

    label : (m,), -1 free form.   tolerance : within which the patches were grown, three deviations of the noise and 2 % of the spacing.
    """
    variance = _variance(near, label, surfaces)
    if variance <= (LEAST * tolerance) ** 2:
        return label, surfaces
    label, surfaces, n_before = label.copy(), list(surfaces), len(surfaces)
    free = np.flatnonzero(label < 0)
    n, part = face_components(near.mesh.faces[free]) if len(free) else (0, free)
    for rows in (free[part == k] for k in range(n)):
        found = _one(near, rows)
        if found is not None:
            label[rows] = len(surfaces)
            surfaces.append(found)
    of_free = set(range(n_before, len(surfaces)))
    for k in range(len(surfaces)):
        rows = np.flatnonzero(label == k)
        halves = _halves(near, rows, surfaces[k], variance)
        if halves is not None:
            is_second, (surfaces[k], second) = halves
            label[rows[is_second]] = len(surfaces)
            of_free.update({len(surfaces)} if k in of_free else ())
            surfaces.append(second)
    for k in of_free:  # planes and cylinders grow from seeds, where there are any; a ball with a strip of the round beside it is a cone at first
        rows = np.flatnonzero(label == k)
        is_bent_twice = surfaces[k].kind in (SPHERE, CONE) and not _holds_more(near, rows, surfaces[k], variance)
        if not is_bent_twice or not _is_asked(near, label, surfaces, rows, variance):
            label[rows] = -1
    if len(surfaces) == n_before:
        return label, surfaces
    label, surfaces = competed(near.mesh, near.of, near.smooth, label, surfaces)
    for k in range(n_before, len(surfaces)):
        _join(near, label, surfaces, k, variance)
    return label, surfaces


def _join(near: Near, label: IntArray, surfaces: list[Surface], k: int, variance: float) -> None:
    """A patch goes to the one beside it whose surface, fitted to both, explains them with less than two."""
    rows = np.flatnonzero(label == k)
    best, joined = 0.0, None
    for j in np.setdiff1d(label[near.of[rows]], [-1, k]).tolist():
        own, their = near.corners(rows)[0], near.corners(np.flatnonzero(label == j))[0]
        both = fitted(surfaces[j], np.concatenate([own, their]))
        if both is not None:
            apart = _cost(surfaces[k], own, variance) + _cost(surfaces[j], their, variance)
            gain = apart - _cost(both, np.concatenate([own, their]), variance)
            if gain > best:
                best, joined = gain, (j, both)
    if joined is not None:
        label[rows], surfaces[joined[0]] = joined


def _cost(surface: Surface, corners: FloatArray, variance: float) -> float:
    """chi2 + k log n."""
    return float((surface.distance(corners) ** 2).sum()) / variance + FREEDOMS[surface.kind] * float(np.log(len(corners)))


def _variance(near: Near, label: IntArray, surfaces: list[Surface]) -> float:
    """Of the corners about their surfaces, by the median: few patches hold two."""
    off = [surfaces[k].distance(near.corners(np.flatnonzero(label == k))[0]) for k in np.unique(label[label >= 0]).tolist()]
    return float(np.median(np.concatenate(off) ** 2)) / CHI_MEDIAN if off else 0.0


def _holds_more(near: Near, rows: IntArray, surface: Surface, variance: float) -> bool:
    """Does it leave more than chance in the corners of some faces?"""
    off = surface.distance(near.corners(rows)[0])
    return float((off**2).sum()) / variance > len(off) + DEVIATIONS * float(np.sqrt(2.0 * len(off)))


def _is_asked(near: Near, label: IntArray, surfaces: list[Surface], rows: IntArray, variance: float) -> bool:
    """Does the surface of some faces explain them much better than the nearest of those beside? Of the rounding of a crease it does not."""
    k, corners = int(label[rows[0]]), near.corners(rows)[0]
    beside = np.setdiff1d(label[near.of[rows]], [-1, k]).tolist()
    if not beside:
        return True
    nearest = np.min([surfaces[j].distance(corners) ** 2 for j in beside], axis=0)
    return float(nearest.sum()) / variance > _cost(surfaces[k], corners, variance) + DOUBT


def _one(near: Near, rows: IntArray) -> Surface | None:
    """The surface of any kind that leaves the least n log(variance) + k log(n) in the corners of some faces; None of too few."""
    corners, normals = near.corners(rows)
    n = len(corners)
    if n < LEAST_CORNERS:
        return None
    found = [f for kind in KINDS if (f := fit_surface(kind, corners, normals)) is not None and is_bent(near, rows, f)]
    return min(found, key=lambda f: n * np.log(float(np.mean(f.distance(corners) ** 2)) + 1e-300) + FREEDOMS[f.kind] * np.log(n), default=None)


def _halves(near: Near, rows: IntArray, surface: Surface, variance: float) -> tuple[BoolArray, tuple[Surface, Surface]] | None:
    """Which faces of a patch are of the second of two surfaces, and these; None where one explains it, or two do not. Begun with parts along the ways
    in which its places and normals spread most.
    """
    if len(rows) < 2 * LEAST_FACES:
        return None
    corners = near.corners(rows)[0]
    whole = fitted(surface, corners) or surface
    if not _holds_more(near, rows, whole, variance):
        return None
    least, best = _cost(whole, corners, variance) - DOUBT, None
    for spread in (near.centres[rows], near.smooth[rows]):
        for way in np.linalg.svd(spread - spread.mean(0), full_matrices=False)[2]:
            along = spread @ way
            for share in SHARES:
                found = _shared(near, rows, along > np.quantile(along, share))
                if found is None:
                    continue
                is_second, pair = found
                left = sum(_cost(s, near.corners(rows[k])[0], variance) for s, k in zip(pair, (~is_second, is_second), strict=True))
                if left < least and not any(_holds_more(near, rows[k], s, variance) for s, k in zip(pair, (~is_second, is_second), strict=True)):
                    least, best = left, found
    return best


def _shared(near: Near, rows: IntArray, is_second: BoolArray) -> tuple[BoolArray, tuple[Surface, Surface]] | None:
    """Two surfaces and which faces are of the second, once no face is nearer to the other."""
    pair = [_one(near, rows[~is_second]), _one(near, rows[is_second])]
    if pair[0] is None or pair[1] is None:
        return None
    number = np.full(len(near.areas), -1, np.int64)
    number[rows] = np.arange(len(rows))
    of = number[near.of[rows]]
    of = np.where(of < 0, np.arange(len(rows))[:, None], of)  # what is not of the patch is no border
    alone = TriangleMesh(vertices=near.mesh.vertices, faces=near.mesh.faces[rows])
    label, (first, second) = competed(alone, of, near.smooth[rows], is_second.astype(np.int64), [pair[0], pair[1]])
    is_second = label == 1
    return (is_second, (first, second)) if min(is_second.sum(), (~is_second).sum()) >= LEAST_FACES else None
