"""The one optimiser of estimation: maximum likelihood by scoring with the outer products of the scores (Berndt, Hall, Hall and Hausman 1974), damped.

The sum of the scores' outer products estimates the information matrix from first derivatives alone and is never indefinite. Levenberg's damping,
in units of `scale`, shortens the step wherever the likelihood would fall: it never does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

Evaluate = Callable[[FloatArray], tuple[FloatArray, FloatArray]]  # theta -> log p (n,) and scores (n, p)
Summed = tuple[float, FloatArray, FloatArray]  # log likelihood, its slope (p,) and the outer products of the scores (p, p), over all points
Sums = Callable[[FloatArray], Summed]
Prior = tuple[FloatArray, FloatArray]  # mean and standard deviation of each unknown; inf where nothing is known

_FIRST_DAMPING = 1e-3
_STRETCH = 3.0  # where the slope has hardly fallen along a step the next goes further: far off, the scores' products exceed the curvature by far
_MAX_TRIES = 12  # the damping rises tenfold each: 1e12 times the information is no step at all


@dataclass(frozen=True, eq=False, kw_only=True)
class Scored(Value):
    """Where the likelihood is largest.

    theta : (p,).   log_likelihood : of the points, without the prior; `log_posterior` with it.
    information : (p, p) sum of the outer products of the scores at theta, and the prior's.   at_bound : (p,) held by its bound.
    """

    theta: FloatArray
    log_likelihood: float
    log_posterior: float
    information: FloatArray
    at_bound: BoolArray
    n_iterations: int
    converged: bool


def summed(*parts: Evaluate) -> Sums:
    """The sums of point by point likelihoods; each part looks at its own points (less memory for many)."""

    def sums(theta: FloatArray) -> Summed:
        total, gradient, information = 0.0, np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
        for part in parts:
            logp, scores = part(theta)
            total += float(np.sum(logp))
            if not np.isfinite(total):
                break
            gradient += scores.sum(0)
            information += scores.T @ scores
        return total, gradient, information

    return sums


def maximise(
    sums: Sums,
    start: FloatArray,
    *,
    scale: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    prior: Prior | None = None,
    max_iterations: int = 50,
    tolerance: float = 1e-5,
    least_gain: float = 0.0,
) -> Scored:
    """The unknowns that make the points likeliest, from `start`, within [lower, upper].

    sums : what a model's points add up to at theta; a log likelihood of -inf or nan marks an impossible theta.
    scale : (p,) size of a small change of each unknown.
    tolerance : ends when the next step promises less than this in log likelihood (1e-5: a step of 0.4 % of a standard deviation).
    least_gain : also ends when two steps in a row gain less than this (a likelihood with kinks never promises nothing).
    The value at `start` must be finite, else the start itself comes back, not converged.
    """
    theta = np.clip(start, lower, upper)
    here = _Point.at(sums, theta, prior)
    damping, stretch = _FIRST_DAMPING, 1.0
    n_small = 0
    for iteration in range(max_iterations):
        if not np.isfinite(here.value):
            return here.scored(theta, np.zeros(len(theta), bool), iteration, False)
        free = _free(theta, here.gradient, lower, upper)
        if not free.any():
            return here.scored(theta, ~free, iteration, True)
        plain = _step(here, free, scale, 0.0)
        promise = 0.5 * float(here.gradient @ plain)
        if promise < tolerance:
            return here.scored(theta, ~free, iteration, True)
        accepted = False
        for _ in range(_MAX_TRIES):
            trial = np.clip(theta + stretch * _step(here, free, scale, damping), lower, upper)
            there = _Point.at(sums, trial, prior)
            if np.isfinite(there.value) and there.value > here.value:
                accepted = True
                break
            damping, stretch = (damping, 1.0) if stretch > 1 else (damping * 10, 1.0)
        if not accepted:  # the rounding of the sum is all that is left to gain
            return here.scored(theta, ~free, iteration, promise < 1e-2)
        gain = there.value - here.value
        predicted = here.predicted(trial - theta)
        damping = max(damping * (0.1 if gain > 0.5 * predicted else 1.0 if gain > 0.1 * predicted else 5.0), 1e-12)
        still_up = float(there.gradient @ (trial - theta)) / max(float(here.gradient @ (trial - theta)), 1e-300)
        stretch = stretch * _STRETCH if still_up > 0.5 else 1.0
        theta, here = trial, there
        n_small = n_small + 1 if gain < least_gain else 0
        if n_small == 2:
            return here.scored(theta, ~_free(theta, here.gradient, lower, upper), iteration + 1, True)
    return here.scored(theta, ~_free(theta, here.gradient, lower, upper), max_iterations, False)


@dataclass(frozen=True, eq=False)
class _Point:
    likelihood: float
    value: float
    gradient: FloatArray
    information: FloatArray

    @classmethod
    def at(cls, sums: Sums, theta: FloatArray, prior: Prior | None) -> _Point:
        likelihood, gradient, information = sums(theta)
        value = likelihood
        if prior is not None:
            mean, precision = prior[0], 1 / np.square(prior[1])
            away = np.where(precision > 0, theta - mean, 0.0)
            value -= 0.5 * float(precision @ away**2)
            gradient = gradient - precision * away
            information = information + np.diag(precision)
        return cls(likelihood, value, gradient, information)

    def predicted(self, step: FloatArray) -> float:
        return float(self.gradient @ step - 0.5 * step @ self.information @ step)

    def scored(self, theta: FloatArray, at_bound: BoolArray, n_iterations: int, converged: bool) -> Scored:
        return Scored(
            theta=theta,
            log_likelihood=self.likelihood,
            log_posterior=self.value,
            information=self.information,
            at_bound=at_bound,
            n_iterations=n_iterations,
            converged=converged,
        )


def _free(theta: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Unknowns that may move: not those at a bound which the likelihood pushes against it."""
    blocked = ((theta <= lower) & (gradient < 0)) | ((theta >= upper) & (gradient > 0)) | (lower >= upper)
    return np.asarray(~blocked, bool)


def _step(here: _Point, free: BoolArray, scale: FloatArray, damping: float) -> FloatArray:
    """(J + damping (diag J + 1 / scale^2)) step = gradient over the free unknowns; solved in units of `scale`."""
    return _solved(here.information, here.gradient, np.flatnonzero(free), scale, damping)


@jit
def _solved(information: FloatArray, gradient: FloatArray, rows: IntArray, scale: FloatArray, damping: float) -> FloatArray:
    n = len(rows)
    matrix, right, trace = np.empty((n, n)), np.empty(n), 1e-300
    for a in range(n):
        right[a] = scale[rows[a]] * gradient[rows[a]]
        for b in range(n):
            matrix[a, b] = information[rows[a], rows[b]] * scale[rows[a]] * scale[rows[b]]
        trace += matrix[a, a]
    step = np.zeros(len(scale))
    if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
        step[rows] = np.nan
        return step
    for a in range(n):
        matrix[a, a] += damping * (matrix[a, a] + 1.0) + 1e-12 * trace
    found = np.linalg.solve(matrix, right)
    for a in range(n):
        step[rows[a]] = scale[rows[a]] * found[a]
    return step
