"""What is left of the neighbourhoods of points when a quadric is taken out: one compiled pass over the patches, nothing stored between them."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.kernel.small_matrices import eigh_3, solve_definite
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
    weight, error, terms = np.empty(k), np.empty(k), np.empty((k, QUADRIC_TERMS + 1))
    for i in range(m):
        if len(weights) > 0:
            for j in range(k):
                weight[j] = weights[i, j]
            rms[i], width[i], used[i] = _quadric(patches[i], weight, error, terms)
        else:
            rms[i], width[i], used[i] = _own_sheet(patches[i], weight, error, terms)
    return rms, width, used


@jit_ieee
def _own_sheet(patch: FloatArray, weight: FloatArray, error: FloatArray, terms: FloatArray) -> tuple[float, float, float]:
    """Fills the weights with 1 for the neighbours on the sheet of the point itself (the origin of its patch), 0 for those beyond a gap across it;
    what `_quadric` says of them.

    The scale across is the shortest interval that holds 40 % of the heights: 1.05 sigma for one Gaussian sheet, up to 2.56 sigma for two
    equal ones (a quarter less in small samples). The start keeps twice that around the own height, which is inside a gap of 6 sigma in
    either case; three quadric fits, each keeping what is within 3.5 of its residuals' rms, then grow to the whole sheet.
    """
    k = len(patch)
    weight[:] = 1.0
    axes, height = _axes(patch, weight)[1], error
    for j in range(k):
        height[j] = patch[j, 0] * axes[0, 0] + patch[j, 1] * axes[1, 0] + patch[j, 2] * axes[2, 0]
    ranked = np.sort(height)
    held = max(2, round(_HELD * k))
    scale = np.inf
    for j in range(k - held + 1):
        scale = min(scale, ranked[j + held - 1] - ranked[j])
    for j in range(k):
        weight[j] = 1.0 if abs(height[j]) <= _START * scale / 1.05 else 0.0
    for _ in range(_GROWTHS):
        rms, width, used = _quadric(patch, weight, error, terms)
        is_whole = True
        if used > 2 * QUADRIC_TERMS:
            for j in range(k):
                kept = 1.0 if abs(error[j]) <= _KEEP * rms else 0.0
                is_whole = is_whole and kept == weight[j]
                weight[j] = kept
        if is_whole:  # the same neighbours have the same quadric
            return rms, width, used
    return _quadric(patch, weight, error, terms)


@jit_ieee
def _axes(patch: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Variances, ascending, and axes (3, 3) of a weighted patch, and its middle."""
    n = max(weight.sum(), 1.0)
    middle, spread, values, axes = np.zeros(3), np.zeros((3, 3)), np.empty(3), np.empty((3, 3))
    for j in range(len(patch)):
        for a in range(3):
            middle[a] += weight[j] * patch[j, a]
    middle /= n
    for j in range(len(patch)):
        if weight[j] > 0:
            x, y, z = patch[j, 0] - middle[0], patch[j, 1] - middle[1], patch[j, 2] - middle[2]
            spread[0, 0] += weight[j] * x * x
            spread[1, 0] += weight[j] * y * x
            spread[1, 1] += weight[j] * y * y
            spread[2, 0] += weight[j] * z * x
            spread[2, 1] += weight[j] * z * y
            spread[2, 2] += weight[j] * z * z
    for a in range(3):
        for b in range(a + 1):
            spread[a, b] /= n
            spread[b, a] = spread[a, b]
    eigh_3(spread, values, axes)
    return values, axes, middle


@jit_ieee
def _quadric(patch: FloatArray, weight: FloatArray, error: FloatArray, terms: FloatArray) -> tuple[float, float, float]:
    """The quadric through the weighted patch (k, 3): fills the errors of all its points; rms of the weighted ones, lateral width, their number.

    terms : (k, 7) room for the terms of the quadric and the height of every point in the axes of the patch.
    """
    used = weight.sum()
    values, axes, middle = _axes(patch, weight)
    width, size = np.sqrt(max(values[1], 0.0)), np.sqrt(max(values[2], 0.0))
    scale = size if size > 0 else 1.0
    axes /= scale
    matrix, right = np.zeros((QUADRIC_TERMS, QUADRIC_TERMS)), np.zeros(QUADRIC_TERMS)
    for j in range(len(patch)):
        term = terms[j]
        _terms(patch[j], axes, middle, term)
        if weight[j] > 0:
            for a in range(QUADRIC_TERMS):
                right[a] += term[a] * term[QUADRIC_TERMS]
                for b in range(a + 1):
                    matrix[a, b] += term[a] * term[b]
    for a in range(QUADRIC_TERMS):
        matrix[a, a] += 1e-12 * max(used, 1.0)
    solve_definite(matrix, right)
    total = 0.0
    for j in range(len(patch)):
        left = terms[j, QUADRIC_TERMS]
        for a in range(QUADRIC_TERMS):
            left -= terms[j, a] * right[a]
        error[j] = left * scale
        total += weight[j] * error[j] * error[j]
    return np.sqrt(total / max(used - QUADRIC_TERMS, 1.0)), width, used


@jit_ieee
def _terms(point: FloatArray, axes: FloatArray, middle: FloatArray, term: FloatArray) -> None:
    """Fills the terms of the quadric at a point in the axes of the patch, and its height there."""
    dx, dy, dz = point[0] - middle[0], point[1] - middle[1], point[2] - middle[2]
    z = dx * axes[0, 0] + dy * axes[1, 0] + dz * axes[2, 0]
    y = dx * axes[0, 1] + dy * axes[1, 1] + dz * axes[2, 1]
    x = dx * axes[0, 2] + dy * axes[1, 2] + dz * axes[2, 2]
    term[0], term[1], term[2], term[3], term[4], term[5], term[6] = 1.0, x, y, x * x, x * y, y * y, z
