"""Does a face go on beyond the corner at which its section ends it? Then the section is only part of what was scanned.

An I of which the scan ends just beside its web looks like a channel with two short strips in line with its flanges: too few points to be a second
body, and yet a channel has none there. A Z looks like an I of which half of each flange was not seen, but its web runs through, to the outer face of
the flange: where a neighbour was not seen, a face may not go on into the wall that the neighbour would bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from scan2fea.estimation.ends import RunEnd, run_end
from scan2fea.estimation.explain import TOLERANCE
from scan2fea.estimation.straight import Face, ends_at, straight_faces
from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.pinned import SEEN
from scan2fea.kernel.sections import PARAMETERS, ROUND
from scan2fea.types import FloatArray, Member
from scan2fea.units import MILLIMETRES_PER_METRE

_BAND_SIGMAS, _BAND_SIZE = 4.0, 1e-3  # about a face: its points, exact ones too (of the section's size)
_ROUNDING = 1e-6  # of the section's size: exact points lie on either side
_CLEAR = 4.0  # standard deviations
_OF_OTHER = 0.8  # sigma: points of the other face that noise carries over its end, over the density of the half of this one that lies outside
_CORNER = 0.1  # of a face, at its other end
_LEAST = 100  # points of a face


def continued(points: FloatArray, member: Member) -> str:
    """Why the section is only part of what was scanned; "" where every face ends as it says. points : (n, 3) metres."""
    if member.family in ROUND:
        return ""
    sigma, size = member.sigma_m, max(member.values()[name] for name in PARAMETERS[member.family])
    local = sweep_of_member(member).coordinates(points)
    margin = max(_BAND_SIGMAS * sigma, 1e-3 * member.values()["length"])
    local = local[(local[:, 2] > margin) & (local[:, 2] < member.values()["length"] - margin)]
    band = max(_BAND_SIGMAS * sigma, _BAND_SIZE * size)
    found: dict[str, list[tuple[Face, RunEnd]]] = {}
    for one, other, thick in _corners(member):
        away = one.outward * (local[:, one.axis] - one.place)
        width = one.high - one.low
        start, reach = max(_CORNER * width, _BAND_SIGMAS * sigma) - width, min(width, thick - band)
        out = np.sign(other.place - 0.5 * (one.low + one.high)) * (local[:, other.axis] - other.place)
        out = out[(away > -_ROUNDING * size) & (away < band) & (out > start) & (out < reach)]
        if reach > TOLERANCE * size and len(out) >= _LEAST and start <= -0.5 * width:
            cap_m = _OF_OTHER * sigma if member.seen.get(other.name, 1.0) >= SEEN else 0.0
            found.setdefault(other.name, []).append((one, run_end(out, sigma, start, cap_m)))
    for name, ends in found.items():
        short = any(end.edge_m < -_CLEAR * end.std_m - TOLERANCE * size for _, end in ends)  # a cut askew: less here, more there
        for one, end in ends:
            if end.edge_m > _CLEAR * end.std_m + (0.0 if short else TOLERANCE * size):
                return (
                    f"{one.name} goes on {end.edge_m * MILLIMETRES_PER_METRE:.3g} mm beyond {name}: the {member.family} is only part of what was "
                    "scanned, or something else is in line with it; scan the rest, or segment it"
                )
    return ""


def _corners(member: Member) -> Iterator[tuple[Face, Face, float]]:
    """Each seen face with each neighbour at which it ends, and how far beyond points are asked.

    Any distance where the corner stands out, as the section has nothing there; where it does not, through the wall that a neighbour not seen bounds.
    """
    for loop in straight_faces(member)[:1]:
        for i, face in enumerate(loop):
            if member.seen.get(face.name, 1.0) < SEEN:
                continue
            for other in (loop[i - 1], loop[(i + 1) % len(loop)]):
                if ends_at(face, other):
                    yield face, other, math.inf
                elif member.seen.get(other.name, 1.0) < SEEN:
                    yield face, other, _thickness(loop, face, other)


def _thickness(loop: Sequence[Face], face: Face, other: Face) -> float:
    """From a face to the one behind it, where the line of its neighbour would meet it."""
    behind = [f for f in loop if f.axis == other.axis and f.outward == -other.outward and f.low < face.place < f.high]
    return min((d for f in behind if (d := (other.place - f.place) * other.outward) > 0), default=0.0)
