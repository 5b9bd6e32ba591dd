"""Calibration of a rig of two cameras from pictures of a chessboard (Zhang 2000), by OpenCV's corner finder and bundle adjustment.

Pictures are paired by what their names have besides "left" and "right" (left01.jpg, right01.jpg). A pair that does not fit the others is left out:
its reprojection error is more than three times the median of all, as where the finder took a wrong corner.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.acquisition.cameras import Camera, Rig
from scan2fea.acquisition.images import is_image, read_grey
from scan2fea.errors import InputError, UsageError, require
from scan2fea.types import FloatArray, Value
from scan2fea.units import metres_per

LEAST_PAIRS = 5
OFF = 3.0  # a pair whose error is so many times the median of all is left out
_BOARD = re.compile(r"\s*(\d+)\s*[xX*]\s*(\d+)\s+([0-9.eE+-]+)\s*([a-z_]+)\s*")
_SUBPIX_WINDOW, _SUBPIX_STEPS, _SUBPIX_MOVE = (5, 5), 60, 1e-4


@dataclass(frozen=True, kw_only=True)
class Board(Value):
    """Inner corners along and across, and the side of a square."""

    columns: int
    rows: int
    side_m: float


def board_of(text: str) -> Board:
    """The board of a text such as 9x6 25 mm. Raises UsageError."""
    found = _BOARD.fullmatch(text)
    says = f'acquisition.board = {text!r}: write the inner corners and the side of a square, e.g. "9x6 25 mm"'
    if found is None:
        raise UsageError(says)
    try:
        board = Board(columns=int(found[1]), rows=int(found[2]), side_m=float(found[3]) * metres_per(found[4]))
    except ValueError as error:
        raise UsageError(says) from error
    require(min(board.columns, board.rows) >= 3 and board.side_m > 0, UsageError, says + ": 3 corners each way or more, a side above zero")
    return board


def pairs_of(folder: Path) -> list[tuple[Path, Path]]:
    """The left and right pictures of a folder, in the order of their names. Raises InputError where there are too few."""
    pictures = sorted(path for path in folder.iterdir() if is_image(path))
    key = {path: re.sub("left|right", "", path.stem.lower()) for path in pictures}
    left = {key[path]: path for path in pictures if "left" in path.stem.lower()}
    right = {key[path]: path for path in pictures if "right" in path.stem.lower()}
    pairs = [(left[k], right[k]) for k in sorted(left.keys() & right.keys())]
    says = f"{folder}: {len(pairs)} pairs of pictures named left* and right*; a calibration needs {LEAST_PAIRS} or more"
    require(len(pairs) >= LEAST_PAIRS, InputError, says)
    return pairs


def calibrate(folder: Path, board: Board) -> Rig:
    """The rig that took the chessboard pairs of a folder. `rms_px`: of all corners against the reprojected board.

    Raises InputError where the board is found in too few pairs or the pictures have several sizes.
    """
    pairs = pairs_of(folder)
    found, size = _corners(pairs, board)
    says = f"{folder}: a chessboard of {board.columns} x {board.rows} inner corners was found in {len(found)} of {len(pairs)} pairs, "
    says += f"{LEAST_PAIRS} are needed: check acquisition.board (corners inside, not squares) and that the whole board is in the picture"
    require(len(found) >= LEAST_PAIRS, InputError, says)
    grid = _grid(board)
    names = sorted(found)
    rig, error = _solve([found[name] for name in names], grid, size)
    kept = [name for name, e in zip(names, error, strict=True) if e <= OFF * float(np.median(error))]
    if LEAST_PAIRS <= len(kept) < len(names):
        rig, error = _solve([found[name] for name in kept], grid, size)
    lost = len(pairs) - len(found)
    notes = [f"calibrated from {len(kept)} chessboard pairs: reprojection rms {rig.rms_px:.3f} px, baseline {rig.baseline_m:.4g} m"]
    if lost:
        notes.append(f"the chessboard was not found in {lost} of {len(pairs)} pairs of {folder.name}")
    if len(kept) < len(names):
        notes.append(f"left out of the calibration, as they do not fit the others: {', '.join(sorted(set(names) - set(kept)))}")
    return Rig(
        left=rig.left, right=rig.right, R=rig.R, t=rig.t, size=size, unit_source="option", rms_px=rig.rms_px, notes=tuple(notes)
    )  # fmt: skip


def _grid(board: Board) -> FloatArray:
    """(n, 3) corners of the board in its plane."""
    j, i = np.mgrid[: board.rows, : board.columns]
    return np.asarray(np.c_[i.ravel(), j.ravel(), np.zeros(i.size)] * board.side_m)


def _corners(pairs: list[tuple[Path, Path]], board: Board) -> tuple[dict[str, tuple[FloatArray, FloatArray]], tuple[int, int]]:
    found, sizes = {}, set()
    for pair in pairs:
        grey = [read_grey(path) for path in pair]
        sizes |= {picture.shape[::-1] for picture in grey}
        corners = [_found(picture, board) for picture in grey]
        if corners[0] is not None and corners[1] is not None:
            found[pair[0].name] = (corners[0], corners[1])
    told = ", ".join(f"{w} x {h}" for w, h in sorted(sizes))
    says = f"{pairs[0][0].parent}: the pictures have {len(sizes)} sizes ({told}): they are of several cameras"
    require(len(sizes) == 1, InputError, says)
    width, height = sizes.pop()
    return found, (int(width), int(height))


def _found(grey: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], board: Board) -> FloatArray | None:
    """(n, 2) corners to a hundredth of a pixel, or None."""
    import cv2

    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    ok, corners = cv2.findChessboardCorners(grey, (board.columns, board.rows), flags=flags)
    if not ok:
        return None
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, _SUBPIX_STEPS, _SUBPIX_MOVE)
    return np.asarray(cv2.cornerSubPix(grey, corners, _SUBPIX_WINDOW, (-1, -1), stop), float).reshape(-1, 2)


def _solve(corners: list[tuple[FloatArray, FloatArray]], grid: FloatArray, size: tuple[int, int]) -> tuple[Rig, FloatArray]:
    """The rig, and the error of each pair in pixels (rms of both pictures)."""
    import cv2

    world = [grid.astype(np.float32)] * len(corners)
    left = [pair[0].astype(np.float32) for pair in corners]
    right = [pair[1].astype(np.float32) for pair in corners]
    start = [cv2.calibrateCamera(world, seen, size, np.eye(3), np.zeros(5))[1:3] for seen in (left, right)]
    solved = cv2.stereoCalibrateExtended(
        world, left, right, start[0][0], start[0][1], start[1][0], start[1][1], size, np.eye(3), np.zeros(3), flags=cv2.CALIB_USE_INTRINSIC_GUESS
    )
    rms, K1, D1, K2, D2, R, T = solved[:7]
    error = np.sqrt((np.asarray(solved[-1], float) ** 2).mean(axis=1))
    rig = Rig(
        left=Camera(K=np.asarray(K1, float), distortion=np.asarray(D1, float).ravel()),
        right=Camera(K=np.asarray(K2, float), distortion=np.asarray(D2, float).ravel()),
        R=np.asarray(R, float), t=np.asarray(T, float).ravel(), size=size, unit_source="option", rms_px=float(rms),
    )  # fmt: skip
    return rig, error
