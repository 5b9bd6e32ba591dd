"""What one photograph says of depths, held against what others say: kept is what at least one other confirms, once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.acquisition.depths import Depths, Picture
from scan2fea.acquisition.structure import View
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

STEADY = 3.0  # standard deviations within which two photographs say the same
STEP = 2  # every second pixel of every second row is asked: nearer ones were told by the same window
_SAME = 0.02  # of the depth: farther apart are two surfaces, one before the other, which tells nothing of the errors
_LEAST_PAIRS = 2  # of a view's pairs that must agree, where it has so many
_NINE_TENTHS = 1.645  # standard deviations of a Gaussian that hold nine of ten: wrong matches have longer tails than noise, and count
_EVERY = 7  # comparisons from which the scatter is told


@dataclass(frozen=True, eq=False, kw_only=True)
class Places(Value):
    """Pixels of one view with a depth. x, y : (k,) int.   w, sigma : (k,) inverse depth.   rays : (k, 3) with z = 1."""

    x: IntArray
    y: IntArray
    w: FloatArray
    sigma: FloatArray
    rays: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Agreement(Value):
    """kept : per view the places that are its own.   factor : by which standard deviations are to be widened so that differences between photographs
    are what they say.   within_2 : share of the confirmed places at which another photograph that sees that surface is within two standard
    deviations of the difference (after widening), None where nothing could be compared.
    """

    kept: tuple[Places, ...]
    factor: float
    within_2: float | None


def confirmed(views: Sequence[View], pictures: Sequence[Picture], depths: Sequence[Depths]) -> Agreement:
    """Compare every view with every other that looks at the same places; each place stays with the view that knows it best."""
    places = [places_of(picture, depth) for picture, depth in zip(pictures, depths, strict=True)]
    n = len(views)
    compared = {
        (i, j): _compared(places[i], pictures[j], depths[j], inverse(views[j].T_world_camera) @ views[i].T_world_camera)
        for i in range(n)
        for j in range(n)
        if i != j
    }
    drawn = [ratio[same][::_EVERY] for ratio, same, _ in compared.values()]
    ratios = np.concatenate(drawn) if drawn else np.zeros(0)
    factor = max(1.0, float(np.percentile(ratios, 90.0)) / _NINE_TENTHS) if len(ratios) else 1.0
    kept, near, seen = [], 0, 0
    for i in range(n):
        own, beaten = np.zeros(len(places[i].w), bool), np.zeros(len(places[i].w), bool)
        depth_sigma = places[i].sigma / places[i].w ** 2
        others = [(j, *compared[i, j]) for j in range(n) if j != i]
        for j, ratio, _, sigma_j in others:
            agrees = ratio <= STEADY * factor  # False where nan
            own |= agrees
            beaten |= agrees & ((sigma_j < depth_sigma) | ((sigma_j == depth_sigma) & (j < i)))
        for _, ratio, same, _ in others:
            both = own & same
            seen += int(both.sum())
            near += int((ratio[both] <= 2.0 * factor).sum())
        kept.append(_taken(places[i], own & ~beaten))
    return Agreement(kept=tuple(kept), factor=factor, within_2=near / seen if seen else None)


def places_of(picture: Picture, depth: Depths) -> Places:
    """Every second pixel of every second row at which enough pairs agree."""
    least = max(1, min(_LEAST_PAIRS, int(depth.n.max(initial=0))))
    usable = np.isfinite(depth.w) & (depth.n >= least)
    y, x = (k * STEP for k in np.nonzero(usable[::STEP, ::STEP]))
    K = picture.K
    rays = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(len(x))], axis=1)
    return Places(x=x.astype(np.int64), y=y.astype(np.int64), w=depth.w[y, x], sigma=depth.sigma[y, x], rays=rays)


def _taken(places: Places, rows: BoolArray) -> Places:
    return Places(x=places.x[rows], y=places.y[rows], w=places.w[rows], sigma=places.sigma[rows], rays=places.rays[rows])


def _compared(places: Places, picture: Picture, depth: Depths, T_other_own: FloatArray) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Of each place: difference of the inverse depths in the other camera over its standard deviation (nan where that sees nothing), whether both
    are of one surface, and the other's standard deviation of depth.
    """
    import cv2

    local = applied(T_other_own, places.rays / places.w[:, None])
    farther = applied(T_other_own, places.rays / (places.w - places.sigma)[:, None])[:, 2]
    z = local[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (picture.K[0, 0] * local[:, 0] / z + picture.K[0, 2]).astype(np.float32)
        v = (picture.K[1, 1] * local[:, 1] / z + picture.K[1, 2]).astype(np.float32)
        own = np.abs(1.0 / z - 1.0 / farther)
    missing = cv2.BORDER_CONSTANT, float("nan")
    at = [np.where(z > 0, k, -10.0).astype(np.float32).reshape(1, -1) for k in (u, v)]
    maps = [_sampled(values, at, missing) for values in (depth.w, depth.sigma)]
    with np.errstate(divide="ignore", invalid="ignore"):
        difference = np.abs(1.0 / z - maps[0])
        ratio = np.where(z > 0, difference / np.hypot(own, maps[1]), np.nan)
        same = np.isfinite(ratio) & (difference <= _SAME * maps[0])
        return ratio, same, np.nan_to_num(maps[1] / maps[0] ** 2, nan=np.inf)


def _sampled(values: FloatArray, at: Sequence[Any], missing: tuple[int, float]) -> FloatArray:
    import cv2

    # pictures have fewer columns than 32767 places in a row: OpenCV's limit
    parts = []
    for k in range(0, at[0].shape[1], 30_000):
        part = [m[:, k : k + 30_000] for m in at]
        parts.append(cv2.remap(values.astype(np.float32), part[0], part[1], cv2.INTER_LINEAR, borderMode=missing[0], borderValue=missing[1])[0])
    return np.concatenate(parts).astype(np.float64) if parts else np.zeros(0)
