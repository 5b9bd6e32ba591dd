"""Which approximate inverse to use, and conjugate gradients that make any of them exact."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from scan2fea.errors import SolveError
from scan2fea.fea.amg import Multigrid
from scan2fea.fea.assemble import System
from scan2fea.fea.cholesky import Cholesky
from scan2fea.fea.dissection import Tree
from scan2fea.fea.options import FeaOptions
from scan2fea.types import BoolArray, FloatArray
from scan2fea.units import BYTES_PER_MIB

MAX_ITERATIONS = 600
TOLERANCE = 1e-10  # in the energy norm; thin parts end above it, where rounding of the displacement itself is felt
RESTARTS = 4  # each takes the residual anew: iterative refinement


class Inverse(Protocol):
    """An approximate inverse of K + shift M on the nodes that are not held."""

    def apply(self, right: FloatArray) -> FloatArray:
        """(n, 3, r) to (n, 3, r)."""


def inverses(
    system: System, tree: Tree | None, rigid: FloatArray, held: BoolArray, shift: float, options: FeaOptions
) -> Iterator[tuple[str, Callable[[], Inverse]]]:
    """(name, how to make it) of the approximate inverses worth trying, best first.

    tree : fronts of the nodes that are not held, or None where factors are not wanted. Factors in double precision where they fit
    `max_factor_mb`, in single precision where only those fit, multigrid otherwise or next.
    """
    if tree is not None:
        need = 8 * tree.peak_entries / BYTES_PER_MIB
        if need <= options.max_factor_mb or options.solver == "direct":
            yield "Cholesky (multifrontal, double precision)", lambda: Cholesky(system, tree, shift)
        elif need / 2 <= options.max_factor_mb:
            yield "Cholesky (multifrontal, single precision) with conjugate gradients", lambda: Cholesky(system, tree, shift, np.float32)
    if options.solver != "direct":
        yield "algebraic multigrid with conjugate gradients", lambda: Multigrid(system, rigid, held, shift)


def conjugate_gradients(
    matrix: Callable[[FloatArray], FloatArray], inverse: Inverse, right: FloatArray, tolerance: float
) -> tuple[FloatArray, float, int]:
    """(x, relative error in the energy norm, iterations) of matrix x = right, both (n, 3), preconditioned.

    The error is sqrt(r' B r / b' x) with the inverse B and r computed from the right side again, not taken from the recurrence. It
    bounds displacement and energy of thin parts too, where the plain residual cannot fall below rounding times the condition number.
    """
    x = np.zeros_like(right)
    if not right.any():
        return x, 0.0, 0
    error, count = np.inf, 0
    for _ in range(RESTARTS):
        residual = right - matrix(x)
        step, more = _descend(matrix, inverse, residual, float(np.vdot(right, x)), tolerance)
        x, count = x + step, count + more
        residual = right - matrix(x)
        energy, left = float(np.vdot(right, x)), float(np.vdot(residual, inverse.apply(residual[:, :, None])[:, :, 0]))
        before, error = error, math.sqrt(abs(left / energy)) if energy > 0 and math.isfinite(left) else math.inf
        if not tolerance < error < before:
            break
    return x, error, count


def _descend(
    matrix: Callable[[FloatArray], FloatArray], inverse: Inverse, right: FloatArray, energy: float, tolerance: float
) -> tuple[FloatArray, int]:
    """(x, iterations) of conjugate gradients from 0, until r' B r <= tolerance^2 times the energy so far, or arithmetic ends."""
    x, r, direction = np.zeros_like(right), right.copy(), np.zeros_like(right)
    rho_before, count = 1.0, 0
    while count < MAX_ITERATIONS:
        z = inverse.apply(r[:, :, None])[:, :, 0]
        rho = float(np.vdot(r, z))
        if not math.isfinite(rho) or rho <= tolerance**2 * (energy + float(np.vdot(right, x))):
            break
        direction = z + (rho / rho_before) * direction if count else z
        image = matrix(direction)
        curvature = float(np.vdot(direction, image))
        if curvature <= 0:
            break
        x += rho / curvature * direction
        r -= rho / curvature * image
        rho_before, count = rho, count + 1
    return x, count


def solve_static(
    system: System, tree: Tree | None, rigid: FloatArray, held: BoolArray, force: FloatArray, options: FeaOptions
) -> tuple[FloatArray, float, str]:
    """(displacement (n, 3), relative error in the energy norm, name of the solver) under `force` (n, 3) with the `held` nodes fixed.

    Raises SolveError where no solver reaches `max_residual`; it says what each of them reached.
    """
    stiffness = system.stiffness_matrix()
    free = (~held)[:, None].astype(float)

    def product(x: FloatArray) -> FloatArray:
        return np.asarray((stiffness @ x.ravel()).reshape(-1, 3) * free)

    tried = []
    for name, make in inverses(system, tree, rigid, held, 0.0, options):
        try:
            x, residual, count = conjugate_gradients(product, make(), force * free, TOLERANCE)
        except SolveError as error:
            tried.append(f"{name}: {error}")
            continue
        if residual <= options.max_residual:
            return x, residual, f"{name}, {count} iterations"
        tried.append(f"{name}: error {residual:.1e} after {count} iterations")
    raise SolveError(f"self weight, {3 * len(held)} dof: error above {options.max_residual:g}: {'; '.join(tried) or 'no solver fits'}")
