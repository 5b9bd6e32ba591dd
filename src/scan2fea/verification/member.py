"""Is a fitted member known well enough to be built? What was not observed must be named, and nothing may rest on a guess that is not told."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.sections import section, section_area, section_area_slopes
from scan2fea.types import Check, Member
from scan2fea.verification.limits import at_least, at_most

# Faces that end an open section on each side. Of each group one at least must have been seen: an I of which half was
# scanned looks like a T whose web has no end.
TOES = {
    "L": (("A_TOE",), ("B_TOE",), ("A_OUTER",), ("B_OUTER",)),
    "I": (("BOTTOM_TOE_RIGHT", "TOP_TOE_RIGHT"), ("BOTTOM_TOE_LEFT", "TOP_TOE_LEFT")),
    "C": (("BOTTOM_TOE", "TOP_TOE"), ("WEB_OUTER",)),
    "T": (("WEB_TOE",), ("FLANGE_TOE_RIGHT",), ("FLANGE_TOE_LEFT",)),
}
SEEN = 0.05  # of its length: less is no face that was seen
WALLS = ("t", "tw", "tf")  # may come from the catalogue; the verdict then says so


def member_checks(member: Member, explains: bool) -> tuple[Check, ...]:
    """The points are explained, the family is not in doubt, the outer dimensions were seen, and the volume is known."""
    unseen = sum(not p.observable for p in member.parameters if p.name not in WALLS)
    return (
        at_most("member.unexplained", int(not explains)),
        at_least("member.family", member.families.get(member.family, 1.0)),
        at_most("member.unseen_dimensions", unseen),
        at_most("member.open_walls", open_walls(member)),
        at_most("member.walls_in_noise", walls_in_noise(member)),
        at_most("member.volume_std", relative_volume_std(member)),
    )


def open_walls(member: Member) -> int:
    """How many walls end where no face that ends them was seen: the scan may have ended there, not the wall."""
    groups = TOES.get(member.family, ())
    return sum(all(member.seen.get(name, 1.0) < SEEN for name in group) for group in groups)


def walls_in_noise(member: Member) -> int:
    """Walls of an open section that the points do not tell: two sides of a solid bar, seen through as much noise, look like such an angle."""
    return sum(not p.observable for p in member.parameters if p.name in WALLS) if member.family in TOES else 0


def relative_volume_std(member: Member) -> float:
    """Standard deviation of section area x length over its value, from the covariance of the dimensions; what is not observable does not count."""
    values = member.values()
    area, by_dimension = section_area(section(member.family, values)), section_area_slopes(member.family, values)
    by_parameter = np.array([area if p.name == "length" else values["length"] * by_dimension[p.name] for p in member.parameters])
    return math.sqrt(max(float(by_parameter @ member.covariance @ by_parameter), 0.0)) / (area * values["length"])
