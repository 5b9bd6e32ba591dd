"""Where a dimension may lie for all the rays tell: the likelihood's profile, walked outward from its top, and its mean and spread.

Between two rings of a scanner nothing holds an edge: the likelihood is flat there and steep beside, and neither where on the plateau its top lies
nor the curvature there says much. So each dimension is moved, all else is fitted again, and where the fall is short of that of a 99 % interval the
walk goes on, twice as far each time and from the fit before; where it fell much farther at one step, places between are asked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.ray_data import RayData
from scan2fea.estimation.ray_model import RayLayout
from scan2fea.estimation.ray_starts import fitted
from scan2fea.estimation.scoring import Scored
from scan2fea.types import FloatArray

_FIRST = 3.0  # standard deviations
LIMIT = 2.58  # deviations of a 99 % interval: there the log likelihood has fallen by half of its square
_STEEP = 4.5  # one and a half times the first step: farther down the fall between is asked
_DEEPEST = 6.0  # deviations beyond which nothing lies
_STEPS = 5  # the last is 48 standard deviations away
_BETWEEN = 3  # places
_LEAST, _MOST = 0.25, 4.0  # of the dimension: beyond it is not told at all
_GRID = 400


@dataclass(frozen=True, kw_only=True)
class Walk:
    """What the profile of a dimension says.

    shift_m : of its mean from the top that it was walked from.   std_m : inf where the rays do not end it.   best : likeliest fit on the way.
    """

    shift_m: float
    std_m: float
    best: Scored


def walked(
    data: RayData, layout: RayLayout, top: Scored, held: Mapping[str, float], name: str, std_m: float, *, still: tuple[str, ...], free_edge: bool
) -> Walk:
    """The profile of one dimension. std_m : the step of the walk, as the curvature at the top has it."""
    place, best = layout.place[name], top
    at = float(top.theta[place])
    places, levels = [at], [top.log_posterior]

    def fit_at(value: float, theta: FloatArray) -> Scored:
        nonlocal best
        theta = theta.copy()
        theta[place] = value
        there = fitted(data, layout, theta, {**held, name: value}, still=still, free_edge=free_edge, max_iterations=8, tolerance=1e-2)
        best = max(best, there, key=lambda one: one.log_posterior)
        places.append(value)
        levels.append(there.log_posterior)
        return there

    for side in (-1.0, 1.0):
        inner, distance = top, _FIRST * std_m
        for _ in range(_STEPS):
            moved = max(at + side * distance, _LEAST * at)
            if moved > _MOST * at or abs(moved - at) <= abs(float(inner.theta[place]) - at):
                return Walk(shift_m=0.0, std_m=math.inf, best=best)
            there = fit_at(moved, inner.theta)
            if _deep(best, there) >= LIMIT:
                break
            inner, distance = there, 2 * distance
        else:
            return Walk(shift_m=0.0, std_m=math.inf, best=best)
        outer = moved
        for _ in range(_BETWEEN if _deep(best, there) > _STEEP else 0):
            middle = 0.5 * (float(inner.theta[place]) + outer)
            there = fit_at(middle, inner.theta)
            if _deep(best, there) < LIMIT:
                inner = there
            elif _deep(best, there) <= _STEEP:
                break
            else:
                outer = middle
    mean, std = moments(np.array(places), np.array(levels))
    return Walk(shift_m=mean - at, std_m=std, best=best)


def _deep(best: Scored, there: Scored) -> float:
    """How many deviations down a fit lies."""
    return math.sqrt(2 * max(best.log_posterior - there.log_posterior, 0.0))


def moments(places: FloatArray, levels: FloatArray) -> tuple[float, float]:
    """Mean and standard deviation of a profile known at some places (n,), by its log (n,): exact where that is a parabola.

    The root of twice the fall, with a sign, is taken to be straight between them and beyond the outermost.
    """
    order = np.argsort(places)
    x, level = places[order], levels[order]
    top = int(np.argmax(level))
    depth = np.minimum(np.sqrt(2 * (level[top] - level)), _DEEPEST)
    depth[:top] *= -1
    low = x[0] - (_DEEPEST + depth[0]) * (x[1] - x[0]) / max(depth[1] - depth[0], 1e-3)
    high = x[-1] + (_DEEPEST - depth[-1]) * (x[-1] - x[-2]) / max(depth[-1] - depth[-2], 1e-3)
    grid = np.unique(np.r_[np.linspace(low, high, _GRID), x])
    at = np.interp(grid, np.r_[low, x, high], np.r_[-_DEEPEST, depth, _DEEPEST])
    mass = np.exp(-0.5 * at**2) * np.gradient(grid)
    mass /= mass.sum()
    mean = float(mass @ grid)
    return mean, math.sqrt(float(mass @ (grid - mean) ** 2))
