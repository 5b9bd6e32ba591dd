"""Bores whose walls were scanned, and that a solid closes all the same.

Where nobody knows from where the points were seen, no ball enters a bore of a few spacings, and a cut may close it by a plug that leaves every point
of its wall near the surface. But a circle that both faces of a wall leave empty, with points all round it between them, is a hole (`bores`): its axis
leads through nothing, unless a bottom was measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtrc

from scan2fea.errors import ReconstructionError
from scan2fea.kernel.delaunay import Tetrahedralisation
from scan2fea.kernel.distances import signed_distance
from scan2fea.kernel.surfaces import Surface
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction.bores import ALONG, AROUND, CLEAR, LEAST_POINTS, RADIUS_KNOWN, Bore, distinct_bores, every_bore, meet, on_one_axis
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.plane_growing import Planes, grow_planes
from scan2fea.reconstruction.regular import EXACT
from scan2fea.reconstruction.round_growing import CHORD, off_round_m
from scan2fea.types import BoolArray, Check, FloatArray, TriangleMesh, Value

BORES_CLOSED = "scanned bores that are closed"
WIDEST = 4.0  # spacings, radius: what closes a wider one is bare for all to see, and may be a bolt
HELD = 0.4  # of the points due on the wall of a bore between its two faces: noise, or another face between these, puts few there
LIKE_HELD = 0.2  # the same where another bore is as wide and as deep: of a pattern one is seen at a slant
DEEPEST = 8.0  # times that radius: from one face to the other
SECTORS = 5  # of AROUND: many points of a wall lie in more
LEAST_TOLD, CIRCLE_CHANCE = 8, 1e-4  # points of its wall; that as many at random, in one of dozens of circles, lie so near to its edge
LIKE_CHANCE, LIKE_FREE = 1e-3, 2  # the same where another bore is as wide and as deep: the centre alone is fitted
OUTWARD = 0.5  # mean cosine between normals and the way from the axis: of skins 0.6 to 0.9, of bores 0.3 at most
BEHIND = 0.25  # of the radius of a bore, from its wall into the solid
LEAST_SIDE = 2  # points of a sector of its wall, that tell the solid there
BESIDE = 4  # of the sectors round it that hold points of each face: the edge of a plate may run past a hole
FREE, CHANCE = 3, 0.05  # centre and radius are fitted; that points of a circle scatter so far about it
BAND_CHANCE = 1e-3  # that the points on the wall of a bore reach over so little of its depth
ONE_SIDE, BESIDE_EDGE = 1 / 3, 1 / 2  # of its girth: of a wall at a slant half is seen; and of one round which the faces end
SIDE_CHANCE = 0.01  # that the points deep in it lie on so little
CORE, BOTTOM = 0.7, 3  # of the radius: so many points of a bottom lie nearer to the axis, of the wall none
WHOLE = 1.2  # of the radius: tets at the wall of a bore too
STEPS = 64  # places on the axis


@dataclass(frozen=True, eq=False, kw_only=True)
class Told(Value):
    """grown : the planes under the points; None where these are too many.   bores : those that the points tell beside them."""

    grown: Planes | None
    bores: Sequence[Bore]


def told_by(points: FloatArray, normals: FloatArray, spacing_m: float, sigma_m: float) -> Told:
    """What the points tell. points, normals : (n, 3) raw, and outward."""
    try:
        grown = grow_planes(points, normals, spacing_m, sigma_m)
    except ReconstructionError:
        return Told(grown=None, bores=())
    return Told(grown=grown, bores=told_bores(points, normals, spacing_m, sigma_m, grown))


def told_bores(points: FloatArray, normals: FloatArray, spacing_m: float, sigma_m: float, planes: Planes) -> list[Bore]:
    """Small round holes through walls, with points on all their wall and none within.

    points, normals : (n, 3) raw, and outward.   planes : under them.
    """
    found = every_bore(points, planes, spacing_m, sigma_m, DEEPEST * WIDEST * spacing_m, HELD)
    if not found:
        return []
    nearest = cKDTree(points)
    found = [bore for bore in found if _faces_in(bore, normals[nearest.query(bore.wall)[1]])]
    least = LEAST_POINTS if sigma_m <= EXACT else LEAST_TOLD  # chance puts not even five points on a circle exactly
    told = [bore for bore in found if _is_told(bore, points, spacing_m, sigma_m, least, CIRCLE_CHANCE, HELD, FREE)]
    like = [bore for bore in found if any(_is_like(bore, other) for other in told)]
    more = [bore for bore in like if _is_told(bore, points, spacing_m, sigma_m, LEAST_POINTS, LIKE_CHANCE, LIKE_HELD, LIKE_FREE)]
    return distinct_bores([*told, *more])


def closed_bores(bores: Sequence[Bore], mesh: TriangleMesh) -> Check:
    """Does the solid lie across the axis of one of the bores, between the outermost points of its wall, or is there none behind a side of this?"""
    axes = [_on_axis(bore.surface, bore.wall) for bore in bores]
    inside = signed_distance(np.concatenate(axes), mesh).reshape(-1, STEPS).min(axis=1) < 0 if axes else np.zeros(0, bool)
    closed = [bore.surface.point for bore, is_closed in zip(bores, inside, strict=True) if is_closed or _is_broken(bore, mesh)]
    n = max(len(closed), _n_openings(bores, mesh) - surface_topology(mesh).n_handles) if bores else 0  # one that is open to the side is no handle
    says = (
        f"the points show {len(bores)} bores, and the solid closes or breaks {n} of them{around(np.array(closed))}: "
        "give the sensor position, or scan them more densely"
    )
    return at_most(BORES_CLOSED, float(n), 0.0, says)


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


def _faces_in(bore: Bore, normals: FloatArray) -> bool:
    """Do the normals (k, 3) of its wall not all look away from the axis? Those of the skins of a wall do, between which a circle fits; of few points
    of a bore they are blended with those of the faces, or look to the axis.
    """
    aside = bore.wall - _foot(bore.surface, bore.wall)
    return bool(np.einsum("ij,ij->i", normals, aside / np.linalg.norm(aside, axis=1, keepdims=True)).mean() < OUTWARD)


def _is_like(bore: Bore, other: Bore) -> bool:
    """Is a bore as wide and as deep as another? Bolt holes come in patterns, on both legs of an angle too: one more of the same needs less proof."""
    as_wide = abs(bore.surface.radius - other.surface.radius) < RADIUS_KNOWN * other.surface.radius
    as_deep = abs(bore.depth_m - other.depth_m) < RADIUS_KNOWN * other.depth_m
    return bool(as_wide and as_deep)


def _is_told(bore: Bore, points: FloatArray, spacing_m: float, sigma_m: float, least: int, chance: float, held: float, free: int) -> bool:
    surface, wall = bore.surface, bore.wall
    along, aside = _along(surface, wall), (wall - surface.point) @ surface.frame().T
    deep = bore.depth_m - 2.0 * CLEAR * sigma_m
    due = 2.0 * math.pi * surface.radius * deep * bore.beside / spacing_m**2
    if surface.radius > WIDEST * spacing_m or bore.around < BESIDE or len(wall) < held * due or not _all_round(aside):
        return False
    if _in_a_band(np.ptp(along) / deep, len(wall)) or _on_one_side(aside[bore.deep], ONE_SIDE if bore.around == AROUND else BESIDE_EDGE):
        return False
    spread = math.hypot(sigma_m, CHORD * spacing_m)
    if chdtrc(len(wall) - FREE, float((surface.distance(wall) ** 2).sum()) / spread**2) < CHANCE:
        return False
    width = math.sqrt(3.0 * float((surface.distance(wall) ** 2).mean()))  # of a band as evenly filled; at random points lie anywhere in the circle
    share = 4.0 * surface.radius * width / (surface.radius + off_round_m(spacing_m, sigma_m)) ** 2
    if len(wall) < least or min(share, 1.0) ** (len(wall) - free) > chance:
        return False
    every = _along(surface, points)
    near = points[(every > along.min()) & (every < along.max())]
    off = near - surface.point
    return bool(np.sum(np.linalg.norm(off - np.outer(off @ surface.axis, surface.axis), axis=1) < CORE * surface.radius) < BOTTOM)


def _n_openings(bores: Sequence[Bore], mesh: TriangleMesh) -> int:
    """How many openings the bores are: a step is none of its own, and the two ends of a slot, with nothing of the solid between them, are one."""
    kept: list[Bore] = []
    for bore in bores:
        if not any(on_one_axis(bore.surface, other.surface) or _in_one_slot(bore, other, mesh) for other in kept):
            kept.append(bore)
    return len(kept)


def _in_one_slot(one: Bore, other: Bore, mesh: TriangleMesh) -> bool:
    """Are two bores through one wall open to each other all the way, and has neither points of its wall towards the other?"""
    if abs(one.surface.axis @ other.surface.axis) < ALONG or not meet(one, other):
        return False
    middle = one.wall.mean(axis=0, keepdims=True)
    first, last = _foot(one.surface, middle)[0], _foot(other.surface, middle)[0]
    for bore, start, end in ((one, first, last), (other, last, first)):
        aside = bore.wall - _foot(bore.surface, bore.wall)
        way = (end - start) / np.linalg.norm(end - start)
        if (aside @ way > CORE * bore.surface.radius).any():
            return False
    return bool((signed_distance(first + np.linspace(0.0, 1.0, STEPS)[:, None] * (last - first), mesh) > 0).all())


def _is_broken(bore: Bore, mesh: TriangleMesh) -> bool:
    """Is there no solid behind the points of one sector of its wall? It is open to the side then: what lies between it and an edge is lost."""
    aside = bore.wall - _foot(bore.surface, bore.wall)
    sector = np.floor(np.arctan2(*(aside @ bore.surface.frame().T).T[::-1]) / (2.0 * np.pi) * AROUND).astype(np.int64) + AROUND // 2
    behind = signed_distance(bore.wall + BEHIND * aside, mesh) < 0
    n, n_solid = np.bincount(sector, minlength=AROUND + 1), np.bincount(sector, weights=behind, minlength=AROUND + 1)
    return bool(((n >= LEAST_SIDE) & (n_solid == 0)).any())


def _all_round(aside: FloatArray) -> bool:
    """Does the axis lie among the points (n, 2) of the wall, in as many sectors about it as so many have by chance, SECTORS at most?

    Those of a fillet or a notch lie on one side of it, those of the two skins of a wall on two. n points leave all but k of m sectors bare with a
    probability of at most C(m, k) (k / m)^n.
    """
    turn = np.sort(np.arctan2(aside[:, 1], aside[:, 0]))
    few = next((k for k in range(SECTORS) if math.comb(AROUND, k + 1) * ((k + 1) / AROUND) ** len(turn) > BAND_CHANCE), SECTORS)
    in_sectors = len(np.unique(np.floor(turn / (2.0 * np.pi) * AROUND)))
    return bool(in_sectors > few and np.diff(np.append(turn, turn[0] + 2.0 * math.pi)).max() < math.pi)


def _in_a_band(reach: float, n: int) -> bool:
    """Do n points reach over less of the depth than those of a bore's wall would? They are of a face across it then. reach : share of the depth.

    n uniform draws reach over at most x of their range with probability n x^(n-1) - (n-1) x^n.
    """
    return bool(reach < HELD and n * reach ** (n - 1) - (n - 1) * reach**n < BAND_CHANCE)


def _on_one_side(aside: FloatArray, limit: float) -> bool:
    """Do the points (n, 2) deep between the faces lie on less of the girth than those of a bore would? They are of the face that ends the wall.

    n uniform draws lie within a share x of a circle, of at most a half, with probability n x^(n-1).
    """
    turn = np.sort(np.arctan2(aside[:, 1], aside[:, 0]))
    share = 1.0 - np.diff(np.append(turn, turn[0] + 2.0 * math.pi)).max() / (2.0 * math.pi)
    return bool(share < limit and len(turn) * share ** (len(turn) - 1) < SIDE_CHANCE)


def _along(surface: Surface, points: FloatArray) -> FloatArray:
    return np.asarray((points - surface.point) @ surface.axis)


def _foot(surface: Surface, points: FloatArray) -> FloatArray:
    """(n, 3) the places on the axis that are nearest."""
    return np.asarray(surface.point + np.outer(_along(surface, points), surface.axis))


def _on_axis(surface: Surface, wall: FloatArray) -> FloatArray:
    along = _along(surface, wall)
    return np.asarray(surface.point + np.linspace(along.min(), along.max(), STEPS)[:, None] * surface.axis)
