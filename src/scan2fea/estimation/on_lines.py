"""Sections whose faces lie on the lines along which the points crowd: where a search from afar does not get to.

From afar all faces of a section count alike, and two of which one was seen much better than the other flow together: the wall between them closes up
and never opens again. Once the roll is known nothing need be searched. Every face lies on a line x = c or y = c of the section's frame, at an offset
that is linear in the dimensions, so lines give to as many faces of a family as it has unknowns are solved for those. Each way of giving lines to
faces is a hypothesis; those that explain the most points are kept. Where lines are too few the places where those across them end stand in: beside
the hypotheses on lines alone, since they may be better.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.section_likelihood import is_section
from scan2fea.kernel.sections import PARAMETERS, corner_factors, edge_names
from scan2fea.types import BoolArray, FloatArray, Value

_WIDE = 2.0  # sigma: half of a line's width
_FLANK = 3.0  # half widths of a line: what lies beside it, on the denser side
_SURE = 5.0  # standard deviations of what lies beside it that a line stands out
_LEAST = 0.01  # of the points, on a line
_MOST_LINES = 6  # of one direction
_SAME = 3.0  # sigma: a line and a face are at one place
_ROUNDS = 3  # of a run's ends and densities
_OF_END = 0.1  # of a line's points: what its end weighs beside a line of its own, since a shadow ends a face as well as a corner does
_KEPT = 4  # ways of giving the lines of one direction to faces
_MOST = 6  # hypotheses of a family
_QUARTERS: Mapping[str, int] = {"L": 4, "C": 4, "T": 4, "I": 2, "RHS": 1}  # quarter turns that make a different section
_WALL = {"L": ("t", "t"), "RHS": ("t", "t"), "C": ("tw", "tf"), "I": ("tw", "tf"), "T": ("tw", "tf")}  # across x, across y
_OUTER = {"L": ("a", "b"), "RHS": ("b", "h"), "C": ("b", "h"), "I": ("b", "h"), "T": ("b", "h")}
_Placed = tuple[float, FloatArray, float, FloatArray]  # score, dimensions, roll, place


@dataclass(frozen=True, eq=False)
class _Lines(Value):
    """Places (k,) across one axis, in order, how many points (k,) each explains, and which of them are ends of lines along it."""

    places: FloatArray
    weights: FloatArray
    are_ends: BoolArray


def sections_on_lines(xy: FloatArray, family: str, roll: float, sigma_m: float) -> list[tuple[FloatArray, float, FloatArray]]:
    """Dimensions (p,), roll and place (2,) of the sections of a family on lines of the points (n, 2), best first; none of round ones and flats.

    Those on lines alone come before those that also need places where lines end, and these before those of which no line tells a wall.
    roll : of the section's x, rad, to a quarter turn.   sigma_m : noise of the points.
    """
    on_lines: list[_Placed] = []
    on_ends: list[_Placed] = []
    unresolved: list[_Placed] = []
    for quarter in range(_QUARTERS.get(family, 0)):
        turn = roll + quarter * math.pi / 2
        c, s = math.cos(turn), math.sin(turn)
        own = xy @ np.array([[c, -s], [s, c]])
        told = [_Lines(*found, np.zeros(len(found[0]), bool)) for found in (lines(own[:, axis], sigma_m) for axis in (0, 1))]
        more = [_with_ends(family, axis, own, told, sigma_m) for axis in (0, 1)]
        on_lines += _placed(family, turn, told, sigma_m)
        if any(one.are_ends.any() for one in more):
            on_ends += _placed(family, turn, more, sigma_m)
        if family != "RHS":  # of a tube that is seen from outside: it takes the outer faces of a bar
            unresolved += _placed(family, turn, more, sigma_m, _WIDE * sigma_m)
    best = [sorted(found, key=lambda one: -one[0])[:_MOST] for found in (on_lines, on_ends, unresolved)]
    return [one[1:] for found in best for one in found]


def _placed(family: str, turn: float, told: Sequence[_Lines], sigma_m: float, wall_m: float | None = None) -> list[_Placed]:
    """Score, dimensions, roll and place of the sections turned by `turn` on the lines across both of its directions.

    wall_m : only of sections of which no line tells a wall, where it is begun: both faces of a thinner one than twice that lie on one line.
    """
    c, s = math.cos(turn), math.sin(turn)
    found = []
    for (x_score, x), (y_score, y) in itertools.product(*(_ways(family, axis, told[axis], sigma_m) for axis in (0, 1))):
        if wall_m is not None:
            if _WALL[family][0] in x or _WALL[family][1] in y:
                continue
            x = {**x, _WALL[family][0]: wall_m}
        values = _together(family, x, y, sigma_m)
        if values is not None:
            place = np.array([c * x["place"] - s * y["place"], s * x["place"] + c * y["place"]])
            found.append((x_score + y_score, values, turn, place))
    return found


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


def _with_ends(family: str, axis: int, own: FloatArray, told: Sequence[_Lines], sigma_m: float) -> _Lines:
    """The lines across one axis; where they are fewer than its unknowns, also the places at which the lines along it begin and end.

    A face that nobody saw is where its neighbours stop: of an angle of which one leg and the other's toe were seen no line runs along that other leg.
    """
    known = told[axis]
    if len(known.places) >= len(_offsets(family, axis)[0]):
        return known
    ends: list[tuple[float, float]] = []
    for line in told[1 - axis].places:
        along = np.sort(own[np.abs(own[:, 1 - axis] - line) <= _WIDE * sigma_m, axis])
        low, high = densest_run(along)
        ends += [(float(along[at]), _OF_END * (high - low)) for at in (low, high)]
    places, weights = known.places.tolist(), known.weights.tolist()
    for at, weight in sorted(ends, key=lambda one: -one[1]):
        if len(places) < _MOST_LINES and min((abs(at - place) for place in places), default=math.inf) > _SAME * sigma_m:
            places.append(at)
            weights.append(weight)
    order = np.argsort(places)
    return _Lines(np.array(places, float)[order], np.array(weights, float)[order], order >= len(known.places))


def densest_run(along: FloatArray) -> tuple[int, int]:
    """First and last row of the stretch of sorted places (n,) that is likeliest to hold a line, as even points among fewer even ones.

    Two Poisson densities: a place in the stretch gains log(in / out), a metre of it costs in - out (a scan statistic).
    """
    n, extent = len(along), float(np.ptp(along))
    half = max(n // 2, 1)
    if n < 2 or extent <= 0:
        return 0, max(n - 1, 0)
    inside, low, high = half / max(float((along[half:] - along[:-half]).min()), 1e-9 * extent), 0, n - 1
    for _ in range(_ROUNDS):
        outside = max((n - (high - low)) / extent, 0.01 * inside)
        inside = max(inside, 1.5 * outside)
        cost = np.arange(n) - along * (inside - outside) / math.log(inside / outside)
        least = np.minimum.accumulate(cost)
        high = int(np.argmax(cost - least))
        low = int(np.argmin(cost[: high + 1]))
        inside = (high - low) / max(float(along[high] - along[low]), 1e-9 * extent)
    return low, high


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


def _ways(family: str, axis: int, told: _Lines, sigma_m: float) -> list[tuple[float, Mapping[str, float]]]:
    """Score and unknowns of the best ways of giving lines to the faces across one axis. Without "wall" where too few lines tell it."""
    places, weights = told.places, told.weights
    found: dict[tuple[int, ...], tuple[float, Mapping[str, float]]] = {}
    for values in _solutions(family, axis, told):
        names, offsets = _offsets(family, axis)
        wall = _WALL[family][axis]
        outer = values[_OUTER[family][axis]]
        if outer <= 0 or not 0 < values.get(wall, sigma_m) < 0.5 * outer:
            continue
        placed = offsets[:, [k for k, name in enumerate(names) if name in values]] @ np.array([values[name] for name in names if name in values])
        if wall not in values:
            placed = placed[~offsets[:, names.index(wall)].astype(bool)]
        score = float(weights[np.abs(places[:, None] - placed).min(axis=1) <= _SAME * sigma_m].sum())
        key = tuple(np.round(np.array([values.get(name, 0.0) for name in names]) / (_SAME * sigma_m)).astype(int).tolist())
        if key not in found or found[key][0] < score:
            found[key] = score, values
    return sorted(found.values(), key=lambda one: -one[0])[:_KEPT]


def _solutions(family: str, axis: int, told: _Lines) -> Iterator[Mapping[str, float]]:
    """Unknowns of one direction from lines given, in order, to as many of its faces; with the wall left open, from the others.

    Ends tell no wall, since they may be where faces were cut: half a box tube had been an angle whose wall was what was left of a side.
    """
    names, offsets = _offsets(family, axis)
    wall = names.index(_WALL[family][axis])
    without = [k for k in range(len(names)) if k != wall]
    for rows, used in ((range(len(offsets)), list(range(len(names)))), (np.flatnonzero(offsets[:, wall] == 0).tolist(), without)):
        for chosen in itertools.permutations(rows, len(used)):
            system = offsets[np.ix_(chosen, used)]
            if abs(float(np.linalg.det(system))) < 1e-9:
                continue
            inverted = np.linalg.inv(system)
            of_wall = np.abs(inverted[used.index(wall)]) > 1e-9 if wall in used else np.zeros(len(used), bool)
            for given in itertools.combinations(range(len(told.places)), len(used)):
                if not (of_wall & told.are_ends[list(given)]).any():
                    yield dict(zip((names[k] for k in used), (inverted @ told.places[list(given)]).tolist(), strict=True))


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
