"""What a cloud says about itself: the spacing of its points and the noise across its surface."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaincinv

from scan2fea.kernel.near_tree import NearTree, near_tree
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.patch_noise import QUADRIC_TERMS, patch_noise
from scan2fea.types import BoolArray, FloatArray, IntArray

SPACING_NEIGHBORS = 6  # reconstruction.md: h = median of the mean distance to 6 neighbours
_SPACING_QUERIES = 20_000  # the median of 20,000 draws is within 1 % of the median of all where the spacing varies by a factor of 2
_SIGMA_QUERIES = 1_000
QUANTILE = 0.3  # patches across an edge read too high, so the scale is taken from the flat ones: low quantile, exact factor below
_SHEET_SHARE = 0.5  # of a patch must lie on the point's own sheet: less is a stripe of the scan, or several sheets
_SAME_SIDE = 0.3  # cosine between normals of one side of a wall
_FLAT = 0.3  # a neighbourhood tells noise from shape only if it is this much thinner than wide
_THERE = 24  # neighbours that tell the noise of one place, to a sixth
_EXACT_SHARE, _EXACT = 0.1, 1e-6  # of the patches about measured points, and of their width: noise leaves none so flat, edges bend all others


def sampled_rows(n: int, at_most: int, seed: int) -> IntArray:
    """`at_most` of n rows (all if there are fewer), drawn without replacement, ascending."""
    if n <= at_most:
        return np.arange(n, dtype=np.int64)
    return np.sort(np.random.default_rng(seed).choice(n, at_most, replace=False)).astype(np.int64)


def spacing(points: FloatArray, seed: int = 0, tree: NearTree | None = None) -> float:
    """Median over the points of the mean distance to the 6 nearest others, m. 0 if all points are equal, nan for fewer than two points.

    points : (n, 3). Large clouds are judged by a seeded draw of 20,000 of their points.   tree : of the points, where one is there already.
    """
    if len(points) < 2:
        return float("nan")
    distances, _ = k_nearest(points, SPACING_NEIGHBORS + 1, points[sampled_rows(len(points), _SPACING_QUERIES, seed)], tree)
    return float(np.median(distances[:, 1:].mean(axis=1)))


def noise_sigma(
    points: FloatArray,
    normals: FloatArray | None = None,
    seed: int = 0,
    tree: NearTree | None = None,
    below_m: float = math.inf,
    is_measured: BoolArray | None = None,
) -> float:
    """Standard deviation of the points across their surface, m; nan where the data cannot tell it from shape.

    points : (n, 3).   normals : (n, 3) oriented outward, or None. With them only neighbours on the same side of a wall are used
    (n_i.n_j > 0.3). Without them the sheet a point lies on is told from the other one by the gap between; walls thinner than about six
    sigma then read as noise.   tree : of the points, where one is there already.   below_m : whether it is below this is all that is asked: nan,
    too, where smaller neighbourhoods already show more.   is_measured : (n,) or None, for which nothing is said of points without noise: what a
    stage has put on an exact plane has none either.

    Each of a seeded draw of points gives the residual of a quadric z(x, y) over its neighbours (a plane would read curvature as
    noise). The scale is the 30 % quantile of these residuals, divided by what that quantile is for pure Gaussian noise (chi-square
    with k - 6 degrees of freedom; 0.9 at k = 24, the 0.92 of reconstruction.md). Neighbourhoods grow until the noise is small
    against their width.
    """
    rows = sampled_rows(len(points), _SIGMA_QUERIES, seed)
    for k in (24, 48, 96, 192, 384):
        if len(points) < k:
            break
        tree = tree or near_tree(points)
        _, near = k_nearest(points, k, points[rows], tree)
        rms, width, used = patch_noise(points[near] - points[rows][:, None], np.zeros((0, k)) if normals is None else _same_side(normals, rows, near))
        good = used >= max(2 * QUADRIC_TERMS + 1, _SHEET_SHARE * k)
        if good.mean() < 0.5:
            continue
        own = good & is_measured[rows] if is_measured is not None else np.zeros(len(rows), bool)
        flattest = float(np.quantile(rms[own], _EXACT_SHARE)) if own.any() else math.inf
        if flattest <= _EXACT * float(np.median(width[good])):
            return flattest
        dof = used[good] - QUADRIC_TERMS
        scaled = rms[good] / np.sqrt(2.0 * gammaincinv(dof / 2.0, QUANTILE) / dof)
        sigma = float(np.quantile(scaled, QUANTILE))
        if sigma <= _FLAT * float(np.median(width[good])):
            return sigma
        if sigma > below_m:  # wider neighbourhoods hold more of the noise, not less
            break
    return float("nan")


def noise_there(points: FloatArray, normals: FloatArray, rows: IntArray) -> FloatArray:
    """(m,) variance of the points across their surface round each of `rows`, m^2, 0 where too few lie on its side: along rays it goes with the angle.

    points, normals : (n, 3), oriented. Residuals of a quadric over the nearest, as in `noise_sigma`; too small where noise is as wide as these reach.
    """
    near = k_nearest(points, min(_THERE, len(points)), points[rows])[1]
    rms, _, used = patch_noise(points[near] - points[rows][:, None], _same_side(normals, rows, near))
    return np.asarray(np.where(used > 2 * QUADRIC_TERMS, np.nan_to_num(rms), 0.0) ** 2)


def _same_side(normals: FloatArray, rows: IntArray, near: IntArray) -> FloatArray:
    same: FloatArray = (np.einsum("mc,mkc->mk", normals[rows], normals[near]) > _SAME_SIDE).astype(float)
    return same
