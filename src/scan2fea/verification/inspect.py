"""Everything that `scan2fea check` says about one mesh: the checks and the table of quality measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from scan2fea.kernel.boundary import boundary_surface
from scan2fea.kernel.measures import area, tet_volumes, volume
from scan2fea.kernel.quality import TET_LIMITS, TRIANGLE_LIMITS, Limit, summary, tet_quality, triangle_quality, worst_element
from scan2fea.types import Check, FloatArray, TetMesh, TriangleMesh
from scan2fea.verification.mesh import surface_checks, tet_checks
from scan2fea.verification.solvers import Judged, judged


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """figures: counts, volume, area.   quality: measure -> {min, p01, median, p99, max}.   worst: measure -> number of its worst element, from 0.

    limits: measure -> its range.   checks: what any solver asks for.   solvers: what each solver says, measure by measure; none for a surface.
    """

    figures: Mapping[str, float]
    quality: Mapping[str, Mapping[str, float]]
    worst: Mapping[str, int]
    limits: Mapping[str, Limit]
    checks: tuple[Check, ...]
    solvers: tuple[Judged, ...] = ()

    @property
    def passed(self) -> bool:
        return all(check.passed for check in self.checks)


def inspect(mesh: TriangleMesh | TetMesh) -> Inspection:
    """Inspect a surface, or tets together with their boundary."""
    if isinstance(mesh, TriangleMesh):
        figures = {"vertices": len(mesh.vertices), "faces": len(mesh.faces), "area_m2": area(mesh), "volume_m3": volume(mesh)}
        found = triangle_quality(mesh.vertices, mesh.faces)
        return Inspection(figures=figures, quality=_spread(found), worst=_worst(found), limits=TRIANGLE_LIMITS, checks=surface_checks(mesh))
    surface = boundary_surface(mesh)
    total = float(tet_volumes(mesh.nodes, mesh.tets).sum())
    figures = {"nodes": len(mesh.nodes), "tets": len(mesh.tets), "order": mesh.order, "area_m2": area(surface), "volume_m3": total}
    found = tet_quality(mesh.nodes, mesh.tets)
    checks = (*surface_checks(surface), *tet_checks(mesh, volume(surface)))
    solvers = judged(found, mesh.order)
    return Inspection(figures=figures, quality=_spread(found), worst=_worst(found), limits=TET_LIMITS, checks=checks, solvers=solvers)


def _spread(found: Mapping[str, FloatArray]) -> dict[str, dict[str, float]]:
    return {name: summary(values) for name, values in found.items()}


def _worst(found: Mapping[str, FloatArray]) -> dict[str, int]:
    return {name: worst_element(name, values) for name, values in found.items()}
