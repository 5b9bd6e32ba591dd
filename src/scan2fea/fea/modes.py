"""Modes of the free body by LOBPCG (Knyazev 2001), preconditioned with an inverse of K + shift M.

The six rigid-body modes are in the start block but nothing is assumed of them: their frequencies are computed like the others, and a
mesh in two pieces shows twelve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from scan2fea.errors import SolveError
from scan2fea.fea.assemble import System
from scan2fea.fea.linear import Inverse
from scan2fea.fea.restrain import rigid_fields
from scan2fea.types import FloatArray, Value

MAX_ROUNDS = 200
GUARD = 4  # vectors iterated beyond those asked for: they carry clustered and unforeseen modes
_SEED = 7


@dataclass(frozen=True, eq=False, kw_only=True)
class Modes(Value):
    """eigenvalues : (k,) rad2/s2, rising.   shapes : (k, n, 3), orthonormal in the mass.   error : largest bound, relative."""

    eigenvalues: FloatArray
    shapes: FloatArray
    error: float
    rounds: int


class Products:
    """K x and M x for blocks (3n, r)."""

    def __init__(self, system: System) -> None:
        self._stiffness, self._mass = system.stiffness_matrix(), system.mass_matrix()

    def stiffness(self, x: FloatArray) -> FloatArray:
        return np.asarray(self._stiffness @ x)

    def mass(self, x: FloatArray) -> FloatArray:
        return np.asarray(self._mass @ x.reshape(self._mass.shape[0], -1)).reshape(x.shape)


def start_fields(nodes: FloatArray) -> FloatArray:
    """(3n, 30) displacements that are polynomials of degree 2: rigid motion, stretch, shear, bending, twist."""
    x = nodes - nodes.mean(axis=0)
    axes = np.linalg.eigh(x.T @ x)[1]
    x = x @ axes
    x = x / np.abs(x).max(axis=0)
    terms = [np.ones(len(x)), *x.T] + [x[:, i] * x[:, j] for i in range(3) for j in range(i, 3)]
    out = np.zeros((len(x), 3, 10, 3))
    for k, term in enumerate(terms):
        for c in range(3):
            out[:, c, k, c] = term
    return out.reshape(3 * len(x), 30)


def orthonormal(block: FloatArray, inner: Callable[[FloatArray], FloatArray], against: FloatArray, i_against: FloatArray) -> FloatArray:
    """Columns that span `block` without `against`, orthonormal in the inner product; columns that depend on others are dropped."""
    for _ in range(2):
        block = block - against @ (i_against.T @ block)
        gram = block.T @ inner(block)
        scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
        values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
        keep = values > 1e-12 * max(values.max(initial=0.0), 1e-300)
        block = (block * scale) @ (vectors[:, keep] / np.sqrt(values[keep]))
    return block


def _ritz(basis: FloatArray, k_basis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(values, vectors) of K on an orthonormal basis (3n, r), rising."""
    small = basis.T @ k_basis
    values, vectors = np.linalg.eigh((small + small.T) / 2)
    return values, vectors


def first_guess(system: System, nodes: FloatArray, n_wanted: int) -> tuple[FloatArray, float]:
    """(start block (3n, b), bound from above of the first elastic eigenvalue) by Rayleigh-Ritz on `start_fields`."""
    products = Products(system)
    none = np.zeros((3 * len(nodes), 0))
    rigid = orthonormal(rigid_fields(nodes).reshape(-1, 6), products.mass, none, none)
    m_rigid = products.mass(rigid)
    basis = orthonormal(start_fields(nodes), products.mass, rigid, m_rigid)
    values, vectors = _ritz(basis, products.stiffness(basis))
    n_fields = min(n_wanted - 6, basis.shape[1])
    drawn = np.random.default_rng(_SEED).normal(size=(3 * len(nodes), n_wanted + GUARD - 6 - n_fields))
    others = np.concatenate([basis @ vectors[:, :n_fields], drawn], axis=1)
    return np.concatenate([rigid, orthonormal(others, products.mass, rigid, m_rigid)], axis=1), float(values[0])


def lobpcg(system: System, inverse: Inverse, shift: float, start: FloatArray, n_wanted: int, tolerance: float) -> Modes:
    """The lowest `n_wanted` modes. `tolerance` bounds r' A^-1 r / (lambda + shift) = relative error of an eigenvalue, A = K + shift M.

    Raises SolveError if the bound is not reached in `MAX_ROUNDS`.
    """
    products = Products(system)
    n, width = system.n_nodes, start.shape[1]
    none = np.zeros((3 * n, 0))
    x = orthonormal(start, products.mass, none, none)
    k_x = products.stiffness(x)
    values, vectors = _ritz(x, k_x)
    x, k_x, momentum = x @ vectors, k_x @ vectors, none
    error = np.inf
    for count in range(1, MAX_ROUNDS + 1):
        m_x = products.mass(x)
        residual = k_x - m_x * values
        step = inverse.apply(residual.reshape(n, 3, -1)).reshape(3 * n, -1)
        bounds = np.einsum("ij,ij->j", residual, step) / (np.abs(values) + shift)
        error = float(np.abs(bounds[:n_wanted]).max())
        if error <= tolerance:
            return Modes(eigenvalues=values[:n_wanted], shapes=x[:, :n_wanted].T.reshape(n_wanted, n, 3), error=error, rounds=count)
        more = orthonormal(np.concatenate([step, momentum], axis=1), products.mass, x, m_x)
        basis, k_basis = np.concatenate([x, more], axis=1), np.concatenate([k_x, products.stiffness(more)], axis=1)
        values, vectors = _ritz(basis, k_basis)
        values, vectors = values[:width], vectors[:, :width]
        x, k_x, momentum = basis @ vectors, k_basis @ vectors, more @ vectors[width:]
    raise SolveError(f"free modes, {3 * n} dof: eigenvalues still {error:.1e} off after {MAX_ROUNDS} rounds, limit {tolerance:g}")


def from_strains(energy: FloatArray, products: Products, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(eigenvalues (k,), shapes (k, n, 3)) of the modes again, from their strain energies (k, k) instead of the assembled matrix.

    Strains of a rigid motion vanish to rounding squared, where the assembled matrix leaves rounding times its largest eigenvalue.
    """
    flat = shapes.reshape(len(shapes), -1).T
    mass = flat.T @ products.mass(flat)
    values, vectors = scipy.linalg.eigh((energy + energy.T) / 2, (mass + mass.T) / 2)
    return values, (flat @ vectors).T.reshape(shapes.shape)
