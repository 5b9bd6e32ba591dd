"""The law of the noise is an unknown too: what a wall's thickness owes to the choice among laws."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from scan2fea.estimation.anneal import walls
from scan2fea.estimation.candidates import Candidate
from scan2fea.estimation.likelihood import Layout
from scan2fea.estimation.observability import SEPARATE
from scan2fea.types import FloatArray

PLAUSIBLE = 60.0  # BIC units on 3,000 points: noise even in a cube askew to the section is of no law here; its nearest lay so far behind


def law_spread(family: str, tried: Mapping[str, Candidate], within: float = math.inf) -> dict[str, float] | None:
    """Per wall, the largest difference of its thickness among the laws of noise at most `within` BIC units behind, m; None where one was tried."""
    if len(tried) < 2:
        return None
    lowest = min(c.bic for c in tried.values())
    found = {}
    for wall in walls(family):
        thickness = [c.layout.get(c.theta, wall) for c in tried.values() if c.bic <= lowest + within]
        found[wall] = max(thickness) - min(thickness)
    return found


def with_law_spread(layout: Layout, covariance: FloatArray, tried: Mapping[str, Candidate]) -> FloatArray:
    """The covariance with the variance of every wall between the laws, each counted by its posterior (shape-estimation.md, method 9); where a wall
    may be traded against noise, every dimension with its mean square departure under the laws that are not far behind, all counted alike.
    """
    if len(tried) < 2:
        return covariance
    lowest = min(c.bic for c in tried.values())
    weight = {law: math.exp(-0.5 * min(c.bic - lowest, 1400)) for law, c in tried.items()}
    total = sum(weight.values())
    out = covariance.copy()
    for wall in walls(layout.family):
        i = layout.place[wall]
        mean = sum(weight[law] * c.layout.get(c.theta, wall) for law, c in tried.items()) / total
        if out[i, i] > 0:
            out[i, i] += sum(weight[law] * (c.layout.get(c.theta, wall) - mean) ** 2 for law, c in tried.items()) / total
    near = [c for c in tried.values() if c.bic <= lowest + PLAUSIBLE]
    best = min(near, key=lambda c: c.bic)
    thinnest = min((best.layout.get(best.theta, wall) for wall in walls(layout.family)), default=math.inf)
    if thinnest < SEPARATE * best.layout.sigma(best.theta):  # walls and noise trade, and the legs follow the walls
        n, told = layout.n_values, np.diag(out)[: layout.n_values] > 0
        away = np.array([c.layout.values(c.theta) - best.layout.values(best.theta) for c in near]) * told
        out[:n, :n] += away.T @ away / len(near)
    return out
