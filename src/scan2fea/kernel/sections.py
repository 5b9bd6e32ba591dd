"""The cross-sections of members: which parameters each family has, where its corners lie, and what follows from that in closed form.

Every corner is LINEAR in the parameters, so a family of straight-edged sections is one constant array and its derivatives are exact.

Frame of a section (x right, y up, metres), outer sizes, sharp corners:

    L     corner at the origin, leg a along +x, leg b along +y           T     flange on top, its outer face at y = 0, web down to y = -h
    I     centred; web along y, flanges along x                          C     back of the web at x = 0, flanges towards +x, centred in y
    RHS   centred; h along y, b along x                                  rect  centred; b along x, t along y
    CHS, round   centred
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.types import FloatArray, Section

PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "L": ("a", "b", "t"),
    "I": ("h", "b", "tw", "tf"),
    "C": ("h", "b", "tw", "tf"),
    "T": ("h", "b", "tw", "tf"),
    "RHS": ("h", "b", "t"),
    "CHS": ("d", "t"),
    "rect": ("b", "t"),
    "round": ("d",),
}
ROUND = ("CHS", "round")  # families whose outline is a circle

_Corner = tuple[Mapping[str, float], Mapping[str, float]]  # x and y, each as factors of the parameters
_Loop = Sequence[tuple[str, _Corner]]  # name of the edge that starts at the corner, and the corner


_H, _B = {"h": 0.5}, {"b": 0.5}
_H_, _B_ = {"h": -0.5}, {"b": -0.5}
_IN_H, _IN_H_ = {"h": 0.5, "tf": -1.0}, {"h": -0.5, "tf": 1.0}
_W, _W_ = {"tw": 0.5}, {"tw": -0.5}
_0: Mapping[str, float] = {}

_LOOPS: Mapping[str, tuple[_Loop, ...]] = {
    "L": (
        (
            ("A_OUTER", (_0, _0)),
            ("A_TOE", ({"a": 1}, _0)),
            ("A_INNER", ({"a": 1}, {"t": 1})),
            ("B_INNER", ({"t": 1}, {"t": 1})),
            ("B_TOE", ({"t": 1}, {"b": 1})),
            ("B_OUTER", (_0, {"b": 1})),
        ),
    ),
    "I": (
        (
            ("BOTTOM_OUTER", (_B_, _H_)),
            ("BOTTOM_TOE_RIGHT", (_B, _H_)),
            ("BOTTOM_INNER_RIGHT", (_B, _IN_H_)),
            ("WEB_RIGHT", (_W, _IN_H_)),
            ("TOP_INNER_RIGHT", (_W, _IN_H)),
            ("TOP_TOE_RIGHT", (_B, _IN_H)),
            ("TOP_OUTER", (_B, _H)),
            ("TOP_TOE_LEFT", (_B_, _H)),
            ("TOP_INNER_LEFT", (_B_, _IN_H)),
            ("WEB_LEFT", (_W_, _IN_H)),
            ("BOTTOM_INNER_LEFT", (_W_, _IN_H_)),
            ("BOTTOM_TOE_LEFT", (_B_, _IN_H_)),
        ),
    ),
    "C": (
        (
            ("BOTTOM_OUTER", (_0, _H_)),
            ("BOTTOM_TOE", ({"b": 1}, _H_)),
            ("BOTTOM_INNER", ({"b": 1}, _IN_H_)),
            ("WEB_INNER", ({"tw": 1}, _IN_H_)),
            ("TOP_INNER", ({"tw": 1}, _IN_H)),
            ("TOP_TOE", ({"b": 1}, _IN_H)),
            ("TOP_OUTER", ({"b": 1}, _H)),
            ("WEB_OUTER", (_0, _H)),
        ),
    ),
    "T": (
        (
            ("WEB_TOE", (_W_, {"h": -1})),
            ("WEB_RIGHT", (_W, {"h": -1})),
            ("FLANGE_INNER_RIGHT", (_W, {"tf": -1})),
            ("FLANGE_TOE_RIGHT", (_B, {"tf": -1})),
            ("FLANGE_OUTER", (_B, _0)),
            ("FLANGE_TOE_LEFT", (_B_, _0)),
            ("FLANGE_INNER_LEFT", (_B_, {"tf": -1})),
            ("WEB_LEFT", (_W_, {"tf": -1})),
        ),
    ),
    "RHS": (
        (("BOTTOM_OUTER", (_B_, _H_)), ("RIGHT_OUTER", (_B, _H_)), ("TOP_OUTER", (_B, _H)), ("LEFT_OUTER", (_B_, _H))),
        (
            ("LEFT_INNER", ({"b": -0.5, "t": 1}, {"h": -0.5, "t": 1})),
            ("TOP_INNER", ({"b": -0.5, "t": 1}, {"h": 0.5, "t": -1})),
            ("RIGHT_INNER", ({"b": 0.5, "t": -1}, {"h": 0.5, "t": -1})),
            ("BOTTOM_INNER", ({"b": 0.5, "t": -1}, {"h": -0.5, "t": 1})),
        ),
    ),
    "rect": ((("BOTTOM", (_B_, {"t": -0.5})), ("RIGHT", (_B, {"t": -0.5})), ("TOP", (_B, {"t": 0.5})), ("LEFT", (_B_, {"t": 0.5}))),),
}


@functools.cache
def corner_factors(family: str) -> tuple[FloatArray, ...]:
    """Per loop (k, 2, p): corner i of the section lies at factors[i] @ parameters. Not for the ROUND families. The arrays are read-only."""
    names = PARAMETERS[family]
    loops = []
    for loop in _LOOPS[family]:
        factors = np.zeros((len(loop), 2, len(names)))
        for i, (_, corner) in enumerate(loop):
            for axis in (0, 1):
                for name, factor in corner[axis].items():
                    factors[i, axis, names.index(name)] = factor
        factors.flags.writeable = False
        loops.append(factors)
    return tuple(loops)


@functools.cache
def edge_names(family: str) -> tuple[tuple[str, ...], ...]:
    """Per loop, the name of the face over the edge from corner i to corner i + 1; the outer and inner circle of the ROUND families."""
    if family in ROUND:
        return (("OUTER",), ("INNER",))[: len(PARAMETERS[family])]
    return tuple(tuple(name for name, _ in loop) for loop in _LOOPS[family])


def check_section(family: str, values: Mapping[str, float]) -> None:
    """Raises UsageError unless the family exists and its dimensions make a section: all positive, no wall thicker than its leg allows."""
    require(family in PARAMETERS, UsageError, f"section family {family!r} is unknown; choose one of {', '.join(PARAMETERS)}")
    names = PARAMETERS[family]
    for name in names:
        require(name in values, UsageError, f"section {family}: dimension {name!r} is missing; it needs {', '.join(names)}")
        v = values[name]
        require(math.isfinite(v) and v > 0, UsageError, f"section {family}: {name} is {v} m; it must be positive")
    for wall, whole, share in _WALLS.get(family, ()):
        limit = share * values[whole]
        require(
            values[wall] < limit,
            UsageError,
            f"section {family}: {wall} is {values[wall]} m; it must be less than {limit:.6g} m, {share:g} of {whole}",
        )


def makes_section(family: str, values: Mapping[str, float]) -> bool:
    """Whether `check_section` lets the dimensions pass."""
    positive = all(math.isfinite(values[name]) and values[name] > 0 for name in PARAMETERS[family])
    return positive and all(values[wall] < share * values[whole] for wall, whole, share in _WALLS.get(family, ()))


_WALLS: Mapping[str, tuple[tuple[str, str, float], ...]] = {
    "L": (("t", "a", 1.0), ("t", "b", 1.0)),
    "I": (("tw", "b", 1.0), ("tf", "h", 0.5)),
    "C": (("tw", "b", 1.0), ("tf", "h", 0.5)),
    "T": (("tw", "b", 1.0), ("tf", "h", 1.0)),
    "RHS": (("t", "h", 0.5), ("t", "b", 0.5)),
    "CHS": (("t", "d", 0.5),),
}


def chords_of(radius_m: float, tolerance_m: float) -> int:
    """Number of chords of a circle, a multiple of 4, whose sagitta is at most the tolerance."""
    if tolerance_m >= radius_m:
        return 8
    return max(8, 4 * math.ceil(math.pi / math.acos(1 - tolerance_m / radius_m) / 4))


def section(family: str, values: Mapping[str, float], n_chords: int = 96) -> Section:
    """The section of a family with the given dimensions (metres; other keys, such as length, are ignored).

    Circles become inscribed polygons of `n_chords` edges, every edge with the same face name. Raises UsageError as `check_section`.
    """
    check_section(family, values)
    return drawn(family, values, n_chords)


def drawn(family: str, values: Mapping[str, float], n_chords: int = 96) -> Section:
    """The loops (k, 2), metres, as the dimensions say, be it a section or not: a wall may be no more than a guess."""
    if family in ROUND:
        return _round_section(family, values, n_chords)
    parameters = np.array([values[name] for name in PARAMETERS[family]])
    loops = tuple(factors @ parameters for factors in corner_factors(family))
    return Section(family=family, loops=loops, face_names=edge_names(family))


def _round_section(family: str, values: Mapping[str, float], n_chords: int) -> Section:
    angle = 2 * np.pi * np.arange(n_chords) / n_chords
    unit = np.stack([np.cos(angle), np.sin(angle)], 1)
    outer = unit * (values["d"] / 2)
    if family == "round":
        return Section(family=family, loops=(outer,), face_names=(("OUTER",) * n_chords,))
    inner = unit[::-1] * (values["d"] / 2 - values["t"])
    return Section(family=family, loops=(outer, inner), face_names=(("OUTER",) * n_chords, ("INNER",) * n_chords))


def section_area(shape: Section) -> float:
    """Area of the polygons, m2 (shoelace; holes are clockwise and subtract)."""
    total = 0.0
    for loop in shape.loops:
        x, y = loop[:, 0], loop[:, 1]
        total += 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y))
    return total


def section_centroid(shape: Section) -> FloatArray:
    """(2,) centroid of the area of the polygons, metres."""
    moment = np.zeros(2)
    for loop in shape.loops:
        after = np.roll(loop, -1, axis=0)
        cross = loop[:, 0] * after[:, 1] - after[:, 0] * loop[:, 1]
        moment += ((loop + after) * cross[:, None]).sum(0) / 6
    return moment / section_area(shape)


def section_area_slopes(family: str, values: Mapping[str, float]) -> dict[str, float]:
    """Derivative of the area by each dimension of the family, metres. Areas are quadratic in the dimensions: central differences are exact,
    also where a step leads to what is no section any more.
    """
    slopes = {}
    for name in PARAMETERS[family]:
        step = 1e-3 * min(values[n] for n in PARAMETERS[family])
        more, less = ({**values, name: values[name] + sign * step} for sign in (1, -1))
        slopes[name] = (section_area(drawn(family, more)) - section_area(drawn(family, less))) / (2 * step)
    return slopes
