"""Algebraic multigrid as an approximate inverse (Vanek, Mandel, Brezina 1996), with the six rigid-body modes as near-null space.

It needs little memory on compact solids, where factors fill up; on thin walls it converges slowly, and there factors are small. The hierarchy is
pyamg's; the cycles are ours: all right sides go through each matrix together, and a matrix is read once on the way down and once on the way up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from scan2fea.errors import SolveError
from scan2fea.fea.assemble import System
from scan2fea.fea.sweeps import ascend, descend
from scan2fea.types import BoolArray, FloatArray, IntArray

STRONG = 0.08  # coupling, relative to the diagonal, that joins nodes: with 0.03 coarser, and thin walls took twice the cycles
COARSEST = 150  # nodes of the level that is solved by factors
_SEED = 20_240_607


@dataclass(frozen=True, eq=False, kw_only=True)
class _Level:
    """A matrix of n x n blocks (indptr, indices, blocks (nnz, b, b)), the inverses (n, b, b) of its diagonal blocks, and the way up from the next."""

    indptr: IntArray
    indices: IntArray
    blocks: FloatArray
    diagonal: FloatArray
    up: sp.csr_array
    down: sp.csr_array


class Multigrid:
    """One V-cycle on (K + shift M) of the nodes that are not held."""

    def __init__(self, system: System, rigid: FloatArray, held: BoolArray, shift: float) -> None:
        """rigid : (n, 3, 6).   Raises SolveError where the hierarchy cannot be built."""
        import pyamg

        self._free = np.flatnonzero(~held)
        matrix = system.stiffness_matrix()
        if shift:
            matrix = sp.bsr_array(matrix + shift * sp.kron(system.mass_matrix(), sp.eye_array(3), format="bsr"))
        dofs = (3 * self._free[:, None] + np.arange(3)).ravel()
        inner = sp.bsr_matrix(sp.csr_matrix(matrix)[dofs][:, dofs], blocksize=(3, 3))
        inner.indices, inner.indptr = inner.indices.astype(np.int32), inner.indptr.astype(np.int32)
        state = np.random.get_state()  # noqa: NPY002  pyamg draws its start vectors from the global generator
        np.random.seed(_SEED)  # noqa: NPY002
        try:
            made = pyamg.smoothed_aggregation_solver(
                inner, B=rigid[self._free].reshape(-1, 6), strength=("symmetric", {"theta": STRONG}), symmetry="symmetric", max_coarse=COARSEST
            ).levels
            self._levels = [_level(level) for level in made[:-1]]
            self._coarse = _factored(made[-1].A.toarray())
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            raise SolveError(f"multigrid cannot be set up on {len(dofs)} dof: {error}") from error
        finally:
            np.random.set_state(state)  # noqa: NPY002

    def apply(self, right: FloatArray) -> FloatArray:
        """Approximate x (n, 3, r) for right sides (n, 3, r); held nodes get 0."""
        n, _, r = right.shape
        out = np.zeros((n, 3, r))
        out[self._free] = self._cycle(0, np.array(right[self._free].reshape(-1, r), order="C")).reshape(-1, 3, r)
        return out

    def _cycle(self, k: int, right: FloatArray) -> FloatArray:
        """One V-cycle from level k down, on (m, r)."""
        if k == len(self._levels):
            return np.asarray(scipy.linalg.cho_solve(self._coarse, right))
        at = self._levels[k]
        rows = right.reshape(len(at.diagonal), -1, right.shape[1])
        x, left = np.zeros_like(rows), np.zeros_like(rows)
        descend(at.indptr, at.indices, at.blocks, at.diagonal, rows, x, left)
        x += (at.up @ self._cycle(k + 1, np.asarray(at.down @ left.reshape(right.shape)))).reshape(x.shape)
        ascend(at.indptr, at.indices, at.blocks, at.diagonal, rows, x)
        return x.reshape(right.shape)


def _factored(matrix: FloatArray) -> tuple[FloatArray, bool]:
    """Cholesky factor of the coarsest matrix; unknowns that an aggregate of few nodes does not have stay zero. Raises LinAlgError."""
    none = np.flatnonzero(matrix.diagonal() <= 0)
    matrix[none, none] = 1.0
    return scipy.linalg.cho_factor(matrix, lower=True)


def _level(level: Any) -> _Level:
    """A level of pyamg's."""
    matrix = sp.bsr_array(level.A)
    matrix.sort_indices()
    n = len(matrix.indptr) - 1
    row = np.repeat(np.arange(n), np.diff(matrix.indptr))
    on = np.flatnonzero(row == matrix.indices)
    diagonal = np.zeros((n, *matrix.blocksize))
    diagonal[row[on]] = np.linalg.pinv(matrix.data[on], hermitian=True)  # an aggregate of few nodes has fewer than six motions
    up = sp.csr_array(level.P)
    indptr, indices = matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64)
    return _Level(indptr=indptr, indices=indices, blocks=matrix.data, diagonal=diagonal, up=up, down=sp.csr_array(up.T))
