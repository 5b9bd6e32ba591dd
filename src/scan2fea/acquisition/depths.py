"""Depths of one photograph from several others: every neighbouring pair is rectified and matched, and what the pairs say is put together.

A pair tells inverse depths w = (d - d_infinity) / (f B), whose errors are those of the disparity d: of the same size everywhere in the picture.
The pairs of one photograph share its own noise, so that the variance of their mean is (1 + (n - 1) / 2) / sum(1 / sigma^2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.acquisition.cameras import Camera
from scan2fea.acquisition.disparity import checked, sgbm, sgbm_right
from scan2fea.acquisition.rectify import Rectified, warped
from scan2fea.acquisition.structure import View
from scan2fea.kernel.transforms import inverse
from scan2fea.types import BoolArray, ByteArray, FloatArray, IntArray, Value

LEAST_SHARED = 40  # sparse points that both photographs show
FLATTEST, STEEPEST = np.radians(2.0), np.radians(40.0)  # between two lines of sight to a point: nothing told below, nothing alike above
AHEAD = np.cos(np.radians(30.0))  # a camera that moved along its view has no common rows: cosine of baseline and viewing axis
WIDEST = 2.0  # of the picture's size, that a rectified one may have
MOST_DISPARITIES = 320.0  # px: pairs that span more are matched in coarser pictures: they tell as much as nearer pairs in fine ones
_MARGIN = 0.15  # of the range of the sparse points' disparities, added on either side
_MIXED_PX = 0.5  # nearest and interpolated disparity differ by more: two surfaces
_STEADY = 3.0  # standard deviations that estimates may differ by


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture(Value):
    """An undistorted, reduced photograph. K : (3, 3).   grey : (h, w).   colour : (h, w, 3)."""

    K: FloatArray
    grey: ByteArray
    colour: ByteArray

    @property
    def size(self) -> tuple[int, int]:
        return self.grey.shape[1], self.grey.shape[0]


@dataclass(frozen=True, eq=False, kw_only=True)
class Told(Value):
    """What one pair says of a photograph: inverse depth along its viewing axis and standard deviation, (h, w) float32, nan where nothing."""

    w: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Depths(Value):
    """w : (h, w) inverse depth, nan where not known.   sigma : (h, w).   n : (h, w) pairs that agree.   scatter : robust standard deviation of
    the differences of pairs over what their standard deviations say, nan for fewer than two pairs.
    """

    w: FloatArray
    sigma: FloatArray
    n: FloatArray
    scatter: float


def pairs_of(views: Sequence[View], points: FloatArray, neighbours: int) -> list[tuple[int, int]]:
    """Pairs of views to match: of each those that share most points under a fair angle."""
    n = len(views)
    score = np.zeros((n, n))
    for i in range(n):
        for j in range(i):
            shared = np.intersect1d(views[i].point, views[j].point)
            if len(shared) < LEAST_SHARED:
                continue
            a, b = (_unit(points[shared] - views[k].T_world_camera[:3, 3]) for k in (i, j))
            angle = np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0))
            fair = (angle >= FLATTEST) & (angle <= STEEPEST)
            way = _unit(views[j].T_world_camera[:3, 3] - views[i].T_world_camera[:3, 3])
            if max(abs(float(way @ views[k].T_world_camera[:3, 2])) for k in (i, j)) <= AHEAD:
                score[i, j] = score[j, i] = fair.sum()
    chosen = set()
    for i in range(n):
        for j in np.argsort(-score[i], kind="stable")[:neighbours]:
            if score[i, j] >= LEAST_SHARED:
                chosen.add((min(i, int(j)), max(i, int(j))))
    return sorted(chosen)


def _unit(v: FloatArray) -> FloatArray:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300))


def told_by(a: View, b: View, pictures: tuple[Picture, Picture], points: FloatArray) -> tuple[Told, Told, FloatArray] | None:
    """What the pair says of either photograph, and how far the rows of the points that both show lie apart (k,) pixels.

    None where it cannot be rectified.
    """
    T = inverse(b.T_world_camera) @ a.T_world_camera
    shared, ia, ib = np.intersect1d(a.point, b.point, return_indices=True)
    common = _common(pictures, T)
    if common is None:
        return None
    least, most = _range(common, a, points[shared])
    if most - least > MOST_DISPARITIES:
        common = _common(pictures, T, MOST_DISPARITIES / (most - least))
        if common is None:
            return None
        least, most = _range(common, a, points[shared])
    turned = _turned(pictures, common)
    both = sgbm(turned[0], turned[1], least, most), sgbm_right(turned[0], turned[1], least, most)
    left = checked(turned[0], turned[1], *both)
    right = checked(_mirror(turned[1]), _mirror(turned[0]), _mirror(both[1]), _mirror(both[0]))
    told = (
        _in_picture(left.px, left.sigma_px, common, common.R_rect_left, common.K_left, pictures[0]),
        _in_picture(_mirror(right.px), _mirror(right.sigma_px), common, common.R_rect_right, common.K_right, pictures[1]),
    )
    return *told, _row_errors(a, b, common, np.asarray(ia, np.int64), np.asarray(ib, np.int64))


def _range(common: Rectified, a: View, points: FloatArray) -> tuple[float, float]:
    """Least and most disparity to look for, from the points that both photographs show."""
    z = (points - a.T_world_camera[:3, 3]) @ (a.T_world_camera[:3, :3] @ common.R_rect_left[2])
    low, high = np.percentile(common.K_left[0, 0] * common.baseline_m / np.maximum(z, 1e-12) + common.offset_px, [0.5, 99.5])
    margin = _MARGIN * (high - low) + 8.0
    return float(low - margin), float(high + margin)


def _turned(pictures: tuple[Picture, Picture], common: Rectified) -> list[ByteArray]:
    """The grey pictures as the turned cameras show them, smoothed first where these are coarser."""
    import cv2

    turned = []
    for p, R, K in zip(pictures, (common.R_rect_left, common.R_rect_right), (common.K_left, common.K_right), strict=True):
        coarser = p.K[1, 1] / K[1, 1]
        grey = p.grey if coarser < 1.2 else np.asarray(cv2.GaussianBlur(p.grey, (0, 0), 0.5 * coarser), np.uint8)
        turned.append(warped(grey, Camera(K=p.K, distortion=np.zeros(4)), R, K, common.size))
    return turned


def _mirror(values: Any) -> Any:
    return np.ascontiguousarray(values[:, ::-1])


def _common(pictures: tuple[Picture, Picture], T_b_a: FloatArray, shrink: float = 1.0) -> Rectified | None:
    """Common axes with room for what both pictures show; `shrink` of their focal length."""
    R, t = T_b_a[:3, :3], T_b_a[:3, 3]
    baseline = float(np.linalg.norm(t))
    x = -R.T @ t / baseline
    mean = np.array([0.0, 0.0, 1.0]) + R.T[:, 2]
    z = mean - (mean @ x) * x
    z = z / np.linalg.norm(z)
    axes = np.stack([x, np.cross(z, x), z])
    turn = (axes, axes @ R.T)
    focal = shrink * float(np.mean([p.K[1, 1] for p in pictures]))
    boxes = [_box(p, own, focal) for p, own in zip(pictures, turn, strict=True)]
    if any(box is None for box in boxes):
        return None
    (low_a, high_a), (low_b, high_b) = (box for box in boxes if box is not None)
    top, bottom = max(low_a[1], low_b[1]), min(high_a[1], high_b[1])
    width, height = int(np.ceil(max(high_a[0] - low_a[0], high_b[0] - low_b[0]))) + 1, int(np.ceil(bottom - top)) + 1
    longest = WIDEST * max(max(p.size) for p in pictures)
    if height < 32 or width > longest or height > longest:
        return None
    K = [np.array([[focal, 0.0, -low[0]], [0.0, focal, -top], [0.0, 0.0, 1.0]]) for low in (low_a, low_b)]
    return Rectified(
        R_rect_left=turn[0], R_rect_right=turn[1], K_left=K[0], K_right=K[1], size=(width, height), baseline_m=baseline, is_same=False
    )  # fmt: skip


def _box(picture: Picture, R: FloatArray, focal: float) -> tuple[FloatArray, FloatArray] | None:
    """Least and most column and row of a picture's corners on the common plane, from its middle; None where one lies behind it."""
    width, height = picture.size
    corners = np.array([[0.0, 0.0, 1.0], [width - 1.0, 0.0, 1.0], [0.0, height - 1.0, 1.0], [width - 1.0, height - 1.0, 1.0]])
    ray = corners @ np.linalg.inv(picture.K).T @ R.T
    if (ray[:, 2] <= 0.1 * np.linalg.norm(ray, axis=1)).any():
        return None
    plane = focal * ray[:, :2] / ray[:, 2:]
    return plane.min(axis=0), plane.max(axis=0)


def _in_picture(d: FloatArray, sigma: FloatArray, common: Rectified, R: FloatArray, K: FloatArray, picture: Picture) -> Told:
    """Disparities carried from the common plane to the pixels of a picture: bilinear, as that of a plane surface is linear."""
    import cv2

    width, height = picture.size
    x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    ray = np.stack([x, y, np.ones_like(x)], axis=2) @ np.linalg.inv(picture.K).T @ R.T
    u = (K[0, 0] * ray[:, :, 0] / ray[:, :, 2] + K[0, 2]).astype(np.float32)
    v = (K[1, 1] * ray[:, :, 1] / ray[:, :, 2] + K[1, 2]).astype(np.float32)
    how: dict[str, Any] = {"borderMode": cv2.BORDER_CONSTANT, "borderValue": float("nan")}
    even = cv2.remap(d.astype(np.float32), u, v, cv2.INTER_LINEAR, **how)
    nearest = cv2.remap(d.astype(np.float32), u, v, cv2.INTER_NEAREST, **how)
    spread = cv2.remap(sigma.astype(np.float32), u, v, cv2.INTER_NEAREST, **how)
    factor = ray[:, :, 2] / (K[0, 0] * common.baseline_m)  # inverse depth along the picture's own axis per disparity
    with np.errstate(invalid="ignore"):
        w = (even - common.offset_px) * factor
        w = np.where((np.abs(even - nearest) <= _MIXED_PX) & (w > 0), w, np.nan)
    return Told(w=w.astype(np.float32), sigma=np.where(np.isfinite(w), spread * factor, np.nan).astype(np.float32))


def _row_errors(a: View, b: View, common: Rectified, ia: IntArray, ib: IntArray) -> FloatArray:
    import cv2

    rows = []
    for view, which, R, K in ((a, ia, common.R_rect_left, common.K_left), (b, ib, common.R_rect_right, common.K_right)):
        seen = view.pixel[which].reshape(-1, 1, 2)
        rows.append(cv2.undistortPoints(seen, view.camera.K, view.camera.distortion, R=R, P=K).reshape(-1, 2)[:, 1] * view.camera.K[1, 1] / K[1, 1])
    return np.asarray(np.abs(rows[0] - rows[1]), float)


def together(told: Sequence[Told]) -> Depths:
    """One inverse depth per pixel: the weighted mean of the pairs that agree with their median."""
    w, sigma = np.stack([t.w for t in told]), np.stack([t.sigma for t in told])
    scatter = _scatter(w, sigma)
    sigma = sigma * (max(1.0, scatter) if np.isfinite(scatter) else 1.0)
    known = np.isfinite(w)
    ranked = np.sort(np.where(known, w, np.inf), axis=0)
    count = known.sum(axis=0)
    middle = np.take_along_axis(ranked, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    with np.errstate(invalid="ignore"):
        good: BoolArray = known & (np.abs(w - middle) <= _STEADY * np.sqrt(2.0) * sigma)
    weight = np.where(good, 1.0 / np.where(good, sigma, 1.0) ** 2, 0.0)
    total, n = weight.sum(axis=0), good.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(n > 0, (weight * np.where(good, w, 0.0)).sum(axis=0) / total, np.nan)
        spread = np.sqrt((1.0 + (n - 1.0) / 2.0) / total)
    return Depths(w=mean, sigma=np.where(n > 0, spread, np.nan), n=n.astype(np.float64), scatter=scatter)


def _scatter(w: FloatArray, sigma: FloatArray) -> float:
    """1.4826 times the median of |difference| / standard deviation over pairs of estimates, of every seventh pixel."""
    if len(w) < 2:
        return float("nan")
    parts = []
    for k in range(1, len(w)):
        with np.errstate(invalid="ignore"):
            ratio = (np.abs(w[k] - w[k - 1]) / np.hypot(sigma[k], sigma[k - 1])).ravel()[::7]
        parts.append(ratio[np.isfinite(ratio)])
    ratios = np.concatenate(parts)
    return float(1.4826 * np.median(ratios)) if len(ratios) else float("nan")
