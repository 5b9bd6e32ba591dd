"""The one optimiser of estimation: maximum likelihood by scoring with the outer products of the scores (Berndt, Hall, Hall and Hausman 1974), damped.

The sum of the scores' outer products estimates the information matrix from first derivatives alone and is never indefinite. Levenberg's damping,
in units of `scale`, shortens the step wherever the likelihood would fall: it never does.

A search takes thousands of short climbs, so what is between two evaluations is compiled: `_answered` takes a value and says where to look next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit_ieee
from scan2fea.types import BoolArray, FloatArray, Value

Evaluate = Callable[[FloatArray], tuple[FloatArray, FloatArray]]  # theta -> log p (n,) and scores (n, p)
Summed = tuple[float, FloatArray, FloatArray]  # log likelihood, its slope (p,) and the outer products of the scores (p, p), over all points
Sums = Callable[[FloatArray], Summed]
Prior = tuple[FloatArray, FloatArray]  # mean and standard deviation of each unknown; inf where nothing is known

_FIRST_DAMPING = 1e-3
_STRETCH = 3.0  # where the slope has hardly fallen along a step the next goes further: far off, the scores' products exceed the curvature by far
_MAX_TRIES = 12  # the damping rises tenfold each: 1e12 times the information is no step at all
_LOST = 1e-2  # log-likelihood units: a step that promises less and gains nothing is the rounding of the sum


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
    p = len(start)
    mean, sd = (np.zeros(p), np.full(p, np.inf)) if prior is None else prior
    limits = np.stack([np.broadcast_to(np.asarray(row, float), (p,)) for row in (scale, lower, upper, mean, 1 / np.square(sd))])
    ends = np.array([max_iterations, tolerance, least_gain])
    here = np.zeros((p + 2, p))  # unknowns, slope, information of the best place so far
    trial = np.clip(np.asarray(start, float), lower, upper)
    count = np.zeros(_N_COUNT)
    while True:
        # a fresh copy for every evaluation: who keeps one must not see it change
        likelihood, gradient, information = sums(trial.copy())
        if not _answered(here, trial, count, limits, ends, likelihood, gradient, information):
            break
    return Scored(
        theta=here[0].copy(),
        log_likelihood=float(count[_LIKELIHOOD]),
        log_posterior=float(count[_VALUE]),
        information=here[2:].copy(),
        at_bound=~_free(here, limits) if np.isfinite(count[_VALUE]) else np.zeros(p, bool),
        n_iterations=int(count[_ITERATION]),
        converged=bool(count[_CONVERGED]),
    )


# places in the counts of a climb
_VALUE, _LIKELIHOOD, _DAMPING, _STEP, _SMALL, _ITERATION, _TRIES, _PROMISE, _CONVERGED, _BEGUN = range(10)
_N_COUNT = 10


@jit_ieee
def _answered(
    here: FloatArray,
    trial: FloatArray,
    count: FloatArray,
    limits: FloatArray,
    ends: FloatArray,
    likelihood: float,
    gradient: FloatArray,
    information: FloatArray,
) -> bool:
    """Takes the value at `trial` and enters the next place to look at there; False where the climb has ended.

    here : (p + 2, p) theta, slope and information of the best place.   limits : (5, p) scale, lower, upper, mean and precision of the prior.
    ends : iterations at most, tolerance, least gain.
    """
    p = len(trial)
    value = likelihood
    for a in range(p):
        if limits[4, a] > 0:
            away = trial[a] - limits[3, a]
            value -= 0.5 * limits[4, a] * away * away
    if count[_BEGUN] == 0:
        count[_BEGUN], count[_DAMPING], count[_STEP] = 1.0, _FIRST_DAMPING, 1.0
        _moved(here, trial, count, limits, likelihood, value, gradient, information)
        if not np.isfinite(value):
            return False
        return _begun(here, trial, count, limits, ends)
    if np.isfinite(value) and value > count[_VALUE]:
        gain = value - count[_VALUE]
        predicted, rise, left = 0.0, 0.0, 0.0
        for a in range(p):
            step = trial[a] - here[0, a]
            rise += here[1, a] * step
            slope = gradient[a] - limits[4, a] * (trial[a] - limits[3, a]) if limits[4, a] > 0 else gradient[a]
            left += slope * step
            predicted += here[1, a] * step
            for b in range(p):
                predicted -= 0.5 * step * here[2 + a, b] * (trial[b] - here[0, b])
        factor = 0.1 if gain > 0.5 * predicted else 1.0 if gain > 0.1 * predicted else 5.0
        count[_DAMPING] = max(count[_DAMPING] * factor, 1e-12)
        count[_STEP] = count[_STEP] * _STRETCH if left / max(rise, 1e-300) > 0.5 else 1.0
        count[_SMALL] = count[_SMALL] + 1 if gain < ends[2] else 0.0
        count[_ITERATION] += 1
        _moved(here, trial, count, limits, likelihood, value, gradient, information)
        if count[_SMALL] == 2:
            count[_CONVERGED] = 1.0
            return False
        return _begun(here, trial, count, limits, ends)
    if count[_STEP] > 1:
        count[_STEP] = 1.0
    else:
        count[_DAMPING] *= 10
    count[_TRIES] += 1
    if count[_TRIES] >= _MAX_TRIES:  # the rounding of the sum is all that is left to gain
        count[_CONVERGED] = 1.0 if count[_PROMISE] < _LOST else 0.0
        return False
    _tried(here, trial, count, limits)
    return True


@jit_ieee
def _begun(here: FloatArray, trial: FloatArray, count: FloatArray, limits: FloatArray, ends: FloatArray) -> bool:
    """Begins an iteration: enters its first trial; False where there is nothing left to gain, or no iteration left."""
    if count[_ITERATION] >= ends[0]:
        return False
    is_free = _free(here, limits)
    if not is_free.any():
        count[_CONVERGED] = 1.0
        return False
    plain = _step(here, is_free, limits, 0.0)
    promise = 0.0
    for a in range(len(trial)):
        promise += 0.5 * here[1, a] * plain[a]
    count[_PROMISE], count[_TRIES] = promise, 0.0
    if promise < ends[1]:
        count[_CONVERGED] = 1.0
        return False
    _tried(here, trial, count, limits)
    return True


@jit_ieee
def _tried(here: FloatArray, trial: FloatArray, count: FloatArray, limits: FloatArray) -> None:
    """Enters the place that a step of the present damping and stretch leads to."""
    step = _step(here, _free(here, limits), limits, count[_DAMPING])
    for a in range(len(trial)):
        at = here[0, a] + count[_STEP] * step[a]
        trial[a] = at if np.isnan(at) else min(max(at, limits[1, a]), limits[2, a])


@jit_ieee
def _moved(
    here: FloatArray,
    trial: FloatArray,
    count: FloatArray,
    limits: FloatArray,
    likelihood: float,
    value: float,
    gradient: FloatArray,
    information: FloatArray,
) -> None:
    """Makes the trial the best place: its slope and information with the prior's."""
    count[_LIKELIHOOD], count[_VALUE] = likelihood, value
    for a in range(len(trial)):
        here[0, a], here[1, a] = trial[a], gradient[a]
        for b in range(len(trial)):
            here[2 + a, b] = information[a, b]
        if limits[4, a] > 0:
            here[1, a] -= limits[4, a] * (trial[a] - limits[3, a])
            here[2 + a, a] += limits[4, a]


@jit_ieee
def _free(here: FloatArray, limits: FloatArray) -> BoolArray:
    """Unknowns that may move: not those at a bound which the likelihood pushes against it."""
    is_free = np.ones(here.shape[1], np.bool_)
    for a in range(here.shape[1]):
        low, high = limits[1, a], limits[2, a]
        is_free[a] = not ((here[0, a] <= low and here[1, a] < 0) or (here[0, a] >= high and here[1, a] > 0) or low >= high)
    return is_free


@jit_ieee
def _step(here: FloatArray, is_free: BoolArray, limits: FloatArray, damping: float) -> FloatArray:
    """(J + damping (diag J + 1 / scale^2)) step = gradient over the free unknowns; solved in units of `scale`."""
    rows = np.flatnonzero(is_free)
    n, scale = len(rows), limits[0]
    matrix, right, trace = np.empty((n, n)), np.empty(n), 1e-300
    for a in range(n):
        right[a] = scale[rows[a]] * here[1, rows[a]]
        for b in range(n):
            matrix[a, b] = here[2 + rows[a], rows[b]] * scale[rows[a]] * scale[rows[b]]
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
