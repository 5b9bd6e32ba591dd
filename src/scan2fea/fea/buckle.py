"""Linear buckling of a solid: the factor of a load at which its stresses take away all stiffness of some shape."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from scan2fea.errors import SolveError
from scan2fea.fea.assemble import System, _find, _jacobian
from scan2fea.fea.elements import quadrature, shape_gradient
from scan2fea.fea.linear import StaticSolver
from scan2fea.fea.strain import stresses
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray, Material, TetMesh

_SEED, _TOLERANCE, _ROUNDS = 11, 1e-7, 60


@jit
def _fill(
    nodes: FloatArray,
    tets: IntArray,
    indptr: IntArray,
    indices: IntArray,
    dshape: FloatArray,
    weights: FloatArray,
    stress: FloatArray,
    out: FloatArray,
) -> None:
    """Add every element's integral of grad N_a . sigma . grad N_b; stress (m, q, 3, 3)."""
    n = tets.shape[1]
    inverse = np.zeros((3, 3))
    g = np.zeros((n, 3))
    s = np.zeros((n, 3))
    for e in range(len(tets)):
        for q in range(len(weights)):
            det = _jacobian(nodes, tets[e], dshape[q], inverse)
            for a in range(n):
                for c in range(3):
                    g[a, c] = (dshape[q, a, 0] * inverse[0, c] + dshape[q, a, 1] * inverse[1, c] + dshape[q, a, 2] * inverse[2, c]) / det
            for a in range(n):
                for c in range(3):
                    s[a, c] = stress[e, q, c, 0] * g[a, 0] + stress[e, q, c, 1] * g[a, 1] + stress[e, q, c, 2] * g[a, 2]
            w = weights[q] * det / 6.0
            for a in range(n):
                for b in range(n):
                    k = _find(indices, indptr[tets[e, a]], indptr[tets[e, a] + 1], tets[e, b])
                    out[k] += w * (g[b, 0] * s[a, 0] + g[b, 1] * s[a, 1] + g[b, 2] * s[a, 2])


def stress_stiffness(mesh: TetMesh, material: Material, system: System, field: FloatArray) -> sp.csr_array:
    """(n, n), alike along x, y and z: what the stresses under the displacements (n, 3) add to the stiffness, N/m."""
    points, weights = quadrature(1 if mesh.order == 1 else 2)
    out = np.zeros(len(system.indices))
    nodes, tets = np.array(mesh.nodes - mesh.nodes.mean(axis=0)), np.array(mesh.tets, np.int64)
    indptr, indices = np.array(system.indptr), np.array(system.indices)
    _fill(nodes, tets, indptr, indices, shape_gradient(points, tets.shape[1]), weights, stresses(mesh, material, field), out)
    return sp.csr_array((out, indices, indptr), shape=(len(nodes), len(nodes)))


def buckling_factors(stiffness: sp.csr_array, solver: StaticSolver, held: BoolArray, n_modes: int = 1) -> tuple[FloatArray, FloatArray]:
    """(factors (k,), rising; shapes (k, n, 3)): K x = -factor * Kg x by Lanczos on K^-1 Kg in the norm of K. Raises SolveError without convergence.

    Fewer than `n_modes` where the load presses nothing.
    """
    n = len(held)
    free = (~held).astype(float)
    inverse = solver.inverse()

    def shaped(x: FloatArray) -> FloatArray:
        return np.asarray(x).reshape(n, 3)

    def pressed(x: FloatArray) -> FloatArray:
        return np.asarray(-(stiffness @ (shaped(x) * free)) * free).ravel()

    def stiff(x: FloatArray) -> FloatArray:
        return np.asarray(solver.product(shaped(x) * free) + shaped(x) * (1 - free)).ravel()

    def soft(x: FloatArray) -> FloatArray:
        return np.asarray(inverse.apply(shaped(x)[:, :, None])[:, :, 0] + shaped(x) * (1 - free)).ravel()

    a, m, w = (LinearOperator((3 * n, 3 * n), matvec=f, dtype=float) for f in (pressed, stiff, soft))
    start = (np.random.default_rng(_SEED).normal(size=(n, 3)) * free).ravel()
    try:
        values, vectors = eigsh(a, k=n_modes, M=m, Minv=w, which="LA", v0=start, tol=_TOLERANCE, maxiter=_ROUNDS, ncv=max(16, 3 * n_modes))
    except ArpackNoConvergence as error:
        says = f"buckling: no shape found after {_ROUNDS} rounds: the load presses hardly anything, or the mesh is too distorted"
        raise SolveError(says) from error
    order = np.argsort(-values, kind="stable")
    values, vectors = values[order], vectors[:, order]
    keep = values > 0
    return 1 / values[keep], vectors[:, keep].T.reshape(-1, n, 3)
