"""Bar or tube: what the ends show. From outside they are the same; a cap that was scanned is full or a ring.

The core of the outline is what lies deeper below its faces than the noise and than any wall: no point of a side is there, nor of the ring.
Points of the core that crowd at the ends of the member lie on the cap of a bar. Where a cap as dense as the sides would have put several points
there and none is, the member is a tube or its caps were not seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.candidates import Candidate
from scan2fea.estimation.likelihood import model_of
from scan2fea.kernel.section_likelihood import face_lengths
from scan2fea.types import FloatArray, Value

_DEEP = 4.0  # sigma below a face: one point of a side in 30,000 gets there
_THICKEST = 0.25  # of the smaller side: no wall is thicker (sections.csv: 0.18 at most), so the ring of a tube's cap stays out of the core
_NEAR = 3.5  # sigma from an end
_SHARE = 0.01  # of the length: what the ends are known to


@dataclass(frozen=True, kw_only=True)
class EndView(Value):
    """n_core : points of the core near the ends.   n_elsewhere : those expected there by what lies in the core elsewhere.

    n_cap : points of the core that caps as dense as the sides would show.
    """

    n_core: int
    n_elsewhere: float
    n_cap: float


def end_view(points: FloatArray, bar: Candidate, ends: tuple[float, float], z_range: tuple[float, float]) -> EndView:
    """What the ends say about a rect or a round whose sides were fitted.

    points : (n, 3) of the whole member, caps included.   ends : z of its ends.   z_range : that of the bar's fit.
    """
    layout, theta = bar.layout, bar.theta
    values, sigma = layout.values(theta), layout.sigma(theta)
    u = model_of(points, layout, z_range, area_m2=1.0).in_section(theta)
    depth = values / 2 - max(_DEEP * sigma, _THICKEST * float(values.min()))
    low, high = ends
    reach = _NEAR * sigma + _SHARE * (high - low)
    middle = high - low - 2 * reach
    if (depth <= 0).any() or middle <= 0:
        return EndView(n_core=0, n_elsewhere=0.0, n_cap=0.0)
    if layout.family == "round":
        core, core_area = np.hypot(*u.T) < depth[0], math.pi * depth[0] ** 2
    else:
        core, core_area = (np.abs(u[:, 0]) < depth[0]) & (np.abs(u[:, 1]) < depth[1]), 4 * depth[0] * depth[1]
    z = points[:, 2]
    at_end = (np.abs(z - low) < reach) | (np.abs(z - high) < reach)
    inner = (z > low + reach) & (z < high - reach)
    n_core = int((core & at_end).sum())
    n_elsewhere = (float((core & inner).sum()) + 0.5) * 4 * reach / middle
    n_cap = 2 * core_area * float((inner & ~core).sum()) / (float(face_lengths(layout.family, values).sum()) * middle)
    return EndView(n_core=n_core, n_elsewhere=n_elsewhere, n_cap=n_cap)
