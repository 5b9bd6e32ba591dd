"""Ways out of a wrong optimum: a noise that shrinks step by step, and walls traded against noise along the ridge of the likelihood.

Through a blurred wall only V = sigma^2 + t^2 / 4 is well measured (shape-estimation.md, "Limit"): the likelihood has a ridge on which a thick wall
with little noise and a thin one with much look alike from afar, and each end of it may hold an optimum.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from scan2fea.estimation.likelihood import Layout, SectionModel, bounds, prior, scales
from scan2fea.estimation.scoring import Scored, Summed, maximise
from scan2fea.types import FloatArray

RIDGE = (0.3, 0.7, 0.93)  # t / (2 sqrt V) of the restarts (shape-estimation.md, method 5)
_SHRINK = 0.6  # of sigma from stage to stage (same place)
_STAGES = 30  # 0.6^30 = 2e-7: from the size of the section to the floor of sigma
_STAGE_ITERATIONS = 5
_LOOSE = 0.05  # log-likelihood units that a stage may leave on the table

# What a wall that grows by dt about its own middle plane does to the other dimensions and to the origin (x, y) in the section's frame
_GROWTH: Mapping[str, Mapping[str, tuple[Mapping[str, float], tuple[float, float]]]] = {
    "L": {"t": ({"a": 0.5, "b": 0.5}, (-0.5, -0.5))},
    "I": {"tw": ({}, (0, 0)), "tf": ({"h": 1.0}, (0, 0))},
    "C": {"tw": ({"b": 0.5}, (-0.5, 0)), "tf": ({"h": 1.0}, (0, 0))},
    "T": {"tw": ({}, (0, 0)), "tf": ({"h": 0.5}, (0, 0.5))},
    "RHS": {"t": ({"h": 1.0, "b": 1.0}, (0, 0))},
    "CHS": {"t": ({"d": 1.0}, (0, 0))},
}


def walls(family: str) -> tuple[str, ...]:
    """Names of the wall thicknesses of a family; none for solid bars."""
    return tuple(_GROWTH.get(family, {}))


def with_walls(layout: Layout, theta: FloatArray, thickness: Mapping[str, float]) -> FloatArray:
    """theta with other wall thicknesses, the middle plane of every wall and every toe where they were."""
    out = theta.copy()
    roll = layout.get(theta, "roll")
    for name, new in thickness.items():
        grow = new - layout.get(theta, name)
        others, (ox, oy) = _GROWTH[layout.family][name]
        out[layout.place[name]] = new
        for other, factor in others.items():
            out[layout.place[other]] += factor * grow
        out[layout.place["cx"]] += grow * (math.cos(roll) * ox - math.sin(roll) * oy)
        out[layout.place["cy"]] += grow * (math.sin(roll) * ox + math.cos(roll) * oy)
    return out


def annealed(
    model: SectionModel,
    theta: FloatArray,
    size_m: float,
    *,
    fixed: Mapping[str, float] | None = None,
    max_iterations: int = 25,
    tolerance: float = 1e-3,
) -> Scored:
    """The optimum that is reached while sigma may shrink by at most 0.6 a stage; then freely."""
    layout = model.layout
    at = layout.place["log_sigma"]
    lower, upper = bounds(layout, size_m, fixed)
    floor = lower[at]
    if lower[at] < upper[at]:
        for _ in range(_STAGES):
            lower[at] = max(floor, theta[at] + math.log(_SHRINK))
            done = _run(model, theta, size_m, lower, upper, _STAGE_ITERATIONS, _LOOSE)
            theta = done.theta
            if theta[at] > lower[at] + 1e-9 or lower[at] <= floor:
                break
        lower[at] = floor
    return _run(model, theta, size_m, lower, upper, max_iterations, tolerance)


def ridge_restarts(
    model: SectionModel, theta: FloatArray, size_m: float, *, fixed: Mapping[str, float] | None = None, max_iterations: int = 15
) -> list[Scored]:
    """Optima reached from `theta` itself and from the walls of RIDGE at the same sigma^2 + t^2 / 4, the best first."""
    layout = model.layout
    found = [annealed(model, theta, size_m, fixed=fixed, max_iterations=max_iterations, tolerance=_LOOSE)]
    for other in on_the_ridge(layout, theta, fixed):
        found.append(annealed(model, other, size_m, fixed=fixed, max_iterations=max_iterations, tolerance=_LOOSE))
    return sorted(found, key=lambda s: -s.log_posterior)


def on_the_ridge(layout: Layout, theta: FloatArray, fixed: Mapping[str, float] | None = None) -> list[FloatArray]:
    """theta with the walls of RIDGE at the same sigma^2 + t^2 / 4; none where there is no wall to fit."""
    names = [name for name in walls(layout.family) if name not in (fixed or {})]
    if not names:
        return []
    root_v = math.hypot(layout.sigma(theta), max(layout.get(theta, name) for name in names) / 2)
    found = []
    for ratio in RIDGE:
        other = with_walls(layout, theta, dict.fromkeys(names, 2 * ratio * root_v))
        other[layout.place["log_sigma"]] = math.log(root_v * math.sqrt(1 - ratio**2))
        found.append(other)
    return found


def _run(model: SectionModel, theta: FloatArray, size_m: float, lower: FloatArray, upper: FloatArray, iterations: int, tolerance: float) -> Scored:
    layout = model.layout
    at = layout.place["logit_outliers"]

    def curved(theta: FloatArray) -> Summed:
        """Where the prior holds more strays than there are, their scores are alike and the products of these say nothing: the curvature does."""
        level, slope, information = model.sums(theta)
        if slope[at] < 0:  # products minus second derivatives, exactly
            information[at, at] -= (1 - 2 * layout.outlier_share(theta)) * slope[at]
        return level, slope, information

    return maximise(
        curved,
        theta,
        scale=scales(layout, size_m),
        lower=lower,
        upper=upper,
        prior=prior(layout, model.stated),
        max_iterations=iterations,
        tolerance=tolerance,
        least_gain=0.1 * tolerance,
    )


def climbed(
    model: SectionModel,
    theta: FloatArray,
    size_m: float,
    *,
    fixed: Mapping[str, float] | None = None,
    max_iterations: int = 25,
    tolerance: float = 1e-4,
) -> Scored:
    """The optimum nearest to theta, all unknowns free but the `fixed` ones."""
    lower, upper = bounds(model.layout, size_m, fixed)
    return _run(model, np.asarray(theta, float), size_m, lower, upper, max_iterations, tolerance)
