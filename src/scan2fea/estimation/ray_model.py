"""The likelihood of all rays as a function of one vector of unknowns, for `scoring.maximise`."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.ray_data import FULL_OPENING, USUAL_BEAM_RAD, RayData
from scan2fea.estimation.rays_of_member import VALUES, in_unknowns, ray_terms, seen_from_axis
from scan2fea.estimation.scoring import Prior
from scan2fea.kernel.sections import PARAMETERS, ROUND, corner_factors
from scan2fea.types import FloatArray, IntArray

N_CHORDS = 48  # of a round outline, whose polygon has the circle's area: the ranges err by 0.07 % of the radius, both ways
LOGIT_PRIOR = (-5.0, 1.5)  # shares of lost and of meaningless rays (shape-estimation.md, method 3)
LOG_FOOT_PRIOR = (math.log(USUAL_BEAM_RAD), 1.0)
KNOWN_FOOT_SD = 0.5  # of the log of a stated width, where the sensor proves not to see edges at half of its beam
WALLS = ("t", "tw", "tf")  # of open sections
WALL_PRIOR = (0.1, 0.1)  # mean and standard deviation in sizes of the section (rolled shapes: 0.02 to 0.25); it settles what the rays leave open
MAX_SHARE = 0.3
NUISANCE = ("log_sigma", "log_footprint", "edge", "logit_dropped", "logit_outlier")
N_TAIL = 2 + len(NUISANCE)  # the ends come before them
EDGE_PRIOR = 1.5  # standard deviations of the beam: a sensor that notices any light sees an edge 2 of them farther out than half the beam
_SCALE_SIZE, _SCALE_ANGLE, _SCALE_LOG = 0.01, 0.01, 0.1


@functools.cache
def outline_of(family: str) -> tuple[FloatArray, IntArray]:
    """(k, 2, p) derivatives of the corners of the outer outline, and (k,) the corner after each. The arrays are read-only."""
    if family in ROUND:
        angle = 2 * np.pi * np.arange(N_CHORDS) / N_CHORDS
        radius = math.sqrt(angle[1] / math.sin(angle[1])) / 2  # per diameter
        factors = np.stack([np.cos(angle), np.sin(angle)], 1)[:, :, None] * radius
    else:
        factors = np.ascontiguousarray(corner_factors(family)[0][:, :, : RayLayout(family, 1).n_values])
    after = np.roll(np.arange(len(factors)), -1)
    for shared in (factors, after):
        shared.setflags(write=False)
    return factors, after


@dataclass(frozen=True)
class RayLayout:
    """Which unknown is where: dimensions, roll, Legendre coefficients of the axis in x and in y, heights of the ends, noise, beam, shares."""

    family: str
    degree: int

    @functools.cached_property
    def dimensions(self) -> tuple[str, ...]:
        """The dimensions that show from outside: the wall of a hollow section is none of them."""
        return tuple(n for n in PARAMETERS[self.family] if not (self.family in ("RHS", "CHS") and n == "t"))

    @property
    def n_values(self) -> int:
        return len(self.dimensions)

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        axis = tuple(f"{c}{k}" for c in "xy" for k in range(self.degree + 1))
        return (*self.dimensions, "roll", *axis, "start", "end", *NUISANCE)

    @functools.cached_property
    def place(self) -> Mapping[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def axis(self, theta: FloatArray) -> FloatArray:
        """(2, degree + 1) Legendre coefficients."""
        return theta[self.n_values + 1 : -N_TAIL].reshape(2, -1)

    def scale(self, size: float) -> FloatArray:
        scale = np.full(len(self.names), _SCALE_SIZE * size)
        scale[self.n_values] = _SCALE_ANGLE
        scale[-len(NUISANCE) :] = _SCALE_LOG
        return scale

    def bounds(self, theta: FloatArray, size: float, footprint_known: bool, held: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Closed range of every unknown; `held` ones have a single value."""
        lower, upper = np.full(len(theta), -np.inf), np.full(len(theta), np.inf)
        lower[: self.n_values], upper[: self.n_values] = 1e-3 * size, 4 * size
        for name, low, high in (
            ("log_sigma", math.log(1e-7 * size), math.log(size)),
            ("log_footprint", *((-5.0, 1.0) if footprint_known else (math.log(1e-6), math.log(0.05)))),
            ("edge", -6.0, 6.0),
            ("logit_dropped", -12.0, math.log(MAX_SHARE / (1 - MAX_SHARE))),
            ("logit_outlier", -12.0, math.log(MAX_SHARE / (1 - MAX_SHARE))),
        ):
            lower[self.place[name]], upper[self.place[name]] = low, high
        for name, value in held.items():
            lower[self.place[name]] = upper[self.place[name]] = value
        return lower, upper

    def prior(self, size: float, footprint_known: bool) -> Prior:
        mean, sd = np.zeros(len(self.names)), np.full(len(self.names), np.inf)
        for name in ("logit_dropped", "logit_outlier"):
            mean[self.place[name]], sd[self.place[name]] = LOGIT_PRIOR
        mean[self.place["edge"]], sd[self.place["edge"]] = 0.0, EDGE_PRIOR
        for name in self.dimensions:
            if name in WALLS:
                mean[self.place[name]], sd[self.place[name]] = WALL_PRIOR[0] * size, WALL_PRIOR[1] * size
        where = self.place["log_footprint"]
        mean[where], sd[where] = (-math.log(FULL_OPENING), KNOWN_FOOT_SD) if footprint_known else LOG_FOOT_PRIOR
        return mean, sd


@dataclass(frozen=True, eq=False)
class RayModel:
    """Rays and what is known of them. least_m : neither the beam nor the noise is taken narrower (annealing)."""

    layout: RayLayout
    data: RayData
    least_m: float = 0.0

    def evaluate(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """logp (n,) and scores (n, p) at theta; -inf where the dimensions make no section."""
        d, layout, p = self.data, self.layout, self.layout.n_values
        logp, scores = np.empty(len(d)), np.empty((len(d), len(theta)))
        if not _is_section(layout, theta) or theta[layout.place["end"]] <= theta[layout.place["start"]]:
            return np.full(len(d), -np.inf), np.zeros_like(scores)
        axis, roll, t, at = layout.axis(theta), float(theta[p]), theta, layout.place
        q, e = np.empty((len(d), 2)), np.empty((len(d), 2))
        seen_from_axis(d.o, d.d, d.legendre, d.slopes, d.ahead, axis, roll, q, e)
        # widths below what the rays can resolve enter as a root of squares: smooth, and the score shrinks by the same share
        foot, foot_share = _floored(math.exp(t[at["log_footprint"]]) * d.foot_m, max(self.least_m, d.least_width))
        sigma, sigma_share = _floored(np.array([math.exp(t[at["log_sigma"]])]), self.least_m)
        unit = (1 / FULL_OPENING if d.footprint_known else USUAL_BEAM_RAD) * d.foot_m
        factors, after = outline_of(layout.family)
        raw = np.empty((len(d), VALUES + p))
        ray_terms(
            q, e, d.o[:, 2].copy(), d.d[:, 2].copy(), d.range_m, foot, t[at["edge"]] * unit, factors @ t[:p], factors, after,
            t[[at["start"], at["end"]]], float(sigma[0]), _share(t[at["logit_dropped"]]), _share(t[at["logit_outlier"]]), d.window, d.hits_only,
            logp, raw,
        )  # fmt: skip
        in_unknowns(raw, q, e, d.d[:, 2].copy(), d.legendre, d.slopes, d.ahead, roll, float(sigma_share[0]), foot_share, unit, scores)
        return logp, scores


def _is_section(layout: RayLayout, theta: FloatArray) -> bool:
    v = dict(zip(layout.dimensions, theta, strict=False))
    if min(v.values()) <= 0:
        return False
    if layout.family == "L":
        return bool(v["t"] < min(v["a"], v["b"]))
    if layout.family in ("I", "C", "T"):
        return bool(v["tw"] < v["b"] and v["tf"] < v["h"] * (1.0 if layout.family == "T" else 0.5))
    return True


def _share(logit: float) -> float:
    return 1 / (1 + math.exp(-logit))


def _floored(value: FloatArray, least: float) -> tuple[FloatArray, FloatArray]:
    both = np.sqrt(value**2 + least**2)
    return both, (value / both) ** 2
