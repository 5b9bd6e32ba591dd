"""Does a thin wall show two faces? One face under wide noise of a flat law looks like two faces under a narrower one.

Noise has one mode. Where the points across a wall are scarcer in its middle than at both of its faces, they lie on two; where they are not, one face
seen from one side explains them too, and what looks like a thickness may be the law of the noise (a uniform law, the flattest there is, fits
as two Gaussian faces 3.5 sigma apart).
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from scan2fea.estimation.swept import sweep_of_member
from scan2fea.kernel.sections import PARAMETERS, ROUND, corner_factors, edge_names
from scan2fea.types import FloatArray, Member

APART = 5.0  # sigma between two faces from which no single law of noise reaches from one to the other
_SIGNIFICANT = 4.0  # standard deviations of the counts
_MARGIN = 3.0  # sigma that stay clear of the ends of a wall, where its neighbours' points are


def blended(points: FloatArray, member: Member, seen: Collection[str]) -> frozenset[str]:
    """Dimensions that are walls whose two seen faces do not stand apart, in no place where both were seen. points : (n, 3) metres."""
    local = sweep_of_member(member).coordinates(points)
    sigma, tried, apart = member.sigma_m, set(), set()
    for name, distance, across in _walls(member, seen, local[:, :2]):
        tried.add(name)
        if distance > APART * sigma or _two_modes(across, distance):
            apart.add(name)
    return frozenset(tried - apart)


def _two_modes(across: FloatArray, distance: float) -> bool:
    """Whether points at `across` from the middle of a wall are significantly fewer there than at both of its faces."""
    left, middle, right = (int((np.abs(across - at) < distance / 6).sum()) for at in (-distance / 2, 0.0, distance / 2))
    lower = min(left, right)
    return lower - middle > _SIGNIFICANT * math.sqrt(max(lower + middle, 1))


def _walls(member: Member, seen: Collection[str], xy: FloatArray) -> list[tuple[str, float, FloatArray]]:
    """Per pair of parallel faces, both seen, with material between: the dimension that is their distance, its value, and where points lie across."""
    values, sigma = member.values(), member.sigma_m
    if member.family in ROUND:
        both = len(PARAMETERS[member.family]) == 2 and {"OUTER", "INNER"} <= set(seen)
        return [("t", values["t"], values["d"] / 2 - values["t"] / 2 - np.hypot(*xy.T))] if both else []
    names = PARAMETERS[member.family]
    parameters = np.array([values[name] for name in names])
    faces = []
    for factors, edges in zip(corner_factors(member.family), edge_names(member.family), strict=True):
        corners = factors @ parameters
        for i, name in enumerate(edges):
            after = (i + 1) % len(edges)
            across = 0 if np.array_equal(factors[i, 0], factors[after, 0]) else 1
            way = corners[after] - corners[i]
            outward = float(np.sign(way[1])) if across == 0 else -float(np.sign(way[0]))  # outlines run counter-clockwise
            faces.append((name, across, outward, factors[i, across], np.sort([corners[i, 1 - across], corners[after, 1 - across]])))
    found = []
    for one, axis, side, place, (low, high) in faces:
        for other, axis2, side2, place2, (low2, high2) in faces:
            if axis != axis2 or side != 1.0 or side2 != -1.0 or one not in seen or other not in seen:
                continue
            factor = place - place2
            distance, low_both, high_both = float(factor @ parameters), max(low, low2), min(high, high2)
            if distance <= 0 or np.count_nonzero(factor) != 1 or factor.max() != 1.0 or low_both >= high_both:
                continue
            margin = min(_MARGIN * sigma, 0.25 * (high_both - low_both))
            inside = (xy[:, 1 - axis] > low_both + margin) & (xy[:, 1 - axis] < high_both - margin)
            found.append((names[int(np.argmax(factor))], distance, xy[inside, axis] - float((place + place2) @ parameters) / 2))
    return found
