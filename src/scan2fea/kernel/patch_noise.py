"""What is left of the neighbourhoods of points when a quadric is taken out: one compiled pass over the patches, nothing stored between them."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import FloatArray

QUADRIC_TERMS = 6
_HELD = 0.4  # of the heights: the shortest interval that holds them is the scale across
_START, _KEEP = 2.0, 3.5  # of that scale, and of the residuals' rms
_GROWTHS = 3


@jit_ieee
def patch_noise(patches: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(m,) rms about the quadric through each patch, lateral width, and number of points used.

    patches : (m, k, 3) neighbours of m points, from the point.   weights : (m, k) 1 for those that count, or (0, k): then the sheet a point
    lies on is told from others by the gap between.

    The rms counts degrees of freedom; the width is a standard deviation along the narrower direction of the surface.
    """
    m, k = patches.shape[0], patches.shape[1]
    rms, width, used = np.zeros(m), np.zeros(m), np.zeros(m)
    weight, error = np.empty(k), np.empty(k)
    for i in range(m):
        if len(weights) > 0:
            weight[:] = weights[i]
        else:
            _own_sheet(patches[i], weight, error)
        rms[i], width[i], used[i] = _quadric(patches[i], weight, error)
    return rms, width, used


@jit_ieee
def _own_sheet(patch: FloatArray, weight: FloatArray, error: FloatArray) -> None:
    """Fills the weights with 1 for the neighbours on the sheet of the point itself (the origin of its patch), 0 for those beyond a gap across it.

    The scale across is the shortest interval that holds 40 % of the heights: 1.05 sigma for one Gaussian sheet, up to 2.56 sigma for two
    equal ones (a quarter less in small samples). The start keeps twice that around the own height, which is inside a gap of 6 sigma in
    either case; three quadric fits, each keeping what is within 3.5 of its residuals' rms, then grow to the whole sheet.
    """
    k = len(patch)
    weight[:] = 1.0
    normal = np.ascontiguousarray(_axes(patch, weight)[1][:, 0])
    height = np.dot(patch, normal)
    ranked = np.sort(height)
    held = max(2, round(_HELD * k))
    scale = np.inf
    for j in range(k - held + 1):
        scale = min(scale, ranked[j + held - 1] - ranked[j])
    for j in range(k):
        weight[j] = 1.0 if abs(height[j]) <= _START * scale / 1.05 else 0.0
    for _ in range(_GROWTHS):
        rms, _width, used = _quadric(patch, weight, error)
        if used > 2 * QUADRIC_TERMS:
            for j in range(k):
                weight[j] = 1.0 if abs(error[j]) <= _KEEP * rms else 0.0


@jit_ieee
def _axes(patch: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Variances, ascending, and axes (3, 3) of a weighted patch, and its middle."""
    n = max(weight.sum(), 1.0)
    middle, spread = np.zeros(3), np.zeros((3, 3))
    for j in range(len(patch)):
        for a in range(3):
            middle[a] += weight[j] * patch[j, a] / n
    for j in range(len(patch)):
        for a in range(3):
            for b in range(a + 1):
                spread[a, b] += weight[j] * (patch[j, a] - middle[a]) * (patch[j, b] - middle[b]) / n
    for a in range(3):
        for b in range(a):
            spread[b, a] = spread[a, b]
    values, axes = np.linalg.eigh(spread)
    return values, axes, middle


@jit_ieee
def _quadric(patch: FloatArray, weight: FloatArray, error: FloatArray) -> tuple[float, float, float]:
    """The quadric through the weighted patch (k, 3): fills the errors of all its points; rms of the weighted ones, lateral width, their number."""
    used = weight.sum()
    values, axes, middle = _axes(patch, weight)
    width, size = np.sqrt(max(values[1], 0.0)), np.sqrt(max(values[2], 0.0))
    scale = size if size > 0 else 1.0
    matrix, right, term = np.zeros((QUADRIC_TERMS, QUADRIC_TERMS)), np.zeros(QUADRIC_TERMS), np.empty(QUADRIC_TERMS)
    for j in range(len(patch)):
        if weight[j] > 0:
            z = _terms(patch, axes, middle, scale, j, term)
            for a in range(QUADRIC_TERMS):
                right[a] += term[a] * z
                for b in range(a + 1):
                    matrix[a, b] += term[a] * term[b]
    for a in range(QUADRIC_TERMS):
        matrix[a, a] += 1e-12 * max(used, 1.0)
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    coefficients = np.linalg.solve(matrix, right)
    total = 0.0
    for j in range(len(patch)):
        left = _terms(patch, axes, middle, scale, j, term)
        for a in range(QUADRIC_TERMS):
            left -= term[a] * coefficients[a]
        error[j] = left * scale
        total += weight[j] * error[j] * error[j]
    return np.sqrt(total / max(used - QUADRIC_TERMS, 1.0)), width, used


@jit_ieee
def _terms(patch: FloatArray, axes: FloatArray, middle: FloatArray, scale: float, j: int, term: FloatArray) -> float:
    """Fills the terms of the quadric at point j in the axes of the patch; its height there."""
    z, y, x = 0.0, 0.0, 0.0
    for a in range(3):
        away = (patch[j, a] - middle[a]) / scale
        z += away * axes[a, 0]
        y += away * axes[a, 1]
        x += away * axes[a, 2]
    term[0], term[1], term[2], term[3], term[4], term[5] = 1.0, x, y, x * x, x * y, y * y
    return z
