"""Everything that `scan2fea check` says about one mesh: the checks and the table of quality measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from scan2fea.kernel.boundary import boundary_surface
from scan2fea.kernel.measures import area, tet_volumes, volume
from scan2fea.kernel.quality import TET_LIMITS, TRIANGLE_LIMITS, Limit, summary, surface_quality, tet_quality
from scan2fea.types import Check, TetMesh, TriangleMesh
from scan2fea.verification.mesh import surface_checks, tet_checks


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """figures: counts, volume, area.   quality: measure -> {min, p01, median}.   limits: measure -> its range.   checks: what a solver asks for."""

    figures: Mapping[str, float]
    quality: Mapping[str, Mapping[str, float]]
    limits: Mapping[str, Limit]
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        return all(check.passed for check in self.checks)


def inspect(mesh: TriangleMesh | TetMesh) -> Inspection:
    """Inspect a surface, or tets together with their boundary."""
    if isinstance(mesh, TriangleMesh):
        figures = {"vertices": len(mesh.vertices), "faces": len(mesh.faces), "area_m2": area(mesh), "volume_m3": volume(mesh)}
        return Inspection(figures=figures, quality=surface_quality(mesh), limits=TRIANGLE_LIMITS, checks=surface_checks(mesh))
    surface = boundary_surface(mesh)
    total = float(tet_volumes(mesh.nodes, mesh.tets).sum())
    figures = {"nodes": len(mesh.nodes), "tets": len(mesh.tets), "order": mesh.order, "area_m2": area(surface), "volume_m3": total}
    quality = {name: summary(values) for name, values in tet_quality(mesh.nodes, mesh.tets).items()}
    checks = (*surface_checks(surface), *tet_checks(mesh, volume(surface)))
    return Inspection(figures=figures, quality=quality, limits=TET_LIMITS, checks=checks)
