"""Bores and pins whose few points the reconstruction left as small planes, balls, cones or free form: cylinders square to the plane they leave.

Fifteen points round a bolt hole, a spacing of rounding at both its rims: what is grown there is a square of four planes as often as a cylinder. The
points are not rounded, and a circle has fewer freedoms than anything else that holds them: where they leave it no more than the noise, all round, it
is taken, unless what was found explains them better than its freedoms account for (a square hole).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.cad.patches import Near, Patches
from scan2fea.cad.resting import LEAST_POINTS
from scan2fea.cad.surfaces import CLIP, fit_to_points
from scan2fea.kernel.measures import extent
from scan2fea.kernel.surfaces import CYLINDER, FREEDOMS, PLANE, Surface
from scan2fea.kernel.topology import face_components
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

WIDE = 0.02  # of the area: planes that may be bored, and that tell the noise
HELD = 0.95  # share of the points within CLIP noises: the rest is what a normal law clips, and chance
CLEAR = (CLIP, 2.5, 1.5)  # noises from a plane
TURN_RAD = float(2 * np.pi / 3)  # the widest gap between points round the axis: of 18 at random one in fifty leaves a wider one
FREE_CIRCLE = 3  # its middle and radius: the axis is the plane's


def bored(mesh: TriangleMesh, patches: Patches, points: FloatArray, face: IntArray) -> Patches:
    """The patches with each place between wide planes that is one cylinder, made that. points : (n, 3).   face : (n,) of the mesh, next to each."""
    near = Near(mesh)
    size = extent(mesh.vertices)
    area = np.bincount(patches.label + 1, weights=near.areas, minlength=len(patches.surfaces) + 1)[1:]
    flat = [k for k, s in enumerate(patches.surfaces) if s.kind == PLANE and area[k] >= WIDE * near.areas.sum()]
    own = [fit for k in flat if (fit := fit_to_points(patches.surfaces[k], points[patches.label[face] == k], size)) is not None]
    if not own:
        return patches
    n = np.array([len(fit.points) for fit in own])
    noise = float(np.sqrt(n @ np.array([fit.sigma_m**2 for fit in own]) / n.sum()))
    label, surfaces = patches.label.copy(), list(patches.surfaces)
    for rows in _places(mesh, near, np.isin(label, flat)):
        inside = np.zeros(len(label), bool)
        inside[rows] = True
        beside = np.unique(label[near.of[rows]])
        planes = [surfaces[k] for k in beside.tolist() if k in flat]
        used = _clear(points[inside[face]], planes, noise)
        if len(used) < LEAST_POINTS:
            continue
        found = _cylinder(used, near.normals[rows], near.centres[rows], planes, noise, size)
        known = np.unique(label[rows][label[rows] >= 0])
        if found is not None and not _are_better([surfaces[k] for k in known.tolist()], found, used, noise):
            label[rows] = len(surfaces)
            surfaces.append(found)
    kept = np.unique(label[label >= 0])
    packed = np.full(len(surfaces) + 1, -1, np.int64)
    packed[kept] = np.arange(len(kept))
    return Patches(label=packed[label], surfaces=tuple(surfaces[k] for k in kept))


def _places(mesh: TriangleMesh, near: Near, is_wide: BoolArray) -> list[IntArray]:
    """Connected faces that are of no wide plane."""
    joined = np.zeros(len(near.table.edges), bool)
    joined[near.table.edge_of[np.repeat(~is_wide, 3) & ~is_wide[near.table.twin // 3]]] = True
    _, part = face_components(mesh.faces, joined)
    rows = np.flatnonzero(~is_wide)
    order = rows[np.argsort(part[rows], kind="stable")]
    return np.split(order, np.flatnonzero(np.diff(part[order])) + 1) if len(order) else []


def _clear(points: FloatArray, planes: Sequence[Surface], noise_m: float) -> FloatArray:
    """The points that lie on no plane beside them; in a thin plate few are as far from both its faces as the noise reaches, and nearer ones serve."""
    if not planes:
        return points[:0]
    off = np.min([np.abs(p.distance(points)) for p in planes], axis=0)
    return next((points[off > k * noise_m] for k in CLEAR if np.sum(off > k * noise_m) >= LEAST_POINTS), points[:0])


def _cylinder(
    points: FloatArray, normals: FloatArray, centres: FloatArray, planes: Sequence[Surface], noise_m: float, size_m: float
) -> Surface | None:
    """The cylinder square to one of `planes` that holds the points all round. normals, centres : of faces there, that tell hole from pin."""
    best: Surface | None = None
    for plane in planes:
        found = bore(plane.axis, points)
        if found is None or not CLIP * noise_m < found.radius <= size_m:  # round a point noise is round too
            continue
        out = found.normals(centres)
        found = replace(found, sense=1 if float(np.einsum("ij,ij->", out, normals)) > 0 else -1)
        off = found.distance(points)
        sigma = float(np.sqrt((off**2).sum() / max(len(points) - FREE_CIRCLE, 1)))
        holds = np.mean(np.abs(off) <= CLIP * noise_m) >= HELD and sigma**2 <= noise_m**2 * (1 + 3 * np.sqrt(2 / len(points)))
        if holds and _widest_gap(found, points) <= TURN_RAD and (best is None or sigma < best.rms_m):
            best = replace(found, rms_m=sigma)
    return best


def bore(axis: FloatArray, points: FloatArray) -> Surface | None:
    """The cylinder along an axis by the circle of least squares of the squared radii; None where the points lie in a line."""
    start = Surface(kind=CYLINDER, axis=axis, point=points.mean(0))
    flat = (points - start.point) @ start.frame().T
    matrix = np.column_stack([2 * flat, np.ones(len(flat))])
    if np.linalg.matrix_rank(matrix) < FREE_CIRCLE:
        return None
    x, y, c = np.linalg.lstsq(matrix, (flat**2).sum(1), rcond=None)[0]
    return replace(start, point=start.point + np.array([x, y]) @ start.frame(), radius=float(np.sqrt(max(c + x * x + y * y, 0.0))))


def _widest_gap(surface: Surface, points: FloatArray) -> float:
    u, v = ((points - surface.point) @ surface.frame().T).T
    turn = np.sort(np.arctan2(v, u))
    return float(np.diff(np.append(turn, turn[0] + 2 * np.pi)).max())


def _are_better(known: Sequence[Surface], found: Surface, points: FloatArray, noise_m: float) -> bool:
    """Do other surfaces explain the points better than one cylinder, by chi-square and freedoms log n? Points are given to the nearest."""
    if not known:
        return False
    off = np.min([np.abs(s.distance(points)) for s in known], axis=0)
    gain = float((found.distance(points) ** 2).sum() - (off**2).sum()) / noise_m**2
    return gain > (sum(FREEDOMS[s.kind] for s in known) - FREE_CIRCLE) * float(np.log(len(points)))
