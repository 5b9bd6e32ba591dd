"""How far a dimension may be moved before the rays tell: the likelihood's profile, walked outward from its top.

Between two rings of a scanner nothing holds an edge: the likelihood is flat there and steep beside, and its curvature at the top, wherever on the
plateau that lies, says little of its width. So each dimension is moved, all else is fitted again, and where the fall is short of what the curvature
foretold the walk goes on, twice as far each time and from the fit before, until the fall is that of a 99 % interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from scan2fea.estimation.ray_data import RayData
from scan2fea.estimation.ray_model import RayLayout
from scan2fea.estimation.ray_starts import fitted
from scan2fea.estimation.scoring import Scored

_FIRST = 3.0  # standard deviations
_LIMIT = 2.58  # at the end of a 99 % interval the log likelihood has fallen by half of its square: what lies on a plateau lower than that is wide
_LEAST_FALL = 0.125  # that of half a standard deviation: rounding and chance
_STEPS = 5  # the last is 48 standard deviations away
_LEAST, _MOST = 0.25, 4.0  # of the dimension: beyond it is not told at all


def walked(
    data: RayData, layout: RayLayout, top: Scored, held: Mapping[str, float], name: str, std_m: float, *, still: tuple[str, ...], free_edge: bool
) -> tuple[float, Scored]:
    """The standard deviation (m) of one dimension, at least std_m: the widest that a place of its profile asks for, inf where the rays do not end it.

    And the best fit that was met on the way, which may be likelier than `top`.
    """
    place, best, std = layout.place[name], top, std_m
    at = float(top.theta[place])
    for side in (-1.0, 1.0):
        theta, distance, before = top.theta, _FIRST * std_m, 0.0
        for _ in range(_STEPS):
            moved = max(at + side * distance, _LEAST * at)
            if moved > _MOST * at or abs(moved - at) <= before:
                return math.inf, best
            theta = theta.copy()
            theta[place] = moved
            there = fitted(data, layout, theta, {**held, name: moved}, still=still, free_edge=free_edge, max_iterations=8, tolerance=1e-2)
            best = max(best, there, key=lambda one: one.log_posterior)
            fall, before = max(top.log_posterior - there.log_posterior, _LEAST_FALL), abs(moved - at)
            std = max(std, before / math.sqrt(2 * fall))
            if fall >= 0.5 * _LIMIT**2:
                break
            theta, distance = there.theta, 2 * distance
        else:
            return math.inf, best
    return std, best
