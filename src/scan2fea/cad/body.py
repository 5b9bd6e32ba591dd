"""A closed surface and its measured points: what every way to a solid of true faces begins with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.cad.bores import bored
from scan2fea.cad.compared import FIT_POINTS, Compared, Scale, compared
from scan2fea.cad.evidence import asked_for
from scan2fea.cad.patches import Patches, segmented
from scan2fea.cad.resting import Resting, resting_planes
from scan2fea.cad.roundings import without_roundings
from scan2fea.cad.surfaces import Fit, Snap
from scan2fea.cad.trued import fits_of
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import extent, face_areas
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.surfaces import Surface
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value
from scan2fea.units import MILLIMETRES_PER_METRE


@dataclass(frozen=True, eq=False, kw_only=True)
class Body(Value):
    """mesh : the surface.   points : (n, 3) measured.   stands : the planes that it stands on.

    used : (m, 3) of the points.   face : (m,) of the surface, next to each.   density : of these per m2, 0 where they need not lie everywhere on it.
    """

    mesh: TriangleMesh
    points: FloatArray
    scale: Scale
    stands: tuple[Resting, ...]
    used: FloatArray
    face: IntArray
    density: float

    @staticmethod
    def of(mesh: TriangleMesh, points: FloatArray, spacing_m: float, noise_m: float, resting: tuple[FloatArray, FloatArray] | None) -> Body:
        """resting : places where it stands on something, (k, 3), and their normals out of it."""
        scale = Scale(spacing_m=spacing_m, noise_m=noise_m, size_m=extent(mesh.vertices))
        used = points[sampled_rows(len(points), FIT_POINTS, 0)]
        at = PointToMesh(mesh).nearest(used)
        is_given = float(at.distance.max(initial=0.0)) <= 1e-9 * scale.size_m  # vertices of the surface lie where its triangles end, not everywhere
        density = 0.0 if is_given else len(used) / float(face_areas(mesh).sum())
        stands = () if resting is None else tuple(resting_planes(*resting, scale.tolerance_m))
        return Body(mesh=mesh, points=points, scale=scale, stands=stands, used=used, face=at.face, density=density)

    @property
    def known(self) -> list[Surface]:
        """The surfaces that it stands on."""
        return [r.surface for r in self.stands]

    @property
    def crease_m(self) -> float:
        """How far a crease is rounded: where the vertices are the points, creases are sharp, and what lies within twice the tolerance of two surfaces
        is a rounding, and no more.
        """
        return 2 * self.scale.tolerance_m if self.density == 0.0 else self.scale.reach_m

    @property
    def middle(self) -> FloatArray:
        """(3,) of the box round it."""
        return np.asarray((self.mesh.vertices.min(0) + self.mesh.vertices.max(0)) / 2)

    @property
    def local(self) -> TriangleMesh:
        """The surface in millimetres around its middle."""
        return TriangleMesh(vertices=(self.mesh.vertices - self.middle) * MILLIMETRES_PER_METRE, faces=self.mesh.faces)

    def segmented(self, factor: float) -> Patches:
        """The patches that lie on surfaces within so many times the tolerance, and what the points ask for besides."""
        found = segmented(self.mesh, factor * self.scale.tolerance_m, self.known)
        return bored(self.mesh, found, self.used, self.face) if self.density else found

    def evident(self, patches: Patches, reach_m: float) -> Patches:
        """Those that the points ask for, where creases are rounded by no more than `reach_m`."""
        told = self.used, self.face, self.scale.tolerance_m
        return asked_for(self.mesh, without_roundings(self.mesh, patches, reach_m, self.known, told), self.used, self.face, self.density)

    def fits(self, patches: Patches, *, radii: bool = True, told: Mapping[int, FloatArray] | None = None) -> tuple[list[Fit], tuple[Snap, ...], bool]:
        """`fits_of` its points."""
        return fits_of(self.mesh, self.points, patches, self.scale, self.stands, radii=radii, told=told)

    def compared(self, solid: Any, within_m: float = 0.0) -> Compared:
        """A solid, in millimetres around its middle, with it."""
        return compared(solid, self.mesh, self.points, self.middle, self.scale, within_m)
