"""The faces of a straight-edged section in its own frame: across which axis each lies, where, and which side of it is free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.sections import PARAMETERS, corner_factors, edge_names
from scan2fea.types import FloatArray, Member, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Face(Value):
    """A straight face: x (axis 0) or y (axis 1) = factors . dimensions, and where along the other axis it lies. outward : +1 or -1 along `axis`."""

    name: str
    axis: int
    outward: float
    factors: FloatArray
    place: float
    low: float
    high: float


def straight_faces(member: Member) -> list[list[Face]]:
    """The straight faces of every loop, in their order."""
    values = np.array([member.values()[name] for name in PARAMETERS[member.family]])
    loops = []
    for factors, names in zip(corner_factors(member.family), edge_names(member.family), strict=True):
        corners = factors @ values
        loop = []
        for i, name in enumerate(names):
            after = (i + 1) % len(names)
            axis = 0 if np.array_equal(factors[i, 0], factors[after, 0]) else 1
            way = corners[after] - corners[i]
            outward = float(np.sign(way[1])) if axis == 0 else -float(np.sign(way[0]))
            low, high = sorted((float(corners[i, 1 - axis]), float(corners[after, 1 - axis])))
            loop.append(
                Face(name=name, axis=axis, outward=outward, factors=factors[i, axis], place=float(corners[i, axis]), low=low, high=high)
            )
        loops.append(loop)
    return loops


def ends_at(one: Face, other: Face) -> bool:
    """Whether the first of two neighbours ends at the other at a corner that stands out, beyond which the section has nothing."""
    return (other.place - 0.5 * (one.low + one.high)) * other.outward > 0
