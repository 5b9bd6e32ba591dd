"""Pinhole cameras with lens distortion, and a rig of two, from the files that calibrations are kept in.

==================  ===============================================================  ===================================================
file                content                                                          unit of the baseline
==================  ===============================================================  ===================================================
OpenCV yml, xml     M1 D1 M2 D2 R T (x_right = R x_left + T); R and T may stand in   input.unit, else metres (assumed)
                    extrinsics.yml beside it
Middlebury          calib.txt: cam0, cam1, doffs, baseline of a rectified pair       millimetres (vision.middlebury.edu/stereo)
calibration.json    what a run with chessboards writes                               metres
==================  ===============================================================  ===================================================
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import FormatError, InputError, require
from scan2fea.types import FloatArray, Value

_NAMES = {
    "K1": ("M1", "K1", "cameraMatrix1", "camera_matrix_1", "left_camera_matrix", "cam0"),
    "D1": ("D1", "distCoeffs1", "dist_coeffs_1", "left_distortion"),
    "K2": ("M2", "K2", "cameraMatrix2", "camera_matrix_2", "right_camera_matrix", "cam1"),
    "D2": ("D2", "distCoeffs2", "dist_coeffs_2", "right_distortion"),
    "R": ("R", "rotation"),
    "T": ("T", "translation", "t"),
}
_SCHEMA = "scan2fea stereo calibration 1"
_MILLIMETRE = 1e-3
_LARGEST_BYTES = 50_000_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera(Value):
    """K : (3, 3) in pixels, the centre of the first pixel is (0, 0).   distortion : (k,) of OpenCV's order k1 k2 p1 p2 k3 ..., k = 0, 4, 5, 8."""

    K: FloatArray
    distortion: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Rig(Value):
    """x_right = R x_left + t, metres.   offset_px : difference of the principal points of a rectified pair (doffs), else 0.
    size : (width, height) of its pictures, (0, 0) where the file does not say.   rms_px : of the calibration, nan where not known.
    """

    left: Camera
    right: Camera
    R: FloatArray
    t: FloatArray
    size: tuple[int, int]
    unit_source: str
    rms_px: float
    notes: tuple[str, ...] = ()

    @property
    def baseline_m(self) -> float:
        return float(np.linalg.norm(self.t))


def read_rig(path: Path, unit_m: float | None) -> Rig:
    """A stereo rig from a file. unit_m : metres per unit of a file that states none, None: taken for metres.

    Raises InputError where it is missing, FormatError where it is no calibration of two cameras.
    """
    _require_file(path)
    suffix = path.suffix.lower()
    if suffix in (".yml", ".yaml", ".xml"):
        return _rig(path, _opencv(path), unit_m or 1.0, "option" if unit_m else "assumed")
    text = _text(path)
    if suffix == ".json":
        return _json(path, text)
    if "cam0" in text and "baseline" in text:
        return _middlebury(path, text)
    raise FormatError(f"{path}: is no calibration that is known: OpenCV yml or xml, Middlebury calib.txt, calibration.json of a run")


def write_rig(rig: Rig) -> str:
    """calibration.json, in metres."""
    tree = {
        "schema": _SCHEMA, "width": rig.size[0], "height": rig.size[1], "K1": rig.left.K.tolist(), "D1": rig.left.distortion.tolist(),
        "K2": rig.right.K.tolist(), "D2": rig.right.distortion.tolist(), "R": rig.R.tolist(), "T_m": rig.t.tolist(),
        "rms_px": rig.rms_px if np.isfinite(rig.rms_px) else None,
    }  # fmt: skip
    return json.dumps(tree, indent=1) + "\n"


def read_camera(path: Path) -> Camera:
    """One camera: json with `intrinsic_matrix` (column by column, as Open3D writes it) or `K`, OpenCV yml or xml, or text of 9 numbers.

    Raises InputError, FormatError.
    """
    _require_file(path)
    if path.suffix.lower() in (".yml", ".yaml", ".xml"):
        names = {"K1": ("camera_matrix", "cameraMatrix", "K", *_NAMES["K1"]), "D1": ("distortion_coefficients", "distCoeffs", "D", "D1")}
        tree = _opencv(path, names)
        require("K1" in tree, FormatError, f"{path}: holds no camera matrix")
        return Camera(K=_matrix(path, tree["K1"]), distortion=np.asarray(tree.get("D1", np.zeros(0))).ravel())
    text = _text(path)
    if path.suffix.lower() == ".json":
        tree = _tree(path, text)
        if "intrinsic_matrix" in tree:
            return Camera(K=_matrix(path, np.asarray(tree["intrinsic_matrix"], float).reshape(3, 3).T), distortion=np.zeros(0))
        require("K" in tree, FormatError, f"{path}: has neither intrinsic_matrix nor K")
        return Camera(K=_matrix(path, np.asarray(tree["K"], float)), distortion=np.asarray(tree.get("distortion", []), float))
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError as error:
        raise FormatError(f"{path}: a camera is 9 numbers, row by row ({error})") from error
    require(len(values) == 9, FormatError, f"{path}: a camera is 9 numbers, row by row; found {len(values)}")
    return Camera(K=_matrix(path, values.reshape(3, 3)), distortion=np.zeros(0))


def _require_file(path: Path) -> None:
    require(path.is_file(), InputError, f"{path}: no such file of calibration")
    require(path.stat().st_size <= _LARGEST_BYTES, FormatError, f"{path}: {path.stat().st_size} bytes is no file of calibration")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: is no text: a calibration is yml, xml, txt or json") from error


def _tree(path: Path, text: str) -> dict[str, Any]:
    try:
        tree = json.loads(text)
    except json.JSONDecodeError as error:
        raise FormatError(f"{path}: is not JSON ({error})") from error
    require(isinstance(tree, dict), FormatError, f"{path}: holds no table of names and values")
    return dict(tree)


def _matrix(path: Path, K: FloatArray) -> FloatArray:
    fits = K.shape == (3, 3) and bool(np.isfinite(K).all()) and K[0, 0] > 0 and K[1, 1] > 0 and K[2, 2] == 1.0
    require(fits, FormatError, f"{path}: a camera matrix is 3 x 3 with positive focal lengths and 1 in its last place, found {K.tolist()}")
    return np.asarray(K, float)


def _opencv(path: Path, names: dict[str, tuple[str, ...]] = _NAMES) -> dict[str, FloatArray]:
    import cv2

    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        opened = storage.isOpened()
    except cv2.error as error:
        raise FormatError(f"{path}: OpenCV cannot read it ({str(error).splitlines()[-1][:120]})") from error
    require(opened, FormatError, f"{path}: OpenCV cannot read it")
    found = {}
    for key, aliases in names.items():
        for alias in aliases:
            node = storage.getNode(alias)
            if not node.empty() and node.isMap() and node.mat() is not None:
                found[key] = np.asarray(node.mat(), float)
                break
    size = [storage.getNode(name) for name in ("image_width", "image_height")]
    if not any(node.empty() for node in size):
        found["size"] = np.array([node.real() for node in size])
    storage.release()
    return found


def _rig(path: Path, tree: dict[str, FloatArray], unit_m: float, unit_source: str) -> Rig:
    beside = path.with_name(f"extrinsics{path.suffix}")
    if "R" not in tree and path.suffix != ".json" and beside.is_file():
        tree = {**_opencv(beside), **tree}
    missing = [name for name in ("K1", "K2", "R", "T") if name not in tree]
    says = f"{path}: lacks {', '.join('/'.join(_NAMES[name][:3]) for name in missing)}: a rig needs both cameras and R, T between them"
    require(not missing, FormatError, says)
    R, t = tree["R"], tree["T"].ravel() * unit_m
    if R.size == 3:
        import cv2

        R = np.asarray(cv2.Rodrigues(R.ravel())[0], float)
    fits = R.shape == (3, 3) and np.allclose(R @ R.T, np.eye(3), atol=1e-4) and np.linalg.det(R) > 0
    require(fits, FormatError, f"{path}: R is no rotation")
    require(t.shape == (3,) and np.linalg.norm(t) > 0, FormatError, f"{path}: T must be three numbers that are not all zero")
    size = tree.get("size", np.zeros(2)).astype(int)
    cameras = [Camera(K=_matrix(path, tree[f"K{k}"]), distortion=np.asarray(tree.get(f"D{k}", np.zeros(0))).ravel()) for k in (1, 2)]
    return Rig(left=cameras[0], right=cameras[1], R=R, t=t, size=(int(size[0]), int(size[1])), unit_source=unit_source, rms_px=float("nan"))


def _middlebury(path: Path, text: str) -> Rig:
    values = dict(re.findall(r"^\s*(\w+)\s*=\s*(.+?)\s*$", text, re.MULTILINE))
    missing = [name for name in ("cam0", "cam1", "baseline") if name not in values]
    require(not missing, FormatError, f"{path}: lacks {', '.join(missing)}")
    try:
        K = [np.array([[float(x) for x in row.split()] for row in values[name].strip("[]").split(";")]) for name in ("cam0", "cam1")]
        baseline = float(values["baseline"]) * _MILLIMETRE
        size = (int(values.get("width", 0)), int(values.get("height", 0)))
    except ValueError as error:
        raise FormatError(f"{path}: {error}") from error
    require(baseline > 0, FormatError, f"{path}: baseline = {values['baseline']} must be positive")
    left, right = (Camera(K=_matrix(path, k), distortion=np.zeros(0)) for k in K)
    return Rig(
        left=left, right=right, R=np.eye(3), t=np.array([-baseline, 0.0, 0.0]), size=size, unit_source="format", rms_px=float("nan")
    )  # fmt: skip


def _json(path: Path, text: str) -> Rig:
    tree = _tree(path, text)
    require(tree.get("schema") == _SCHEMA, FormatError, f"{path}: is no {_SCHEMA}")
    try:
        arrays = {name: np.asarray(tree[key], float) for name, key in (*((k, k) for k in ("K1", "D1", "K2", "D2", "R")), ("T", "T_m"))}
        arrays["size"] = np.array([tree["width"], tree["height"]], float)
        rms = float("nan") if tree.get("rms_px") is None else float(tree["rms_px"])
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"{path}: {error!r} is missing or no number") from error
    rig = _rig(path, arrays, 1.0, "format")
    return Rig(left=rig.left, right=rig.right, R=rig.R, t=rig.t, size=rig.size, unit_source="format", rms_px=rms)
