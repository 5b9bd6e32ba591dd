"""The law of the noise is an unknown too: what a wall's thickness owes to the choice among laws."""

from __future__ import annotations

import math
from collections.abc import Mapping

from scan2fea.estimation.anneal import walls
from scan2fea.estimation.candidates import Candidate
from scan2fea.estimation.likelihood import Layout
from scan2fea.types import FloatArray


def law_spread(family: str, tried: Mapping[str, Candidate]) -> dict[str, float] | None:
    """Per wall, the largest difference of its thickness among all laws of noise, m; None where only one was tried."""
    if len(tried) < 2:
        return None
    found = {}
    for wall in walls(family):
        thickness = [c.layout.get(c.theta, wall) for c in tried.values()]
        found[wall] = max(thickness) - min(thickness)
    return found


def with_law_spread(layout: Layout, covariance: FloatArray, tried: Mapping[str, Candidate]) -> FloatArray:
    """The covariance with the variance of every wall between the laws, each counted by its posterior (shape-estimation.md, method 9)."""
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
    return out
