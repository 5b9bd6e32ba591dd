"""A folder of depth images, with or without colours, becomes one frame per image; registration finds the poses.

Layouts: `depth/` (with `color/`, `colour/` or `rgb/` beside it), or files depth_NNN and color_NNN in one folder. Intrinsics: --calibration, or a file
camera_intrinsic.json, intrinsic.json, camera.json or intrinsics.txt in the folder; else those that the maker states for the PrimeSense sensor, told
as assumed.

Noise of structured light: sd along the viewing axis 1.2 mm + 1.9 mm/m2 (z - 0.4 m)^2, across 0.8 px (Nguyen, Izadi, Lovell 2012).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from scan2fea.acquisition.acquired import Acquired, Frame, nothing, seen_from
from scan2fea.acquisition.cameras import Camera, read_camera
from scan2fea.acquisition.images import is_image, read_colour, read_depth
from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.errors import InputError, require
from scan2fea.types import BoolArray, ByteArray, FloatArray, Scan

_COLOURS = ("color", "colour", "rgb", "image")
_INTRINSICS = ("camera_intrinsic.json", "intrinsic.json", "intrinsics.json", "camera.json", "intrinsics.txt", "intrinsic.txt")
_VGA = (640, 480)
_PRIMESENSE = ((525.0, 0.0, 319.5), (0.0, 525.0, 239.5), (0.0, 0.0, 1.0))  # of 640 x 480 depths laid over the colours, as OpenNI states it
_AXIAL = (0.0012, 0.0019, 0.4)  # m, 1/m, m
_ACROSS_PX = 0.8
_STEP = 0.05  # of the depth: neighbours farther apart lie on two surfaces, and what lies between is neither
_LEAST_POINTS = 100


def is_rgbd(folder: Path) -> bool:
    """Whether a folder holds depth images."""
    return bool(depths_of(folder))


def depths_of(folder: Path) -> list[Path]:
    """The depth images of a folder in the order of their names."""
    inner = folder / "depth"
    if inner.is_dir():
        return sorted(path for path in inner.iterdir() if is_image(path))
    return sorted(path for path in folder.iterdir() if is_image(path) and path.stem.lower().startswith("depth"))


def from_rgbd(folder: Path, options: AcquisitionOptions) -> Acquired:
    """A frame per depth image in the frame of its camera (x right, y down, z ahead), seen from the origin.

    Raises InputError where no image is usable or the intrinsics of its size are not known.
    """
    depths = depths_of(folder)
    colours = _colours(folder)
    camera, said = _camera(folder, options, depths[0])
    frames = []
    for path in depths:
        try:
            frames.append(Frame(name=str(path), scan=_scan(path, colours.get(_key(path)), camera, options)))
        except InputError as error:
            frames.append(Frame(name=str(path), scan=nothing(), reason=str(error)))
    if all(frame.reason for frame in frames):
        raise InputError("; ".join(frame.reason for frame in frames[:3]))
    how = {"method": "rgbd", "folder": str(folder), "n_images": len(depths), "n_colours": len(colours), "K": camera.K.tolist()}
    return Acquired(frames=tuple(frames), unit_source="option" if options.depth_per_m != 1000.0 else "format", how=how, notes=said)


def _key(path: Path) -> str:
    """What depth and colour of one moment share in their names."""
    return re.sub("depth|colou?r|rgb|image", "", path.stem.lower()).strip("_-. ")


def _colours(folder: Path) -> dict[str, Path]:
    inner = [folder / name for name in _COLOURS if (folder / name).is_dir()]
    files = [path for place in (inner or [folder]) for path in sorted(place.iterdir()) if is_image(path)]
    return {_key(path): path for path in files if inner or path.stem.lower().startswith(_COLOURS)}


def _camera(folder: Path, options: AcquisitionOptions, first: Path) -> tuple[Camera, tuple[str, ...]]:
    from scan2fea.acquisition.images import read_header

    beside = [folder / name for name in _INTRINSICS if (folder / name).is_file()]
    if options.calibration or beside:
        return read_camera(Path(options.calibration) if options.calibration else beside[0]), ()
    header = read_header(first)
    says = f"{first}: the intrinsics of a depth camera of {header.width} x {header.height} pixels are not known: give them with --calibration FILE"
    require((header.width, header.height) == _VGA, InputError, says + " (json with K, or 9 numbers)")
    told = f"{folder.name}: no intrinsics stated: those of the PrimeSense sensor were taken (525 px, centre 319.5, 239.5); --calibration FILE if not"
    return Camera(K=np.array(_PRIMESENSE), distortion=np.zeros(0)), (told,)


def _scan(path: Path, colour: Path | None, camera: Camera, options: AcquisitionOptions) -> Scan:
    depth = read_depth(path, options.depth_per_m)
    height, width = depth.shape
    K = camera.K
    says = f"{path} has {width} x {height} pixels, the intrinsics have their middle at ({K[0, 2]:.0f}, {K[1, 2]:.0f}): they are of another size"
    require(0.25 < K[0, 2] / width < 0.75 and 0.25 < K[1, 2] / height < 0.75, InputError, says)
    with np.errstate(invalid="ignore"):
        used = np.isfinite(depth) & (depth <= options.max_depth_m) & ~_torn(depth)
    says = f"{path}: {int(used.sum())} depths up to {options.max_depth_m:g} m (acquisition.max_depth_m); is acquisition.depth_per_m right?"
    require(int(used.sum()) >= _LEAST_POINTS, InputError, says)
    y, x = np.nonzero(used)
    z, place = depth[used], _normalised(np.stack([x, y], axis=1).astype(float), camera)
    ray = np.column_stack([place, np.ones(len(x))])
    axial = _AXIAL[0] + _AXIAL[1] * (z - _AXIAL[2]) ** 2
    picture = _picture(colour, depth.shape)
    columns: Mapping[str, ByteArray] = {} if picture is None else {"colour": picture[used]}
    return seen_from(np.zeros(3), ray * z[:, None], axial * np.linalg.norm(ray, axis=1), _ACROSS_PX * z / K[0, 0], **columns)


def _normalised(pixels: FloatArray, camera: Camera) -> FloatArray:
    if not camera.distortion.any():
        return (pixels - camera.K[:2, 2]) / np.diag(camera.K)[:2]
    import cv2

    return np.asarray(cv2.undistortPoints(pixels.reshape(-1, 1, 2), camera.K, camera.distortion), float).reshape(-1, 2)


def _torn(depth: FloatArray) -> BoolArray:
    """Pixels beside a step: they see the near and the far surface at once."""
    torn = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis)) > _STEP * np.minimum(*_both(depth, axis))
        torn[_slices(axis)[0]] |= step
        torn[_slices(axis)[1]] |= step
    return torn


def _both(depth: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    first, second = _slices(axis)
    return depth[first], depth[second]


def _slices(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    every = slice(None)
    return ((slice(None, -1), every), (slice(1, None), every)) if axis == 0 else ((every, slice(None, -1)), (every, slice(1, None)))


def _picture(colour: Path | None, shape: Sequence[int]) -> ByteArray | None:
    """The colours where they are of the same pixels as the depths."""
    if colour is None:
        return None
    picture = read_colour(colour)
    return picture if picture.shape[:2] == tuple(shape) else None
