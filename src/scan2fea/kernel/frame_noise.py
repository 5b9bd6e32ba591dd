"""How far the points of one scan lie off those of another across the surface that both saw: what poses leave, and what each scan has bent by itself.

The noise about the points' own neighbourhood does not tell it where one scan prevails; and no number of points averages it away.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from scan2fea.kernel.near_tree import NearTree
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.side_normals import SAME_FACE
from scan2fea.types import FloatArray, IntArray

PATCHES, NEIGHBORS = 1_000, 64
LEAST, FREE = 3, 8  # points of a frame in a patch, and degrees of freedom left in it
PAIRS, SHARED = 30, 0.1  # pairs of frames, and share of the patches that have any: where few do, wrong normals bring the skins of a wall together
QUANTILE = 0.75  # of the pairs: a quarter may lie across an edge; more of them than half, as some places are bent more than others
COUNTS = 1.0  # of the noise within a frame: chance, and skins that mix, show less in scans that agree
HALVINGS = 60


class FrameNoise(NamedTuple):
    """Standard deviations across the surface, m. within : of points of one frame.   between : of frames' places, 0 where they agree within that."""

    within: float
    between: float


def frame_noise(points: FloatArray, normals: FloatArray, frame: IntArray, seed: int = 0, tree: NearTree | None = None) -> FrameNoise | None:
    """Noise within and between the frames; None where too few places were seen by two.

    points : (n, 3).   normals : (n, 3) outward: only neighbours on the same face are compared, so the other skin of a wall is none of them.
    frame : (n,) number of the scan each point came from, negative for points of none.   tree : of the points, where one is there already.

    Each of a seeded draw of patches gets one quadric and one height per frame by least squares (analysis of covariance), so frames side by side on a
    bent face are told apart only as well as they overlap. A difference of two heights has the variance v + 2 between^2, v from the fit.
    """
    own = frame >= 0
    if len(points) < NEIGHBORS or len(np.unique(frame[own])) < 2:
        return None
    rows = sampled_rows(len(points), PATCHES, seed)
    near = k_nearest(points, NEIGHBORS, points[rows], tree)[1]
    alike = (np.einsum("nkc,nc->nk", normals[near], normals[rows]) >= SAME_FACE) & own[near]
    patches = [(row, around[use]) for row, around, use in zip(rows, near, alike, strict=True)]
    told = [_heights(points[patch] - points[row], normals[row], frame[patch]) for row, patch in patches]
    pairs = np.concatenate([pair for pair, _ in told])
    if len(pairs) < PAIRS or sum(len(pair) > 0 for pair, _ in told) < SHARED * len(rows):
        return None
    within = float(np.sqrt(np.median([variance for pair, variance in told if len(pair)])))
    between = _between(np.abs(pairs[:, 0]), pairs[:, 1])
    return FrameNoise(within=within, between=between if between > COUNTS * within else 0.0)


def sigma_of_scans(points: FloatArray, normals: FloatArray, frame: IntArray | None, sigma_m: float) -> tuple[float, float]:
    """The noise of the points with that of the places of their scans, and the latter alone; as given where no scan lies off another.

    sigma_m : of neighbouring points, which tells little of the places where one scan prevails; nan where it is not known.
    """
    told = None if frame is None or not math.isfinite(sigma_m) else frame_noise(points, normals, frame)
    if told is None or told.between <= 0.0:
        return sigma_m, 0.0
    return max(sigma_m, math.hypot(*told)), told.between


def _heights(patch: FloatArray, normal: FloatArray, frame: IntArray) -> tuple[FloatArray, float]:
    """(k, 2) differences of the heights of frames in a patch (m, 3), from its point, with their variances; the variance of its points about them."""
    ids, number, count = np.unique(frame, return_inverse=True, return_counts=True)
    use = count[number] >= LEAST
    ids, number = np.unique(number[use], return_inverse=True)
    n_free = int(use.sum()) - 5 - len(ids)
    if len(ids) < 2 or n_free < FREE:
        return np.zeros((0, 2)), 0.0
    across = np.linalg.svd(normal[None])[2][1:]
    xy, z = patch[use] @ across.T, patch[use] @ normal
    x, y = (xy / max(float(np.abs(xy).max()), np.finfo(float).tiny)).T
    design = np.column_stack([x, y, x * x, x * y, y * y, number[:, None] == np.arange(len(ids))])
    values, axes = np.linalg.eigh(design.T @ design)
    if values[0] <= 1e-9 * values[-1]:
        return np.zeros((0, 2)), 0.0
    inverse = (axes / values) @ axes.T
    fit = inverse @ (design.T @ z)
    variance = float(((z - design @ fit) ** 2).sum()) / n_free
    i, j = (5 + k for k in np.triu_indices(len(ids), 1))
    spread = variance * (inverse[i, i] + inverse[j, j] - 2.0 * inverse[i, j])
    return np.column_stack([fit[i] - fit[j], spread]), variance


def _between(apart: FloatArray, variance: FloatArray) -> float:
    """The standard deviation for which QUANTILE of normal differences are as small as those seen (bisection)."""
    expected = float(ndtri(0.5 + 0.5 * QUANTILE))
    low, high = 0.0, float(apart.max())
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        scaled = np.quantile(apart / np.sqrt(np.maximum(variance + 2.0 * middle**2, np.finfo(float).tiny)), QUANTILE)
        low, high = (middle, high) if scaled > expected else (low, middle)
    return low
