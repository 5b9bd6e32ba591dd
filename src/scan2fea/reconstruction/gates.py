"""When a surface must not be shipped: what the scan itself says against it.

Every check compares the finished surface with the raw points, or two independent ways of finding the same thing with each other. Limits
are those of reference/reconstruction.md ("Gates", "Refusal gate"); all are ratios, none is a length. The first that fails is the plainest
reason, so the order is: the data, the outside, the surface.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.measures import face_normals
from scan2fea.reconstruction.bare_ends import bare_ends
from scan2fea.reconstruction.budget import VOLUME_IN_DOUBT, volume_in_doubt
from scan2fea.reconstruction.evidence import Evidence, Unseen, scatter_m, wall_m
from scan2fea.reconstruction.gates_outside import both_faces, cut_agrees, gaps_entered, open_inside, signs_agree, winding_agrees
from scan2fea.reconstruction.gates_surface import (
    afloat,
    coverage,
    deviation,
    merged,
    mixed,
    patch_moments,
    resolution,
    rims,
    scans,
    sheet,
    solid_core,
    stray,
)
from scan2fea.reconstruction.hidden_volume import REACH, REACH_UNSEEN, hidden_volume
from scan2fea.reconstruction.unseen_rims import UNSEEN_RIMS, unseen_rims
from scan2fea.reconstruction.wall_ends import points_due, stretches, told_ends
from scan2fea.types import Check

UNMEASURED_SEEN, UNMEASURED_UNSEEN = 0.10, 0.02  # of the area, with and without sensor positions
DEVIATION_SEEN = 2.5  # (sigma + QUIET h)
DEVIATION_UNSEEN = 2.0  # of the same
QUIET = 0.05  # spacings: what a surface may lie off its points without any noise
STRAY_SIGMAS, STRAY_SPACINGS = 3.0, 0.5


def gates_seen(evidence: Evidence, held: float) -> tuple[Check, ...]:
    """The checks where sensor positions are known. held : share of the points under which the cut found the inside."""
    nearest = evidence.nearest_measured
    sigma = scatter_m(evidence, nearest.distance)
    limit = DEVIATION_SEEN * (sigma + QUIET * evidence.spacing_m)
    return in_all(
        *sheet(evidence),
        *resolution(evidence),
        *rims(evidence),
        *scans(evidence),
        *coverage(evidence, UNMEASURED_SEEN, sigma),
        hidden_volume(evidence.mesh, evidence.nearest_backed, evidence.spacing_m),
        *_ends(evidence),
        bare_ends(evidence),
        cut_agrees(held),
        deviation(nearest.distance, limit),
    )


def gates_unseen(evidence: Evidence, unseen: Unseen) -> tuple[Check, ...]:
    """The checks where sensor positions are not known: those above, and that four ways of telling the outside agree."""
    points, least = evidence.measured, QUIET * evidence.spacing_m
    nearest = evidence.nearest_measured
    normals = face_normals(evidence.mesh)[nearest.face]
    signed = np.einsum("ij,ij->i", points - nearest.closest, normals)
    sigma = scatter_m(evidence, nearest.distance)
    moments = patch_moments(points, normals, signed)
    flood = unseen.flood
    return in_all(
        *(() if flood is None else (both_faces(evidence.points, flood), *gaps_entered(flood))),
        *resolution(evidence),
        *mixed(evidence),
        *coverage(evidence, UNMEASURED_UNSEEN, sigma),
        hidden_volume(evidence.mesh, evidence.nearest_backed, evidence.spacing_m, REACH_UNSEEN),
        *_ends(evidence),
        bare_ends(evidence),
        *winding_agrees(evidence),
        signs_agree(evidence, unseen),
        cut_agrees(unseen.held),
        *(() if flood is None else (open_inside(unseen.flood_inside),)),
        *rims(evidence),
        *scans(evidence),
        deviation(nearest.distance, DEVIATION_UNSEEN * (sigma + least)),
        stray(points, nearest.distance, STRAY_SIGMAS * sigma + STRAY_SPACINGS * evidence.spacing_m),
        afloat(evidence.mesh, points, nearest.distance, evidence.spacing_m, sigma),
        merged(*moments, least),
        *(() if flood is None else solid_core(flood, *moments, least)),
    )


def gates_again(evidence: Evidence, before: tuple[Check, ...], seen: bool) -> tuple[Check, ...]:
    """The checks of another surface over the same points and normals: what can be asked of it is asked, the rest stays as it was `before`.

    seen : were the sensor positions known?
    """
    points, least = evidence.measured, QUIET * evidence.spacing_m
    distance = evidence.nearest_measured.distance
    sigma = scatter_m(evidence, distance)
    asked = (
        *resolution(evidence),
        *rims(evidence),
        *coverage(evidence, UNMEASURED_SEEN if seen else UNMEASURED_UNSEEN, sigma),
        hidden_volume(evidence.mesh, evidence.nearest_backed, evidence.spacing_m, REACH if seen else REACH_UNSEEN),
        *_ends(evidence),
        bare_ends(evidence),
        deviation(distance, (DEVIATION_SEEN if seen else DEVIATION_UNSEEN) * (sigma + least)),
        stray(points, distance, STRAY_SIGMAS * sigma + STRAY_SPACINGS * evidence.spacing_m),
        *(() if seen else (*winding_agrees(evidence), afloat(evidence.mesh, points, distance, evidence.spacing_m, sigma))),
    )
    names = {VOLUME_IN_DOUBT, UNSEEN_RIMS, *(check.name for check in asked)}
    return in_all(*asked, *(check for check in before if check.name not in names))


def _ends(evidence: Evidence) -> tuple[Check, ...]:
    """What may hide beyond ends of walls without points, and which holes have no other rim."""
    unproved, every = stretches(evidence)
    return (told_ends(evidence, unproved, every), *unseen_rims(evidence.mesh, every, points_due(evidence) if every else None))


def in_all(*checks: Check) -> tuple[Check, ...]:
    """The checks, and that of what they leave open altogether."""
    return (*checks, volume_in_doubt(checks))


def failed(checks: tuple[Check, ...]) -> tuple[Check, ...]:
    """Those that did not pass."""
    return tuple(check for check in checks if not check.passed)


__all__ = ["Evidence", "Unseen", "failed", "gates_again", "gates_seen", "gates_unseen", "wall_m"]
