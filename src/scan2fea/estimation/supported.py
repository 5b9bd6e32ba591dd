"""Which dimensions the faces that were seen can tell at all: two sides for each, or a wall whose both sides were seen to come from one to the other.

The likelihood knows where faces end, and where a face is hidden it may still take the place of its edge for a measure of what lies behind. That is no
measurement: the edge of an inner face of a flange says nothing of how thick the flange is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from scan2fea.types import Member

SEEN = 0.05  # share of a face from which on it was seen
TOE_SEEN, TOE_SIGMAS = 0.5, 10.0  # the face that ends a wall shows its thickness where half of it was seen and it is far wider than the noise

_Pair = tuple[str, str]
# per wall: pairs of faces on either side of it, and the narrow faces as wide as it is
_WALLS: Mapping[str, Mapping[str, tuple[Sequence[_Pair], Sequence[str]]]] = {
    "L": {"t": ((("A_OUTER", "A_INNER"), ("B_OUTER", "B_INNER")), ("A_TOE", "B_TOE"))},
    "I": {
        "tw": ((("WEB_LEFT", "WEB_RIGHT"),), ()),
        "tf": (
            (
                ("TOP_OUTER", "TOP_INNER_LEFT"),
                ("TOP_OUTER", "TOP_INNER_RIGHT"),
                ("BOTTOM_OUTER", "BOTTOM_INNER_LEFT"),
                ("BOTTOM_OUTER", "BOTTOM_INNER_RIGHT"),
            ),
            ("TOP_TOE_LEFT", "TOP_TOE_RIGHT", "BOTTOM_TOE_LEFT", "BOTTOM_TOE_RIGHT"),
        ),
    },
    "C": {
        "tw": ((("WEB_OUTER", "WEB_INNER"),), ()),
        "tf": ((("TOP_OUTER", "TOP_INNER"), ("BOTTOM_OUTER", "BOTTOM_INNER")), ("TOP_TOE", "BOTTOM_TOE")),
    },
    "T": {
        "tw": ((("WEB_LEFT", "WEB_RIGHT"),), ("WEB_TOE",)),
        "tf": (
            (("FLANGE_OUTER", "FLANGE_INNER_LEFT"), ("FLANGE_OUTER", "FLANGE_INNER_RIGHT")),
            ("FLANGE_TOE_LEFT", "FLANGE_TOE_RIGHT"),
        ),
    },
}
# outer dimensions between two flat faces: the faces on either side, first the one that is the side itself, then those a wall behind it
_ACROSS: Mapping[str, Mapping[str, tuple[str, tuple[tuple[str, ...], tuple[str, ...]]]]] = {
    "I": {
        "h": ("tf", (("TOP_OUTER", "TOP_INNER_LEFT", "TOP_INNER_RIGHT"), ("BOTTOM_OUTER", "BOTTOM_INNER_LEFT", "BOTTOM_INNER_RIGHT"))),
    },
    "C": {"h": ("tf", (("TOP_OUTER", "TOP_INNER"), ("BOTTOM_OUTER", "BOTTOM_INNER")))},
}


def unsupported(member: Member) -> dict[str, str]:
    """Dimension -> why the faces that were seen cannot tell it."""
    seen, values, found = member.seen, member.values(), {}
    for wall, (pairs, toes) in _WALLS.get(member.family, {}).items():
        both = any(min(seen.get(a, 1.0), seen.get(b, 1.0)) >= SEEN for a, b in pairs)
        toe = values[wall] >= TOE_SIGMAS * member.sigma_m and any(seen.get(name, 0.0) >= TOE_SEEN for name in toes)
        if not both and not toe:
            found[wall] = "no wall of it was seen from both sides"
    for name, (wall, sides) in _ACROSS.get(member.family, {}).items():
        outer = all(seen.get(side[0], 1.0) >= SEEN for side in sides)
        some = all(max(seen.get(face, 1.0) for face in side) >= SEEN for side in sides)
        if not outer and (not some or wall in found):
            found[name] = "only one of its two sides was seen, the other lies behind a wall of unknown thickness"
    return found


def told_only(member: Member) -> tuple[Member, dict[str, str]]:
    """The member whose dimensions without support are marked as not observable, and why each is."""
    why = {p.name: unsupported(member)[p.name] for p in member.parameters if p.observable and p.source == "fitted" and p.name in unsupported(member)}
    if not why:
        return member, why
    covariance = np.array(member.covariance, float)
    for k, p in enumerate(member.parameters):
        if p.name in why:
            covariance[k, :] = covariance[:, k] = 0.0
    parameters = tuple(replace(p, std_m=None, observable=False) if p.name in why else p for p in member.parameters)
    return replace(member, covariance=covariance, parameters=parameters), why
