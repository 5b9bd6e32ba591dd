"""What may be wrong with a volume altogether: doubts that each pass alone must not add up to more than is tolerated of one.

Hidden volume, unseen ends of walls and what spacing and noise do to edges are found by different checks, each with a limit of its own. A solid can
pass them all and still be off by their sum.
"""

from __future__ import annotations

from scan2fea.reconstruction.evidence import at_most
from scan2fea.types import Check

VOLUME_IN_DOUBT = "volume in doubt"
LIMIT = 0.05  # of the volume: the error that is tolerated of a volume without noise
HIDDEN_VOLUME = "volume behind unmeasured area"
WALL_ENDS = "wall ends without points"
BARE_FACES = "flat faces without points"
EDGES_CUT = "edges between points"
EDGES_GROWN = "edges in the noise"
PLACE = "place of the planes"
SCANS = "places of the scans"
ROUNDED = "rounded coordinates"
GAPS = "volume under gaps"
UNSEEN_WALLS = "walls that nobody saw"
FLAT_INSTEAD = "flat solid through the same points"
MIXED = "noise past the middle of walls"
SHARES = dict.fromkeys((HIDDEN_VOLUME, WALL_ENDS, BARE_FACES, EDGES_CUT, EDGES_GROWN, GAPS, MIXED, UNSEEN_WALLS, FLAT_INSTEAD), 1.0)
SHARES[PLACE] = SHARES[SCANS] = SHARES[ROUNDED] = 2.0  # a standard deviation counts twice


def volume_in_doubt(checks: tuple[Check, ...]) -> Check:
    """The sum of the shares of the volume that `checks` leave open. One that fails speaks for itself and is not added.

    Spacing takes from edges and noise adds to them: of the two only the larger counts.
    """
    alone = [check for check in checks if check.name in SHARES and check.passed]
    parts = {check.name: SHARES[check.name] * check.value for check in alone if isinstance(check.value, float)}
    if EDGES_CUT in parts and EDGES_GROWN in parts:
        parts.pop(min(EDGES_CUT, EDGES_GROWN, key=parts.__getitem__))
    share = float(sum(parts.values()))
    told = ", ".join(f"{name} {part:.1%}" for name, part in sorted(parts.items(), key=lambda item: -item[1]) if part >= 0.001)
    says = f"{share:.1%} of the volume is in doubt altogether ({told}; limit {LIMIT:.0%}): scan more densely, or what was not seen"
    return at_most(VOLUME_IN_DOUBT, share, LIMIT, says)
