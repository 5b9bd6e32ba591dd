"""A pair of pictures from a calibrated rig becomes points with their uncertainty, in the frame of the left camera (x right, y down, z ahead)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.acquisition.acquired import Acquired, Frame, nothing, seen_from
from scan2fea.acquisition.cameras import Rig, read_rig
from scan2fea.acquisition.chessboard import board_of, calibrate
from scan2fea.acquisition.disparity import Disparity, disparity, matched
from scan2fea.acquisition.images import read_colour
from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.acquisition.rectify import Rectified, rectified, seen_by, warped
from scan2fea.errors import InputError, UsageError, require
from scan2fea.types import BoolArray, ByteArray, FloatArray, Scan

LEAST_MATCHES = 20
OFF_ROWS = 2.0  # px between rows: the calibration is of another rig, or of other pictures
_RATIO = 0.75  # of the best to the second best descriptor (Lowe 2004)
_COARSE = 4  # the range of disparities is told by pictures of this part of the size
_MARGIN = 0.05  # of that range, added on either side
_PIXEL = 1.0 / math.sqrt(12.0)  # standard deviation of a place that is told by a whole pixel


def rig_of(options: AcquisitionOptions, unit_m: float | None) -> Rig:
    """The rig that `acquisition.calibration` tells, a file or a folder of chessboard pairs. Raises UsageError, InputError."""
    require(options.calibration, UsageError, "a pair of pictures needs the cameras: give --calibration FILE, or a folder of chessboard pairs")
    path = Path(options.calibration)
    if path.is_dir():
        says = f'{path} is a folder: to calibrate from its chessboards give the board, --set acquisition.board="9x6 25 mm"'
        require(options.board, UsageError, says)
        return calibrate(path, board_of(options.board))
    return read_rig(path, unit_m)


def from_stereo(paths: Sequence[Path], options: AcquisitionOptions, unit_m: float | None = None) -> Acquired:
    """Pictures left, right, left, right, ... of one rig: a frame per pair, named after the left picture.

    A pair that cannot be used has its reason. Raises InputError where none can, UsageError without a calibration or with an odd number.
    """
    require(len(paths) % 2 == 0, UsageError, f"{len(paths)} pictures with a stereo calibration: give left and right of each pair in turn")
    rig = rig_of(options, unit_m)
    frames, rows, notes = [], [], list(rig.notes)
    for left, right in zip(paths[::2], paths[1::2], strict=True):
        try:
            scan, row, said = scan_of_pair(left, right, rig)
        except InputError as error:
            frames.append(Frame(name=str(left), scan=nothing(), reason=str(error)))
            continue
        frames.append(Frame(name=str(left), scan=scan))
        rows.append({"left": str(left), "right": str(right), **row})
        notes += said
    if all(frame.reason for frame in frames):
        raise InputError("; ".join(frame.reason for frame in frames[:3]))
    how = {
        "method": "stereo", "calibration": options.calibration, "calibration_rms_px": rig.rms_px, "baseline_m": rig.baseline_m,
        "focal_px": float(rig.left.K[0, 0]), "pairs": rows,
    }  # fmt: skip
    return Acquired(frames=tuple(frames), unit_source=rig.unit_source, how=how, notes=tuple(notes))


def scan_of_pair(left: Path, right: Path, rig: Rig) -> tuple[Scan, dict[str, Any], list[str]]:
    """Points of one pair in the frame of the left camera, figures, and notes. Raises InputError where the pair does not fit the rig."""
    colours = [read_colour(path) for path in (left, right)]
    size = (colours[0].shape[1], colours[0].shape[0])
    _require_size(left, right, colours, rig)
    common = rectified(rig.left, rig.right, rig.R, rig.t, size)
    pictures = _turned(colours, rig, common)
    grey = [_grey(picture) for picture in pictures]
    least, most, off, n = span(grey[0], grey[1], f"{left.name} and {right.name}")
    found = disparity(grey[0], grey[1], least, most)
    inside = np.ones(grey[0].shape, bool) if common.is_same else seen_by(rig.left, common.R_rect_left, common.K_left, size, size)
    scan = points_of(found, common, pictures[0], inside)
    says = f"{left.name} and {right.name}: matching found no surface: the pictures show none with texture, or not the same"
    require(len(scan.cloud) > 0, InputError, says)
    share = len(scan.cloud) / found.px.size
    row = {
        "n_points": len(scan.cloud), "matched_share": share, "row_error_px": off, "n_features": n,
        "disparity_px": [least, most], "sigma_px_median": float(np.nanmedian(found.sigma_px)),
    }  # fmt: skip
    notes = [f"{left.name}, {right.name}: rows of the two differ by {off:.2f} px (median of {n} features)"] if off > 0.5 else []
    return scan, row, notes


def _require_size(left: Path, right: Path, colours: Sequence[ByteArray], rig: Rig) -> None:
    sizes = [(c.shape[1], c.shape[0]) for c in colours]
    says = f"{left.name} has {sizes[0][0]} x {sizes[0][1]} pixels and {right.name} {sizes[1][0]} x {sizes[1][1]}: they are not of one rig"
    require(sizes[0] == sizes[1], InputError, says)
    told = rig.size if rig.size != (0, 0) else sizes[0]
    says = f"{left.name} has {sizes[0][0]} x {sizes[0][1]} pixels, the calibration is of {told[0]} x {told[1]}: give full pictures of that camera"
    require(sizes[0] == told, InputError, says)
    K = rig.left.K
    says = f"{left.name}: the calibration has its principal point at ({K[0, 2]:.0f}, {K[1, 2]:.0f}), outside of {sizes[0][0]} x {sizes[0][1]} pixels"
    require(0 < K[0, 2] < sizes[0][0] and 0 < K[1, 2] < sizes[0][1], InputError, says)


def _turned(colours: Sequence[ByteArray], rig: Rig, common: Rectified) -> list[ByteArray]:
    if common.is_same:
        return list(colours)
    return [
        warped(colours[0], rig.left, common.R_rect_left, common.K_left, common.size),
        warped(colours[1], rig.right, common.R_rect_right, common.K_right, common.size),
    ]


def _grey(colour: ByteArray) -> ByteArray:
    import cv2

    return np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY), np.uint8)


def span(left: ByteArray, right: ByteArray, name: str) -> tuple[float, float, float, int]:
    """Least and most disparity, median distance of the rows, and how many features told them.

    Raises InputError where the pictures share too little, do not lie in the same rows, or have changed places.
    """
    d, rows = _feature_disparities(left, right)
    says = f"{name}: only {len(d)} places of one were found in the other, {LEAST_MATCHES} are needed: they show different things, or are blurred"
    require(len(d) >= LEAST_MATCHES, InputError, says)
    off = float(np.median(np.abs(rows)))
    says = f"{name}: after rectification their rows differ by {off:.1f} px (median of {len(d)}): the calibration is not of these pictures"
    require(off <= OFF_ROWS, InputError, says + ", or they show different things")
    low, high = np.percentile(d, [1.0, 99.0])
    says = f"{name}: the right picture shows things farther right than the left one does: give them the other way around"
    require(np.median(d) > -0.02 * left.shape[1], InputError, says)
    coarse = coarse_range(left, right, float(low), float(high))
    return (*coarse, off, len(d))


def coarse_range(left: ByteArray, right: ByteArray, low: float, high: float) -> tuple[float, float]:
    """Least and most disparity of what both directions find in pictures of a quarter of the size, searched far beyond what features say."""
    import cv2

    small = [cv2.resize(picture, None, fx=1 / _COARSE, fy=1 / _COARSE, interpolation=cv2.INTER_AREA) for picture in (left, right)]
    wide = max(high - low, 0.05 * left.shape[1])
    found = matched(small[0], small[1], (low - wide) / _COARSE, (high + wide) / _COARSE)
    d = found[np.isfinite(found)] * _COARSE
    if len(d):
        low, high = (min(low, float(np.percentile(d, 0.1))), max(high, float(np.percentile(d, 99.9))))
    margin = _MARGIN * (high - low) + _COARSE
    return low - margin, high + margin


def _feature_disparities(left: ByteArray, right: ByteArray) -> tuple[FloatArray, FloatArray]:
    """Differences of columns and of rows of matched SIFT features, with what fits no common line left out."""
    import cv2

    sift = cv2.SIFT.create(nfeatures=4000)
    (a, own), (b, other) = (sift.detectAndCompute(picture, None) for picture in (left, right))
    if own is None or other is None or min(len(own), len(other)) < 2:
        return np.zeros(0), np.zeros(0)
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(own, other, k=2)
    good = [(m.queryIdx, m.trainIdx) for m, n in pairs if m.distance < _RATIO * n.distance]
    if not good:
        return np.zeros(0), np.zeros(0)
    i, j = np.array(good).T
    apart = np.array([k.pt for k in a])[i] - np.array([k.pt for k in b])[j]
    # wrong matches lie anywhere: the rows of right ones are close together, whatever the calibration is worth
    middle = float(np.median(apart[:, 1]))
    spread = 1.4826 * float(np.median(np.abs(apart[:, 1] - middle)))
    near = np.abs(apart[:, 1] - middle) <= max(3.0 * spread, 1.0)
    return np.asarray(apart[near, 0], float), np.asarray(apart[near, 1], float)


def points_of(found: Disparity, common: Rectified, colour: ByteArray, inside: BoolArray) -> Scan:
    """Points of all pixels with a disparity, in the frame of the left camera."""
    depth = common.depth_m(found.px)
    with np.errstate(invalid="ignore"):
        known = np.isfinite(depth) & (depth > 0) & inside
    y, x = np.nonzero(known)
    z, focal, K = depth[known], common.K_left[0, 0], common.K_left
    ray = np.stack([(x - K[0, 2]) / focal, (y - K[1, 2]) / focal, np.ones(len(x))], axis=1)
    points = (ray * z[:, None]) @ common.R_rect_left
    along = z * z / (focal * common.baseline_m) * found.sigma_px[known] * np.linalg.norm(ray, axis=1)
    return seen_from(np.zeros(3), points, along, z / focal * _PIXEL, colour=colour[known])
