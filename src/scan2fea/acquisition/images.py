"""Pictures from files: grey values, colours, depths, and what their headers say of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, require
from scan2fea.types import ByteArray, FloatArray, Value

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm"})
_LARGEST_PX = 400_000_000
_FULL_FRAME_MM = 36.0  # width that the EXIF tag "focal length in 35 mm film" refers to
_EXIF_IFD, _FOCAL_35, _MAKE, _MODEL = 0x8769, 0xA405, 0x010F, 0x0110

Picture = npt.NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class Header(Value):
    """width, height : px.   focal_px : from EXIF, nan where it says none.   camera : maker and model as EXIF says, or empty."""

    width: int
    height: int
    focal_px: float
    camera: str


def is_image(path: Path) -> bool:
    """Whether the name is that of a picture."""
    return path.suffix.lower() in SUFFIXES


def read_header(path: Path) -> Header:
    """Size and EXIF of a picture. Raises FormatError where it is none."""
    with _opened(path) as image:
        width, height = image.size
        exif = image.getexif()
        more = exif.get_ifd(_EXIF_IFD)
    try:
        film = float(more.get(_FOCAL_35, 0) or 0)
    except (TypeError, ValueError):
        film = 0.0
    camera = " ".join(str(exif.get(tag, "")).strip("\x00 ") for tag in (_MAKE, _MODEL)).strip()
    return Header(width=width, height=height, focal_px=film / _FULL_FRAME_MM * max(width, height) if film > 0 else float("nan"), camera=camera)


def read_grey(path: Path) -> ByteArray:
    """(h, w) grey values. Raises FormatError."""
    with _opened(path) as image:
        return np.asarray(_loaded(path, image, "L"), np.uint8)


def read_colour(path: Path) -> ByteArray:
    """(h, w, 3) red, green, blue. Raises FormatError."""
    with _opened(path) as image:
        return np.asarray(_loaded(path, image, "RGB"), np.uint8)


def read_depth(path: Path, per_m: float) -> FloatArray:
    """(h, w) metres, nan where the camera gave none (0). Raises FormatError for a picture of less than 16 bits or of colours."""
    with _opened(path) as image:
        says = f"{path} holds values of the kind {image.mode}: a depth image has one channel of 16 bits or more; export the depths as 16-bit PNG"
        require(image.mode in ("I;16", "I;16B", "I;16L", "I", "F"), FormatError, says)
        values = np.asarray(_loaded(path, image, ""), float)
    return np.asarray(np.where(np.isfinite(values) & (values > 0), values / per_m, np.nan))


def sharpness(grey: ByteArray) -> float:
    """How sharp a picture is: variance of its second differences over that of its first, 0 .. 4; blur takes the high frequencies away, whatever the
    contrast.
    """
    values = grey.astype(np.float32)
    first, second = np.diff(values, axis=1), np.diff(values, 2, axis=1)
    return float(second.var() / max(float(first.var()), 1e-12))


def _opened(path: Path) -> Any:
    from PIL import Image, UnidentifiedImageError

    try:
        image = Image.open(path)
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError) as error:
        raise FormatError(f"{path} cannot be read as a picture ({error}): export it again as JPEG or PNG") from error
    says = f"{path} has {image.size[0]} x {image.size[1]} pixels, at most {_LARGEST_PX:,} are read: reduce it"
    require(image.size[0] * image.size[1] <= _LARGEST_PX, FormatError, says)
    return image


def _loaded(path: Path, image: Any, mode: str) -> Any:
    try:
        return image.convert(mode) if mode else image.copy()
    except (OSError, ValueError, SyntaxError) as error:
        raise FormatError(f"{path} is damaged ({error}): copy or export it again") from error
