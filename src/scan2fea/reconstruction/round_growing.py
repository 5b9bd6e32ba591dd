"""Circular cylinders under a cloud whose outer side is known: bores, walls of tubes, round rims, grown as planes are and held against them.

At each seed the plane that grows from it and the cylinders that the normals round it suggest are both grown as far as the noise allows; a cylinder
is one where it takes in clearly more points than the plane (Schnabel, Wahl, Klein 2007, with seeds by flatness in place of chance). Its axis and
radius are least squares through raw points, likeliest for normal noise; it joins a direction of the planes' frame where that allows (`regular`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.surfaces import Surface, about_axis, covariance, first_cylinder, fitted
from scan2fea.reconstruction.hanging import Among
from scan2fea.reconstruction.plane_growing import (
    FAILURES,
    LEAST_POINTS,
    MOST_PLANES,
    NEIGHBORS,
    OWN_SIDE,
    SEED,
    SIGMAS,
    grown_plane,
    own_points,
    robust_plane,
    tolerance_m,
)
from scan2fea.reconstruction.regular import EXACT, HARDLY, UNLIKELY, near_ways
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

CHORD = 0.05  # spacings: what a round face's points may lie off it without noise: drawn as facets, or as a surface follows its points
REACHES = (3.0, 6.0, 12.0)  # spacings round a seed from which a cylinder is guessed
GUESSED = 8  # points that a guess needs
MORE = 1.5  # times the points of the plane that a cylinder must take in
ROUNDS = 12
JUDGED = 4000  # points that a cylinder is fitted to
SQUARE = float(np.sin(np.radians(20.0)))  # of normals against a direction that planes give, to try it as an axis
RADIUS_KNOWN = 0.05  # std of a radius, of it: a cylinder known worse is none
LEAST_TURN = float(np.radians(60.0))  # that the normals of a cylinder's points turn through
SECTORS = 24
SHARED = 2  # times the planes of a solid that may be found on the way: strips of them lie on cylinders that come later


@dataclass(frozen=True, eq=False, kw_only=True)
class Rounds(Value):
    """surfaces : cylinders, those of most points first.   label : (n,) cylinder of each point, -1 none.   std_m : (c,) of the radii."""

    surfaces: tuple[Surface, ...]
    label: IntArray
    std_m: FloatArray

    def __len__(self) -> int:
        return len(self.surfaces)


NO_ROUNDS = Rounds(surfaces=(), label=np.zeros(0, np.int64), std_m=np.zeros(0))


def off_round_m(spacing_m: float, sigma_m: float) -> float:
    """How far a point may lie off its cylinder."""
    return SIGMAS * sigma_m + (CHORD + 0.02) * spacing_m


def grow_rounds(points: FloatArray, normals: FloatArray, spacing_m: float, sigma_m: float) -> Rounds:
    """The cylinders of (n, 3) raw points with outward normals; none where planes explain as much.

    Raises ReconstructionError where so many planes are found on the way that they can be no solid of flat and round faces.
    """
    _, near = k_nearest(points, NEIGHBORS)
    alike = np.einsum("ni,nki->nk", normals, normals[near[:, 1:]])
    flatness = np.where(alike > 0, alike, 0.0).sum(axis=1) / np.maximum((alike > 0).sum(axis=1), 1)
    among = Among.of(points, normals, near)
    off = off_round_m(spacing_m, sigma_m)
    free = np.ones(len(points), bool)
    ways, found, failures = np.zeros((0, 3)), list[Surface](), 0
    for seed in np.argsort(-flatness, kind="stable").tolist():
        if not free[seed]:
            continue
        if failures >= FAILURES:
            break
        plane = grown_plane(among, seed, free, spacing_m, tolerance_m(spacing_m, sigma_m)) if flatness[seed] >= SEED else None
        flat = np.zeros(len(points), bool) if plane is None else own_points(points, normals, plane, tolerance_m(spacing_m, sigma_m)) & free
        best = _best(among, seed, free, ways, spacing_m, sigma_m, int(flat.sum()))
        if best is not None:
            found.append(best)
            free &= ~on_round(points, normals, best, off)
            failures = 0
        elif plane is not None and flat.sum() >= LEAST_POINTS and flat[seed]:
            free &= ~flat
            ways = np.vstack([ways, plane.normal])
            require(len(ways) <= SHARED * MOST_PLANES, ReconstructionError, f"the points fall into {len(ways)} planes and more: they are free form")
            failures = 0
        else:
            free[seed] = False
            failures += 1
    return settled_rounds(points, normals, found, ways, spacing_m, sigma_m)


def on_round(points: FloatArray, normals: FloatArray, surface: Surface, off: float) -> BoolArray:
    """(n,) points within `off` of a cylinder, of its side."""
    on = np.abs(surface.distance(points)) <= off
    on[on] = np.einsum("ij,ij->i", surface.normals(points[on]), normals[on]) >= OWN_SIDE
    return np.asarray(on)


def _best(
    among: Among, seed: int, free: BoolArray, ways: FloatArray, spacing_m: float, sigma_m: float, flat: int
) -> Surface | None:
    """The cylinder through a seed that takes in most free points; None where none takes in clearly more than the `flat` ones of its plane."""
    least = max(LEAST_POINTS, MORE * flat)
    best: tuple[int, Surface] | None = None
    for guess in _guesses(among, seed, free, ways, spacing_m, sigma_m):
        grown = _grown(among, seed, free, guess, spacing_m, sigma_m)
        if grown is None or len(grown[1]) < least or (best is not None and len(grown[1]) <= best[0]):
            continue
        own = among.points[grown[1]]
        strip = np.abs(robust_plane(own, among.normals[seed]).distance(own)) <= tolerance_m(spacing_m, sigma_m)
        if len(own) >= MORE * strip.sum():  # normals blended along an edge turn over a strip of a face, whose points lie on a plane
            best = len(own), grown[0]
    return None if best is None else best[1]


def _guesses(among: Among, seed: int, free: BoolArray, ways: FloatArray, spacing_m: float, sigma_m: float) -> Iterator[Surface]:
    """Cylinders that the normals near a seed suggest, along the direction they have least of, or one that planes give."""
    normal = among.normals[seed]
    tangent = Plane(normal=normal, offset=float(normal @ among.points[seed]))
    for reach in REACHES:
        rows = among.near(seed, free, tangent, reach * spacing_m + SIGMAS * sigma_m, 0.0, reach * spacing_m)
        if len(rows) < GUESSED:
            continue
        points, normals = among.points[rows], among.normals[rows]
        own = first_cylinder(points, normals)
        if own is not None:
            yield own
        for way in _square(ways, normals):
            given = about_axis(points, normals, way)
            if given is not None:
                yield given


def _square(ways: FloatArray, normals: FloatArray) -> list[FloatArray]:
    """Directions of planes, each once, to which the normals (n, 3) are square."""
    out: list[FloatArray] = []
    for way in ways[np.median(np.abs(normals @ ways.T), axis=0) <= SQUARE]:
        if all(abs(float(way @ other)) < 0.99 for other in out):
            out.append(way)
    return out


def _grown(
    among: Among, seed: int, free: BoolArray, surface: Surface, spacing_m: float, sigma_m: float
) -> tuple[Surface, IntArray] | None:
    """The cylinder through a guess, fitted to the points on it that hang together with the seed, and their rows; None where it settles on none."""
    off = off_round_m(spacing_m, sigma_m)
    size = float(np.linalg.norm(among.high - among.low))
    before = np.zeros(0, np.int64)
    for step in range(ROUNDS):
        if not 0.5 * spacing_m < surface.radius < size:
            return None
        rows = among.near_round(seed, free, surface, off if step else 2.0 * off + 0.25 * spacing_m, OWN_SIDE)
        if len(rows) < GUESSED:
            return None
        if np.array_equal(rows, before):
            break
        fit = fitted(surface, among.points[rows[sampled_rows(len(rows), JUDGED, 0)]])
        if fit is None:
            return None
        surface, before = fit, rows
    return (surface, rows) if is_round(surface, among.points[rows], spacing_m, sigma_m) else None


def is_round(surface: Surface, points: FloatArray, spacing_m: float, sigma_m: float) -> bool:
    """Do points go round a cylinder far enough to know its radius?"""
    spread = max(sigma_m, surface.rms_m, 1e-9 * spacing_m)
    if not 0.0 <= covariance(surface, points, spread)[4, 4] <= (RADIUS_KNOWN * surface.radius) ** 2:  # below 0: points that tell no radius
        return False
    across = (points - surface.point) @ surface.frame().T
    sector = np.floor(np.arctan2(across[:, 1], across[:, 0]) / (2 * np.pi) * SECTORS).astype(np.int64)
    return len(np.unique(sector)) * 2 * np.pi / SECTORS >= LEAST_TURN


def settled_rounds(points: FloatArray, normals: FloatArray, found: list[Surface], ways: FloatArray, spacing_m: float, sigma_m: float) -> Rounds:
    """The cylinders with every point given to the nearest, fitted again along directions they share with planes (k, 3) and each other.

    Those left with too few points, or whose radius these do not tell, are dropped.
    """
    off = off_round_m(spacing_m, sigma_m)
    for _ in range(2):
        label = nearest_round(points, normals, found, off)
        kept, shared = list[Surface](), ways
        for k in np.argsort(-np.bincount(label[label >= 0], minlength=len(found)), kind="stable").tolist():
            own = points[label == k]
            own = own[sampled_rows(len(own), JUDGED, 0)]
            fit = _along(found[k], own, shared, sigma_m) if len(own) >= LEAST_POINTS else None
            if fit is not None and is_round(fit, own, spacing_m, sigma_m) and not any(_is_one(fit, own, s, off) for s in kept):
                kept.append(fit)
                shared = np.vstack([shared, fit.axis])
        found = kept
    label = nearest_round(points, normals, found, off)
    std = [radius_std(s, points[label == k], sigma_m) for k, s in enumerate(found)]
    return Rounds(surfaces=tuple(found), label=label, std_m=np.array(std))


def _is_one(surface: Surface, own: FloatArray, other: Surface, off: float) -> bool:
    """Do the points of a cylinder lie on another, of whichever side? A wall is thicker than nothing."""
    return bool(abs(surface.radius - other.radius) <= off and np.median(np.abs(other.distance(own))) <= 0.5 * off)


def nearest_round(points: FloatArray, normals: FloatArray, found: list[Surface] | tuple[Surface, ...], off: float) -> IntArray:
    """(n,) the cylinder of its side that each point lies nearest to, -1 beyond `off`."""
    label, best = np.full(len(points), -1, np.int64), np.full(len(points), off)
    for k, surface in enumerate(found):
        distance = np.where(on_round(points, normals, surface, off), np.abs(surface.distance(points)), np.inf)
        closer = distance <= best
        label[closer], best[closer] = k, distance[closer]
    return label


def _along(start: Surface, own: FloatArray, ways: FloatArray, sigma_m: float) -> Surface | None:
    """The cylinder through its points, along a direction of (k, 3) where squares grow by less than chance makes, or hardly at all."""
    fit = fitted(start, own)
    if fit is None:
        return None
    noise = max(sigma_m, fit.rms_m)
    for way in near_ways(ways, fit.axis):
        turned = fitted(replace(fit, axis=way), own, free=np.array([True, True, False, False, True]))
        if turned is None:
            continue
        grown = len(own) * (turned.rms_m**2 - fit.rms_m**2)
        if grown <= UNLIKELY * noise**2 or (sigma_m > EXACT and turned.rms_m <= HARDLY * noise):
            return turned
    return fit


def radius_std(surface: Surface, own: FloatArray, sigma_m: float) -> float:
    """What the radius is known to, m: by chance, and by noise along the tangent, that draws the least-squares circle out by sigma^2 / (2 r)."""
    sigma = max(sigma_m, surface.rms_m)
    return math.hypot(math.sqrt(covariance(surface, own, sigma)[4, 4]), 0.5 * sigma**2 / surface.radius)


