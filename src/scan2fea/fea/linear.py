"""Which approximate inverse to use, and conjugate gradients that make any of them exact."""

from __future__ import annotations

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
    """(x, relative residual, iterations) of matrix x = right, both (n, 3), preconditioned; it stops at `tolerance` or when it stalls.

    The residual is computed from the right side again at the end, not taken from the recurrence.
    """
    size = float(np.linalg.norm(right))
    if size == 0.0:
        return np.zeros_like(right), 0.0, 0
    x = np.zeros_like(right)
    r, count = right.copy(), 0
    direction = np.zeros_like(right)
    rho_before = 1.0
    while count < MAX_ITERATIONS and np.linalg.norm(r) > tolerance * size:
        z = inverse.apply(r[:, :, None])[:, :, 0]
        rho = float(np.vdot(r, z))
        if not np.isfinite(rho) or rho <= 0:
            break
        direction = z + (rho / rho_before) * direction if count else z
        image = matrix(direction)
        step = rho / float(np.vdot(direction, image))
        x += step * direction
        r -= step * image
        rho_before, count = rho, count + 1
    return x, float(np.linalg.norm(right - matrix(x))) / size, count


def solve_static(
    system: System, tree: Tree | None, rigid: FloatArray, held: BoolArray, force: FloatArray, options: FeaOptions
) -> tuple[FloatArray, float, str]:
    """(displacement (n, 3), relative residual, name of the solver) under `force` (n, 3) with the `held` nodes fixed.

    Raises SolveError where no solver reaches `max_residual`; it says what each of them reached.
    """
    stiffness = system.stiffness_matrix()
    free = (~held)[:, None].astype(float)

    def product(x: FloatArray) -> FloatArray:
        return np.asarray((stiffness @ x.ravel()).reshape(-1, 3) * free)

    tried = []
    for name, make in inverses(system, tree, rigid, held, 0.0, options):
        try:
            x, residual, count = conjugate_gradients(product, make(), force * free, 0.01 * options.max_residual)
        except SolveError as error:
            tried.append(f"{name}: {error}")
            continue
        if residual <= options.max_residual:
            return x, residual, f"{name}, {count} iterations"
        tried.append(f"{name}: relative residual {residual:.1e} after {count} iterations")
    raise SolveError(f"self weight, {3 * len(held)} dof: residual above {options.max_residual:g}: {'; '.join(tried) or 'no solver fits'}")
