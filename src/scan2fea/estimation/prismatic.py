"""Can the points be a member at all? Seen along its axis a member's points lie on the outline of a section; a free form's fill an area.

Asked before the search among families, which takes a hundred times as long, and only where the local noise is small against the section: a wide noise
fills areas too. A section that changes along the axis fills the area between its outlines: what `profile` says of it counts as a member.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.estimation.axis import Axis
from scan2fea.estimation.profile import RADIAL, laws_of
from scan2fea.kernel.blurred import grid_of, log_density_of
from scan2fea.kernel.noise import noise_sigma, sampled_rows
from scan2fea.types import FloatArray

_NARROW, _WIDE = 0.02, 0.06  # of the section: widths at which the density is compared
_POINTS = 6_000
_LEAST = 200
_ENDS = 0.1  # of the length on either side, where caps fill areas
_AREA = 1.65  # dimension of what half of the points lie on: an outline has 1, two close walls up to 1.5, an area 2
_QUIET = 0.5  # of the narrower width: local noise up to which an outline is thin


def is_prismatic(points: FloatArray, axes: tuple[Axis, ...], seed: int = 0) -> bool:
    """False where the points (n, 3) lie on no outline along any of the axes; True where they do, or where noise or number leave it open."""
    some = points[sampled_rows(len(points), _POINTS, seed)]
    sigma = noise_sigma(some, seed=seed, below_m=_QUIET * _NARROW * max(axis.size_m for axis in axes))
    return any(_may_be_along(points, axis, sigma, seed) for axis in axes)


def _may_be_along(points: FloatArray, axis: Axis, sigma_m: float, seed: int) -> bool:
    if not sigma_m < _QUIET * _NARROW * axis.size_m:  # nan too
        return True
    straight = axis.straightened(points[sampled_rows(len(points), _POINTS, seed)])
    low, high = axis.ends
    margin = _ENDS * (high - low)
    inside = straight[(straight[:, 2] > low + margin) & (straight[:, 2] < high - margin)]
    if len(inside) < _LEAST or dimension(inside[:, :2], axis.size_m) < _AREA:
        return True
    return any(laws_of(inside, (low + margin, high - margin), across) for across in (0, 1, RADIAL))


def dimension(xy: FloatArray, size_m: float) -> float:
    """Dimension of what half of the points (n, 2) lie on: 1 for lines, 2 for areas. From densities at 2 % and at 6 % of the size."""
    narrow, wide = (log_density_of(xy, grid_of(xy, share * size_m))[0] for share in (_NARROW, _WIDE))
    return 2.0 - float(np.median(narrow - wide)) / math.log(_WIDE / _NARROW)
