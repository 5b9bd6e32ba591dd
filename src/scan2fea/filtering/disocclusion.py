"""Ranges behind what stands in the way, and points there that nobody measured (thesis eq 2.7; Biasutti et al. 2017).

diffusion    u_t = Lap u in the mask, u fixed outside, u the RANGE (eq 2.7 as corrected): its steady state.
anisotropic  u_t = div((grad u . eta) eta), eta the vertical of the station: ranges run on from above and below, edges at the sides stay sharp.
planes       the inverse range of any plane is a cos(azimuth) + b sin(azimuth) + c along a ring, exactly; fitted to both sides of each run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from scan2fea.errors import UsageError, require
from scan2fea.filtering.occluders import Run, occluders
from scan2fea.filtering.range_image import RangeImage
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

ACROSS = 1e-3  # of the anisotropic diffusion: what is bordered on neither end stays defined


@dataclass(frozen=True, eq=False, kw_only=True)
class Disoccluded(Value):
    """is_occluder : (n,) points that stand before a surface seen on both of their sides.   points : (k, 3) behind them, inferred, in the frame of the
    station.   sigma_m : (k,) scatter of the background that they were made from, at their range.   filled_m : (rows, columns) the range behind, nan
    elsewhere.   source : (k,) a measured point of that background.
    """

    is_occluder: BoolArray
    points: FloatArray
    sigma_m: FloatArray
    filled_m: FloatArray
    source: IntArray


def disocclude(image: RangeImage, sigma_m: float, method: str = "planes", tau_m: float | None = None) -> Disoccluded:
    """Find what stands in the way and make up what is behind it. sigma_m : noise of a range. Raises UsageError for an unknown method."""
    require(method in METHODS, UsageError, f"filtering.disocclusion {method!r}: use none, {', '.join(METHODS)}")
    mask, runs = occluders(image, sigma_m, tau_m)
    filled = METHODS[method](image, runs)
    row, column = np.nonzero(np.isfinite(filled))
    r = filled[row, column]
    scatter, source = np.zeros(image.range_m.shape), np.full(image.range_m.shape, -1, np.int64)
    for run in runs:
        scatter[run.row, run.columns] = run.scatter
        source[run.row, run.columns] = image.row_of_point[run.row, run.beside]
    return Disoccluded(
        is_occluder=mask.ravel()[image.cell],
        points=image.station + image.directions(row, column) * r[:, None],
        sigma_m=np.maximum(scatter[row, column] * r**2, sigma_m),
        filled_m=filled,
        source=source[row, column],
    )


def _planes(image: RangeImage, runs: list[Run]) -> FloatArray:
    filled = np.full(image.range_m.shape, np.nan)
    for run in runs:
        filled[run.row, run.columns] = run.behind_m
    return filled


def _diffused(image: RangeImage, runs: list[Run], along: float, down: float) -> FloatArray:
    """Steady state of the diffusion: each cell of the mask is the mean of its neighbours, weighted by the couplings over squared distances.

    along, down : diffusivity along the ring and across rings. Cells without return beside the mask let nothing through.
    """
    shape = image.range_m.shape
    mask, hidden = np.zeros(shape, bool), np.zeros(shape, bool)
    for run in runs:
        (mask if np.isfinite(run.behind_m[0]) else hidden)[run.row, run.columns] = True
    n = int(mask.sum())
    filled = np.full(shape, np.nan)
    if n == 0:
        return filled
    number = np.full(shape, -1, np.int64)
    number[mask] = np.arange(n)
    row, column = np.nonzero(mask)
    gap = np.diff(image.elevation)
    entries: list[tuple[IntArray, IntArray, FloatArray]] = []
    total, right_side = np.zeros(n), np.zeros(n)
    arc = image.step_rad * np.cos(image.elevation[row])
    for d_row, d_column in ((0, -1), (0, 1), (-1, 0), (1, 0)):
        r, c = row + d_row, column + d_column
        inside = (r >= 0) & (r < shape[0]) & ((c >= 0) & (c < shape[1]) | image.is_closed)
        r, c = np.clip(r, 0, shape[0] - 1), c % shape[1]
        reach = arc if d_row == 0 else (gap[np.clip(np.minimum(row, r), 0, max(len(gap) - 1, 0))] if len(gap) else np.ones(n))
        weight = (along if d_row == 0 else down) / np.maximum(reach, 1e-9) ** 2
        within = inside & mask[r, c]
        fixed = inside & ~mask[r, c] & ~hidden[r, c] & np.isfinite(image.range_m[r, c])
        entries.append((np.flatnonzero(within), number[r, c][within], -weight[within]))
        total += np.where(within | fixed, weight, 0.0)
        right_side += np.where(fixed, weight * np.nan_to_num(image.range_m[r, c]), 0.0)
    at = [np.concatenate(parts) for parts in zip(*entries, strict=True)]
    lonely = total <= 0
    diagonal = np.arange(n)
    matrix = coo_array(
        (np.concatenate([at[2], np.where(lonely, 1.0, total)]), (np.concatenate([at[0], diagonal]), np.concatenate([at[1], diagonal]))), shape=(n, n)
    ).tocsr()
    u = np.asarray(spsolve(matrix, right_side))
    filled[mask] = np.where((u > 0) & np.isfinite(u), u, np.nan)
    return filled


METHODS: Mapping[str, Callable[[RangeImage, list[Run]], FloatArray]] = {
    "planes": _planes,
    "diffusion": lambda image, runs: _diffused(image, runs, 1.0, 1.0),
    "anisotropic": lambda image, runs: _diffused(image, runs, ACROSS, 1.0),
}
