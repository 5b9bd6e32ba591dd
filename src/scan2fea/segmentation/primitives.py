"""Planes, cylinders and spheres: hypotheses from neighbourhoods, scored by what they explain, grown over what hangs together, refitted.

After Schnabel, Wahl and Klein (2007): each round takes the best of all hypotheses out of the cloud. A curved surface is taken only where it explains
a tenth more than the plane of the same patch: a cylinder of a very large radius fits every plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.errors import SegmentationError, require
from scan2fea.kernel.neighbors import k_nearest, radius_components
from scan2fea.kernel.noise import noise_sigma, sampled_rows, spacing
from scan2fea.kernel.normals import pca_normals
from scan2fea.kernel.surfaces import CYLINDER, PLANE, SPHERE, Surface, fit_surface, fitted
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.segmentation.options import SegmentationOptions
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud, Value

_MOST = 60_000  # points that are looked at; the others follow the nearest of them
_JUDGED = 4_000  # points that hypotheses are scored on
_SEEDS = 60  # patches a round, of each size
_PATCHES = (24, 96)
_NORMAL_NEIGHBOURS = 16
_SIGMAS = 3.0
_COSINE = 0.9  # 26 degrees
_MORE = 1.1  # times the points of a plane that a curved surface must explain
_LINK = 3.5  # spacings, as in radius.link_radius
_REFITS = 3
_TRIED = 6  # hypotheses that are grown and refitted a round
_MOST_FOUND = 200
_FLAT = 0.05  # a curved surface must bend by this many radians over its points, or it is a plane
_MISSES = 3  # rounds without anything before the search ends


@dataclass(frozen=True, eq=False, kw_only=True)
class Primitive(Value):
    """rows : of its points, ascending.   surface : least squares through them."""

    rows: IntArray
    surface: Surface


@dataclass(frozen=True, eq=False, kw_only=True)
class _Left(Value):
    """What no primitive has yet. points, normals : (m, 3).   h, band : spacing, and how far a point may lie off."""

    points: FloatArray
    normals: FloatArray
    h: float
    band: float

    def on(self, surface: Surface) -> BoolArray:
        """(m,) points within the band whose normal is that of the surface, of any sign."""
        near = np.abs(surface.distance(self.points)) <= self.band
        near[near] = np.abs(np.einsum("nc,nc->n", surface.normals(self.points[near]), self.normals[near])) >= _COSINE
        return np.asarray(near)

    def taken(self, rows: IntArray | BoolArray) -> _Left:
        return _Left(points=self.points[rows], normals=self.normals[rows], h=self.h, band=self.band)


def find_primitives(points: FloatArray, min_points: int = 100, seed: int = 0) -> list[Primitive]:
    """The primitives of points (n, 3), those of most points first; each hangs together and has `min_points` or more.

    Raises SegmentationError for coordinates that are not finite or points at one place.
    """
    require(np.isfinite(points).all(), SegmentationError, "the cloud has coordinates that are not finite: surfaces need numbers; drop those points")
    h = spacing(points, seed) if len(points) > 1 else math.nan
    require(h > 0 and math.isfinite(h), SegmentationError, "the points lie at one place: there is no surface to find")
    edge, low = 0.7 * h, points.min(axis=0)
    cells = voxel_mean(points - low, edge)
    while cells.n_cells > _MOST:
        edge *= 1.05 * math.sqrt(cells.n_cells / _MOST)
        cells = voxel_mean(points - low, edge)
    thin = cells.mean + low
    h = spacing(thin, seed)
    sigma = noise_sigma(points, seed=seed)
    band = max(_SIGMAS * sigma if math.isfinite(sigma) else h, 0.2 * h)
    whole = _Left(points=thin, normals=pca_normals(thin, _NORMAL_NEIGHBOURS), h=h, band=band)
    least = max(_PATCHES[0], round(min_points * len(thin) / len(points)))
    number, surfaces = _searched(whole, least, np.random.default_rng(seed))
    rows_of = number[cells.cell_of_point]
    found = [Primitive(rows=np.flatnonzero(rows_of == k).astype(np.int64), surface=surface) for k, surface in enumerate(surfaces)]
    return sorted((p for p in found if len(p.rows) >= min_points), key=lambda p: (-len(p.rows), int(p.rows[0])))


def _searched(whole: _Left, least: int, rng: np.random.Generator) -> tuple[IntArray, list[Surface]]:
    """Number (m,) of the surface that each point lies on, -1 none, and the surfaces."""
    number = np.full(len(whole.points), -1, np.int64)
    surfaces: list[Surface] = []
    missed = 0
    while missed < _MISSES and len(surfaces) < _MOST_FOUND:
        free = np.flatnonzero(number < 0)
        if len(free) < least:
            break
        best = _best(whole.taken(free), least, rng)
        if best is None:
            missed += 1
            continue
        missed = 0
        surface, rows = best
        number[free[rows]] = len(surfaces)
        surfaces.append(surface)
    return number, surfaces


def _best(left: _Left, least: int, rng: np.random.Generator) -> tuple[Surface, IntArray] | None:
    """The surface that holds most points in one piece, and their rows; None where none holds enough."""
    judged = left.taken(rng.permutation(len(left.points))[:_JUDGED])
    share = len(left.points) / len(judged.points)
    scored: list[tuple[float, Surface]] = []
    for size in _PATCHES:
        if len(left.points) < size:
            continue
        seeds = rng.integers(len(left.points), size=_SEEDS)
        _, near = k_nearest(left.points, size, left.points[seeds])
        for patch in near:
            scored += _hypotheses(left, judged, patch)
    scored.sort(key=lambda item: -item[0])
    grown = [_grown(left, surface) for score, surface in scored[:_TRIED] if score * share >= 0.5 * least]
    good = [(surface, rows) for surface, rows in grown if len(rows) >= least]
    return max(good, key=lambda item: len(item[1]), default=None)


def _hypotheses(left: _Left, judged: _Left, patch: IntArray) -> list[tuple[float, Surface]]:
    """The plane of a patch, and its cylinder and sphere where they explain more; each with the judged points on it."""
    points, normals = left.points[patch], left.normals[patch]
    normals = np.where((normals @ normals[0] < 0)[:, None], -normals, normals)
    plane = fit_surface(PLANE, points, normals)
    if plane is None:
        return []
    flat = float(judged.on(plane).sum())
    found = [(flat, plane)]
    for kind in (CYLINDER, SPHERE):
        surface = fit_surface(kind, points, normals)
        if surface is not None and surface.rms_m <= left.band and np.ptp(points, axis=0).max() > _FLAT * surface.radius:
            held = float(judged.on(surface).sum())
            if held > _MORE * flat:
                found.append((held, surface))
    return found


def _grown(left: _Left, surface: Surface) -> tuple[Surface, IntArray]:
    """The surface refitted to the largest connected part of the points on it, and their rows."""
    rows = np.zeros(0, np.int64)
    for _ in range(_REFITS):
        on = np.flatnonzero(left.on(surface))
        if len(on) < _PATCHES[0]:
            return surface, np.zeros(0, np.int64)
        part = radius_components(left.points[on], _LINK * left.h)
        rows = on[part == int(np.bincount(part).argmax())]
        fit = fitted(surface, left.points[rows[sampled_rows(len(rows), _JUDGED, 0)]])
        if fit is None:
            break
        surface = fit
    return surface, rows


def primitive_row(primitive: Primitive) -> dict[str, Any]:
    """For the report: kind, number of points, radius, axis (normal of a plane) and the spread of its points."""
    surface = primitive.surface
    row: dict[str, Any] = {"kind": surface.kind, "n_points": len(primitive.rows), "rms_m": surface.rms_m, "point_m": surface.point.tolist()}
    row |= {"axis": surface.axis.tolist()} if surface.kind != SPHERE else {}
    return row if surface.kind == PLANE else {**row, "radius_m": surface.radius}


def primitives(cloud: PointCloud, options: SegmentationOptions = SegmentationOptions()) -> IntArray:
    """(n,) number of the primitive each point lies on, those of most points first; -1 on none."""
    labels = np.full(len(cloud), -1, np.int64)
    for label, primitive in enumerate(find_primitives(cloud.points, options.min_points, options.seed)):
        labels[primitive.rows] = label
    return labels
