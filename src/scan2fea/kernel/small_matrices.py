"""Symmetric matrices of a few rows, and a product of vectors, inside compiled loops, where libraries would take longer than the arithmetic."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit, jit_ieee
from scan2fea.types import FloatArray

_SWEEPS = 12  # Jacobi's converge quadratically: five are enough
_ROUNDING = 1e-17  # of the trace


@jit
def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """(3,) a x b. Numba's own `np.cross` copies arrays into parts of another (see `kernel.jit`)."""
    out = np.empty(3)
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return out


@jit_ieee
def eigh_3(matrix: FloatArray, values: FloatArray, axes: FloatArray) -> None:
    """Fills the eigenvalues (3,), ascending, and the eigenvectors in the columns of axes (3, 3), by Jacobi's rotations.

    matrix : (3, 3) symmetric, written over; one that is not finite gives nan.
    """
    axes[:] = 0.0
    axes[0, 0] = axes[1, 1] = axes[2, 2] = 1.0
    limit = _ROUNDING * (abs(matrix[0, 0]) + abs(matrix[1, 1]) + abs(matrix[2, 2]))
    for _ in range(_SWEEPS):
        if abs(matrix[0, 1]) + abs(matrix[0, 2]) + abs(matrix[1, 2]) <= limit:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] != 0.0:
                    _rotated(matrix, axes, p, q)
    for a in range(3):
        values[a] = matrix[a, a]
    for a, b in ((0, 1), (1, 2), (0, 1)):
        if values[a] > values[b]:
            values[a], values[b] = values[b], values[a]
            for k in range(3):
                axes[k, a], axes[k, b] = axes[k, b], axes[k, a]


@jit_ieee
def _rotated(matrix: FloatArray, axes: FloatArray, p: int, q: int) -> None:
    """The rotation of axes p and q that makes matrix[p, q] zero (Golub and Van Loan, Matrix Computations, 8.5)."""
    tau = (matrix[q, q] - matrix[p, p]) / (2 * matrix[p, q])
    t = math.copysign(1.0, tau) / (abs(tau) + math.sqrt(1.0 + tau * tau))
    c = 1.0 / math.sqrt(1.0 + t * t)
    s, r, off = t * c, 3 - p - q, matrix[p, q]
    matrix[p, p] -= t * off
    matrix[q, q] += t * off
    matrix[p, q] = matrix[q, p] = 0.0
    one, other = matrix[r, p], matrix[r, q]
    matrix[r, p] = matrix[p, r] = c * one - s * other
    matrix[r, q] = matrix[q, r] = s * one + c * other
    for k in range(3):
        one, other = axes[k, p], axes[k, q]
        axes[k, p], axes[k, q] = c * one - s * other, s * one + c * other


@jit_ieee
def solve_definite(matrix: FloatArray, right: FloatArray) -> None:
    """Writes the solution of a symmetric positive definite system over its right side (n,), the factors over its lower half: L D L'."""
    n = len(right)
    for a in range(n):
        for b in range(a):
            left = matrix[a, b]
            for c in range(b):
                left -= matrix[a, c] * matrix[b, c] * matrix[c, c]
            matrix[a, b] = left / matrix[b, b]
        for c in range(a):
            matrix[a, a] -= matrix[a, c] * matrix[a, c] * matrix[c, c]
        for c in range(a):
            right[a] -= matrix[a, c] * right[c]
    for a in range(n):
        right[a] /= matrix[a, a]
    for a in range(n - 1, -1, -1):
        for c in range(a + 1, n):
            right[a] -= matrix[c, a] * right[c]
