"""What a cloud says about itself: the spacing of its points and the noise across its surface."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincinv

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.types import FloatArray, IntArray

SPACING_NEIGHBORS = 6  # reconstruction.md: h = median of the mean distance to 6 neighbours
_SPACING_QUERIES = 20_000  # the median of 20,000 draws is within 1 % of the median of all where the spacing varies by a factor of 2
_SIGMA_QUERIES = 3_000
_QUANTILE = 0.3  # patches across an edge read too high, so the scale is taken from the flat ones: low quantile, exact factor below
_QUADRIC_TERMS = 6
_FLAT = 0.3  # a neighbourhood tells noise from shape only if it is this much thinner than wide


def sampled_rows(n: int, at_most: int, seed: int) -> IntArray:
    """`at_most` of n rows (all if there are fewer), drawn without replacement, ascending."""
    if n <= at_most:
        return np.arange(n, dtype=np.int64)
    return np.sort(np.random.default_rng(seed).choice(n, at_most, replace=False)).astype(np.int64)


def spacing(points: FloatArray, seed: int = 0) -> float:
    """Median over the points of the mean distance to the 6 nearest others, m. 0 if all points are equal, nan for fewer than two points.

    points : (n, 3). Large clouds are judged by a seeded draw of 20,000 of their points.
    """
    if len(points) < 2:
        return float("nan")
    distances, _ = k_nearest(points, SPACING_NEIGHBORS + 1, points[sampled_rows(len(points), _SPACING_QUERIES, seed)])
    return float(np.median(distances[:, 1:].mean(axis=1)))


def noise_sigma(points: FloatArray, normals: FloatArray | None = None, seed: int = 0) -> float:
    """Standard deviation of the points across their surface, m; nan where the data cannot tell it from shape.

    points : (n, 3).   normals : (n, 3) oriented outward, or None. With them only neighbours on the same side of a wall are used
    (n_i.n_j > 0.3); without them a wall thinner than about two spacings reads as noise.

    Each of a seeded draw of points gives the residual of a quadric z(x, y) over its neighbours (a plane would read curvature as
    noise). The scale is the 30 % quantile of these residuals, divided by what that quantile is for pure Gaussian noise (chi-square
    with k - 6 degrees of freedom; 0.9 at k = 24, the 0.92 of reconstruction.md). Neighbourhoods grow until the noise is small
    against their width.
    """
    rows = sampled_rows(len(points), _SIGMA_QUERIES, seed)
    for k in (24, 48, 96, 192, 384):
        if len(points) < k:
            break
        _, near = k_nearest(points, k, points[rows])
        rms, width, used = _residuals(points, near, None if normals is None else _same_side(normals, rows, near))
        good = used > 2 * _QUADRIC_TERMS
        if good.mean() < 0.5:
            continue
        dof = used[good] - _QUADRIC_TERMS
        scaled = rms[good] / np.sqrt(2.0 * gammaincinv(dof / 2.0, _QUANTILE) / dof)
        sigma = float(np.quantile(scaled, _QUANTILE))
        if sigma <= _FLAT * float(np.median(width[good])):
            return sigma
    return float("nan")


def _same_side(normals: FloatArray, rows: IntArray, near: IntArray) -> FloatArray:
    same: FloatArray = (np.einsum("mc,mkc->mk", normals[rows], normals[near]) > 0.3).astype(float)
    return same


def _residuals(points: FloatArray, near: IntArray, weight: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Root mean square residual (degrees of freedom counted), lateral width (standard deviation) and number of points of each quadric."""
    w = np.ones(near.shape) if weight is None else weight
    used = w.sum(axis=1)
    patch = points[near]
    patch = patch - (w[..., None] * patch).sum(axis=1, keepdims=True) / np.maximum(used, 1.0)[:, None, None]
    values, axes = np.linalg.eigh(np.einsum("mk,mki,mkj->mij", w, patch, patch) / np.maximum(used, 1.0)[:, None, None])
    width = np.sqrt(np.maximum(values[:, 1], 0.0))
    scale = np.sqrt(np.maximum(values[:, 2], 0.0))
    scale = np.where(scale > 0, scale, 1.0)  # a patch of one point
    z, y, x = np.moveaxis(np.einsum("mki,mij->mkj", patch, axes), -1, 0) / scale[:, None]
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1) * w[..., None]
    normal_matrix = np.einsum("mki,mkj->mij", basis, basis) + 1e-12 * used[:, None, None] * np.eye(_QUADRIC_TERMS)
    coefficients = np.linalg.solve(normal_matrix, np.einsum("mki,mk->mi", basis, z * w)[..., None])[..., 0]
    error = (z * w - np.einsum("mki,mi->mk", basis, coefficients)) * scale[:, None]
    rms = np.sqrt((error**2).sum(axis=1) / np.maximum(used - _QUADRIC_TERMS, 1.0))
    return rms, width, used
