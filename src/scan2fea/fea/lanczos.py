"""Block Lanczos (Grimes, Lewis and Simon 1994): the modes of the free body from its elastic flexibility, and shapes of buckling.

Held at three points a body can be solved for any load that its own inertia balances (inertia relief); without its rigid motions the answer is that
of the free body. The shift is then zero, and each round costs one pair of triangular solves for all vectors of the block.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scan2fea.errors import SolveError
from scan2fea.fea.linear import Inverse
from scan2fea.fea.modes import Modes, Products, orthonormal
from scan2fea.types import FloatArray

MAX_ROUNDS = 40
Blocks = Callable[[FloatArray], FloatArray]  # (3n, r) to (3n, r)


def largest(
    inner: Blocks, operate: Blocks, start: FloatArray, k: int, tolerance: float, fixed: FloatArray, *, of_inner: bool
) -> tuple[FloatArray, FloatArray, float, int]:
    """(values (k,) falling, vectors (3n, k) orthonormal, error, rounds) of an operator that is symmetric in the inner product.

    operate : takes a block, or with `of_inner` its image under `inner`.   start : (3n, b), orthonormal.   fixed : (3n, f), orthonormal with it, kept
    out of all vectors.   tolerance : of the error, the largest square of |A x - t x| / t: a value is relatively wrong by that over the gap to the
    next. Fewer than k where the space ends. Raises SolveError without convergence in `MAX_ROUNDS`.
    """
    known, i_known = fixed, inner(fixed)  # all that is known so far
    n_fixed, block, small = fixed.shape[1], start, np.zeros((0, 0))
    error = np.inf
    for count in range(1, MAX_ROUNDS + 1):
        i_block = inner(block)
        known, i_known = np.concatenate([known, block], axis=1), np.concatenate([i_known, i_block], axis=1)
        image = operate(i_block if of_inner else block)
        part = i_known.T @ image
        left = image - known @ part
        old, column = len(small), part[n_fixed:]
        small = np.block([[small, column[:old]], [column[:old].T, (column[old:] + column[old:].T) / 2]])
        block = orthonormal(left, inner, known, i_known)
        values, vectors = (x[..., ::-1] for x in np.linalg.eigh(small))
        if len(values) >= k or not block.shape[1]:
            k = min(k, len(values))
            off = np.linalg.norm(block.T @ inner(left) @ vectors[old:, :k], axis=0) / np.maximum(np.abs(values[:k]), 1e-300)
            error = float((off**2).max())
            if error <= tolerance or not block.shape[1]:
                return values[:k], known[:, n_fixed:] @ vectors[:, :k], error, count
    raise SolveError(f"eigenvalues still {error:.1e} off after {MAX_ROUNDS} rounds, limit {tolerance:g}")


def free_modes(products: Products, inverse: Inverse, start: FloatArray, n_wanted: int, tolerance: float) -> Modes:
    """The six rigid and the lowest elastic modes, `n_wanted` together.

    inverse : of the stiffness held at three points.   start : (3n, b) orthonormal in the mass, the rigid motions first.   tolerance : see `largest`.
    Raises SolveError where that is not reached, or where an elastic motion has no stiffness.
    """
    n, rigid = len(start) // 3, start[:, :6]

    def soft(x: FloatArray) -> FloatArray:
        return inverse.apply(x.reshape(n, 3, -1)).reshape(3 * n, -1)

    values, shapes, error, rounds = largest(products.mass, soft, start[:, 6:], n_wanted - 6, tolerance, rigid, of_inner=True)
    if len(values) < n_wanted - 6 or values[-1] <= 0:
        raise SolveError(f"only {int((values > 0).sum())} elastic modes of {3 * n} dof were found")
    shapes = np.concatenate([rigid, shapes], axis=1).T.reshape(n_wanted, n, 3)
    return Modes(eigenvalues=np.concatenate([np.zeros(6), 1 / values]), shapes=shapes, error=error, rounds=rounds)
