"""Which approximate inverse to use, and conjugate gradients that make any of them exact."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.amg import Multigrid
from scan2fea.fea.assemble import System
from scan2fea.fea.cholesky import Cholesky
from scan2fea.fea.dissection import Tree, without
from scan2fea.fea.options import FeaOptions
from scan2fea.fea.restrain import restrained
from scan2fea.fea.two_level import TwoLevel
from scan2fea.types import BoolArray, FloatArray, Value
from scan2fea.units import BYTES_PER_MIB

MAX_ITERATIONS = 600
TOLERANCE = 1e-10  # in the energy norm
REFINEMENTS = 3  # solutions with one factor, the last only to measure, before conjugate gradients take over
RESTARTS = 6  # each takes the residual anew from the strains: iterative refinement (Wilkinson 1963)


DIRECT = "Cholesky (multifrontal, double precision)"
TWO_LEVEL = "two-level multigrid (factors of the corners) with conjugate gradients"
Product = Callable[[FloatArray], FloatArray]


class Inverse(Protocol):
    """An approximate inverse of K + shift M on the nodes that are not held."""

    def apply(self, right: FloatArray) -> FloatArray:
        """(n, 3, r) to (n, 3, r)."""


def inverses(
    system: System, tree: Tree | None, rigid: FloatArray, held: BoolArray, shift: float, options: FeaOptions
) -> Iterator[tuple[str, Callable[[], Inverse]]]:
    """(name, how to make it) of the approximate inverses worth trying, best first.

    held : (n, 3) unknowns.   tree : fronts of the nodes that are not held, or None where factors are not wanted. Factors in double precision where
    they fit `max_factor_mb`, in single precision where only those fit, multigrid otherwise or next: with factors of the corners of quadratic elements
    where those fit, algebraic last.
    """

    def inner() -> System:
        return restrained(system, held)

    if tree is not None:
        need = 8 * tree.peak_entries / BYTES_PER_MIB
        if need <= options.max_factor_mb or options.solver == "direct":
            yield DIRECT, lambda: Cholesky(inner(), tree, shift)
        elif need / 2 <= options.max_factor_mb:
            yield "Cholesky (multifrontal, single precision) with conjugate gradients", lambda: Cholesky(inner(), tree, shift, np.float32)
    if options.solver == "direct":
        return
    if (system.ends[:, 0] != system.ends[:, 1]).any():
        yield TWO_LEVEL, lambda: TwoLevel(inner(), np.asarray(held.all(axis=1)), shift, options.max_factor_mb)
    yield "algebraic multigrid with conjugate gradients", lambda: Multigrid(inner(), rigid, np.asarray(held.all(axis=1)), shift)


def conjugate_gradients(
    matrix: Callable[[FloatArray], FloatArray],
    inverse: Inverse,
    right: FloatArray,
    tolerance: float,
    exact: Callable[[FloatArray], FloatArray] | None = None,
) -> tuple[FloatArray, float, int]:
    """(x, relative error in the energy norm, iterations) of matrix x = right, both (n, 3), preconditioned.

    exact : the same product with more digits, for the residuals from which each restart begins. The error is sqrt(r' B r / b' x) with the inverse B
    and r computed from the right side again, not taken from the recurrence. It bounds displacement and energy of thin parts too, where the plain
    residual cannot fall below rounding times the condition number.
    """
    exact = exact or matrix
    x = np.zeros_like(right)
    if not right.any():
        return x, 0.0, 0
    error, count = np.inf, 0
    for _ in range(RESTARTS):
        residual = right - exact(x)
        step, more = _descend(matrix, inverse, residual, float(np.vdot(right, x)), tolerance)
        x, count = x + step, count + more
        residual = right - exact(x)
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Static(Value):
    """displacement : (n, 3).   residual : relative error in the energy norm.   solver : how it was found."""

    displacement: FloatArray
    residual: float
    solver: str


class Shared:
    """Factors of the stiffness before it is held, made when first asked for: good for all supports on the last nodes of the tree."""

    def __init__(self, system: System, tree: Tree, options: FeaOptions) -> None:
        self.system, self.tree = system, tree
        self._fits = 8 * tree.peak_entries / BYTES_PER_MIB <= options.max_factor_mb or options.solver == "direct"
        self._made: Cholesky | None = None

    def holds(self, held: BoolArray) -> bool:
        """Whether all held unknowns (n, 3) are of last nodes, and the factors are wanted."""
        others = np.ones(len(held), bool)
        others[self.tree.last] = False
        return bool(self._fits and len(self.tree.last) and not held[others].any())

    def with_held(self, held: BoolArray) -> Cholesky:
        """Raises SolveError where these do not hold the body."""
        self._made = self._made or Cholesky(self.system, self.tree, 0.0)
        return self._made.with_held(held)


class StaticSolver:
    """One set of held unknowns (n, 3), any number of loads: the inverse is made once, the next way of making one only where it does not suffice."""

    def __init__(self, system: System, shared: Shared | None, rigid: FloatArray, held: BoolArray, exact: Product, options: FeaOptions) -> None:
        """`shared`: None where no factors are wanted; `exact`: forces from displacements."""
        self._free, self._exact, self._options = (~held).astype(float), exact, options
        self._stiffness = system.stiffness_matrix()
        self._ways: list[tuple[str, Callable[[], Inverse]]]
        if shared is not None and shared.holds(held):
            self._ways = [(DIRECT, lambda: shared.with_held(held)), *inverses(system, None, rigid, held, 0.0, options)]
        else:
            tree = None if shared is None else without(shared.tree, np.asarray(held.all(axis=1)))
            self._ways = list(inverses(system, tree, rigid, held, 0.0, options))
        self._made: list[Inverse | SolveError] = []

    def product(self, x: FloatArray) -> FloatArray:
        return np.asarray((self._stiffness @ x.ravel()).reshape(-1, 3) * self._free)

    def products(self, x: FloatArray) -> FloatArray:
        """The same for blocks (3n, r)."""
        flat = (x.reshape(*self._free.shape, -1) * self._free[:, :, None]).reshape(x.shape)
        return np.asarray((self._stiffness @ flat).reshape(*self._free.shape, -1) * self._free[:, :, None]).reshape(x.shape)

    def inverse(self, k: int = 0) -> Inverse:
        """The k-th best inverse. Raises SolveError where it cannot be made."""
        require(k < len(self._ways), SolveError, "no solver fits: set fea.solver to auto")
        while len(self._made) <= k:
            try:
                self._made.append(self._ways[len(self._made)][1]())
            except SolveError as error:
                self._made.append(error)
        made = self._made[k]
        if isinstance(made, SolveError):
            raise made
        return Masked(made, self._free)

    def together(self, forces: Mapping[str, FloatArray]) -> dict[str, Static]:
        """Under each of the `forces` (n, 3), as one by one: a factor is read once for all of them. Raises SolveError as for one."""
        out: dict[str, Static] = {}
        if self._ways and self._ways[0][0] == DIRECT:
            with contextlib.suppress(SolveError):  # no factors: told below, where the next way is tried
                x, errors = self._refined(np.stack(list(forces.values()), axis=2))
                for k, what in enumerate(forces):
                    if errors[k] <= TOLERANCE:
                        out[what] = Static(displacement=x[:, :, k].copy(), residual=float(errors[k]), solver=DIRECT)
        return {what: out[what] if what in out else self(force, what) for what, force in forces.items()}

    def _refined(self, right: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(x (n, 3, r), relative errors (r,) in the energy norm) of the first way, by iterative refinement. Raises SolveError as `inverse`."""
        inverse = self.inverse(0)
        right = right * self._free[:, :, None]
        x, error = np.zeros_like(right), np.full(right.shape[2], np.inf)
        for _ in range(REFINEMENTS):
            strained = np.stack([self._exact(x[:, :, k]) for k in range(right.shape[2])], axis=2) * self._free[:, :, None]
            step = inverse.apply(right - strained)
            energy = np.einsum("ncr,ncr->r", right, x)
            error = np.sqrt(np.abs(np.einsum("ncr,ncr->r", right - strained, step)) / np.where(energy > 0, energy, np.nan))
            if (error <= TOLERANCE).all():
                break
            x = x + step
        return x, error

    def __call__(self, force: FloatArray, what: str) -> Static:
        """Under `force` (n, 3). Raises SolveError where no way reaches `max_residual`; it says what each of them reached."""
        tried, limit = [], self._options.max_residual

        def exact(x: FloatArray) -> FloatArray:
            return np.asarray(self._exact(x) * self._free)

        for k, (name, _) in enumerate(self._ways):
            try:
                x, residual, count = conjugate_gradients(self.product, self.inverse(k), force * self._free, TOLERANCE, exact)
            except SolveError as error:
                tried.append(f"{name}: {error}")
                continue
            if residual <= limit:
                return Static(displacement=x, residual=residual, solver=f"{name}, {count} iterations")
            tried.append(f"{name}: error {residual:.1e} after {count} iterations")
        raise SolveError(f"{what}, {force.size} dof: error above {limit:g}: {'; '.join(tried) or 'no solver fits: set fea.solver to auto'}")


class Masked:
    """An inverse whose held unknowns stay zero."""

    def __init__(self, inner: Inverse, free: FloatArray) -> None:
        self._inner, self._free = inner, free

    def apply(self, right: FloatArray) -> FloatArray:
        return np.asarray(self._inner.apply(right * self._free[:, :, None]) * self._free[:, :, None])
