"""Where the search starts: for each family, rolls x quarter turns x sizes x walls, screened by their likelihood on a few hundred points.

shape-estimation.md, method 4: 8 rolls x families x 1-3 shapes, 12 iterations on 600 points, keep the best.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.likelihood import Layout, bounds, model_of, prior, scales
from scan2fea.estimation.scoring import maximise
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.sections import PARAMETERS, ROUND
from scan2fea.types import FloatArray, Value

_N_ROLLS = 8  # in a quarter turn: 11 degrees apart, 6 at most from the truth
_WALLS = (0.05, 0.15, 0.45)  # of the smaller extent
_TRIMS = (0.01, 0.08)  # share of the points cut off each end of the extent: without and with stray points
_SIGMAS = (0.03, 0.12)  # of the larger extent
_SIGMA_FLOOR = 0.015  # of the size: a start that may take less settles on some of the faces and calls the rest stray
_FIRST_OUTLIERS = 0.05
_SCREEN_POINTS, _POINTS = 200, 600
_ITERATIONS = 12
_REFINED = 4  # candidates per family that get the iterations
_QUARTERS = {"L": 4, "C": 4, "T": 4, "I": 2, "RHS": 1, "rect": 2}  # quarter turns that make a different section


@dataclass(frozen=True, eq=False, kw_only=True)
class Start(Value):
    """A place to search from. log_likelihood : of the points it was found on; bic : -2 of it plus the price of the unknowns."""

    layout: Layout
    theta: FloatArray
    log_likelihood: float
    bic: float


def size_of(xy: FloatArray) -> float:
    """Diameter of the section's points without the outermost hundredth, metres."""
    middle = np.median(xy, axis=0)
    return 2 * float(np.quantile(np.hypot(*(xy - middle).T), 0.99))


def starts(points: FloatArray, families: Sequence[str], z_range: tuple[float, float], area_m2: float, seed: int = 0) -> list[Start]:
    """Starts of every family, the likeliest of each family first.

    points : (n, 3) metres in a provisional member frame.   area_m2 : of the stray points (hull of the section's points).
    """
    some = points[sampled_rows(len(points), _POINTS, seed)]
    few = some[sampled_rows(len(some), _SCREEN_POINTS, seed)]
    size = size_of(some[:, :2])
    found: list[Start] = []
    boxes = _boxes(some[:, :2])
    for family in families:
        layout = Layout(family=family)
        guesses = np.array(_round_guesses(some[:, :2], family) if family in ROUND else _guesses(boxes, family))
        level = model_of(few, layout, z_range, area_m2=area_m2).levels(guesses)
        order = np.argsort(-level, kind="stable")
        model = model_of(some, layout, z_range, area_m2=area_m2)
        lower, upper = bounds(layout, size)
        lower[layout.place["log_sigma"]] = math.log(_SIGMA_FLOOR * size)
        refined = []
        for theta in _apart(guesses[order[np.isfinite(level[order])]], layout, size):
            done = maximise(
                model.sums,
                theta,
                scale=scales(layout, size),
                lower=lower,
                upper=upper,
                prior=prior(layout),
                max_iterations=_ITERATIONS,
                tolerance=0.05,
            )
            bic = -2 * done.log_posterior + len(theta) * math.log(len(some))
            refined.append(Start(layout=layout, theta=done.theta, log_likelihood=done.log_likelihood, bic=bic))
        found += sorted(refined, key=lambda s: s.bic)
    return found


def _apart(ordered: FloatArray, layout: Layout, size: float) -> list[FloatArray]:
    """Of guesses (g, q), likeliest first, those that differ from every likelier one: in a length by 0.15 of the size, in the roll by 15 degrees."""
    unit = np.full(len(layout.names) - 2, 0.15 * size)
    if "roll" in layout.place:
        unit[layout.place["roll"]] = math.radians(15)
    kept: list[FloatArray] = []
    for theta in ordered:
        if len(kept) == _REFINED:
            break
        if not any((np.abs(theta - other)[: len(unit)] < unit).all() for other in kept):
            kept.append(theta)
    return kept


def _boxes(xy: FloatArray) -> FloatArray:
    """(rolls, trims, 2, 2) low and high corners of the points (n, 2) in frames turned by each roll, without the outermost at either end."""
    found = []
    for roll in _rolls():
        c, s = math.cos(roll), math.sin(roll)
        found.append(np.quantile(xy @ np.array([[c, -s], [s, c]]), [[trim, 1 - trim] for trim in _TRIMS], axis=0))
    return np.array(found)


def _rolls() -> FloatArray:
    return np.asarray(np.arange(_N_ROLLS) * (math.pi / 2 / _N_ROLLS), np.float64)


def _guesses(boxes: FloatArray, family: str) -> list[tuple[float, ...]]:
    logit = math.log(_FIRST_OUTLIERS / (1 - _FIRST_OUTLIERS))
    found = []
    for roll, by_trim in zip(_rolls(), boxes, strict=True):
        for quarter in range(_QUARTERS[family]):
            turn = roll + quarter * math.pi / 2
            c, s = math.cos(turn), math.sin(turn)
            for low, high in by_trim.tolist():
                for _ in range(quarter):  # a quarter turn on, x is what y was, and y is -x
                    low, high = (low[1], -high[0]), (high[1], -low[0])
                for wall in _WALLS if family != "rect" else _WALLS[:1]:
                    values, origin = _placed(family, low, high, wall)
                    centre = (c * origin[0] - s * origin[1], s * origin[0] + c * origin[1])
                    for sigma in _SIGMAS:
                        extent = max(high[0] - low[0], high[1] - low[1])
                        found.append((*values, turn, *centre, math.log(sigma * extent), logit))
    return found


def _placed(family: str, low: Sequence[float], high: Sequence[float], wall: float) -> tuple[tuple[float, ...], tuple[float, float]]:
    """Dimensions and origin of the section of a family that fills a box; its walls are a share of the smaller side."""
    wide, tall, mid_x, mid_y = high[0] - low[0], high[1] - low[1], (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
    t = wall * min(wide, tall)
    if family == "L":
        return (wide, tall, t), (low[0], low[1])
    if family == "rect":
        return (wide, tall), (mid_x, mid_y)
    if family == "RHS":
        return (tall, wide, t), (mid_x, mid_y)
    origin = {"I": (mid_x, mid_y), "C": (low[0], mid_y), "T": (mid_x, high[1])}[family]
    return (tall, wide, t, t), origin


def _round_guesses(xy: FloatArray, family: str) -> list[FloatArray]:
    """From the middle of the points, and from the circle of least squares through them (Kasa 1976), for which a part of a circle is enough."""
    logit = math.log(_FIRST_OUTLIERS / (1 - _FIRST_OUTLIERS))
    low, high = np.quantile(xy, [0.02, 0.98], axis=0)
    circles = [((low + high) / 2, float((high - low).mean()))]
    middle = xy.mean(0)
    away = xy - middle
    rows = np.concatenate([away, np.ones((len(xy), 1))], 1)
    solution = np.linalg.lstsq(rows, (away**2).sum(1), rcond=None)[0]
    square = solution[2] + (solution[:2] ** 2).sum() / 4
    if 0 < square < (2 * float((high - low).max())) ** 2:
        circles.append((middle + solution[:2] / 2, 2 * math.sqrt(square)))
    found = []
    for centre, diameter in circles:
        for wall in _WALLS if len(PARAMETERS[family]) > 1 else _WALLS[:1]:
            values = (diameter, wall * diameter / 2)[: len(PARAMETERS[family])]
            for sigma in _SIGMAS:
                found.append(np.array([*values, *centre, math.log(sigma * diameter), logit]))
    return found
