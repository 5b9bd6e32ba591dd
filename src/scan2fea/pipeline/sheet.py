"""What is left of an object of which no solid is possible: `sheet.ply`."""

from __future__ import annotations

import numpy as np

from scan2fea.errors import ReconstructionError
from scan2fea.kernel.coverage import NOISE_SIGMAS, REACH_SPACINGS, face_origin, measured_part
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import area, volume
from scan2fea.reconstruction import ReconstructionOptions, open_sheet
from scan2fea.types import Scan, TriangleMesh

UNDER = 0.9  # of the points must have the sheet under them
FILM = 0.5  # spacings: a closed surface thinner than that on average (2 V / A) is wrapped round the points of one face, in shreds; no wall is so thin


def sheet_of(
    scan: Scan, surface: TriangleMesh | None, spacing_m: float, sigma_m: float, options: ReconstructionOptions
) -> TriangleMesh | None:
    """The measured part of the closed surface where that encloses something and lies under the points; else an open sheet through them.

    None where the points are too few for either.
    """
    cloud = scan.cloud
    if surface is not None and len(surface.faces) and 2.0 * abs(volume(surface)) >= FILM * spacing_m * area(surface):
        part = measured_part(surface, face_origin(surface, cloud.points, cloud.is_inferred, spacing_m, sigma_m))
        reach = REACH_SPACINGS * spacing_m + NOISE_SIGMAS * sigma_m
        seen = cloud.points if cloud.is_inferred is None else cloud.points[~cloud.is_inferred]
        if len(part.faces) and np.mean(PointToMesh(part).nearest(seen).distance <= reach) >= UNDER:
            return part
    try:
        return open_sheet(scan, options.max_points, options.seed)
    except ReconstructionError:
        return None
