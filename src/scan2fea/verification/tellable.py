"""How narrow a hole through a wall the points can show. A narrower one may be closed by any surface that keeps to its points, whatever the method."""

from __future__ import annotations

import math

BY_CHANCE = 1e-3  # that the walls of a part show a hole somewhere which is none
BY_CHANCE_MEMBER = 1e-6  # as `estimation.bored` asks of the walls of a member
CELL_POINTS, CELLS = 6.0, 5.0  # of a face alone (`estimation.holes`): points a cell, and cells across a hole that is found wherever it lies
LOOKS = 10.0  # places per square spacing that are not the same: circles of three spacings, moved by a third of one


def smallest_hole_m(area_m2: float, spacing_m: float, sigma_m: float) -> float:
    """Diameter (m) from which a hole through a wall tells itself from chance.

    area_m2 : of the surface.   spacing_m, sigma_m : of its points, spread at random; nan noise counts as none.
    Of n points that are due in a circle of a face none comes with the probability exp(-n), and the other face of the wall must lack its n too. Noise
    throws the points of the rim inwards by a standard deviation on either side.
    """
    places = max(LOOKS * area_m2 / spacing_m**2, 1.0)
    clear = spacing_m * math.sqrt(math.log(places / BY_CHANCE) / (2.0 * math.pi))
    return 2.0 * (clear + (sigma_m if math.isfinite(sigma_m) else 0.0))


def smallest_hole_of_member_m(area_m2: float, spacing_m: float, sigma_m: float, *, both_sides: bool) -> float:
    """The same (m) of a member, whose walls are held against the points that are due on them.

    both_sides : whether of each wall both faces were seen; with one alone a hole is a gap of a face, which its cells must show.
    """
    noise = sigma_m if math.isfinite(sigma_m) else 0.0
    if not both_sides:
        return CELLS * math.sqrt(CELL_POINTS) * spacing_m + 2.0 * noise
    places = max(LOOKS * area_m2 / spacing_m**2, 1.0)
    return 2.0 * (spacing_m * math.sqrt(math.log(places / BY_CHANCE_MEMBER) / (2.0 * math.pi)) + noise)
