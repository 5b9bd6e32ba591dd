"""Dimensions that were given, against what the points say of them: a section that is known is not fitted, but it is not believed blindly either.

The same family is fitted to the same points with every dimension free. Of the dimensions that this fit can tell, the chi-square of all together
(Wald 1943) and the normal deviate of each give the p-values; what the points do not tell contradicts nothing and is said to be untested.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtr

from scan2fea.estimation.anneal import walls
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.types import FloatArray, Member, Value

SIGNIFICANT = 1e-3  # p-value below which a given dimension counts as contradicted
SECTION_TOLERANCE = 0.01  # of the greatest dimension of the section: mill tolerance of outer sizes (EN 10034, EN 10056-2, EN 10210-2)
WALL_TOLERANCE = 0.1  # of a wall: the same standards
LENGTH_TOLERANCE = 1e-3  # of the length, on top of that of the section: cut lengths
_ROUNDING = 1e-12  # of a variance: exact points leave nothing else


@dataclass(frozen=True, kw_only=True)
class Given(Value):
    """One dimension that was given.

    measured_m, std_m, p_value : what the points say of it, None where they do not tell it.   tolerance_m : what a mill or a saw is allowed.
    held : whether the member was built with it (False: only compared).
    """

    name: str
    value_m: float
    measured_m: float | None
    std_m: float | None
    p_value: float | None
    tolerance_m: float
    held: bool

    @property
    def is_contradicted(self) -> bool:
        """Whether the points deny it: beyond chance and beyond tolerance."""
        if self.p_value is None or self.measured_m is None:
            return False
        return self.p_value < SIGNIFICANT and abs(self.measured_m - self.value_m) > self.tolerance_m


@dataclass(frozen=True, eq=False, kw_only=True)
class Told(Value):
    """What a free fit tells: names, values (p,), covariance (p, p), and whether each dimension is observable."""

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    observable: tuple[bool, ...]


def told_by(member: Member) -> Told:
    """What a member tells that was fitted with these dimensions free."""
    return Told(
        names=tuple(p.name for p in member.parameters),
        values=np.array([p.value_m for p in member.parameters]),
        covariance=member.covariance,
        observable=tuple(p.observable and p.source != "fixed" for p in member.parameters),
    )


def tolerance(name: str, family: str, section: Mapping[str, float], value_m: float) -> float:
    """What may lie between a nominal dimension and the real one of a sound member, metres."""
    size = SECTION_TOLERANCE * max(section[n] for n in PARAMETERS[family])
    if name == "length":
        return size + LENGTH_TOLERANCE * value_m
    return max(WALL_TOLERANCE * value_m, _ROUNDING) if name in walls(family) else size


def compared(given: Mapping[str, float], told: Told, family: str, *, held: bool) -> tuple[Given, ...]:
    """Each given dimension beside what the points say. given : metres, of the family or "length"."""
    section = dict(zip(told.names, told.values.tolist(), strict=True)) | {n: v for n, v in given.items() if n != "length"}
    rows = []
    for name, value in given.items():
        k = told.names.index(name) if name in told.names else -1
        measured = std = p = None
        if k >= 0 and told.observable[k] and told.covariance[k, k] > 0:
            measured, std = float(told.values[k]), math.sqrt(float(told.covariance[k, k]))
            p = float(2 * ndtr(-abs(measured - value) / std))
        room = tolerance(name, family, section, value)
        rows.append(Given(name=name, value_m=value, measured_m=measured, std_m=std, p_value=p, tolerance_m=room, held=held))
    return tuple(rows)


def joint_p_value(given: Mapping[str, float], told: Told) -> float | None:
    """Probability of data as far from all given dimensions together as these if those were true; None where the points tell none of them."""
    rows = [k for k, name in enumerate(told.names) if name in given and told.observable[k] and told.covariance[k, k] > 0]
    if not rows:
        return None
    away = np.array([told.values[k] - given[told.names[k]] for k in rows])
    covariance = np.asarray(told.covariance)[np.ix_(rows, rows)]
    spread = covariance + np.diag(_ROUNDING * np.diag(covariance))
    return float(chdtrc(len(rows), float(away @ np.linalg.solve(spread, away))))


def contradictions(rows: Sequence[Given]) -> str:
    """The dimensions that the points deny, in words; empty where there is none."""
    said = [
        f"{g.name} is given as {1e3 * g.value_m:.6g} mm, the points say {1e3 * g.measured_m:.6g} +- {1e3 * g.std_m:.2g} mm"
        for g in rows
        if g.is_contradicted and g.measured_m is not None and g.std_m is not None
    ]
    return "; ".join(said)
