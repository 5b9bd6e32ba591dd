"""One edge of a run of points along a line, a step blurred by noise with a cap and strays: its place and spread under each cap, over all rates.

The intensity is that of `ends.py`, rho Phi((z - e) / s) + c phi((z - e) / s) / s + b.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.edge_density import edge_levels
from scan2fea.types import FloatArray

_DROP = 14.0  # what lies this many log units under the best is not integrated over
_HOPELESS = 100.0  # a cap so far behind is not followed: what lies across the axis and the other end do not bring it back
_GRID = 41
_ZOOMS = 12
_FINE = 0.7  # of the noise: a grid of this step misses no edge that noise has blurred
FEW = 8  # points tell no edge
_CLUTTER = 0.5  # clutter along the axis is at most this dense against the member: else a chance gap inside it would pass for its end
_BINS_PER_SIGMA = 8  # binning by s / 8 widens the noise by 1 / 768 of its variance
_MANY = 150  # more points than this in a window are binned where that costs nothing


@dataclass(frozen=True, kw_only=True)
class EdgeFit:
    """An edge, its standard deviation, and the rates that go with it in `window`. is_told : by points; else it is a guess."""

    edge: float
    std: float
    rho: float
    cap: float
    clutter: float
    window: tuple[float, float]
    log_likelihood: float
    is_told: bool = True


def unknown(edge: float, std: float, rho: float, window: tuple[float, float]) -> EdgeFit:
    return EdgeFit(edge=edge, std=std, rho=rho, cap=0.0, clutter=0.0, window=window, log_likelihood=0.0, is_told=False)


def edge_fits(z: FloatArray, s: float, reach: float, near: float, caps: list[float], kept: tuple[float, float]) -> tuple[EdgeFit, ...]:
    """The edge of a square end under each cap of `cap_ratios`: found roughly among all points, then from a window of `reach` around it, twice.

    kept : outside it the points were left out: what is empty there says nothing of strays or of the member.
    """
    low, high = float(z.min()), float(z.max())
    step = max(high - low, s) / 300  # points on an exactly flat end have no length
    at, weight = _binned(z, (low - s, high), step)
    candidates = np.unique(np.quantile(z, np.linspace(0.0, 0.7, 80)))
    wide = max(s, step)
    edge = float(candidates[int(np.argmax(_profile(at, weight, (low - s, high), wide, candidates, 0.0)[0]))])
    fits = (unknown(near, reach, len(z) / reach, (low, high)),) * len(caps)
    for width, tried in ((max(reach, 4 * wide), caps[:2]), (reach, caps)):
        window = (max(edge - width, kept[0]), min(edge + width, kept[1]))
        own = z[(z > window[0]) & (z < window[1])]
        if len(own) < FEW:
            break
        found = posterior(own, window, s, tried)
        best = max(found, key=lambda fit: fit.log_likelihood)
        fits, edge = found if len(found) == len(caps) else (best,) * len(caps), best.edge
    return fits


def _binned(z: FloatArray, window: tuple[float, float], width: float) -> tuple[FloatArray, FloatArray]:
    n_bins = math.ceil((window[1] - window[0]) / width)
    if len(z) <= _MANY or n_bins > len(z):
        return z, np.ones(len(z))
    counts = np.histogram(z, n_bins, window)[0].astype(float)
    centre = window[0] + (np.arange(n_bins) + 0.5) * (window[1] - window[0]) / n_bins
    return centre[counts > 0], counts[counts > 0]


def _profile(
    at: FloatArray, weight: FloatArray, window: tuple[float, float], s: float, edges: FloatArray, ratio: float
) -> tuple[FloatArray, FloatArray]:
    """(g,) greatest log-likelihood over the rates at each edge, and the rates (3, g): rho, c, b. The cap holds `ratio` (metres) times rho."""
    return edge_levels(np.array(at), weight, window[0], window[1], s, np.array(edges), ratio, _CLUTTER)


def posterior(z: FloatArray, window: tuple[float, float], s: float, caps: list[float], begun: Sequence[EdgeFit] = ()) -> tuple[EdgeFit, ...]:
    """Mean and spread of the edge over a flat prior, under each cap. begun : what was found under the first of them already."""
    if len(begun) == len(caps):
        return tuple(begun)
    at, weight = _binned(z, window, s / _BINS_PER_SIGMA)
    found = list(begun)
    for ratio in caps[len(begun) :]:
        best_so_far = max((fit.log_likelihood for fit in found), default=-math.inf)
        found.append(_spread(at, weight, window, s, ratio, best_so_far - _HOPELESS))
    return tuple(found)


def _spread(at: FloatArray, weight: FloatArray, window: tuple[float, float], s: float, ratio: float, floor: float) -> EdgeFit:
    """Zoom a grid of edges onto where the likelihood lies, then integrate. Its log-likelihood is that of the best edge times its spread.

    A hypothesis that starts below `floor` is not followed: its log-likelihood is -inf.
    """
    is_smooth = weight.max() > 1 or window[1] - window[0] < _FINE * _GRID * s  # over a noise width; else a jump may lie at any point
    candidates = np.unique(np.r_[np.linspace(*window, _GRID), at[:: max(1, len(at) // 200)] if not is_smooth else at[:0]])
    for zoom in range(_ZOOMS):
        level, rates = _profile(at, weight, window, s, candidates, ratio)
        best = int(np.argmax(level))
        alive = np.flatnonzero(level > level[best] - _DROP)
        low, high = candidates[max(alive[0] - 1, 0)], candidates[min(alive[-1] + 1, len(candidates) - 1)]
        if len(alive) > 0.4 * len(candidates) or level[best] < floor or zoom == _ZOOMS - 1:
            break
        candidates = np.unique(np.r_[np.linspace(low, high, _GRID), candidates[best]])  # a needle must not fall between
    spread = np.gradient(candidates)
    mass = np.exp(level - level[best]) * spread
    edge = float(mass @ candidates / mass.sum())
    std = math.sqrt(float(mass @ (candidates - edge) ** 2 / mass.sum()))
    rho, cap, clutter = (float(v) for v in rates[:, best])
    evidence = float(level[best]) + math.log(max(float(mass.sum()), 1e-300) / s) if level[best] >= floor else -math.inf
    return EdgeFit(edge=edge, std=std, rho=rho, cap=cap, clutter=clutter, window=window, log_likelihood=evidence)
