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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from scan2fea.estimation.cap_law import Across, cap_ratios, share_like_caps, together, told_across
from scan2fea.estimation.edge_fit import FEW, EdgeFit, edge_fits, posterior, unknown
from scan2fea.estimation.uneven import unevenness
from scan2fea.kernel.two_densities import densest_stretch
from scan2fea.types import BoolArray, FloatArray, Value

_WINDOW = 12.0  # noise widths on either side of an edge that its likelihood looks at: the rates need far more points than the edge itself
_WINDOW_POINTS = 100  # at least so many points of the member lie in half a window
_BODY_POINTS = 4_000  # from between the ends, asked how many of them lie as a cap's would
_CLOSE = 5.0  # noise widths from an edge within which a cap's points lie
_OTHER_NOISE = (2.0, 0.5, 0.25, 0.125)  # along the axis, of that across it
_TOLD = math.log(len(_OTHER_NOISE))  # log units by which that across it is likelier beforehand: as likely as the others together
_FOLLOWED = 5.0  # log units within which another stays open
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
    """Both ends, and the length between them along the axis through (0, 0).

    alone : belief that of the two end faces only the low one was scanned, and that only the high one was.
    """

    low: End
    high: End
    length_m: float
    std_m: float
    alone: tuple[float, float] = (0.0, 0.0)


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
    fit = edge_fits(z, s, max(_WINDOW * s, _WINDOW_POINTS / density), float(z.min()), [cap_m], (-math.inf, -start_m))[0]
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
    i, j = densest_stretch(counts)
    floor = 0.25 * float(np.median(counts[i:j]))
    pairs = 0.5 * (counts[1:] + counts[:-1])
    before, after = np.r_[counts[0], pairs] >= floor, np.r_[pairs, counts[-1]] >= floor
    while floor > 0 and i > 0 and before[i - 1]:
        i -= 1
    while floor > 0 and j < n_bins and after[j]:
        j += 1
    first, last = _over_gaps(counts, i, j, floor)
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
    """One end while its cap and its noise are open: fits : noise along the axis, over that across -> under each hypothesis of `cap_law`."""

    fits: dict[float, tuple[EdgeFit, ...]]
    slope: FloatArray
    slope_std: FloatArray
    pivot: FloatArray
    excess: float

    def told(self, noises: Sequence[float]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Evidence, edges and variances (k, c) of each noise under each cap; a noise that was not followed has no evidence.

        Counts that scatter more than Poisson's say as much less (Wedderburn 1974).
        """
        some = next(iter(self.fits.values()))
        lost = tuple(replace(fit, log_likelihood=-math.inf) for fit in some)
        rows = [[(fit.log_likelihood / self.excess, fit.edge, self.excess * fit.std**2) for fit in self.fits.get(k, lost)] for k in noises]
        evidence, edges, var = np.moveaxis(np.array(rows), 2, 0)
        return evidence, edges, var

    def end(self, weight: FloatArray, noises: Sequence[float], sign: float) -> End:
        """The mixture of the hypotheses. weight : (k, c).   sign : -1 for an end that was looked at in a mirror."""
        _, edges, var = self.told(noises)
        edge = float((weight * edges).sum())
        k, cap = np.unravel_index(int(np.argmax(weight)), weight.shape)
        return End(
            position_m=sign * edge,
            std_m=math.sqrt(float((weight * (var + (edges - edge) ** 2)).sum())),
            slope=sign * self.slope,
            slope_std=self.slope_std,
            pivot=self.pivot,
            cap_points=self.fits[noises[int(k)]][int(cap)].cap,
            excess=self.excess,
        )


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
    noises = sorted({*low.fits, *high.fits})
    (of_low, low_edge, low_var), (of_high, high_edge, high_var) = low.told(noises), high.told(noises)
    share = together(of_low, of_high, np.array([_noise_prior(k) for k in noises]), vague=vague)
    # the length under each pair of hypotheses: what caps and noise leave open at both ends adds up
    lengths = -np.add.outer(low_edge, high_edge)
    mean = float((share * lengths).sum())
    var = float((share * (np.add.outer(low_var, high_var) + (lengths - mean) ** 2)).sum())
    ends = low.end(share.sum(axis=(2, 3)), noises, 1.0), high.end(share.sum(axis=(0, 1)), noises, -1.0)
    at_axis = [end.position_m - float(end.slope @ end.pivot) for end in ends]
    var += sum(float(((end.slope_std * end.pivot) ** 2).sum()) for end in ends)
    caps = share.sum(axis=(0, 2))  # (c, c): the first hypothesis is none
    alone = float(caps[1:, 0].sum()), float(caps[0, 1:].sum())
    return Ends(low=ends[0], high=ends[1], length_m=at_axis[1] - at_axis[0], std_m=math.sqrt(var), alone=alone)


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
    if len(z) < FEW:
        return _Side(fits={1.0: (unknown(rough[0], 0.05 * span, 1.0, rough),) * len(caps)}, slope=none, slope_std=none, pivot=pivot, excess=excess)
    reach = max(_WINDOW * s, _WINDOW_POINTS / density)
    fits = edge_fits(z, s, reach, rough[0], caps[:2], kept)
    by_noise = _by_noise(z, s, fits, caps[:2], {1.0: fits})
    slope, slope_std = _tilted_by(xy - pivot, z, s * _likeliest(by_noise), reach, fits, kept)
    level = z - (xy - pivot) @ slope
    if slope.any():
        fits = edge_fits(level, s, reach, rough[0], caps[:2], kept)
        by_noise = _by_noise(level, s, fits, caps[:2], {1.0: fits})
    by_noise = _followed(by_noise)
    by_noise = _by_noise(level, s, fits, caps, by_noise, tuple(by_noise)) or {1.0: fits[:1] * len(caps)}
    if look is not None:
        by_noise = _looked_across(by_noise, xy, level, s, points[inside, :2], density, look)
    return _Side(fits=by_noise, slope=slope, slope_std=slope_std, pivot=pivot, excess=excess)


def _tilted_by(
    xy: FloatArray, z: FloatArray, noise: float, reach: float, fits: Sequence[EdgeFit], kept: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Slope (2,) of the end plane and its standard deviations; zero where none is significant."""
    slope, slope_std = np.zeros(2), np.zeros(2)
    for _ in range(2 if len(z) >= 9 * _PATCH_POINTS else 0):  # the second time from points slid along the plane, whose edge is sharp
        best = max(fits, key=lambda fit: fit.log_likelihood)
        tilted = _slopes(xy, z - xy @ slope, noise, best, kept)
        if tilted is None:
            break
        slope, slope_std = slope + tilted[0], np.sqrt(np.diag(tilted[1]))
        fits = edge_fits(z - xy @ slope, noise, reach, best.edge, [0.0], kept)
    return slope, slope_std


def _by_noise(
    z: FloatArray,
    s: float,
    fits: Sequence[EdgeFit],
    caps: list[float],
    begun: Mapping[float, tuple[EdgeFit, ...]],
    tried: tuple[float, ...] = (1.0, *_OTHER_NOISE),
) -> dict[float, tuple[EdgeFit, ...]]:
    """Noise along the axis, over s, that across it -> the edge under each cap, all from the points in one window.

    begun : the same under the first of the caps, where it was found in that window already.

    A scanner's noise acts along its rays, which mostly cross a member: its ends are then sharper than its faces. A sharp edge that is taken for
    blurred by s comes out a third of s within itself (-log Phi(e / s) = 1).
    """
    window = max(fits, key=lambda fit: fit.log_likelihood).window
    own = z[(z > window[0]) & (z < window[1])]
    if len(own) < FEW:
        return {}
    found = {}
    for k in tried:
        known = [replace(fit, log_likelihood=fit.log_likelihood - math.log(k)) for fit in begun.get(k, ()) if fit.is_told]
        under = posterior(own, window, k * s, caps, known)  # its evidence is told per noise width
        found[k] = tuple(replace(fit, log_likelihood=fit.log_likelihood + math.log(k)) for fit in under)
    return found


def _noise_prior(k: float) -> float:
    """Of the noise along the axis, k times that across it: not normalised."""
    return math.exp(_TOLD) if k == 1 else 1.0


def _level(k: float, fits: tuple[EdgeFit, ...]) -> float:
    return max(fit.log_likelihood for fit in fits) + math.log(_noise_prior(k))


def _likeliest(by_noise: dict[float, tuple[EdgeFit, ...]]) -> float:
    return max(by_noise, key=lambda k: _level(k, by_noise[k]), default=1.0)


def _followed(by_noise: dict[float, tuple[EdgeFit, ...]]) -> dict[float, tuple[EdgeFit, ...]]:
    """Those that the points leave open, and that across the axis: a cap in noise that is not normal has sharp borders of its own, and where its
    points lie across says more.
    """
    least = max((_level(k, fits) for k, fits in by_noise.items()), default=0.0) - _FOLLOWED
    return {k: fits for k, fits in by_noise.items() if k == 1 or _level(k, fits) > least}


def _looked_across(
    by_noise: dict[float, tuple[EdgeFit, ...]], xy: FloatArray, level: FloatArray, s: float, body: FloatArray, density: float, look: Look
) -> dict[float, tuple[EdgeFit, ...]]:
    """The fits with what the places across the axis say of a cap, asked of the same points under every noise.

    xy, level : (n, 2), (n,) places across, and along the axis.   body : (m, 2) places across between the ends.
    """
    like_caps = share_like_caps(look(body[:: max(1, len(body) // _BODY_POINTS)]))
    edges = [fit.edge for fits in by_noise.values() for fit in fits]
    low, high = min(edges) - _CLOSE * s, max(edges) + _CLOSE * s
    close = (level > low) & (level < high)
    beside = (level > high) & (level < high + max(high - low, _BESIDE_POINTS / density))
    if beside.sum() >= _BESIDE_POINTS / 2:  # what is seen through an open end is no cap either
        like_caps = max(like_caps, share_like_caps(look(xy[beside])))
    at = look(xy[close]).with_like_caps(like_caps)
    return {k: _seen_across(fits, level[close], k * s, at) for k, fits in by_noise.items()}


def _seen_across(fits: tuple[EdgeFit, ...], z: FloatArray, s: float, at: Across) -> tuple[EdgeFit, ...]:
    """The fits with the evidence of where the points (n,) near the edge lie across the axis added."""
    found = []
    for fit in fits:
        v = (z - fit.edge) / s
        cap = fit.cap * np.exp(-0.5 * v**2) / (s * math.sqrt(2 * math.pi))
        found.append(replace(fit, log_likelihood=fit.log_likelihood + told_across(fit.rho * ndtr(v), cap, fit.clutter, at)))
    return tuple(found)


def _slopes(xy: FloatArray, z: FloatArray, s: float, fit: EdgeFit, kept: tuple[float, float]) -> tuple[FloatArray, FloatArray] | None:
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
            edge = edge_fits(z[own], s, reach, fit.edge, [0.0], kept)[0]
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
