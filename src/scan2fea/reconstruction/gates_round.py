"""What is asked of the round faces of a solid: each cylinder as one face, its points about it as if it were flat."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import fdtrc

from scan2fea.kernel.surfaces import Surface
from scan2fea.reconstruction.evidence import at_most
from scan2fea.reconstruction.round_cuts import Shapes
from scan2fea.reconstruction.round_growing import CHORD
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, TriangleMesh

OUT, OUT_CHANCE, OUT_NOISE = 0.01, 1e-6, 0.3  # as for bent flat faces
FITTED, TERMS = 5, 7  # of the cylinder; of what it may be in truth: oval, three-lobed, a cone, a barrel, a ring whose axis bends
LEAST_POINTS = FITTED + TERMS + 4


def one_region(mesh: TriangleMesh, every: Shapes) -> TriangleMesh:
    """The solid with one region for all facets of a cylinder: the number of its shape, doubled, plus 1 where it looks against its side."""
    region = np.zeros(len(mesh.faces), np.int64) if mesh.face_region is None else mesh.face_region
    return replace(mesh, face_region=2 * every.primitive[region // 2] + region % 2)


def rolled(every: Shapes) -> dict[int, Surface]:
    """The cylinder of each region of `one_region` that is one, its sense that of the face."""
    first = every.n_flat
    return {
        2 * (first + k) + side: replace(surface, sense=surface.sense * (1 - 2 * side))
        for k, surface in enumerate(every.rounds.surfaces)
        for side in (0, 1)
    }


def round_distance(points: FloatArray, number: IntArray, off: FloatArray, every: Shapes) -> FloatArray:
    """(n,) distances `off` from the facets, but from the cylinder itself where a point's face is of one.   number : (n,) cylinder, -1 none."""
    out = off.copy()
    for k, surface in enumerate(every.rounds.surfaces):
        own = number == k
        out[own] = np.minimum(np.abs(surface.distance(points[own])), off[own])
    return out


def out_of_round(points: FloatArray, number: IntArray, every: Shapes, sigma_m: float, spacing_m: float) -> Check:
    """How many points lie on cylinders that are oval, conical or bent more than chance would make them?   number : (n,) cylinder, -1 none."""
    out: BoolArray = np.zeros(len(points), bool)
    for k, surface in enumerate(every.rounds.surfaces):
        own = np.flatnonzero(number == k)
        if len(own) < LEAST_POINTS:
            continue
        explained, left = _squares(points[own], surface)
        free = len(own) - FITTED - TERMS
        ratio = explained / TERMS / max(left / free, 1e-300)
        swing = math.sqrt(explained / len(own))
        out[own] = swing > OUT_NOISE * sigma_m + CHORD * spacing_m and float(fdtrc(TERMS, free, ratio)) < OUT_CHANCE
    share = float(np.mean(out)) if len(out) else 0.0
    return at_most("faces out of round", share, OUT, f"{share:.1%} of the points lie on faces that are round, but no cylinder (limit {OUT:.0%})")


def _squares(points: FloatArray, surface: Surface) -> tuple[float, float]:
    """Sums of squares of distances from a cylinder: what the terms that no cylinder has explain, and what they leave."""
    across = (points - surface.point) @ surface.frame().T
    angle, height = np.arctan2(across[:, 1], across[:, 0]), (points - surface.point) @ surface.axis
    z = (height - height.mean()) / max(float(height.std()), 1e-300)
    c, s = np.cos(angle), np.sin(angle)
    own = [np.ones_like(z), c, s, z * c, z * s]
    more = [np.cos(2 * angle), np.sin(2 * angle), np.cos(3 * angle), np.sin(3 * angle), z, z * z * c, z * z * s]
    distance = surface.distance(points)
    few, all_ = np.stack(own, axis=1), np.stack([*own, *more], axis=1)
    plain = few @ np.linalg.lstsq(few, distance, rcond=None)[0]
    better = all_ @ np.linalg.lstsq(all_, distance, rcond=None)[0]
    return float(((better - plain) ** 2).sum()), float(((distance - better) ** 2).sum())
