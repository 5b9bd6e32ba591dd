"""Linear buckling of a solid: the factor of a load at which its stresses take away all stiffness of some shape."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from scan2fea.errors import SolveError
from scan2fea.fea.assemble import System, _jacobian, entry
from scan2fea.fea.elements import quadrature, shape_gradient
from scan2fea.fea.lanczos import largest
from scan2fea.fea.linear import StaticSolver
from scan2fea.fea.modes import orthonormal
from scan2fea.fea.strain import stresses
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray, Material, TetMesh

_SEED, _TOLERANCE = 11, 1e-9


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
                    k = entry(indices, indptr[tets[e, a]], indptr[tets[e, a] + 1], tets[e, b])
                    out[k] += w * (g[b, 0] * s[a, 0] + g[b, 1] * s[a, 1] + g[b, 2] * s[a, 2])


def stress_stiffness(mesh: TetMesh, material: Material, system: System, field: FloatArray) -> sp.csr_array:
    """(n, n), alike along x, y and z: what the stresses under the displacements (n, 3) add to the stiffness, N/m."""
    points, weights = quadrature(1 if mesh.order == 1 else 2)
    out = np.zeros(len(system.indices))
    nodes, tets = np.array(mesh.nodes - mesh.nodes.mean(axis=0)), np.array(mesh.tets, np.int64)
    indptr, indices = np.array(system.indptr), np.array(system.indices)
    _fill(nodes, tets, indptr, indices, shape_gradient(points, tets.shape[1]), weights, stresses(mesh, material, field), out)
    return sp.csr_array((out, indices, indptr), shape=(len(nodes), len(nodes)))


def buckling_factors(
    stiffness: sp.csr_array, solver: StaticSolver, held: BoolArray, start: FloatArray, n_modes: int = 1
) -> tuple[FloatArray, FloatArray]:
    """(factors (k,), rising; shapes (k, n, 3)): K x = -factor * Kg x by Lanczos on K^-1 Kg in the norm of K. Raises SolveError without convergence.

    start : (k, n, 3) displacements to begin with, whatever is at hand; drawn ones are added. Fewer than `n_modes` where the load presses nothing.
    """
    n = len(held)
    inverse, free = solver.inverse(), (~held).astype(float)[:, :, None]
    drawn = np.random.default_rng(_SEED).normal(size=(n_modes + 1, n, 3))
    begin = (np.concatenate([start, drawn]).transpose(1, 2, 0) * free).reshape(3 * n, -1)
    none = np.zeros((3 * n, 0))

    def pressed(x: FloatArray) -> FloatArray:
        flat = x.reshape(n, 3, -1)
        return np.asarray(-(stiffness @ flat.reshape(n, -1)).reshape(flat.shape) * free)

    def soft(x: FloatArray) -> FloatArray:
        return inverse.apply(pressed(x)).reshape(3 * n, -1)

    begin = orthonormal(soft(begin), solver.products, none, none)  # smooth ones: a drawn field has nearly all of its energy in the smallest elements
    try:
        values, shapes = largest(solver.products, soft, begin, n_modes, _TOLERANCE, none, of_inner=False)[:2]
    except SolveError as error:
        says = f"buckling: no shape found: the load presses hardly anything, or the mesh is too distorted ({error})"
        raise SolveError(says) from error
    keep = values > 0
    return 1 / values[keep], shapes[:, keep].T.reshape(-1, n, 3)
