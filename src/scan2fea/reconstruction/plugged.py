"""Bores that both faces of a wall show, and that the free form closes on the way through, where nobody saw.

A deep bore is scanned at its two mouths; what lies between is closed by a plug from wall to wall of the bore, small and near to points. Planes
know where both faces of a wall are empty (`empty_places`): there the free form is open all the way, or has a bottom that was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.kernel.distances import signed_distance
from scan2fea.reconstruction.budget import UNSEEN_WALLS
from scan2fea.reconstruction.empty_places import EMPTY_PLACES, Discs, discs_of
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.gates_planar import BESIDE_FLATS
from scan2fea.reconstruction.sight import BESIDE, SIGMAS, Sight
from scan2fea.reconstruction.visibility import Reconstruction
from scan2fea.types import BoolArray, Check, FloatArray, Scan, TriangleMesh

PLUGGED = "bores closed where nobody saw"
STEPS = 64  # places on the way from one face to the other
CORE = 0.7  # of an empty circle's radius: the wall of the bore is no nearer to its axis, a bottom is
HELD = 0.5  # share of the points that a flat solid may leave out: beyond it its walls are not those of the part
BOTTOM = 3  # points in that core of a bottom that was measured: 10 are due where 2.5 spacings are empty


def unplugged(scan: Scan, found: Reconstruction, flats: Sequence[Reconstruction], seed: int = 0) -> Reconstruction:
    """The free form, with a check of whether it closes what flat faces through the same points leave empty on both sides of a wall.

    flats : solids of flat faces, refused; those refused for such places are asked where these are. With sight lines a place counts if they enter it
    from both faces, or one passes: elsewhere nobody looked into the wall.
    """
    against = [flat for flat in flats if _knows_empty_places(failed(flat.checks))]
    if failed(found.checks) or not against:
        return found
    measured = scan.cloud.points if scan.cloud.is_inferred is None else scan.cloud.points[~scan.cloud.is_inferred]
    sight = Sight.of(scan, found, seed) if found.source == "sensors" else None
    skin = BESIDE * found.spacing_m + SIGMAS * found.sigma_m
    worst = np.zeros((0, 3))
    for flat in against:
        discs = discs_of(flat.mesh, measured)
        if sight is not None:
            discs = discs.of(discs.passed(sight) | discs.entered(sight))
        closed = discs.of(_is_closed(discs, found.mesh, skin) & ~_has_bottom(discs, measured, skin))
        worst = max(worst, closed.middle, key=len)
    says = (
        f"both faces of a wall show a bore that is closed inside, where nobody saw, {len(worst)} of them{around(worst)}: "
        "it may go through; scan into it"
    )
    return replace(found, checks=(*found.checks, at_most(PLUGGED, float(len(worst)), 0.0, says)))


def _knows_empty_places(against: Sequence[Check]) -> bool:
    """Was a flat solid refused for empty places, and does it hold the points of the part?"""
    values = {check.name: float(check.value or 0.0) for check in against}
    return not {EMPTY_PLACES, UNSEEN_WALLS}.isdisjoint(values) and values.get(BESIDE_FLATS, 0.0) <= HELD


def _is_closed(discs: Discs, mesh: TriangleMesh, skin_m: float) -> BoolArray:
    """(k,) is there a solid, deeper than the skin, on the way along the axis of each circle?"""
    share = (np.arange(STEPS) + 0.5) / STEPS
    way = discs.middle[:, None] - share[None, :, None] * (discs.wall_m[:, None] * discs.normal)[:, None]
    return np.asarray((signed_distance(way.reshape(-1, 3), mesh).reshape(-1, STEPS) < -skin_m).any(axis=1)) if len(way) else np.zeros(0, bool)


def _has_bottom(discs: Discs, points: FloatArray, skin_m: float) -> BoolArray:
    """(k,) are there points between the faces, in the core of each circle?"""
    out = np.zeros(len(discs.radius), bool)
    for k, (middle, radius, wall, normal) in enumerate(zip(discs.middle, discs.radius, discs.wall_m, discs.normal, strict=True)):
        depth = (middle - points) @ normal
        aside = np.linalg.norm(points - middle + depth[:, None] * normal, axis=1)
        out[k] = np.sum((aside < CORE * radius) & (depth > skin_m) & (depth < wall - skin_m)) >= BOTTOM
    return out
