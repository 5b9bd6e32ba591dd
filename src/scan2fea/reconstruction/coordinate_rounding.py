"""Volume that coordinates written with few digits leave open: all points of a face square to an axis are moved alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.kernel.coordinate_steps import noise_before, rounding_std
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.reconstruction.budget import ROUNDED, VOLUME_IN_DOUBT
from scan2fea.reconstruction.evidence import at_most, mm
from scan2fea.reconstruction.gates import in_all
from scan2fea.reconstruction.visibility import Reconstruction

LIMIT = 0.02  # of the volume, one standard deviation: as what noise leaves of the places of planes
ACROSS = 3.0  # spacings over which a leaning face rises by a step: its points are rounded up and down, and the mean is right


def with_rounding(found: Reconstruction, step: float) -> Reconstruction:
    """The surface, with a check of what the rounding of the coordinates to whole steps (m, 0 none) leaves open."""
    std, body = rounding_std(step, noise_before(found.sigma_m, step)), abs(volume(found.mesh))
    if not std > 0.0 or body <= 0.0:
        return found
    normals, areas = face_normals(found.mesh), face_areas(found.mesh)
    square = np.abs(normals) >= np.cos(min(0.1, step / (ACROSS * found.spacing_m)))
    moved = [float(areas[square[:, axis] & (np.sign(normals[:, axis]) == side)].sum()) for axis in range(3) for side in (-1.0, 1.0)]
    share = std * float(np.linalg.norm(moved)) / body
    says = (
        f"the coordinates are whole steps of {mm(step)}: {share:.1%} of the volume is open (one standard deviation; limit {LIMIT:.0%}); "
        "write them with more digits"
    )
    others = (check for check in found.checks if check.name not in (ROUNDED, VOLUME_IN_DOUBT))
    return replace(found, checks=in_all(*others, at_most(ROUNDED, share, LIMIT, says)))
