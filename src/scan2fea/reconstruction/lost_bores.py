"""Bores whose walls were scanned, and that a solid closes all the same.

Where nobody knows from where the points were seen, no ball enters a bore of a few spacings, and a cut may close it by a plug that leaves every point
of its wall near the surface. But a circle that both faces of a wall leave empty, with points all round it between them, is a hole (`bores`): its axis
leads through nothing, unless a bottom was measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from scan2fea.errors import ReconstructionError
from scan2fea.kernel.delaunay import Tetrahedralisation
from scan2fea.kernel.distances import signed_distance
from scan2fea.kernel.surfaces import Surface
from scan2fea.reconstruction.bores import AROUND, CLEAR, Bore, distinct, every_bore
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.plane_growing import Planes, grow_planes
from scan2fea.reconstruction.round_growing import CHORD, off_round_m
from scan2fea.types import BoolArray, Check, FloatArray, TriangleMesh

BORES_CLOSED = "scanned bores that are closed"
WIDEST = 4.0  # spacings, radius: what closes a wider one is bare for all to see, and may be a bolt
HELD = 0.4  # of the points due on the wall of a bore between its two faces: noise, or another face between these, puts few there
DEEPEST = 8.0  # times that radius: from one face to the other
SECTORS = 6  # of AROUND that hold some
FREE, CHANCE = 3, 0.05  # centre and radius are fitted; that points of a circle scatter so far about it
BAND_CHANCE = 1e-3  # that the points on the wall of a bore reach over so little of its depth
CORE, BOTTOM = 0.7, 3  # of the radius: so many points of a bottom lie nearer to the axis, of the wall none
WHOLE = 1.2  # of the radius: tets at the wall of a bore too
STEPS = 64  # places on the axis


def told_bores(points: FloatArray, normals: FloatArray, spacing_m: float, sigma_m: float, grown: Planes | None = None) -> list[Bore]:
    """Small round holes through walls, with points on all their wall and none within. points, normals : (n, 3) raw, and outward.

    grown : the planes under them, where they are known.
    """
    try:
        planes = grow_planes(points, normals, spacing_m, sigma_m) if grown is None else grown
    except ReconstructionError:
        return []
    found = every_bore(points, planes, spacing_m, sigma_m, DEEPEST * WIDEST * spacing_m, HELD)
    return distinct([bore for bore in found if _is_told(bore, points, spacing_m, sigma_m)])


def closed_bores(bores: Sequence[Bore], mesh: TriangleMesh) -> Check:
    """Does the solid lie across the axis of one of the bores, between the outermost points of its wall?"""
    axes = [_on_axis(bore.surface, bore.wall) for bore in bores]
    inside = signed_distance(np.concatenate(axes), mesh).reshape(-1, STEPS).min(axis=1) < 0 if axes else np.zeros(0, bool)
    closed = [bore.surface.point for bore, is_closed in zip(bores, inside, strict=True) if is_closed]
    says = (
        f"the points show {len(bores)} bores, and the solid closes {len(closed)} of them{around(np.array(closed))}: "
        "give the sensor position, or scan them more densely"
    )
    return at_most(BORES_CLOSED, float(len(closed)), 0.0, says)


def facing_axis(bore: Bore, points: FloatArray, normals: FloatArray, spacing_m: float, sigma_m: float) -> FloatArray:
    """(n, 3) the normals, those of the points on the wall of a bore towards its axis: of few, nobody knows the side, or they are blended."""
    along, wall = _along(bore.surface, points), _along(bore.surface, bore.wall)
    own = (along >= wall.min()) & (along <= wall.max()) & (np.abs(bore.surface.distance(points)) <= off_round_m(spacing_m, sigma_m))
    out = normals.copy()
    out[own] = bore.surface.normals(points[own])
    return out


def in_bores(bores: Sequence[Bore], tetra: Tetrahedralisation, share: float = CORE) -> BoolArray:
    """(m,) tets whose middle lies within a share of a bore's radius, between the outermost points of its wall."""
    out = np.zeros(len(tetra), bool)
    middle = tetra.points[tetra.tets].mean(axis=1) if bores else np.zeros((0, 3))
    for bore in bores:
        along, wall = _along(bore.surface, middle), _along(bore.surface, bore.wall)
        off = middle - bore.surface.point
        aside = np.linalg.norm(off - along[:, None] * bore.surface.axis, axis=1)
        out |= (along >= wall.min()) & (along <= wall.max()) & (aside < share * bore.surface.radius)
    return out


def _is_told(bore: Bore, points: FloatArray, spacing_m: float, sigma_m: float) -> bool:
    surface, wall = bore.surface, bore.wall
    along, aside = _along(surface, wall), (wall - surface.point) @ surface.frame().T
    deep = bore.depth_m - 2.0 * CLEAR * sigma_m
    due = 2.0 * math.pi * surface.radius * deep / spacing_m**2
    sectors = np.unique(np.floor(np.arctan2(aside[:, 1], aside[:, 0]) / (2.0 * np.pi) * AROUND))
    if surface.radius > WIDEST * spacing_m or bore.around < SECTORS or len(wall) < HELD * due or len(sectors) < SECTORS:
        return False
    if _in_a_band(np.ptp(along) / deep, len(wall)):
        return False
    spread = sigma_m + CHORD * spacing_m
    if chdtrc(len(wall) - FREE, float((surface.distance(wall) ** 2).sum()) / spread**2) < CHANCE:
        return False
    every = _along(surface, points)
    near = points[(every > along.min()) & (every < along.max())]
    off = near - surface.point
    return bool(np.sum(np.linalg.norm(off - np.outer(off @ surface.axis, surface.axis), axis=1) < CORE * surface.radius) < BOTTOM)


def _in_a_band(reach: float, n: int) -> bool:
    """Do n points reach over less of the depth than those of a bore's wall would? They are of a face across it then. reach : share of the depth.

    n uniform draws reach over at most x of their range with probability n x^(n-1) - (n-1) x^n.
    """
    return bool(reach < HELD and n * reach ** (n - 1) - (n - 1) * reach**n < BAND_CHANCE)


def _along(surface: Surface, points: FloatArray) -> FloatArray:
    return np.asarray((points - surface.point) @ surface.axis)


def _on_axis(surface: Surface, wall: FloatArray) -> FloatArray:
    along = _along(surface, wall)
    return np.asarray(surface.point + np.linspace(along.min(), along.max(), STEPS)[:, None] * surface.axis)
