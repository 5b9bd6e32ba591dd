"""Block Gauss-Seidel sweeps over a matrix of blocks, all right sides together: the smoothers of both multigrids.

A sweep down and one up are each other's transpose, so that a cycle of both stays symmetric.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray


@jit
def _add(out: FloatArray, factor: float, block: FloatArray, x: FloatArray) -> None:
    """out (b, r) += factor block (b, b) x (b, r)."""
    for p in range(block.shape[0]):
        for q in range(block.shape[1]):
            a = factor * block[p, q]
            for c in range(x.shape[1]):
                out[p, c] += a * x[q, c]


@jit
def descend(
    indptr: IntArray, indices: IntArray, blocks: FloatArray, diagonal: FloatArray, right: FloatArray, x: FloatArray, left: FloatArray
) -> None:
    """One block Gauss-Seidel sweep from zero, into `x`, and what it leaves of the right side, into `left`; (n, b, r), both zero before.

    From zero a row sees only the rows before it, and is left with what the rows behind it change afterwards: with the block below the diagonal,
    turned, for the one above it each is read once.
    """
    rest = np.zeros(right.shape[1:])
    for i in range(len(right)):
        for b in range(right.shape[1]):
            for c in range(right.shape[2]):
                rest[b, c] = right[i, b, c]
        for k in range(indptr[i], indptr[i + 1]):
            if indices[k] < i:
                _add(rest, -1.0, blocks[k], x[indices[k]])
        _add(x[i], 1.0, diagonal[i], rest)
        for k in range(indptr[i], indptr[i + 1]):
            if indices[k] < i:
                _add(left[indices[k]], -1.0, blocks[k].T, x[i])


@jit
def ascend(indptr: IntArray, indices: IntArray, blocks: FloatArray, diagonal: FloatArray, right: FloatArray, x: FloatArray) -> None:
    """One block Gauss-Seidel sweep from the last row to the first, in place: the transpose of the one on the way down."""
    rest = np.zeros(right.shape[1:])
    for i in range(len(right) - 1, -1, -1):
        for b in range(right.shape[1]):
            for c in range(right.shape[2]):
                rest[b, c] = right[i, b, c]
        for k in range(indptr[i], indptr[i + 1]):
            if indices[k] != i:
                _add(rest, -1.0, blocks[k], x[indices[k]])
        x[i] = 0.0
        _add(x[i], 1.0, diagonal[i], rest)
