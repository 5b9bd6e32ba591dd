"""Is a fitted member known well enough to be built? What was not observed must be named, and nothing may rest on a guess that is not told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scan2fea.kernel.outline import outline_area, outline_of
from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.sections import section_area_slopes
from scan2fea.types import Check, Member
from scan2fea.verification.limits import at_least, at_most, holds

# Faces that end an open section on each side. Of each group one at least must have been seen: an I of which half was
# scanned looks like a T whose web has no end.
TOES = {
    "L": (("A_TOE",), ("B_TOE",), ("A_OUTER",), ("B_OUTER",)),
    "I": (("BOTTOM_TOE_RIGHT", "TOP_TOE_RIGHT"), ("BOTTOM_TOE_LEFT", "TOP_TOE_LEFT")),
    "C": (("BOTTOM_TOE",), ("TOP_TOE",), ("WEB_OUTER",)),  # with one toe only it may be what is left of a tube
    "T": (("WEB_TOE",), ("FLANGE_TOE_RIGHT",), ("FLANGE_TOE_LEFT",)),
}
WALLS = ("t", "tw", "tf")  # may come from the catalogue; the verdict then says so. The sides of a bar are no walls.
_NO_LENGTH = "where the member ends was not seen; scan its ends, or give its length"
_BOTH_HALVES = 0.75  # of a flange's outer face: half of the half beyond the web at least
STANDARD = 0.95  # probability at which the outer dimensions are those of a standard section


def member_checks(member: Member, explains: bool, *, given: bool = False, open_end: str = "") -> tuple[Check, ...]:
    """The points are explained, the family is not in doubt, the outer dimensions and both ends were seen, the inside is known, and so is the volume.

    given : the user named the family: then a bar is no tube, and a thin wall is no bar that was half seen.   open_end : why its length is not told.
    """
    unseen = sum(not p.observable for p in member.parameters[:-1] if p.name not in WALLS or member.family == "rect")
    return (
        at_most("member.unexplained", int(not explains)),
        at_least("member.family", member.families.get(member.family, 1.0)),
        at_most("member.unseen_dimensions", unseen),
        *length_checks(open_end or ("" if member.parameters[-1].observable else _NO_LENGTH)),
        at_most("member.open_walls", 0 if given else open_walls(member)),
        at_most("member.walls_in_noise", 0 if given else walls_in_noise(member)),
        at_most("member.inside_unknown", 0 if given else int(member.inside == "unknown" or _is_open_bar(member))),
        at_most("member.volume_std", relative_volume_std(member)),
    )


def bare_wall_checks(share: float) -> tuple[Check, ...]:
    """Of the area of a member's sides, the share at which neither side of a wall was seen, though it was beside it."""
    return (at_most("member.bare_walls", share),)


def strip_checks(reason: str) -> tuple[Check, ...]:
    """The failed check of an object beside which an object of its own runs, whatever it is made as: `reason` says so; none where nothing does."""
    return (holds("member.strip_beside", False, reason, "none"),) if reason else ()


def length_checks(reason: str) -> tuple[Check, ...]:
    """The failed check of a member one end of which may lie beyond the scan, whatever it is made as: `reason` says so; none where there is none."""
    return (holds("member.length", False, reason, "told"),) if reason else ()


def _is_open_bar(member: Member) -> bool:
    """Whether a bar was fitted though its ends are seen to be open."""
    return member.inside == "hollow" and member.family in ("rect", "round")


def open_walls(member: Member) -> int:
    """How many walls end where no face that ends them was seen: the scan may have ended there, not the wall.

    Its mirror image may tell a toe, or where both its neighbours stop, or the support that it rests on.
    """
    told = {name for name, share in member.seen.items() if share >= SEEN} | {*member.told_toes, *member.reached, *member.seated}
    open_ones = sum(all(name in member.seen and name not in told for name in group) for group in TOES.get(member.family, ()))
    return open_ones or int(member.family == "I" and _lacks_half(member, told))


def _lacks_half(member: Member, told: set[str]) -> bool:
    """Whether nothing was seen of one half of a flange of an I, not even of its outer face beyond the web: a Z, or a J, has the same faces."""
    for flange in ("BOTTOM", "TOP"):
        is_short = member.seen.get(f"{flange}_OUTER", 1.0) < _BOTH_HALVES
        for side in ("RIGHT", "LEFT"):
            names = {f"{flange}_TOE_{side}", f"{flange}_INNER_{side}"}
            if is_short and names <= member.seen.keys() and told.isdisjoint(names):
                return True
    return False


def walls_in_noise(member: Member) -> int:
    """Walls of an open section that the points do not tell: two sides of a solid bar, seen through as much noise, look like such an angle.

    Outer dimensions that are those of a standard section speak for that section: bars have other proportions.
    """
    if member.family not in TOES or _is_standard(member):
        return 0
    return sum(not p.observable for p in member.parameters if p.name in WALLS)


def _is_standard(member: Member) -> bool:
    """Whether the catalogue leaves little room for outer dimensions that are none of its own."""
    return bool(member.catalogue) and sum(entry.probability for entry in member.catalogue if not entry.is_standard) <= 1 - STANDARD


def relative_volume_std(member: Member) -> float:
    """Standard deviation of section area x length over its value, from the covariance of the dimensions; what is not observable does not count."""
    values = member.values()
    shape, by_dimension = outline_of(member), section_area_slopes(member.family, values)
    area, root = outline_area(shape), member.root
    # by smaller ones: larger might not fit
    less = [replace(root, radius_m=max(root.radius_m - root.std_m, 0.0)), replace(root, toe_m=max(root.toe_m - root.toe_std_m, 0.0))]
    by_root, by_toes = ((area - outline_area(outline_of(replace(member, root=one)))) * values["length"] for one in less)
    by_parameter = np.array([area if p.name == "length" else values["length"] * by_dimension[p.name] for p in member.parameters])
    return math.hypot(math.sqrt(max(float(by_parameter @ member.covariance @ by_parameter), 0.0)), by_root, by_toes) / (area * values["length"])


def assumed_volume_std(member: Member) -> float:
    """Standard deviation of the volume over its value from what stands in for dimensions that are not observable, each by itself."""
    values = member.values()
    area, slopes = outline_area(outline_of(member)), section_area_slopes(member.family, values)
    parts = [slopes[p.name] * p.spread_m for p in member.parameters if not p.observable and p.spread_m and p.name in slopes]
    return math.sqrt(sum(part**2 for part in parts)) / area
