"""Depth from two rectified pictures: which pixel of the right one shows what each pixel of the left one shows, and how surely.

1. Semi-global matching (Hirschmueller 2008, OpenCV) from left to right and from right to left.
2. Kept is what both find: |d_left(x) - d_right(x - d_left)| <= 1 px. What only one camera sees goes with that. Then small isles are dropped.
3. Sub-pixel: a few steps of least squares of the grey values over a window (Lucas, Kanade 1981) with free brightness; every pixel is carried over
   by its own disparity, so that a slanted surface is no bias.
4. Its standard deviation: that of least squares, var = s^2 / sum(g^2), with the residuals s and the gradient g of the window, widened by TOGETHER.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.types import BoolArray, ByteArray, FloatArray, Value

BLOCK = 5  # window of the matching costs, px
WINDOW = 9  # of the sub-pixel step
BOTH_WAYS = 1.0  # px by which the two directions may differ
ISLE_PX, ISLE_STEP = 200, 1.0  # fewer connected pixels than this, with steps below that, are no surface
STEPS = 4
SMOOTH, SAME_PX = 9, 0.5  # pixels within that window whose disparities differ by about that much are of one surface
MOST_SHIFT = 1.0  # px that the sub-pixel step may move a disparity from the matching's
WORST_SIGMA = 1.0  # px: the matching's own step, a disparity known no better is not known
_FLOOR = 1.0 / 32.0  # px: OpenCV carries pictures over in steps of that
BLUR_PX = 0.8  # taken off the finest detail, where the slope of sampled grey values is not that of the scene
TOGETHER = 2.0 * math.pi**0.5 * BLUR_PX  # noise that was blurred is alike over 4 pi b^2 pixels: so many fewer tell anything of their own
_QUANTUM = 16
_NOWHERE = -1e6  # px: a disparity that is like no other


@dataclass(frozen=True, eq=False, kw_only=True)
class Disparity(Value):
    """px : (h, w) x_left - x_right, nan where not known.   sigma_px : (h, w) its standard deviation, nan likewise.   n_found : before the checks."""

    px: FloatArray
    sigma_px: FloatArray
    n_found: int


def disparity(left: ByteArray, right: ByteArray, least: float, most: float) -> Disparity:
    """Disparities between `least` and `most` of two rectified grey pictures (h, w)."""
    both = sgbm(left, right, least, most), sgbm_right(left, right, least, most)
    return checked(left, right, *both)


def range_of(least: float, most: float) -> tuple[int, int]:
    """First disparity and their number, a multiple of 16 as OpenCV has it."""
    first = int(np.floor(least))
    return first, max(_QUANTUM, int(np.ceil((most + 1 - first) / _QUANTUM)) * _QUANTUM)


def sgbm(left: ByteArray, right: ByteArray, least: float, most: float) -> FloatArray:
    """(h, w) float32 disparities of the left picture by semi-global matching, nan where it found none."""
    import cv2

    first, count = range_of(least, most)
    # columns beyond the picture, as the matcher drops those from which the whole range does not fit
    before, after = max(first + count, 0), max(-first, 0)
    pair = [cv2.copyMakeBorder(picture, 0, 0, before, after, cv2.BORDER_REPLICATE) for picture in (left, right)]
    area = BLOCK * BLOCK
    matcher = cv2.StereoSGBM.create(
        minDisparity=first, numDisparities=count, blockSize=BLOCK, P1=8 * area, P2=32 * area, disp12MaxDiff=-1, preFilterCap=31,
        uniquenessRatio=0, speckleWindowSize=0, speckleRange=0, mode=cv2.STEREO_SGBM_MODE_SGBM,
    )  # fmt: skip
    fixed = matcher.compute(pair[0], pair[1])[:, before : before + left.shape[1]]
    found = fixed.astype(np.float32) / _QUANTUM
    found[fixed < first * _QUANTUM] = np.nan
    return np.asarray(found)


def sgbm_right(left: ByteArray, right: ByteArray, least: float, most: float) -> FloatArray:
    """(h, w) disparities of the right picture (positive as the left ones are): both are mirrored and change places."""
    return np.ascontiguousarray(sgbm(np.ascontiguousarray(right[:, ::-1]), np.ascontiguousarray(left[:, ::-1]), least, most)[:, ::-1])


def checked(left: ByteArray, right: ByteArray, of_left: FloatArray, of_right: FloatArray) -> Disparity:
    """The disparities of the left picture that the right one confirms, without isles, refined."""
    found, sigma = refined(left, right, _both(of_left, of_right, ISLE_PX))
    return Disparity(px=found.astype(np.float64), sigma_px=sigma.astype(np.float64), n_found=int(np.isfinite(of_left).sum()))


def matched(left: ByteArray, right: ByteArray, least: float, most: float) -> FloatArray:
    """(h, w) what both directions find, not refined: to look for the range of disparities."""
    return _both(sgbm(left, right, least, most), sgbm_right(left, right, least, most), ISLE_PX // 4)


def _both(of_left: FloatArray, of_right: FloatArray, isle_px: int) -> FloatArray:
    return _without_isles(np.where(_agree(of_left, of_right), of_left, np.nan).astype(np.float32), isle_px)


def _agree(of_left: FloatArray, of_right: FloatArray) -> BoolArray:
    height, width = of_left.shape
    x = np.arange(width, dtype=np.float32)[None, :] - of_left
    column = np.clip(np.nan_to_num(np.rint(x), nan=-1), -1, width).astype(np.int64)
    inside = (column >= 0) & (column < width)
    other = of_right[np.arange(height)[:, None], np.clip(column, 0, width - 1)]
    with np.errstate(invalid="ignore"):
        return np.asarray(inside & (np.abs(other - of_left) <= BOTH_WAYS))


def _without_isles(found: FloatArray, isle_px: int) -> FloatArray:
    import cv2

    missing = ~np.isfinite(found)
    if missing.all():
        return found
    low = float(np.nanmin(found)) - 2.0
    fixed = np.where(missing, 0.0, (found - low) * _QUANTUM)
    # disparities beyond what 16 bits hold are matched at half the resolution of a sixteenth
    coarse = max(1.0, float(fixed.max()) / 32_000)
    fixed16 = (fixed / coarse).astype(np.int16)
    cv2.filterSpeckles(fixed16, 0, isle_px, ISLE_STEP * _QUANTUM / coarse)
    return np.where((fixed16 == 0) | missing, np.nan, found).astype(np.float32)


def refined(left: ByteArray, right: ByteArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sub-pixel disparities and their standard deviations (h, w); nan where the grey values tell the place worse than WORST_SIGMA."""
    import cv2

    known = np.isfinite(start)
    weight = known.astype(np.float32)
    d = np.where(known, start, 0.0).astype(np.float32)
    y, x = np.mgrid[: left.shape[0], : left.shape[1]].astype(np.float32)
    low, high = d - MOST_SHIFT, d + MOST_SHIFT
    d = _smooth(d, known)
    grey, other = (cv2.GaussianBlur(picture.astype(np.float32), (0, 0), BLUR_PX) for picture in (left, right))
    slope = cv2.Sobel(other, cv2.CV_32F, 1, 0, ksize=3, scale=1.0 / 8.0)
    n = np.maximum(_sum(weight), 1.0)
    for step in range(STEPS + 1):
        moved = cv2.remap(other, x - d, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        g = cv2.remap(slope, x - d, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) * weight
        e = (grey - moved) * weight
        g_sum, e_sum = _sum(g), _sum(e)
        gg = np.maximum(_sum(g * g) - g_sum * g_sum / n, 1e-3)
        ge = _sum(g * e) - g_sum * e_sum / n
        if step == STEPS:
            break
        # moved(d + s) = moved - g s: the step that lessens |grey - moved|
        d = np.clip(_smooth(d - np.clip(ge / gg, -0.5, 0.5), known), low, high)
    left_over = np.maximum(_sum(e * e) - e_sum * e_sum / n - ge * ge / gg, 0.0) / np.maximum(n - 2.0, 1.0)
    sigma = np.sqrt(TOGETHER**2 * left_over / gg + _FLOOR * _FLOOR)
    known &= (sigma <= WORST_SIGMA) & (n >= WINDOW)
    return np.where(known, d, np.nan), np.where(known, sigma, np.nan)


def _smooth(d: Any, known: BoolArray) -> Any:
    """Means over neighbours of the same surface: what a window tells is one shift of all its pixels, not the place of each among them."""
    import cv2

    return cv2.bilateralFilter(np.where(known, d, _NOWHERE).astype(np.float32), SMOOTH, SAME_PX, SMOOTH / 3.0, borderType=cv2.BORDER_CONSTANT)


def _sum(values: Any) -> Any:
    import cv2

    return cv2.boxFilter(values, cv2.CV_32F, (WINDOW, WINDOW), normalize=False, borderType=cv2.BORDER_CONSTANT)


def filled(found: FloatArray) -> FloatArray:
    """Every pixel: where nothing is known the farther of the nearest known ones of its row, as what only one camera sees lies behind. To compare
    with true disparities; no points are made of it.
    """
    height, width = found.shape
    known = np.isfinite(found)
    column = np.where(known, np.arange(width)[None, :], -1)
    before = np.maximum.accumulate(column, axis=1)
    after = np.where(known, np.arange(width)[None, :], width)
    after = np.minimum.accumulate(after[:, ::-1], axis=1)[:, ::-1]
    row = np.arange(height)[:, None]
    left = np.where(before >= 0, found[row, np.clip(before, 0, width - 1)], np.inf)
    right = np.where(after < width, found[row, np.clip(after, 0, width - 1)], np.inf)
    least = np.minimum(left, right)
    return np.asarray(np.where(np.isfinite(least), least, np.nan))
