"""How wide the section is along the member: from quantiles of slices, and the piecewise linear laws (prism, taper, haunch) that may describe it.

Robust and rough: it finds the kind of change and where to start from; `changing.py` fits it to the points.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from scan2fea.types import FloatArray, Value

RADIAL = 2
_SLICES, _SLICE_POINTS = (6, 24), 120
_TAIL = 0.04  # of the points of a slice beyond its width on either side: clutter has no say
_RADIAL_TAIL = 0.8  # of the points of a slice within its radius: most of a tube's lie on the outer circle
_LENGTHS = np.arange(0.1, 0.95, 0.05)  # of a haunch, in lengths of the member
_GAIN = 10.0  # BIC units that a change must gain
_MISFIT = 0.03  # of the width: scatter of the slices about a law; of free forms it is more


@dataclass(frozen=True, eq=False, kw_only=True)
class Law(Value):
    """kind : "taper" or "haunch".   axis : 0, 1 or RADIAL.   share (k,) from 0 to 1 and growth_m (k,) >= 0 of the width there.

    side : 1 or -1 where the face of larger or smaller coordinate stays straight.   bic : of the slices.   ends : (2, k) how far the smaller and the
    larger side have moved there.   skew_m : how far a haunched member leaves the frame from end to end.
    """

    kind: str
    axis: int
    share: FloatArray
    growth_m: FloatArray
    side: int
    bic: float
    ends: FloatArray
    skew_m: float = 0.0


def laws_of(local: FloatArray, span: tuple[float, float], axis: int) -> list[Law]:
    """The laws that describe the width along one coordinate better than a prism does, best first. local : (n, 3), z along the member."""
    at, low, high = _slices(local, span, axis)
    if len(at) < _SLICES[0]:
        return []
    width = high - low
    plain = _bic(width, np.ones((len(at), 1)), 1)
    found = []
    for kind, shares in _candidates():
        basis = np.stack([_hat(at, shares, k) for k in range(len(shares))], 1)
        groups = [basis.sum(1), *_grown(shares, basis)] if kind == "haunch" else list(basis.T)
        matrix = np.stack(groups, 1)
        n_free = matrix.shape[1] + (len(shares) - 2 if kind == "haunch" else 0)
        bic = _bic(width, matrix, n_free)
        if bic > plain - _GAIN or _misfit(width, matrix) > _MISFIT:
            continue
        value, skew = _sides(low, high, at, matrix, kind, shares)
        grown = value[1] - value[0]
        growth = grown - grown.min()
        if kind == "haunch" and (growth[0] < 0 or growth[-1] < 0 or growth[1:-1].max() > 1e-9 + 0.02 * growth.max()):
            continue
        moved = value - value[:, [int(np.argmin(growth))]]
        where = int(np.argmax(growth))
        lean = float((moved[1] + moved[0] - 2 * skew * (shares - shares[int(np.argmin(growth))]))[where] / max(growth[where], 1e-300))
        side = 0 if kind == "taper" or axis == RADIAL or abs(lean) < 0.5 else -int(np.sign(lean))
        found.append(Law(kind=kind, axis=axis, share=shares, growth_m=growth, side=side, bic=bic, ends=moved, skew_m=skew))
    return sorted(found, key=lambda law: law.bic)


def _slices(local: FloatArray, span: tuple[float, float], axis: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shares of the length in the middle of the slices, and the low and the high side of the points there."""
    low, high = span
    inside = local[(local[:, 2] > low) & (local[:, 2] < high)]
    n = int(np.clip(len(inside) // _SLICE_POINTS, *_SLICES))
    slot = np.minimum(((inside[:, 2] - low) / (high - low) * n).astype(int), n - 1)
    rows = []
    for k in range(n):
        own = inside[slot == k, :2]
        if len(own) < 20:
            continue
        if axis == RADIAL:
            middle = np.quantile(own, (_TAIL, 1 - _TAIL), axis=0).mean(axis=0)  # the median of a circle wanders
            r = float(np.quantile(np.linalg.norm(own - middle, axis=1), _RADIAL_TAIL))
            rows.append(((k + 0.5) / n, -r, r))
        else:
            rows.append(((k + 0.5) / n, *np.quantile(own[:, axis], (_TAIL, 1 - _TAIL)).tolist()))
    table = np.array(rows).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]


def _candidates() -> list[tuple[str, FloatArray]]:
    """Kind and knots of every law that is tried."""
    one = [("haunch", np.array([0.0, share, 1.0])) for share in _LENGTHS]
    pairs = itertools.combinations(_LENGTHS[::2].tolist(), 2)
    both = [("haunch", np.array([0.0, a, b, 1.0])) for a, b in pairs]
    return [("taper", np.array([0.0, 1.0])), *one, *both]


def _hat(at: FloatArray, knots: FloatArray, k: int) -> FloatArray:
    """Linear hat function of knot k at the places."""
    return np.asarray(np.interp(at, knots, np.eye(len(knots))[k]))


def _grown(shares: FloatArray, basis: FloatArray) -> list[FloatArray]:
    """Hats of the ends that grow. One inner knot: the haunch is at the end that lies nearer to it; two: at both."""
    if len(shares) == 4:
        return [basis[:, 0], basis[:, -1]]
    return [basis[:, 0]] if shares[1] < 0.5 else [basis[:, -1]]


def _sides(
    low: FloatArray, high: FloatArray, at: FloatArray, matrix: FloatArray, kind: str, shares: FloatArray
) -> tuple[FloatArray, float]:
    """(2, k) values of both sides at the knots, by least squares, and the slope that both sides of a haunched member have in common."""
    if kind == "taper":
        return np.stack([np.linalg.lstsq(matrix, one, rcond=None)[0] for one in (low, high)]), 0.0
    n = matrix.shape[1]
    nothing = np.zeros_like(matrix)
    both = np.vstack([np.hstack([matrix, nothing, at[:, None]]), np.hstack([nothing, matrix, at[:, None]])])
    weight = np.linalg.lstsq(both, np.r_[low, high], rcond=None)[0]
    skew = float(weight[-1])
    ends = (0, -1) if len(shares) == 4 else ((0,) if shares[1] < 0.5 else (-1,))
    value = np.stack([w[0] + skew * shares for w in (weight[:n], weight[n : 2 * n])])
    for row, w in zip(value, (weight[:n], weight[n : 2 * n]), strict=True):
        for end, grown in zip(ends, w[1:], strict=True):
            row[end] += grown
    return value, skew


def _bic(width: FloatArray, matrix: FloatArray, n_free: int) -> float:
    weight = np.linalg.lstsq(matrix, width, rcond=None)[0]
    rms2 = float(np.mean((width - matrix @ weight) ** 2)) + (1e-6 * float(np.abs(width).mean())) ** 2
    return len(width) * math.log(rms2) + n_free * math.log(len(width))


def _misfit(width: FloatArray, matrix: FloatArray) -> float:
    weight = np.linalg.lstsq(matrix, width, rcond=None)[0]
    return float(np.sqrt(np.mean((width - matrix @ weight) ** 2)) / max(float(np.abs(width).mean()), 1e-300))
