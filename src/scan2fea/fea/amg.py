"""Algebraic multigrid as an approximate inverse (Vanek, Mandel, Brezina 1996), with the six rigid-body modes as near-null space.

It needs little memory on compact solids, where factors fill up; on thin walls it converges slowly, and there factors are small.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from scan2fea.errors import SolveError
from scan2fea.fea.assemble import System
from scan2fea.types import BoolArray, FloatArray

_SEED = 20_240_607


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
            levels = pyamg.smoothed_aggregation_solver(
                inner, B=rigid[self._free].reshape(-1, 6), strength=("symmetric", {"theta": 0.03}), symmetry="symmetric", max_coarse=600
            )
            self._cycle = levels.aspreconditioner(cycle="V")
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            raise SolveError(f"multigrid cannot be set up on {len(dofs)} dof: {error}") from error
        finally:
            np.random.set_state(state)  # noqa: NPY002

    def apply(self, right: FloatArray) -> FloatArray:
        """Approximate x (n, 3, r) for right sides (n, 3, r); held nodes get 0."""
        n, _, r = right.shape
        inner = right[self._free].reshape(-1, r)
        out = np.zeros((n, 3, r))
        out[self._free] = np.stack([self._cycle.matvec(inner[:, c]) for c in range(r)], axis=1).reshape(-1, 3, r)
        return out
