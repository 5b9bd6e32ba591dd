"""Flat faces and free form are two answers to the same points: where one is full, the other empty, and no sight line passes, neither is sure.

A corner of a wall cut off by what was not scanned is closed across by the free form, with large triangles from point to point, and carried on by the
planes: each follows all points. The free form alone has nothing that says a corner is missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.kernel.distances import signed_distance
from scan2fea.kernel.measures import volume
from scan2fea.reconstruction.budget import BARE_FACES, FLAT_INSTEAD, HIDDEN_VOLUME, UNSEEN_WALLS, VOLUME_IN_DOUBT, WALL_ENDS
from scan2fea.reconstruction.empty_places import EMPTY_PLACES
from scan2fea.reconstruction.evidence import BY_FLOOD, BY_NORMALS, around, at_most
from scan2fea.reconstruction.gates import failed, in_all
from scan2fea.reconstruction.gates_planar import BESIDE_FLATS, DIFFER, RIM_CUT
from scan2fea.reconstruction.gates_surface import UNDER_FACES
from scan2fea.reconstruction.inner_places import inner_places
from scan2fea.reconstruction.lost_holes import LOST_HOLES, holes_apart
from scan2fea.reconstruction.sight import Sight, blocked_lines
from scan2fea.reconstruction.visibility import Reconstruction
from scan2fea.reconstruction.wall_ends import LIMIT
from scan2fea.types import Check, Scan, TriangleMesh

# of these none is about where points lie
WHERE = frozenset({DIFFER, FLAT_INSTEAD, HIDDEN_VOLUME, WALL_ENDS, BARE_FACES, EMPTY_PLACES, UNSEEN_WALLS, VOLUME_IN_DOUBT, "unmeasured area"})
# of these each may come of points on the wall of a hole that the faces close, or of planes that lean among those of its rim
OF_LOST_HOLES = WHERE | {
    LOST_HOLES, BESIDE_FLATS, "deviation p95", "stray points", "points afloat inside", "scatter about flat faces", "bent faces"
}  # fmt: skip
SAME = 0.01  # of the volume
CUT = math.sqrt(RIM_CUT)  # spacings that a square edge lies before the chord which cuts RIM_CUT square spacings off it
SENSORS, BLIND = "sensors", (BY_FLOOD, BY_NORMALS)  # what told the outside


def contradicted(scan: Scan, found: Reconstruction, flats: Sequence[Reconstruction], seed: int = 0) -> Reconstruction:
    """The free form, with a check of where flat solids that hold all its points say otherwise, and nobody saw.

    flats : solids of flat faces through the same points, refused. Points on the wall of a hole lie on none of the faces of a solid that closes it, so
    that one which holds all points tells of no hole that was scanned, with sight lines or without.
    """
    if found.source not in (SENSORS, *BLIND) or failed(found.checks) or found.how["method"] == "planar":
        return found
    holding = [flat for flat in flats if WHERE.issuperset(check.name for check in failed(flat.checks))]
    if found.source == SENSORS:
        holding = [flat for flat in holding if blocked_lines(scan, flat.mesh, found.spacing_m, found.sigma_m).passed]
    hollow = _seen_within(found, flats)
    found = replace(found, checks=(*found.checks, *hollow)) if hollow else found
    narrow = _holes(found, flats)
    found = replace(found, checks=(*found.checks, *narrow)) if narrow else found
    told = [apart(scan, found, flat.mesh, seed) for flat in holding]
    if not told:
        return found
    return _with(found, max(told, key=lambda check: float(check.value or 0.0)))


def _seen_within(found: Reconstruction, flats: Sequence[Reconstruction]) -> tuple[Check, ...]:
    """That points lie under the faces of a flat solid, if it is the same solid and nothing else but places that nobody saw speaks against it."""
    body, kept = abs(volume(found.mesh)), WHERE | {UNDER_FACES}
    same = [flat for flat in flats if abs(abs(volume(flat.mesh)) / body - 1.0) <= SAME and kept.issuperset(c.name for c in failed(flat.checks))]
    return tuple(check for flat in same[:1] for check in failed(flat.checks) if check.name == UNDER_FACES)


def _holes(found: Reconstruction, flats: Sequence[Reconstruction]) -> tuple[Check, ...]:
    """Where no sight lines are known: narrow holes, or gaps taken for holes, that a solid of flat faces closes beside those it has lost."""
    told = []
    for flat in flats if found.source in BLIND else ():
        against = {check.name: check.value for check in failed(flat.checks)}
        if OF_LOST_HOLES.issuperset(against):
            told.append(holes_apart(found.mesh, flat.mesh, round(float(against.get(LOST_HOLES) or 0.0))))
    return (max(told, key=lambda check: float(check.value or 0.0)),) if told else ()


def against_free(scan: Scan, flat: Reconstruction, free: Reconstruction, seed: int = 0) -> Reconstruction:
    """A flat solid labelled by sight lines, with a check of where a free form that passes says otherwise, and nobody saw."""
    return _with(flat, apart(scan, free, flat.mesh, seed))


def _with(found: Reconstruction, check: Check) -> Reconstruction:
    others = (other for other in found.checks if other.name != VOLUME_IN_DOUBT)
    return replace(found, checks=in_all(*others, check))


def apart(scan: Scan, found: Reconstruction, flat: TriangleMesh, seed: int = 0) -> Check:
    """How much lies in one solid and outside the other, deeper than spacing cuts edges and noise moves faces, where no known sight line passes?"""
    far = CUT * found.spacing_m + found.sigma_m
    sight = Sight.of(scan, found, seed) if found.source == SENSORS else None
    body, unseen_m3, where = abs(volume(flat)), 0.0, []
    for one, other in ((flat, found.mesh), (found.mesh, flat)):
        places = inner_places(one, seed)
        deep = places[signed_distance(places, other) > far]
        where.append(deep if sight is None else deep[~sight.passes(deep)])
        unseen_m3 += abs(volume(one)) * len(where[-1]) / max(len(places), 1)
    share = unseen_m3 / body
    says = (
        f"flat faces through the same points enclose {share:.1%} of the volume otherwise, where nobody looked (limit {LIMIT:.0%})"
        f"{around(np.concatenate(where))}: a corner or an end may not have been scanned; scan it too, or fit the member"
    )
    return at_most(FLAT_INSTEAD, share, LIMIT, says)
