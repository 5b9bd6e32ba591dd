"""Optimal Delaunay triangulation of a surface: vertices move to where |x|^2 is interpolated best (Chen and Xu 2004), and slide on the surface.

On a flat closed star of fixed connections sum A c / sum A is the exact minimiser, c the centres of the circles and A the areas.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scan2fea.kernel.relaxation import Relaxed
from scan2fea.remeshing.sliding import CREASE_DEG, OnSurface, opened, run
from scan2fea.remeshing.surface_kernels import ODT, odt_energy, odt_targets
from scan2fea.types import FloatArray, TriangleMesh

ITERATIONS = 200


@dataclass(frozen=True, eq=False, kw_only=True)
class _Odt(OnSurface):
    def targets(self, points: FloatArray) -> FloatArray:
        return odt_targets(points, self.faces)

    def energy(self, points: FloatArray) -> float:
        return float(odt_energy(points, self.faces))


def odt(
    mesh: TriangleMesh, iterations: int = ITERATIONS, *, crease_deg: float = CREASE_DEG, drift_m: float | None = None, constrained: bool = True
) -> tuple[TriangleMesh, Relaxed]:
    """The relaxed surface, and how the loop ended; arguments as of `lloyd`."""
    fields: dict[str, Any] = opened(mesh, ODT, crease_deg, drift_m, constrained)
    return run(mesh, _Odt(**fields), iterations)
