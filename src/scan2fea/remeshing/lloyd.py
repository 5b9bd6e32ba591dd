"""Lloyd's relaxation on a surface: each vertex moves to the centroid of its Voronoi cell, restricted to the triangles (Du et al. 1999).

A triangle is shared out among its own corners, exactly also where it is obtuse; the edges are kept Delaunay, so that no other vertex is nearer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scan2fea.kernel.relaxation import Relaxed
from scan2fea.remeshing.sliding import CREASE_DEG, OnSurface, opened, run
from scan2fea.remeshing.surface_kernels import LLOYD, lloyd_cells
from scan2fea.types import FloatArray, TriangleMesh

ITERATIONS = 200  # of the thesis


@dataclass(frozen=True, eq=False, kw_only=True)
class _Lloyd(OnSurface):
    """last : the points of the last energy and their targets, which the same cells tell (the loop asks for the energy after every change)."""

    last: dict[str, FloatArray]

    def targets(self, points: FloatArray) -> FloatArray:
        return self.last["targets"] if self.last.get("points") is points else lloyd_cells(points, self.faces)[0]

    def energy(self, points: FloatArray) -> float:
        targets, energy = lloyd_cells(points, self.faces)
        self.last.update(points=points, targets=targets)
        return float(energy)


def lloyd(
    mesh: TriangleMesh, iterations: int = ITERATIONS, *, crease_deg: float = CREASE_DEG, drift_m: float | None = None, constrained: bool = True
) -> tuple[TriangleMesh, Relaxed]:
    """The relaxed surface, and how the loop ended.

    Vertices slide on `mesh` (manifold and oriented); edges between its regions, and between free faces that meet at more than `crease_deg` off flat,
    are creases. drift_m : how far turning an edge may move the surface; 5 % of the median edge without it. constrained = False is the form of the
    thesis: nothing is held and nothing put back, the surface shrinks and its creases wear off.
    """
    fields: dict[str, Any] = opened(mesh, LLOYD, crease_deg, drift_m, constrained)
    return run(mesh, _Lloyd(**fields, last={}), iterations)
