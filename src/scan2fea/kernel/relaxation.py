"""The one loop behind Lloyd and ODT, on surfaces and in volumes: step limit, boundary, projection, putting back, energy, stopping.

A method says where each vertex would like to be; the loop decides how far it goes. The energy of what is returned never rises: a step that
raises it is halved until it does not, else the loop ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from scan2fea.types import BoolArray, FloatArray, Value

HALVINGS = 6
PUT_BACK = 40  # times that vertices of spoiled elements are put back before the whole step is given up
SETTLED = 1e-3  # of its reach: a step whose 95th percentile is shorter ends the loop
FLAT = 1e-7  # relative fall of energy that ends the loop


class Method(Protocol):
    """What the loop asks of a method. Points are (n, 3); nothing given is written to."""

    def targets(self, points: FloatArray) -> FloatArray:
        """(n, 3) where each vertex would like to be."""

    def reach(self, points: FloatArray) -> FloatArray:
        """(n,) the longest step of each vertex; 0 for one that is held."""

    def projected(self, points: FloatArray, trial: FloatArray) -> FloatArray:
        """(n, 3) `trial` back on the boundary that its vertices belong to; `points` is where they came from."""

    def spoiled(self, points: FloatArray, trial: FloatArray) -> BoolArray:
        """(n,) True for the vertices of elements that the step makes too bad. False for all where `trial` is `points`."""

    def energy(self, points: FloatArray) -> float:
        """What the method minimises."""

    def reconnected(self, points: FloatArray) -> bool:
        """Improve the connections for the present points where that raises no energy; True where something has changed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Relaxed(Value):
    """points : (n, 3).   energies : (k + 1,) before and after each step, never rising.   why : "settled", "flat", "stuck", "iterations"."""

    points: FloatArray
    energies: FloatArray
    why: str

    @property
    def iterations(self) -> int:
        return len(self.energies) - 1


def relax(points: FloatArray, method: Method, *, iterations: int, settled: float = SETTLED) -> Relaxed:
    """Up to `iterations` steps of `method` from `points` (n, 3)."""
    energies = [method.energy(points)]
    why = "iterations"
    for _ in range(iterations):
        reach = method.reach(points)
        step = method.targets(points) - points
        length = np.linalg.norm(step, axis=1)
        step *= np.minimum(1.0, reach / np.maximum(length, 1e-300))[:, None]
        moves = reach > 0
        if not moves.any() or np.percentile(np.minimum(length, reach)[moves] / reach[moves], 95) < settled:
            why = "settled"
            break
        found = _fitting(points, step, method, energies[-1])
        if found is None:
            why = "stuck"
            break
        points, energy = found
        if method.reconnected(points):
            energy = method.energy(points)
        is_flat = energies[-1] - energy <= FLAT * abs(energies[-1])
        energies.append(energy)
        if is_flat:
            why = "flat"
            break
    return Relaxed(points=points, energies=np.array(energies), why=why)


def _fitting(points: FloatArray, step: FloatArray, method: Method, limit: float) -> tuple[FloatArray, float] | None:
    """The longest of the halved steps that spoils nothing and does not raise the energy over `limit`; None without."""
    for halving in range(HALVINGS + 1):
        trial = method.projected(points, points + step / 2**halving)
        for _ in range(PUT_BACK):
            spoiled = method.spoiled(points, trial)
            if not spoiled.any():
                energy = method.energy(trial)
                if energy <= limit:
                    return trial, energy
                break
            trial = np.where(spoiled[:, None], points, trial)
    return None
