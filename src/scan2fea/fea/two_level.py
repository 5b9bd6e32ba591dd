"""Two-level multigrid of quadratic elements: sweeps over all nodes, and the linear elements of the same mesh solved by factors.

On compact solids the factors of a quadratic mesh fill memory; those of its corners are an eighth of the unknowns and a thirtieth of the numbers. The
corners' matrix is that of the linear fields among the quadratic ones (Ronquist and Patera 1987).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from scan2fea.errors import SolveError, require
from scan2fea.fea.assemble import System, entry
from scan2fea.fea.cholesky import Cholesky
from scan2fea.fea.dissection import dissect, without
from scan2fea.fea.sweeps import ascend, descend
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray
from scan2fea.units import BYTES_PER_MIB


def _corners_of(system: System) -> tuple[IntArray, IntArray]:
    """(nodes that are corners, (n, 2) the numbers among them of the ends of every node)."""
    is_corner = system.ends[:, 0] == system.ends[:, 1]
    return np.flatnonzero(is_corner), (np.cumsum(is_corner) - 1)[system.ends]


def _corner_graph(system: System, n_corners: int, ends: IntArray) -> tuple[IntArray, IntArray]:
    n = system.n_nodes
    among = sp.csr_array((np.ones(len(system.indices), np.int32), system.indices, system.indptr), shape=(n, n))
    to = sp.csr_array((np.ones(2 * n, np.int32), ends.ravel(), 2 * np.arange(n + 1)), shape=(n, n_corners))
    graph = sp.csr_array(to.T @ among @ to)
    graph.sort_indices()
    return graph.indptr.astype(np.int64), graph.indices.astype(np.int64)


class TwoLevel:
    """One cycle on (K + shift M) of the nodes that are not held."""

    def __init__(self, system: System, held: BoolArray, shift: float, max_factor_mb: float) -> None:
        """held : (n,). Raises SolveError where the factors of the corners would need more memory, or their matrix is not positive definite."""
        corners, ends = _corners_of(system)
        self._indptr, self._indices = np.array(system.indptr), np.array(system.indices)
        self._blocks = np.array(system.stiffness)
        if shift:
            self._blocks[:, range(3), range(3)] += shift * np.asarray(system.mass)[:, None]
        rows = np.repeat(np.arange(system.n_nodes), np.diff(self._indptr))
        self._diagonal = np.linalg.inv(self._blocks[rows == self._indices])
        self._diagonal[held] = 0.0  # keeps them at zero in every sweep
        weight = np.where(np.repeat(held, 2), 0.0, 0.5)
        self._up = sp.csr_array((weight, ends.ravel(), 2 * np.arange(system.n_nodes + 1)), shape=(system.n_nodes, len(corners)))
        self._down = sp.csr_array(self._up.T)
        indptr, indices = _corner_graph(system, len(corners), ends)
        tree = without(dissect(system.nodes[corners], indptr, indices), held[corners])
        need = 8 * tree.peak_entries / BYTES_PER_MIB
        require(need <= max_factor_mb, SolveError, f"factors of the corners need {need:.0f} MiB, fea.max_factor_mb = {max_factor_mb:g}")
        coarse = np.zeros((len(indices), 3, 3))
        _condense(self._indptr, self._indices, self._blocks, np.ascontiguousarray(ends), held, indptr, indices, coarse)
        alone = System(
            indptr=indptr,
            indices=indices,
            stiffness=coarse,
            mass=np.zeros(len(indices)),
            nodes=system.nodes[corners],
            ends=np.repeat(np.arange(len(corners))[:, None], 2, axis=1),
        )
        self._coarse = Cholesky(alone, tree, 0.0)

    def apply(self, right: FloatArray) -> FloatArray:
        """Approximate x (n, 3, r) for right sides (n, 3, r); held nodes get 0."""
        n, _, r = right.shape
        right = np.ascontiguousarray(right)
        x, left = np.zeros_like(right), np.zeros_like(right)
        descend(self._indptr, self._indices, self._blocks, self._diagonal, right, x, left)
        below = np.asarray(self._down @ left.reshape(n, 3 * r)).reshape(-1, 3, r)
        x += np.asarray(self._up @ self._coarse.apply(below).reshape(len(below), 3 * r)).reshape(n, 3, r)
        ascend(self._indptr, self._indices, self._blocks, self._diagonal, right, x)
        return x


@jit
def _condense(
    indptr: IntArray, indices: IntArray, blocks: FloatArray, ends: IntArray, held: BoolArray,
    to_indptr: IntArray, to_indices: IntArray, out: FloatArray,
) -> None:  # fmt: skip
    """The matrix of the corners alone, every other node in the middle between its ends."""
    for i in range(len(indptr) - 1):
        for k in range(indptr[i], indptr[i + 1]):
            j = indices[k]
            if held[i] or held[j]:
                continue
            for a in range(2):
                row = ends[i, a]
                for b in range(2):
                    at = entry(to_indices, to_indptr[row], to_indptr[row + 1], ends[j, b])
                    for c in range(3):
                        for d in range(3):
                            out[at, c, d] += 0.25 * blocks[k, c, d]
