"""A circle of which only an arc was seen: how long the arc is does not follow the radius.

The density of a whole circle falls as its radius grows: 1 / (2 pi R) a metre. Of an arc, whose ends lie where the scan ended, it is 1 / (R phi),
phi the angle that the arc fills about the trial centre. Taken for a whole circle, n points of half of one pull its radius in by sigma^2 / (0.19 R),
since centre and radius may move together: 0.3 mm for a bar of 42 mm under 1 mm of noise, whatever n.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.types import FloatArray, Value

_MOST_BINS, _LEAST_BINS, _PER_BIN = 72, 8, 20
_EMPTY = 0.1  # of the typical count: what strays leave in a gap
_NEAR = 3.0  # sigma from a circle


@dataclass(frozen=True, eq=False, kw_only=True)
class Arc(Value):
    """What was not seen of a circle. gaps : (g, 2, 2) metres, where each gap begins and ends, counter-clockwise."""

    gaps: FloatArray

    def log_share(self, centre: FloatArray) -> tuple[float, FloatArray]:
        """log (2 pi / phi) seen from the centre (2,), and its slope (2,): what every point's log density has above that of a whole circle."""
        away = self.gaps - centre
        angle = np.arctan2(away[..., 1], away[..., 0])
        phi = 2 * math.pi - float(np.mod(angle[:, 1] - angle[:, 0], 2 * math.pi).sum())
        by_centre = np.stack([away[..., 1], -away[..., 0]], -1) / (away**2).sum(-1)[..., None]
        if phi <= 0:
            return -math.inf, np.zeros(2)
        return math.log(2 * math.pi / phi), (by_centre[:, 1] - by_centre[:, 0]).sum(axis=0) / phi


def seen_arc(local: FloatArray, radii: FloatArray, sigma_m: float, centre: FloatArray) -> Arc | None:
    """The gaps in the points (n, 2) about the middle of their circles; None where they go all round, or are too few to say.

    radii : of the circles.   centre : (2,) of the middle in the frame of the gaps.
    """
    r = np.hypot(*local.T)
    own = local[np.abs(r[:, None] - radii).min(axis=1) < _NEAR * sigma_m]
    n_bins = min(len(own) // _PER_BIN, _MOST_BINS)
    if n_bins < _LEAST_BINS:
        return None
    step = 2 * math.pi / n_bins
    count = np.histogram(np.mod(np.arctan2(own[:, 1], own[:, 0]), 2 * math.pi), n_bins, (0.0, 2 * math.pi))[0]
    typical = float(np.median(count[count > _EMPTY * count.mean()]))
    empty = count < _EMPTY * typical
    if not empty.any() or empty.all():
        return None
    first = int(np.argmin(empty))  # a bin that is seen: no gap runs over it
    order = np.r_[first:n_bins, 0:first]
    edge = np.flatnonzero(np.diff(np.r_[False, empty[order], False].astype(np.int8))).reshape(-1, 2)
    filled = np.minimum(count / typical, 1.0)
    gaps = []
    for begin, end in edge:  # the bins beside a gap are part of it as far as they are not filled
        low = first + begin - (1 - filled[order[begin - 1]])
        high = first + end + (1 - filled[order[end % n_bins]])
        gaps.append([[math.cos(step * a), math.sin(step * a)] for a in (low, high)])
    return Arc(gaps=centre + float(np.max(radii)) * np.array(gaps))
