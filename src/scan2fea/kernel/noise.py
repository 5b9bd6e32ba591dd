"""What a cloud says about itself: the spacing of its points and the noise across its surface."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincinv

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.types import FloatArray, IntArray

SPACING_NEIGHBORS = 6  # reconstruction.md: h = median of the mean distance to 6 neighbours
_SPACING_QUERIES = 20_000  # the median of 20,000 draws is within 1 % of the median of all where the spacing varies by a factor of 2
_SIGMA_QUERIES = 1_000
_QUANTILE = 0.3  # patches across an edge read too high, so the scale is taken from the flat ones: low quantile, exact factor below
_QUADRIC_TERMS = 6
_SHEET_SHARE = 0.5  # of a patch must lie on the point's own sheet: less is a stripe of the scan, or several sheets
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
    (n_i.n_j > 0.3). Without them the sheet a point lies on is told from the other one by the gap between; walls thinner than about six
    sigma then read as noise.

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
        patch = points[near] - points[rows][:, None]
        weight = _own_sheet(patch) if normals is None else _same_side(normals, rows, near)
        _, rms, width, used = _quadric(patch, weight)
        good = used >= max(2 * _QUADRIC_TERMS + 1, _SHEET_SHARE * k)
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


def _own_sheet(patch: FloatArray) -> FloatArray:
    """(m, k) 1 for the neighbours on the sheet of the point itself (the origin of its patch), 0 for those beyond a gap across it.

    The scale across is the shortest interval that holds 40 % of the heights: 1.05 sigma for one Gaussian sheet, up to 2.56 sigma for two
    equal ones (a quarter less in small samples). The start keeps twice that around the own height, which is inside a gap of 6 sigma in
    either case; three quadric fits, each keeping what is within 3.5 of its residuals' rms, then grow to the whole sheet.
    """
    k = patch.shape[1]
    centred = patch - patch.mean(axis=1, keepdims=True)
    normal = np.linalg.eigh(np.einsum("mki,mkj->mij", centred, centred))[1][:, :, 0]
    height = np.einsum("mki,mi->mk", patch, normal)
    ranked = np.sort(height, axis=1)
    held = max(2, round(0.4 * k))
    scale = (ranked[:, held - 1 :] - ranked[:, : k - held + 1]).min(axis=1) / 1.05
    weight: FloatArray = (np.abs(height) <= 2.0 * scale[:, None]).astype(float)
    for _ in range(3):
        error, rms, _, used = _quadric(patch, weight)
        grown = (np.abs(error) <= 3.5 * rms[:, None]).astype(float)
        weight = np.where((used > 2 * _QUADRIC_TERMS)[:, None], grown, weight)
    return weight


def _quadric(points: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The quadric through each weighted patch (m, k, 3): errors of all its points, rms of the weighted ones, lateral width, their number.

    The rms counts degrees of freedom; the width is a standard deviation along the narrower direction of the surface.
    """
    used = w.sum(axis=1)
    patch = points - (w[..., None] * points).sum(axis=1, keepdims=True) / np.maximum(used, 1.0)[:, None, None]
    values, axes = np.linalg.eigh(np.einsum("mk,mki,mkj->mij", w, patch, patch) / np.maximum(used, 1.0)[:, None, None])
    width = np.sqrt(np.maximum(values[:, 1], 0.0))
    size = np.sqrt(np.maximum(values[:, 2], 0.0))
    scale = np.where(size > 0, size, 1.0)
    z, y, x = np.moveaxis(np.einsum("mki,mij->mkj", patch, axes), -1, 0) / scale[:, None]
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1)
    weighted = basis * w[..., None]
    normal_matrix = np.einsum("mki,mkj->mij", weighted, basis) + 1e-12 * np.maximum(used, 1.0)[:, None, None] * np.eye(_QUADRIC_TERMS)
    coefficients = np.linalg.solve(normal_matrix, np.einsum("mki,mk->mi", weighted, z)[..., None])[..., 0]
    error = (z - np.einsum("mki,mi->mk", basis, coefficients)) * scale[:, None]
    rms = np.sqrt((w * error**2).sum(axis=1) / np.maximum(used - _QUADRIC_TERMS, 1.0))
    return error, rms, width, used
