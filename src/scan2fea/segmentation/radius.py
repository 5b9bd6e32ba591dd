"""The radius that joins neighbours on a surface, from the data, for even and uneven density alike."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.near_tree import NearTree, near_tree
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.types import FloatArray, IntArray

_SAMPLE = 3_000
_NEIGHBOURS = (48, 192, 768)  # a ring scanner puts many points of one ring before the first of the next
_MISSING = 0.1
QUANTILE = 0.87
FACTOR = 2.0


def link_radius(points: FloatArray, seed: int = 0, tree: NearTree | None = None) -> float:
    """Radius at which the points of a surface hang together, m; nan for fewer than 8 points.

    Twice the 87 % quantile of the gap to the third nearest of four quadrants around each point, in its own tangent plane. Plain nearest-
    neighbour spacing says nothing across rings or stripes (it is the spacing along them); the third quadrant looks across them, and at
    the border of a surface, where up to two quadrants are empty, it still looks inside. On a random sheet the radius is 3.4 times the mean
    distance to 6 neighbours, which joins each point to some 30 others: the chance of a false cut is nil. High quantile, because it is the
    sparse regions that fall apart; each point counts by the root of its gap, or a dense detail scan, which holds most of the points, would decide
    for the sparse rest. (By area, gap squared, a few strays would decide.)   tree : of the points, where one is there already.
    """
    if len(points) < 8:
        return math.nan
    tree = tree or near_tree(points)
    rows = sampled_rows(len(points), _SAMPLE, seed)
    for k in _NEIGHBOURS:
        gap = _third_quadrant(points, rows, k, tree)
        known = np.isfinite(gap)
        if 1.0 - known.mean() <= _MISSING or k >= len(points):
            break
    if not known.any():
        return math.nan
    ranked = np.sort(gap[known])
    weight = np.cumsum(np.sqrt(ranked))
    return FACTOR * float(ranked[np.searchsorted(weight, QUANTILE * weight[-1])])


def _third_quadrant(points: FloatArray, rows: IntArray, k: int, tree: NearTree) -> FloatArray:
    """(m,) distance to the nearest point of each of four quadrants, the third smallest of the four; inf where two or more are empty."""
    distance, near = k_nearest(points, k, points[rows], tree)
    offset = points[near] - points[rows][:, None]
    spread = offset - offset.mean(axis=1, keepdims=True)
    axes = np.linalg.eigh(np.einsum("mki,mkj->mij", spread, spread))[1]
    along = np.einsum("mki,mi->mk", offset, axes[:, :, 2])
    across = np.einsum("mki,mi->mk", offset, axes[:, :, 1])
    quadrant = 2 * (along >= 0) + (across >= 0)
    nearest = np.stack([np.where((quadrant == q) & (distance > 0), distance, np.inf).min(axis=1) for q in range(4)], 1)
    third: FloatArray = np.sort(nearest, axis=1)[:, 2]
    return third
