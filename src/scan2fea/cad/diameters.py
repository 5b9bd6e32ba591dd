"""How wide the round faces of a solid are, and how well their points tell it: `cad.cylinders` of the report."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.cad.compared import TO_SIGMA
from scan2fea.cad.naming import HOLE
from scan2fea.cad.surfaces import CLIP
from scan2fea.cad.trued import Trued
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.surfaces import CYLINDER, FREEDOMS, covariance
from scan2fea.types import FloatArray

RADIUS = 4  # of the steps of a cylinder (`kernel.surfaces.moved`)


def with_diameters(found: Trued, points: FloatArray) -> Trued:
    """The solid with the diameter of each cylinder in `how`. points : (n, 3) measured.

    The standard deviation is that of the circle and axis by the cylinder's own points: where relations hold the axis, or make radii equal, it is
    known better. The noise is at least that of all points: of few no less is known. None of so few that they tell no cylinder.
    """
    if found.brep is None or found.mesh is None or found.mesh.face_region is None or CYLINDER not in found.brep.face_kinds:
        return found
    at = PointToMesh(found.mesh).nearest(points)
    face, noise = found.mesh.face_region[at.face], TO_SIGMA * float(np.median(at.distance))
    rows = []
    for k, (name, surface) in enumerate(zip(found.brep.face_names, found.surfaces, strict=True)):
        if surface.kind != CYLINDER:
            continue
        off = np.abs(surface.distance(points[face == k]))
        own = points[face == k][off <= CLIP * max(noise, TO_SIGMA * float(np.median(off)) if len(off) else 0.0)]
        freedom = len(own) - FREEDOMS[CYLINDER]
        std = None
        if freedom > 0:
            sigma = max(noise, float(np.sqrt((surface.distance(own) ** 2).sum() / freedom)))
            std = 2.0 * float(np.sqrt(max(covariance(surface, own, sigma)[RADIUS, RADIUS], 0.0)))
        rows.append({"name": name, "diameter_m": 2.0 * surface.radius, "std_m": std, "is_hole": name.startswith(HOLE), "n_points": len(own)})
    return replace(found, how={**found.how, "cylinders": rows})
