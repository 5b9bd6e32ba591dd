"""Metres for photographs: a length between two targets, two cameras, or two places of one photograph.

Targets are markers with a number (ArUco, AprilTag: their middle is used), or places that are named in targets.csv beside the photographs:
a header photograph,name,x,y and one line per place seen, pixels from the middle of the first pixel.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.acquisition.depths import Depths, Picture
from scan2fea.acquisition.images import read_grey
from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.acquisition.structure import Structure, View
from scan2fea.errors import InputError, UsageError, require
from scan2fea.types import FloatArray, Value
from scan2fea.units import metres_per

TARGETS = "targets.csv"
_BETWEEN = re.compile(r"\s*([0-9.eE+-]+)\s*([a-z_]+)\s+between\s+(targets|cameras)\s+(\S+)\s+(\S+)\s*")
_PLACES = re.compile(r"\s*([0-9.eE+-]+)\s*([a-z_]+)\s+(\S+)\s+([0-9.]+),([0-9.]+)\s+([0-9.]+),([0-9.]+)\s*")
_CLICK_PX = 0.5  # standard deviation of a place that a person or a marker's corner finder gives, at least
_OFF_PX = 5.0  # rays to one target that miss each other by more are not of one target
_WINDOW = 2  # pixels around a place whose depths are asked


@dataclass(frozen=True, kw_only=True)
class Length(Value):
    """What the user says. kind : "targets", "cameras" or "places".   first, second : names, or "x,y" of `photograph`."""

    metres: float
    kind: str
    first: str
    second: str
    photograph: str = ""

    def told(self) -> str:
        """In words, for the report."""
        where = f"{self.kind} {self.first} and {self.second}" + (f" of {self.photograph}" if self.photograph else "")
        return f"{self.metres:g} m between {where}"


@dataclass(frozen=True, kw_only=True)
class Scale(Value):
    """m_per_unit : metres per length of the structure.   relative_std : its standard deviation, by the pixels alone."""

    m_per_unit: float
    relative_std: float
    told: str


def length_of(options: AcquisitionOptions) -> Length | None:
    """What options.scale or options.known_length say, None where both are empty. Raises UsageError."""
    require(not (options.scale and options.known_length), UsageError, "give --scale or --known-length, not both: they might differ")
    if options.scale:
        found = _BETWEEN.fullmatch(options.scale)
        says = f'--scale {options.scale!r}: write "0.25 m between targets A B" or "1.2 m between cameras 01.jpg 02.jpg"'
        if found is None:
            raise UsageError(says)
        require(found[4] != found[5], UsageError, says + ": the two are the same")
        return Length(metres=_metres(found[1], found[2], says), kind=found[3], first=found[4], second=found[5])
    if options.known_length:
        found = _PLACES.fullmatch(options.known_length)
        says = f'--known-length {options.known_length!r}: write "0.8 m 03.jpg 120,340 810,355": length, photograph, two places in pixels'
        if found is None:
            raise UsageError(says)
        first, second = f"{found[4]},{found[5]}", f"{found[6]},{found[7]}"
        return Length(metres=_metres(found[1], found[2], says), kind="places", first=first, second=second, photograph=found[3])
    return None


def _metres(number: str, unit: str, says: str) -> float:
    try:
        metres = float(number) * metres_per(unit)
    except ValueError as error:
        raise UsageError(says) from error
    require(np.isfinite(metres) and metres > 0, UsageError, says + ": the length must be above zero")
    return metres


def scale_of(length: Length, solved: Structure, depths: Sequence[Depths], pictures: Sequence[Picture]) -> Scale:
    """Metres per length of the structure. Raises InputError where the photographs do not show what the length is between."""
    if length.kind == "cameras":
        ends = [_view(solved, name).T_world_camera[:3, 3] for name in (length.first, length.second)]
        spread = [np.eye(3) * (_camera_sigma(solved, k) ** 2) for k in (length.first, length.second)]
    elif length.kind == "targets":
        seen = _targets(solved, (length.first, length.second))
        (a, sa), (b, sb) = (_met(solved.views, seen[name], name) for name in (length.first, length.second))
        ends, spread = [a, b], [sa, sb]
    else:
        k = next(k for k, view in enumerate(solved.views) if view is _view(solved, length.photograph))
        places = [_place(solved.views[k], pictures[k], depths[k], text) for text in (length.first, length.second)]
        ends, spread = [p[0] for p in places], [p[1] for p in places]
    apart = ends[1] - ends[0]
    d = float(np.linalg.norm(apart))
    require(d > 0, InputError, f"{length.told()}: the two are in one place")
    way = apart / d
    std = float(np.sqrt(way @ (spread[0] + spread[1]) @ way)) / d
    says = f"{length.told()}: its ends are known to {std:.0%} of it in the photographs: take a longer length, seen by more photographs"
    require(std < 0.1, InputError, says)
    return Scale(m_per_unit=length.metres / d, relative_std=std, told=length.told())


def _view(solved: Structure, name: str) -> View:
    for view in solved.views:
        if Path(view.path).name == name or Path(view.path).stem == name:
            return view
    known = ", ".join(Path(view.path).name for view in solved.views[:6])
    raise InputError(f"--scale or --known-length: no photograph {name!r} was placed; placed are {known}{', ...' if len(solved.views) > 6 else ''}")


def _camera_sigma(solved: Structure, name: str) -> float:
    """Of a camera's place: that of one point at the median depth by its pixels, over the square root of their number."""
    view = _view(solved, name)
    z = (solved.points[view.point] - view.T_world_camera[:3, 3]) @ view.T_world_camera[:3, 2]
    return float(np.median(z) * solved.error_px / view.camera.K[0, 0] / np.sqrt(max(len(z), 1)) * 3.0)


def _targets(solved: Structure, names: Sequence[str]) -> dict[str, list[tuple[int, FloatArray]]]:
    """Where the views show the named targets: number of the view, pixel (2,)."""
    folder = Path(solved.views[0].path).parent
    listed = folder / TARGETS
    found = _from_file(listed, solved) if listed.is_file() else {}
    if not all(name in found for name in names) and all(name.isdigit() for name in names):
        found = {**_markers(solved, [int(name) for name in names]), **found}
    for name in names:
        n = len(found.get(name, []))
        says = f"--scale: target {name} is seen in {n} placed photographs, two are needed: name places in {TARGETS} beside them, or use markers"
        require(n >= 2, InputError, says)
    return found


def _from_file(path: Path, solved: Structure) -> dict[str, list[tuple[int, FloatArray]]]:
    number = {Path(view.path).name: k for k, view in enumerate(solved.views)}
    found: dict[str, list[tuple[int, FloatArray]]] = {}
    try:
        with path.open(newline="", encoding="utf-8") as handle:
            for row in csv.DictReader(handle):
                if row["photograph"] in number:
                    found.setdefault(row["name"].strip(), []).append((number[row["photograph"]], np.array([float(row["x"]), float(row["y"])])))
    except (KeyError, TypeError, ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {error!r}; it needs a header photograph,name,x,y and numbers") from error
    return found


def _markers(solved: Structure, wanted: Sequence[int]) -> dict[str, list[tuple[int, FloatArray]]]:
    """Middles of the numbered markers, of the dictionary that finds the wanted ones most often."""
    import cv2

    best: dict[str, list[tuple[int, FloatArray]]] = {}
    pictures = [read_grey(Path(view.path)) for view in solved.views]
    for name in ("DICT_APRILTAG_36h11", "DICT_4X4_250", "DICT_5X5_250", "DICT_6X6_250", "DICT_ARUCO_ORIGINAL"):
        detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)))
        found: dict[str, list[tuple[int, FloatArray]]] = {}
        for k, grey in enumerate(pictures):
            corners, numbers, _ = detector.detectMarkers(grey)
            for corner, number in zip(corners, [] if numbers is None else np.ravel(numbers), strict=True):
                if int(number) in wanted:
                    found.setdefault(str(int(number)), []).append((k, _crossing(np.asarray(corner, float).reshape(4, 2))))
        if sum(map(len, found.values())) > sum(map(len, best.values())):
            best = found
    return best


def _crossing(corner: FloatArray) -> FloatArray:
    """Where the diagonals of four corners cross: the middle of a square in perspective."""
    h = np.column_stack([corner, np.ones(4)])
    at = np.cross(np.cross(h[0], h[2]), np.cross(h[1], h[3]))
    return np.asarray(at[:2] / at[2])


def _met(views: Sequence[View], seen: Sequence[tuple[int, FloatArray]], name: str) -> tuple[FloatArray, FloatArray]:
    """Where the lines of sight meet, by least squares of the angles, and its covariance (3, 3). Raises InputError where they do not meet."""
    import cv2

    origins, ways, focal = [], [], []
    for k, pixel in seen:
        view = views[k]
        flat = cv2.undistortPoints(pixel.reshape(1, 1, 2), view.camera.K, view.camera.distortion).reshape(2)
        way = view.T_world_camera[:3, :3] @ np.array([flat[0], flat[1], 1.0])
        origins.append(view.T_world_camera[:3, 3])
        ways.append(way / np.linalg.norm(way))
        focal.append(view.camera.K[0, 0])
    o, d, f = np.array(origins), np.array(ways), np.array(focal)
    square = np.eye(3) - d[:, :, None] * d[:, None, :]
    weight = np.ones(len(o))
    for _ in range(3):
        normal = (weight[:, None, None] * square).sum(axis=0)
        says = f"--scale: target {name}: the photographs that show it were taken from one place"
        require(np.linalg.cond(normal) < 1e9, InputError, says)
        p = np.linalg.solve(normal, (weight[:, None, None] * square @ o[:, :, None]).sum(axis=0)[:, 0])
        weight = (f / np.linalg.norm(p - o, axis=1)) ** 2
    off = np.linalg.norm(np.einsum("nij,nj->ni", square, p - o), axis=1) * np.sqrt(weight)
    says = f"--scale: target {name}: the lines of sight to it miss each other by {off.max():.1f} px: it is not the same thing in all photographs"
    require(off.max() <= _OFF_PX, InputError, says)
    spread = max(_CLICK_PX, float(np.sqrt((off**2).sum() / max(2 * len(o) - 3, 1))))
    return p, np.linalg.inv((weight[:, None, None] * square).sum(axis=0)) * spread**2


def _place(view: View, picture: Picture, depth: Depths, text: str) -> tuple[FloatArray, FloatArray]:
    """A place of a photograph in the world, and its covariance, from the depths about it."""
    import cv2

    pixel = np.array([float(x) for x in text.split(",")])
    flat = cv2.undistortPoints(pixel.reshape(1, 1, 2), view.camera.K, view.camera.distortion, P=picture.K).reshape(2)
    x, y = (round(float(k)) for k in flat)
    around = (slice(max(y - _WINDOW, 0), y + _WINDOW + 1), slice(max(x - _WINDOW, 0), x + _WINDOW + 1))
    w, sigma = depth.w[around], depth.sigma[around]
    known = np.isfinite(w)
    says = f"--known-length: no depth is known about the place {text} of {Path(view.path).name}: choose one with texture, seen in other photographs"
    require(bool(known.any()), InputError, says)
    inverse_depth, spread = float(np.median(w[known])), float(np.median(sigma[known]))
    ray = view.T_world_camera[:3, :3] @ np.linalg.solve(picture.K, np.array([flat[0], flat[1], 1.0]))
    across = _CLICK_PX / picture.K[0, 0] / inverse_depth
    covariance = np.outer(ray, ray) * (spread / inverse_depth**2) ** 2 + np.eye(3) * across**2
    return view.T_world_camera[:3, 3] + ray / inverse_depth, covariance
