"""How far to trust every unknown: the inverse of the information, and the sandwich where the model is wrong.

If the model holds, the sum J of the scores' outer products and the curvature -H of the log likelihood agree, and J^-1 is the covariance (the
Cramer-Rao bound). If it does not, the covariance of the estimate is H^-1 J H^-1 (Huber 1967, White 1982). Per unknown the wider one counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.scoring import Prior, Sums
from scan2fea.types import BoolArray, FloatArray, Value

Slope = Callable[[FloatArray], FloatArray]  # theta -> slope of the log likelihood (p,)

_BLIND = 1e-9  # eigenvalue, in units of the diagonal, below which a direction is not told by the data
_SHARE = 1e-4  # part of a blind direction an unknown may have and still count as told
_STEP_SD = 0.2  # step of the finite differences of the score, in standard deviations


@dataclass(frozen=True, eq=False, kw_only=True)
class Uncertainty(Value):
    """covariance : (p, p), rows of zero where the unknown is fixed or not told by the data.   told : (p,) whether the data tell it at all.

    rank : number of directions told.   misfit : (p,) sd of the sandwich over that of the information, 1 where the model holds.
    """

    covariance: FloatArray
    told: BoolArray
    rank: int
    misfit: FloatArray


def covariance_of(information: FloatArray, free: BoolArray) -> tuple[FloatArray, BoolArray, int]:
    """(p, p) covariance of the free unknowns, (p,) which of them the data tell, and the rank, from an information matrix (p, p)."""
    p = len(information)
    covariance, told = np.zeros((p, p)), np.zeros(p, bool)
    rows = np.flatnonzero(free & (np.diag(information) > 0))
    if not len(rows):
        return covariance, told, 0
    unit = 1 / np.sqrt(np.diag(information)[rows])
    value, vector = np.linalg.eigh(information[np.ix_(rows, rows)] * np.outer(unit, unit))
    seen = value > _BLIND
    inverse = (vector[:, seen] / value[seen]) @ vector[:, seen].T * np.outer(unit, unit)
    told[rows] = (vector[:, ~seen] ** 2).sum(1) < _SHARE
    keep = np.flatnonzero(told[rows])
    covariance[np.ix_(rows[keep], rows[keep])] = inverse[np.ix_(keep, keep)]
    return covariance, told, int(seen.sum())


def uncertainty(
    sums: Sums,
    theta: FloatArray,
    free: BoolArray,
    prior: Prior | None = None,
    *,
    slope: Slope | None = None,
    weight: float = 1.0,
    sandwich: bool = True,
) -> Uncertainty:
    """Covariance of the maximum-likelihood estimate theta.

    sums : as for `scoring.maximise`.   slope : their slope alone, where that costs less.   weight : real points per point of `sums`, where it looks
    at a subsample.
    """
    precision = np.zeros(len(theta)) if prior is None else 1 / np.square(prior[1])
    outer = sums(theta)[2] * weight
    covariance, told, rank = covariance_of(outer + np.diag(precision), free)
    misfit = np.ones(len(theta))
    rows = np.flatnonzero(told)
    if sandwich and len(rows):
        curvature = _curvature(slope or (lambda at: sums(at)[1]), theta, np.sqrt(np.diag(covariance)), rows) * weight + np.diag(precision[rows])
        inner = _sandwiched(curvature, (outer + np.diag(precision))[np.ix_(rows, rows)])
        if inner is not None:
            sd = np.sqrt(np.diag(covariance)[rows])
            misfit[rows] = np.sqrt(np.diag(inner)) / sd
            wide = np.maximum(misfit[rows], 1.0)
            base = inner if misfit[rows].max() > 1 else covariance[np.ix_(rows, rows)]
            have = np.sqrt(np.diag(base))
            stretch = sd * wide / have
            covariance[np.ix_(rows, rows)] = base * np.outer(stretch, stretch)
    return Uncertainty(covariance=covariance, told=told, rank=rank, misfit=misfit)


def _curvature(slope: Slope, theta: FloatArray, sd: FloatArray, rows: np.ndarray) -> FloatArray:
    """(k, k) minus the second derivatives of the log likelihood by the given unknowns: central differences of the exact score."""
    columns = []
    for row in rows:
        step = np.zeros(len(theta))
        step[row] = _STEP_SD * sd[row]
        with np.errstate(all="ignore"):  # an unknown that the data hardly tell is moved so far that its likelihood overflows
            ahead, behind = slope(theta + step), slope(theta - step)
            columns.append(-(ahead - behind)[rows] / (2 * step[row]))
    matrix = np.stack(columns)
    return np.asarray((matrix + matrix.T) / 2)


def _sandwiched(curvature: FloatArray, outer: FloatArray) -> FloatArray | None:
    """H^-1 J H^-1; None where the curvature is not that of a maximum."""
    if not np.isfinite(curvature).all():
        return None
    unit = 1 / np.sqrt(np.maximum(np.abs(np.diag(curvature)), 1e-300))
    value, vector = np.linalg.eigh(curvature * np.outer(unit, unit))
    if value.min() < 1e-6:
        return None
    inverse = (vector / value) @ vector.T * np.outer(unit, unit)
    return np.asarray(inverse @ outer @ inverse)
