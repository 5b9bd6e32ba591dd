"""Sections whose faces lie on the lines along which the points crowd: where a search from afar does not get to.

From afar all faces of a section count alike, and two of which one was seen much better than the other flow together: the wall between them closes up
and never opens again. Once the roll is known nothing need be searched. Every face lies on a line x = c or y = c of the section's frame, at an offset
that is linear in the dimensions, so lines give to as many faces of a family as it has unknowns are solved for those. Each way of giving lines to
faces is a hypothesis; those that explain the most points are kept.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Mapping

import numpy as np

from scan2fea.kernel.section_likelihood import is_section
from scan2fea.kernel.sections import PARAMETERS, corner_factors, edge_names
from scan2fea.types import FloatArray

_WIDE = 2.0  # sigma: half of a line's width
_FLANK = 3.0  # half widths of a line: what lies beside it, on the denser side
_SURE = 5.0  # standard deviations of what lies beside it that a line stands out
_LEAST = 0.01  # of the points, on a line
_MOST_LINES = 6  # of one direction
_SAME = 3.0  # sigma: a line and a face are at one place
_KEPT = 4  # ways of giving the lines of one direction to faces
_MOST = 6  # hypotheses of a family
_QUARTERS: Mapping[str, int] = {"L": 4, "C": 4, "T": 4, "I": 2, "RHS": 1}  # quarter turns that make a different section
_WALL = {"L": ("t", "t"), "RHS": ("t", "t"), "C": ("tw", "tf"), "I": ("tw", "tf"), "T": ("tw", "tf")}  # across x, across y
_OUTER = {"L": ("a", "b"), "RHS": ("b", "h"), "C": ("b", "h"), "I": ("b", "h"), "T": ("b", "h")}


def sections_on_lines(xy: FloatArray, family: str, roll: float, sigma_m: float) -> list[tuple[FloatArray, float, FloatArray]]:
    """Dimensions (p,), roll and place (2,) of the sections of a family on lines of the points (n, 2), best first; none of round ones and flats.

    roll : of the section's x, rad, to a quarter turn.   sigma_m : noise of the points.
    """
    found: list[tuple[float, FloatArray, float, FloatArray]] = []
    for quarter in range(_QUARTERS.get(family, 0)):
        turn = roll + quarter * math.pi / 2
        c, s = math.cos(turn), math.sin(turn)
        own = xy @ np.array([[c, -s], [s, c]])
        ways = [_ways(family, axis, *lines(own[:, axis], sigma_m), sigma_m) for axis in (0, 1)]
        for along_x, along_y in itertools.product(*ways):
            values = _together(family, along_x[1], along_y[1], sigma_m)
            if values is not None:
                x, y = along_x[1]["place"], along_y[1]["place"]
                found.append((along_x[0] + along_y[0], values, turn, np.array([c * x - s * y, s * x + c * y])))
    found.sort(key=lambda one: -one[0])
    return [one[1:] for one in found[:_MOST]]


def lines(at: FloatArray, sigma_m: float) -> tuple[FloatArray, FloatArray]:
    """Places (k,) at which points at (n,) crowd, in order, and how many points (k,) each has more than what lies beside it."""
    half = _WIDE * sigma_m
    order = np.sort(at)

    def n_between(low: float, high: float) -> FloatArray:
        return np.asarray(np.searchsorted(order, order + high, "right") - np.searchsorted(order, order + low, "left"), float)

    n_on = n_between(-half, half)
    beside = 2 / _FLANK * np.maximum(n_between(-half - _FLANK * half, -half), n_between(half, half + _FLANK * half))
    more = n_on - beside
    more[(more < _SURE * np.sqrt(beside + 1)) | (more < _LEAST * len(at))] = 0.0
    places: list[float] = []
    weights: list[float] = []
    while len(places) < _MOST_LINES and more.any():
        k = int(np.argmax(more))
        own = order[np.abs(order - order[k]) <= half]
        places.append(float(np.median(own)))
        weights.append(float(more[k]))
        more[np.abs(order - order[k]) <= 2 * half] = 0.0
    by_place = np.argsort(places)
    return np.array(places)[by_place], np.array(weights)[by_place]


@functools.cache
def _offsets(family: str, axis: int) -> tuple[tuple[str, ...], FloatArray]:
    """The unknowns of one direction, its place last, and (k, u) how the distinct offsets of the faces across it follow from them."""
    rows = set()
    for factors, names in zip(corner_factors(family), edge_names(family), strict=True):
        for i in range(len(names)):
            start, end = factors[i], factors[(i + 1) % len(names)]
            if np.array_equal(start[axis], end[axis]):
                rows.add(tuple(start[axis].tolist()))
    table = np.array(sorted(rows))
    used = [k for k, name in enumerate(PARAMETERS[family]) if table[:, k].any()]
    names = (*(PARAMETERS[family][k] for k in used), "place")
    return names, np.column_stack([table[:, used], np.ones(len(table))])


def _ways(family: str, axis: int, places: FloatArray, weights: FloatArray, sigma_m: float) -> list[tuple[float, Mapping[str, float]]]:
    """Score and unknowns of the best ways of giving lines to the faces across one axis. Without "wall" where too few lines tell it."""
    found: dict[tuple[int, ...], tuple[float, Mapping[str, float]]] = {}
    for values in _solutions(family, axis, places):
        names, offsets = _offsets(family, axis)
        wall = _WALL[family][axis]
        outer = values[_OUTER[family][axis]]
        if outer <= 0 or not 0 < values.get(wall, sigma_m) < 0.5 * outer:
            continue
        told = offsets[:, [k for k, name in enumerate(names) if name in values]] @ np.array([values[name] for name in names if name in values])
        if wall not in values:
            told = told[~offsets[:, names.index(wall)].astype(bool)]
        score = float(weights[np.abs(places[:, None] - told).min(axis=1) <= _SAME * sigma_m].sum())
        key = tuple(np.round(np.array([values.get(name, 0.0) for name in names]) / (_SAME * sigma_m)).astype(int).tolist())
        if key not in found or found[key][0] < score:
            found[key] = score, values
    return sorted(found.values(), key=lambda one: -one[0])[:_KEPT]


def _solutions(family: str, axis: int, places: FloatArray) -> Iterator[Mapping[str, float]]:
    """Unknowns of one direction from lines given, in order, to as many of its faces; with the wall left open, from the others."""
    names, offsets = _offsets(family, axis)
    wall = names.index(_WALL[family][axis])
    without = [k for k in range(len(names)) if k != wall]
    for rows, used in ((range(len(offsets)), list(range(len(names)))), (np.flatnonzero(offsets[:, wall] == 0).tolist(), without)):
        for chosen in itertools.permutations(rows, len(used)):
            system = offsets[np.ix_(chosen, used)]
            if abs(float(np.linalg.det(system))) < 1e-9:
                continue
            inverted = np.linalg.inv(system)
            for given in itertools.combinations(places.tolist(), len(used)):
                yield dict(zip((names[k] for k in used), (inverted @ np.array(given)).tolist(), strict=True))


def _together(family: str, x: Mapping[str, float], y: Mapping[str, float], sigma_m: float) -> FloatArray | None:
    """Dimensions (p,) of a section from the unknowns of both directions; None where they contradict each other or no wall is told."""
    wall_x, wall_y = _WALL[family]
    first, second = x.get(wall_x), y.get(wall_y)
    if first is None and second is None:
        return None
    if wall_x == wall_y and first is not None and second is not None and abs(first - second) > _SAME * sigma_m:
        return None
    known = {**x, **y}
    known.setdefault(wall_x, second or 0.0)  # where nothing tells it, as thick as the other
    known.setdefault(wall_y, first or 0.0)
    values = np.array([known[name] for name in PARAMETERS[family]])
    return values if is_section(family, values) else None
