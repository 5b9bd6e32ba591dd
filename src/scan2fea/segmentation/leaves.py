"""Leaves: points that lie on no surface, in a bush around a post or a heap of small things that touches a frame.

A point lies on a surface where its neighbourhood is flat, near or farther: a thin plate looks rough from near, a bar from afar. Neighbours vote once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scan2fea.kernel.neighbors import k_nearest, radius_components
from scan2fea.kernel.noise import sampled_rows
from scan2fea.types import BoolArray, FloatArray, IntArray

_ROUGH = ((16, 0.08), (96, 0.15))  # neighbours, share of their spread across their plane: a third in leaves, a hundredth on a face
_VOTERS = 16
_JUDGED = 4_000
_BUSH = 0.1  # of all leaves: less is a joint or a rim that looks rough, and goes to its nearest neighbour
_LEAST = 300  # points on surfaces that tell something; a smaller part goes to its nearest neighbour
_WORTH = 0.2  # of the points: less are edges, strays and small parts


def on_surfaces(points: FloatArray, rows: IntArray) -> BoolArray:
    """(m,) which of the rows of points (n, 3) of even density lie on a surface."""
    smooth = np.zeros(len(rows), bool)
    for k, rough in _ROUGH:
        patch = points[k_nearest(points, k, points[rows])[1]]
        patch = patch - patch.mean(axis=1, keepdims=True)
        spread = np.linalg.eigvalsh(np.einsum("mki,mkj->mij", patch, patch))
        smooth |= spread[:, 0] <= rough * spread.sum(axis=1)
    return smooth


def leaves_of(points: FloatArray) -> BoolArray | None:
    """(n,) which points of even density are leaves; None where they are fewer than a fifth, or all."""
    sample = sampled_rows(len(points), _JUDGED, 0)
    if (~on_surfaces(points, sample)).mean() < _WORTH:
        return None
    smooth = on_surfaces(points, np.arange(len(points)))
    leaf: BoolArray = smooth[k_nearest(points, _VOTERS, points)[1]].mean(axis=1) < 0.5
    return leaf if _WORTH <= leaf.mean() <= 1.0 - _WORTH else None


def share_of_surfaces(points: FloatArray, on: BoolArray) -> float:
    """Share of the points marked (n,) among those of points (n, 3) that lie on surfaces: leaves at a frame explain nothing. 0 where few do."""
    rows = sampled_rows(len(on), _JUDGED, 0)
    smooth = on_surfaces(points, rows)
    return float(on[rows][smooth].mean()) if smooth.sum() >= _LEAST else 0.0


def apart_from_leaves(
    points: FloatArray, leaf: BoolArray, reach_m: float, min_points: int, labelled: Callable[[FloatArray], IntArray]
) -> IntArray:
    """Labels (n,) from 0 of the connected bushes, and what `labelled` says of each connected part of the rest."""
    labels = np.full(len(points), -1, np.int64)
    for is_bush in (False, True):
        rows = np.flatnonzero(leaf == is_bush)
        part = radius_components(points[rows], reach_m)
        least = max(min_points, _BUSH * len(rows) if is_bush else _LEAST)
        for p in np.flatnonzero(np.bincount(part, minlength=1) >= least):
            own = rows[part == p]
            labels[own] = int(labels.max()) + 1 + (np.zeros(len(own), np.int64) if is_bush else labelled(points[own]))
    known = np.flatnonzero(labels >= 0)
    if not len(known):
        return np.zeros(len(points), np.int64)
    return np.unique(labels[known[k_nearest(points[known], 1, points)[1][:, 0]]], return_inverse=True)[1].astype(np.int64)
