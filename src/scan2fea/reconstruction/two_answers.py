"""Flat faces and free form are two answers to the same points: where they differ by more than edges explain neither is sure.

A corner of a wall cut off by what was not scanned is closed across by the free form, with large triangles from point to point, and carried on by the
planes: each follows all points. The free form alone has nothing that says a corner is missing.
"""

from __future__ import annotations

from dataclasses import replace

from scan2fea.errors import ReconstructionError
from scan2fea.reconstruction.budget import BARE_FACES, HIDDEN_VOLUME, VOLUME_IN_DOUBT
from scan2fea.reconstruction.empty_places import EMPTY_PLACES
from scan2fea.reconstruction.gates import failed, in_all
from scan2fea.reconstruction.planar import flattened
from scan2fea.reconstruction.sight import blocked_lines
from scan2fea.reconstruction.visibility import Reconstruction
from scan2fea.types import Scan

DIFFER = "solid and first surface"  # the gate of the flat solid that compares the two
WHERE = frozenset({DIFFER, HIDDEN_VOLUME, BARE_FACES, EMPTY_PLACES, VOLUME_IN_DOUBT, "unmeasured area"})  # of these none is about where points lie
FLAT_INSTEAD = "flat solid through the same points"


def contradicted(scan: Scan, found: Reconstruction, seed: int = 0) -> Reconstruction:
    """The free form, refused where a flat solid holds all its points, no sight line runs through that, and their volumes differ.

    Without sight lines a hole that was scanned is told from a corner that was not by nothing: then nothing is said here.
    """
    if found.source != "sensors" or failed(found.checks) or DIFFER not in str(found.how.get("not_planar", "")):
        return found
    try:
        flat = flattened(scan, found, seed)
    except ReconstructionError:
        return found
    against = {check.name: check for check in failed(flat.checks)}
    if DIFFER not in against or not WHERE.issuperset(against) or not blocked_lines(scan, flat.mesh, found.spacing_m, found.sigma_m).passed:
        return found
    differ = against[DIFFER]
    says = (
        f"flat faces through the same points enclose {differ.value:.1%} more or less than edges explain (limit {differ.limit:.0%}): a corner or an "
        "end may not have been scanned; scan it too, or fit the member"
    )
    others = (check for check in found.checks if check.name != VOLUME_IN_DOUBT)
    return replace(found, checks=in_all(*others, replace(differ, name=FLAT_INSTEAD, says=says)))
