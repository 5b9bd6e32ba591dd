"""Where a member begins and ends: the z-density near an end is a step blurred by the noise, plus a cap where it was scanned, plus clutter.

Near one end the points are a Poisson process of intensity

    lambda(z) = rho Phi((z - e) / s) + c phi((z - e) / s) / s + b

with rho points per metre of member, c points on the cap, b clutter per metre. Rates are profiled out; the mean and spread of what is left
as a function of e are the edge and its standard deviation. Where the noise is wide an edge carries the information 0.903 rho / s
(shape-estimation.md) and that is the spread found; where it is below the spacing the edge is a jump, the spread is 1 / rho, and the mean
is still the best estimate (Pitman). Whether the caps were scanned is not known: none, caps as dense as the sides (c = rho A / P) and other
caps are weighed against each other, at both ends together and by where the points lie across the axis too (`cap_law.py`). An end plane that
is not square is e = e0 + g . (x, y), taken where BIC prefers it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from scan2fea.estimation.cap_law import Across, cap_ratios, share_like_caps, together, told_across
from scan2fea.estimation.uneven import unevenness
from scan2fea.kernel.edge_density import edge_levels
from scan2fea.types import BoolArray, FloatArray, Value

_WINDOW = 12.0  # noise widths on either side of an edge that its likelihood looks at: the rates need far more points than the edge itself
_WINDOW_POINTS = 100  # at least so many points of the member lie in half a window
_BINS_PER_SIGMA = 8  # binning by s / 8 widens the noise by 1 / 768 of its variance
_MANY = 150  # more points than this in a window are binned where that costs nothing
_DROP = 14.0  # what lies this many log units under the best is not integrated over
_HOPELESS = 100.0  # a cap so far behind is not followed: what lies across the axis and the other end do not bring it back
_GRID = 41
_ZOOMS = 12
_CLUTTER = 0.5  # clutter along the axis is at most this dense against the member: else a chance gap inside it would pass for its end
_BODY_POINTS = 4_000  # from between the ends, asked how many of them lie as a cap's would
_CLOSE = 5.0  # noise widths from an edge within which a cap's points lie
_OTHER_NOISE = (2.0, 0.5, 0.25, 0.125)  # along the axis, of that across it
_TOLD = 2.0  # log units by which that across it is likelier beforehand
_BESIDE_POINTS = 50  # next to these, asked likewise how many of them lie as a cap's would
_PATCH_POINTS = 15

Look = Callable[[FloatArray], Across]  # (n, 2) across the axis -> densities there of points of the sides, of a cap and of strays
_RUN, _BEYOND = 3, 0.05  # bins and share of the points of a stretch beyond a gap that belongs to the member
_TRACE = 0.03  # of the median density: what is left of a hidden stretch


@dataclass(frozen=True, eq=False, kw_only=True)
class End(Value):
    """One end plane: z = position_m + slope . ((x, y) - pivot).

    std_m : of position_m at the pivot (the mean of the points near the end).   slope_std : (2,).   cap_points : points on the cap, expected.
    excess : how much more the counts along the member scatter than Poisson's (>= 1); std_m is widened by its root.
    """

    position_m: float
    std_m: float
    slope: FloatArray
    slope_std: FloatArray
    pivot: FloatArray
    cap_points: float
    excess: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Ends(Value):
    """Both ends, and the length between them along the axis through (0, 0)."""

    low: End
    high: End
    length_m: float
    std_m: float


@dataclass(frozen=True, kw_only=True)
class RunEnd:
    """Where a run of points ends: edge_m and its standard deviation.   rho : points per metre before it.   beyond : density beyond over rho."""

    edge_m: float
    std_m: float
    rho: float
    beyond: float


def run_end(places: FloatArray, sigma_m: float, start_m: float, cap_m: float = 0.0) -> RunEnd:
    """The upper end of points (n,) that are spread evenly from start_m (others were left out) up to there, blurred by noise, among strays.

    cap_m : points of another face that lie at the end, over rho. Without noise the last of rho points per metre leaves an exponential 1 / rho bare
    (the law of extremes); counts that scatter more than Poisson's widen it.
    """
    z = -places
    density = max(len(z), 1) / max(float(np.ptp(z)), 1e-300)
    s = max(sigma_m, 1e-3 / density)
    fit = _square(z, s, max(_WINDOW * s, _WINDOW_POINTS / density), float(z.min()), [cap_m], (-math.inf, -start_m))[0]
    excess = unevenness(z[z > fit.edge], fit.edge, -start_m)
    return RunEnd(edge_m=-fit.edge, std_m=math.sqrt(excess) * fit.std, rho=fit.rho, beyond=fit.clutter / max(fit.rho, 1e-300))


def rough_ends(z: FloatArray) -> tuple[float, float]:
    """The stretch of z (n,) that the member fills, told from clutter by density: good to about a hundredth of the length.

    The box of two densities of greatest likelihood is widened while what lies beyond is at least a quarter as dense as the median inside.
    """
    low, high = (float(v) for v in np.quantile(z, (0.001, 0.999))) if len(z) > 5000 else (float(z.min()), float(z.max()))
    n_bins = int(np.clip(len(z) // 20, 10, 200))
    if not high > low:
        return low, high
    counts = np.histogram(z, n_bins, (low, high))[0].astype(float)
    counts = np.minimum(counts, 2 * float(np.median(counts[counts > 0])))  # a scanned cap is a spike, and no member
    total = np.r_[0.0, np.cumsum(counts)]
    inside = total[None, :] - total[:, None]
    width = np.arange(n_bins + 1)[None, :] - np.arange(n_bins + 1)[:, None].astype(float)
    outside, rest = total[-1] - inside, n_bins - width
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = np.where(inside > 0, inside * np.log(inside / width), 0.0) + np.where(outside > 0, outside * np.log(outside / rest), 0.0)
        denser = inside * rest >= outside * width
    gain[(width < 2) | ~denser] = -np.inf
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    floor = 0.25 * float(np.median(counts[i:j]))
    while i > 0 and counts[max(i - 2, 0) : i].mean() >= floor > 0:
        i -= 1
    while j < n_bins and counts[j : j + 2].mean() >= floor > 0:
        j += 1
    first, last = _over_gaps(counts, int(i), int(j), floor)
    step = (high - low) / n_bins
    return low + first * step, low + last * step


def _over_gaps(counts: FloatArray, i: int, j: int, floor: float) -> tuple[int, int]:
    """The stretch i .. j with what lies beyond gaps: something before the member hid most of it there, and it goes on behind.

    A stretch beyond a gap belongs where it is three bins long, nowhere thinner than the floor, holds a twentieth of the points, and the gap is not
    empty: two members in one line have nothing between them.
    """
    least, trace = _BEYOND * float(counts[i:j].sum()), _TRACE * 4 * floor
    for start, end in _runs(counts >= max(floor, 1.0)):
        gap = counts[end:i] if end <= i else counts[j:start]
        goes_on = len(gap) == 0 or (float(gap.mean()) >= trace and float((gap > 0).mean()) > 0.5)
        if end - start >= _RUN and float(counts[start:end].sum()) >= least and goes_on:
            i, j = min(i, start), max(j, end)
    return i, j


def _runs(flag: BoolArray) -> list[tuple[int, int]]:
    """(start, end) of the stretches of True."""
    edge = np.flatnonzero(np.diff(np.r_[False, flag, False].astype(np.int8)))
    return [(int(a), int(b)) for a, b in edge.reshape(-1, 2)]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Side:
    """One end while its cap is open: fits : under each hypothesis of `cap_law`, in its order."""

    fits: tuple[_Fit, ...]
    slope: FloatArray
    slope_std: FloatArray
    pivot: FloatArray
    excess: float

    def evidence(self) -> list[float]:
        """Of each hypothesis; counts that scatter more than Poisson's say as much less (Wedderburn 1974)."""
        return [fit.log_likelihood / self.excess for fit in self.fits]

    def end(self, weight: FloatArray, sign: float) -> End:
        """The mixture of the hypotheses. sign : -1 for an end that was looked at in a mirror."""
        edge, var = self.moments(weight)
        cap = self.fits[int(np.argmax(weight))].cap
        position, slope, std = sign * edge, sign * self.slope, math.sqrt(var)
        return End(position_m=position, std_m=std, slope=slope, slope_std=self.slope_std, pivot=self.pivot, cap_points=cap, excess=self.excess)

    def moments(self, weight: FloatArray) -> tuple[float, float]:
        edges, spread = np.array([fit.edge for fit in self.fits]), np.array([fit.std for fit in self.fits])
        edge = float(weight @ edges)
        return edge, float(weight @ (self.excess * spread**2 + (edges - edge) ** 2))


def find_ends(
    points: FloatArray, sigma_m: float, rough: tuple[float, float], cap_ratio_m: float = 0.0, look: Look | None = None, *, vague: bool = False
) -> Ends:
    """The two end planes from (n, 3) points in the member's frame (axis along z, bow removed, clutter off the section left out).

    sigma_m : noise along z.   rough : the ends to about a few per cent of the length.   cap_ratio_m : area over perimeter of the section,
    0 where not known, vague where guessed.   look : how likely points of the sides and of a cap are across the axis; none: not asked.
    """
    low = _side(points, rough, sigma_m, cap_ratio_m, look)
    mirrored = points * np.array([1.0, 1.0, -1.0])
    high = _side(mirrored, (-rough[1], -rough[0]), sigma_m, cap_ratio_m, look)
    share = together(low.evidence(), high.evidence(), vague=vague)
    # the length under each pair of hypotheses: what the caps leave open at both ends adds up
    lengths = -np.add.outer([fit.edge for fit in low.fits], [fit.edge for fit in high.fits])
    mean = float((share * lengths).sum())
    spread = np.add.outer([low.excess * fit.std**2 for fit in low.fits], [high.excess * fit.std**2 for fit in high.fits])
    var = float((share * (spread + (lengths - mean) ** 2)).sum())
    ends = low.end(share.sum(axis=1), 1.0), high.end(share.sum(axis=0), -1.0)
    at_axis = [end.position_m - float(end.slope @ end.pivot) for end in ends]
    var += sum(float(((end.slope_std * end.pivot) ** 2).sum()) for end in ends)
    return Ends(low=ends[0], high=ends[1], length_m=at_axis[1] - at_axis[0], std_m=math.sqrt(var))


def _side(points: FloatArray, rough: tuple[float, float], sigma_m: float, cap_ratio_m: float, look: Look | None) -> _Side:
    """The end at the low side of z."""
    z, none = points[:, 2], np.zeros(2)
    span = rough[1] - rough[0]
    inside = (z > rough[0] + 0.05 * span) & (z < rough[1] - 0.05 * span)
    density = max(float(inside.sum()), 1.0) / (0.9 * span)
    excess = unevenness(z[inside], rough[0] + 0.05 * span, rough[1] - 0.05 * span)
    s = max(sigma_m, 1e-3 / density)
    far = min(0.4 * span, max(2 * _WINDOW * s, 5 * _WINDOW_POINTS / density, 0.06 * span))
    kept = (rough[0] - far, rough[0] + far)
    near = (z > kept[0]) & (z < kept[1])
    xy, z = points[near, :2], z[near]
    pivot = xy.mean(axis=0) if len(z) else none
    caps = cap_ratios(cap_ratio_m if cap_ratio_m > 0 else s)
    if len(z) < 8:
        return _Side(fits=(_unknown(rough[0], 0.05 * span, 1.0, rough),) * len(caps), slope=none, slope_std=none, pivot=pivot, excess=excess)
    reach = max(_WINDOW * s, _WINDOW_POINTS / density)
    other, open_m = _noise_along(z, s, _square(z, s, reach, rough[0], caps[:2], kept), caps[:2])
    body = points[inside, :2]

    def along(noise: float) -> _Side:
        fits = _square(z, noise, reach, rough[0], caps, kept)
        slope, slope_std = none, none
        for _ in range(2):  # the second time from points slid along the plane, whose edge is sharp
            best = max(fits, key=lambda fit: fit.log_likelihood)
            tilted = _slopes(xy - pivot, z - (xy - pivot) @ slope, noise, best, kept) if len(z) >= 9 * _PATCH_POINTS else None
            if tilted is None:
                break
            slope, slope_std = slope + tilted[0], np.sqrt(np.diag(tilted[1]))
            fits = _square(z - (xy - pivot) @ slope, noise, reach, rough[0], caps, kept)
        if look is not None:
            level = z - (xy - pivot) @ slope
            fits = _looked_across(fits, xy, level, noise, max(noise, s), body, density, look)
        return _Side(fits=fits, slope=slope, slope_std=slope_std, pivot=pivot, excess=excess)

    found = along(other)
    if other != s and look is not None:  # a cap in noise that is not normal has sharp borders of its own: where its points lie across says more
        found = max((along(s), _TOLD), (found, 0.0), key=lambda side: side[1] + max(fit.log_likelihood for fit in side[0].fits))[0]
    return replace(found, fits=tuple(replace(fit, std=math.hypot(fit.std, open_m)) for fit in found.fits))


def _looked_across(
    fits: tuple[_Fit, ...], xy: FloatArray, level: FloatArray, s: float, widest: float, body: FloatArray, density: float, look: Look
) -> tuple[_Fit, ...]:
    """The fits with what the places across the axis say of a cap.

    xy, level : (n, 2), (n,) places across, and along the axis.   widest : of the noises s that are compared: all are asked of the same points.
    body : (m, 2) places across between the ends.
    """
    like_caps = share_like_caps(look(body[:: max(1, len(body) // _BODY_POINTS)]))
    low, high = min(fit.edge for fit in fits) - _CLOSE * widest, max(fit.edge for fit in fits) + _CLOSE * widest
    close = (level > low) & (level < high)
    beside = (level > high) & (level < high + max(high - low, _BESIDE_POINTS / density))
    if beside.sum() >= _BESIDE_POINTS / 2:  # what is seen through an open end is no cap either
        like_caps = max(like_caps, share_like_caps(look(xy[beside])))
    return _seen_across(fits, level[close], s, look(xy[close]).with_like_caps(like_caps))


def _noise_along(z: FloatArray, s: float, fits: Sequence[_Fit], caps: list[float]) -> tuple[float, float]:
    """The noise along the axis: s, that across it, or what the points near the end say; and how far off the edge may be for it (m).

    A scanner's noise acts along its rays, which mostly cross a member: its ends are then sharper than its faces. A sharp edge that is taken for
    blurred by s comes out a third of s within itself (-log Phi(e / s) = 1).
    """
    window = max(fits, key=lambda fit: fit.log_likelihood).window
    own = z[(z > window[0]) & (z < window[1])]
    if len(own) < 8:
        return s, 0.0
    tried = np.array([1.0, *_OTHER_NOISE])
    found = [_posterior(own, window, k * s, caps) for k in tried]
    level = np.array([[fit.log_likelihood for fit in fits] for fits in found]) + (np.log(tried) + _TOLD * (tried == 1))[:, None]
    best, cap = np.unravel_index(int(np.argmax(level)), level.shape)  # which cap it is, others decide
    share = np.exp(level[:, cap] - level[best, cap])
    away = np.array([fits[cap].edge - found[best][cap].edge for fits in found])
    return float(tried[best]) * s, math.sqrt(float(share @ away**2 / share.sum()))


def _unknown(edge: float, std: float, rho: float, window: tuple[float, float]) -> _Fit:
    return _Fit(edge=edge, std=std, rho=rho, cap=0.0, clutter=0.0, window=window, log_likelihood=0.0)


def _seen_across(fits: tuple[_Fit, ...], z: FloatArray, s: float, at: Across) -> tuple[_Fit, ...]:
    """The fits with the evidence of where the points (n,) near the edge lie across the axis added."""
    found = []
    for fit in fits:
        v = (z - fit.edge) / s
        cap = fit.cap * np.exp(-0.5 * v**2) / (s * math.sqrt(2 * math.pi))
        found.append(replace(fit, log_likelihood=fit.log_likelihood + told_across(fit.rho * ndtr(v), cap, fit.clutter, at)))
    return tuple(found)


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """An edge, its standard deviation, and the rates that go with it in `window`."""

    edge: float
    std: float
    rho: float
    cap: float
    clutter: float
    window: tuple[float, float]
    log_likelihood: float


def _square(z: FloatArray, s: float, reach: float, near: float, caps: list[float], kept: tuple[float, float]) -> tuple[_Fit, ...]:
    """The edge of a square end under each cap of `cap_ratios`: found roughly among all points, then from a window of `reach` around it, twice.

    kept : outside it the points were left out: what is empty there says nothing of strays or of the member.
    """
    low, high = float(z.min()), float(z.max())
    at, weight = _binned(z, (low - s, high), (high - low) / 300)
    candidates = np.unique(np.quantile(z, np.linspace(0.0, 0.7, 80)))
    wide = max(s, (high - low) / 300)
    edge = float(candidates[int(np.argmax(_profile(at, weight, (low - s, high), wide, candidates, 0.0)[0]))])
    fits = (_unknown(near, reach, len(z) / reach, (low, high)),) * len(caps)
    for width, tried in ((max(reach, 4 * wide), caps[:2]), (reach, caps)):
        window = (max(edge - width, kept[0]), min(edge + width, kept[1]))
        own = z[(z > window[0]) & (z < window[1])]
        if len(own) < 8:
            break
        found = _posterior(own, window, s, tried)
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


def _posterior(z: FloatArray, window: tuple[float, float], s: float, caps: list[float]) -> tuple[_Fit, ...]:
    """Mean and spread of the edge over a flat prior, under each cap."""
    at, weight = _binned(z, window, s / _BINS_PER_SIGMA)
    found: list[_Fit] = []
    best_so_far = -math.inf
    for ratio in caps:
        found.append(_spread(at, weight, window, s, ratio, best_so_far - _HOPELESS))
        best_so_far = max(best_so_far, found[-1].log_likelihood)
    return tuple(found)


def _spread(at: FloatArray, weight: FloatArray, window: tuple[float, float], s: float, ratio: float, floor: float) -> _Fit:
    """Zoom a grid of edges onto where the likelihood lies, then integrate. Its log-likelihood is that of the best edge times its spread.

    A hypothesis that starts below `floor` is not followed: its log-likelihood is -inf.
    """
    is_binned = weight.max() > 1  # then the likelihood is smooth over a noise width; else a jump may lie at any point
    candidates = np.unique(np.r_[np.linspace(*window, _GRID), at[:: max(1, len(at) // 200)] if not is_binned else at[:0]])
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
    return _Fit(edge=edge, std=std, rho=rho, cap=cap, clutter=clutter, window=window, log_likelihood=evidence)


def _slopes(xy: FloatArray, z: FloatArray, s: float, fit: _Fit, kept: tuple[float, float]) -> tuple[FloatArray, FloatArray] | None:
    """Slopes (2,) and their covariance: a plane through the edges of nine patches of the section. None where it is not significantly tilted.

    Each patch's edge comes with its own spread, so that chi-square tells; against BIC's price and three log units because all ends are tried.
    """
    code = np.zeros(len(xy), int)
    for axis in (0, 1):
        code = 3 * code + np.searchsorted(np.quantile(xy[:, axis], (0.33, 0.67)), xy[:, axis])
    rows = []
    for c in range(9):
        own = code == c
        if own.sum() >= _PATCH_POINTS:
            reach = max(_WINDOW * s, _WINDOW_POINTS / (fit.rho * float(own.mean()) + 1e-30))
            edge = _square(z[own], s, reach, fit.edge, [0.0], kept)[0]
            rows.append([1.0, *xy[own].mean(axis=0), edge.edge, edge.std])
    table = np.array(rows)
    if len(table) < 4:
        return None
    scatter = table[:, 3] - np.median(table[:, 3])
    sound = np.abs(scatter) < 4 * np.median(np.abs(scatter)) + 4 * table[:, 4]
    table = table[sound]
    design, weight = table[:, :3], 1 / table[:, 4] ** 2
    information = (design * weight[:, None]).T @ design
    if len(table) < 4 or not np.linalg.cond(information * np.outer(*[1 / np.sqrt(np.diag(information))] * 2)) < 1e4:
        return None
    covariance = np.linalg.inv(information)
    plane = covariance @ (design.T @ (weight * table[:, 3]))
    misfit = float(weight @ (table[:, 3] - design @ plane) ** 2) / (len(table) - 3)
    covariance = covariance * max(misfit, 1.0)
    gain = 0.5 * float(plane[1:] @ np.linalg.solve(covariance[1:, 1:], plane[1:]))
    return (plane[1:], covariance[1:, 1:]) if gain > math.log(max(len(z), 2)) + 3 else None
