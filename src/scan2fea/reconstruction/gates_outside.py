"""Checks of the side that was taken for outside, where no sensor position says it: four ways of telling must agree."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.winding import layout, winding
from scan2fea.reconstruction.evidence import Evidence, Unseen, around, at_least, at_most, wall_m
from scan2fea.reconstruction.outside import LEAK_TOLERATED, Flood
from scan2fea.reconstruction.winding import sheet_areas
from scan2fea.types import Check, FloatArray

CUT_AGREES = 0.95  # a point not held stands for the half wall under it: of the volume as much as is tolerated of any doubt
WINDING_AGREES = 0.965
WINDING_AT_POINTS, WINDING_OFF = 0.05, 0.35
FLOOD_INSIDE = 0.05
SIGNS_AGREE, SIGNS_AGREE_QUIET, QUIET_NOISE = 0.94, 0.90, 0.17
AT_POINTS_SOFTENING, OFF_POINTS_SOFTENING = 0.8, 0.4  # spacings; a place between two sheets of a wall must not feel its softening
WALL_SHARE = 0.45  # of wall or gap: how deep the winding number is asked
SAMPLES = 6000
GAPS_ENTERED, CUT_HELD = "gaps that lead inside", "cut agrees with normals"


def both_faces(points: FloatArray, flood: Flood) -> Check:
    """Few points have open space on both sides."""
    share = flood.leak_share
    says = f"{share:.0%} of the points have open space on both sides (limit {LEAK_TOLERATED:.0%}): the other face of what they lie on was not scanned"
    return at_most("open on both sides", share, LEAK_TOLERATED, f"{says}{around(points[flood.open_both])}; scan it too, or fit the member")


def gaps_entered(flood: Flood) -> tuple[Check, ...]:
    """The solid was told from the outside though gaps lead into it: only faces that carry on across them say that nothing hides there."""
    says = "gaps of the scan lead into the solid, and no flat or round faces carry on across them: scan there too, or give the sensor position"
    return (at_most(GAPS_ENTERED, 1.0, 0.0, says),) if flood.is_parted else ()


def winding_agrees(evidence: Evidence) -> tuple[Check, Check]:
    """The dipoles of the points alone, which never saw the surface, must find it: w > 1/2 under it, < 1/2 above it, near 1/2 at the points."""
    tree = layout(evidence.smoothed)
    areas = sheet_areas(evidence.smoothed, evidence.normals)
    h = evidence.spacing_m
    places, face = sample_surface(evidence.mesh, SAMPLES, seed=0)
    out = face_normals(evidence.mesh)[face]
    row = k_nearest(evidence.smoothed, 1, places)[1][:, 0]
    under = np.fmin(h, WALL_SHARE * evidence.thickness_m[row])[:, None]
    over = np.fmin(h, WALL_SHARE * evidence.gap_m[row])[:, None]
    asked = np.vstack([places - under * out, places + over * out])
    inside, outside = np.split(winding(tree, evidence.normals, areas, OFF_POINTS_SOFTENING * h, asked)[0], 2)
    right = float(np.mean(np.concatenate([inside > 0.5, outside < 0.5])))
    at_points, _ = winding(tree, evidence.normals, areas, AT_POINTS_SOFTENING * h)
    lost = np.abs(at_points - 0.5) > WINDING_OFF
    off = float(np.mean(lost))
    return (
        at_most(
            "winding at points",
            off,
            WINDING_AT_POINTS,
            f"{off:.0%} of the points do not lie between inside and outside (limit {WINDING_AT_POINTS:.0%}): the face opposite them is missing "
            f"from the scan{around(evidence.points[lost])}; scan it too, or fit the member",
        ),
        at_least(
            "winding agrees with surface",
            right,
            WINDING_AGREES,
            f"the winding number of the points contradicts {1 - right:.1%} of the surface (limit {1 - WINDING_AGREES:.1%}): a face is missing "
            "from the scan; scan it too, or give the sensor position",
        ),
    )


def signs_agree(evidence: Evidence, unseen: Unseen) -> Check:
    """The rolling ball, or the normals of the file, and the winding number must find the same side out."""
    told = (unseen.signed != 0).any(axis=1)
    same = np.einsum("ij,ij->i", unseen.signed, unseen.polished) > 0
    share = float(same[told].mean()) if told.any() else 0.0
    wall = wall_m(evidence)
    # noise carries points past the middle of the wall, where the ball meets the other side first: they may disagree
    noisy = evidence.sigma_m >= QUIET_NOISE * wall  # a wall that is not known counts as thick
    limit = SIGNS_AGREE - float(ndtr(-0.5 * wall / evidence.sigma_m)) if noisy else SIGNS_AGREE_QUIET
    first = "rolling ball" if unseen.flood is not None else "the normals given"
    says = f"{first} and winding number agree at {share:.1%} of the points (at least {limit:.0%}): the outside is not certain; "
    return at_least("two ways of finding the outside agree", share, limit, says + "give the sensor position")


def cut_agrees(held: float) -> Check:
    """The inside lies under the points."""
    says = f"the surface keeps the inside under only {held:.0%} of the points (at least {CUT_AGREES:.0%}): outside was not told from inside; "
    return at_least(CUT_HELD, held, CUT_AGREES, says + "give the sensor position")


def open_inside(share: float) -> Check:
    """What the ball reaches is not inside."""
    says = f"{share:.0%} of the solid can be reached from outside between the points (limit {FLOOD_INSIDE:.0%}): the scan leaves it open there"
    return at_most("open space inside", share, FLOOD_INSIDE, says)
