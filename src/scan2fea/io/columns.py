"""What a column is called: the names that formats and people use for the same thing, and what unnamed columns are taken for."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from scan2fea.types import FloatArray

# canonical name -> the other names it goes by, in lower case
_ALIASES = {
    "x": ("easting", "x_m", "point_x", "px", "x_coord"),
    "y": ("northing", "y_m", "point_y", "py", "y_coord"),
    "z": ("height", "elevation", "z_m", "point_z", "pz", "z_coord"),
    "nx": ("normal_x", "normalx", "n_x", "x_normal"),
    "ny": ("normal_y", "normaly", "n_y", "y_normal"),
    "nz": ("normal_z", "normalz", "n_z", "z_normal"),
    "red": ("r", "diffuse_red", "rf"),
    "green": ("g", "diffuse_green", "gf"),
    "blue": ("b", "diffuse_blue", "bf"),
    "intensity": ("i", "reflectance", "reflectivity", "remission", "scalar"),
    "label": ("labels",),
    "ring": ("laser_id", "laser_number"),
    "time": ("time_s",),
    "sensor_x": ("sensorx",),
    "sensor_y": ("sensory",),
    "sensor_z": ("sensorz",),
}
_CANONICAL = {alias: name for name, aliases in _ALIASES.items() for alias in (name, *aliases)}
_FEWEST_ROWS = 3  # that tell a number of the point from a coordinate
_UNIT_LENGTH_TOLERANCE = 0.01  # normals written with three digits


def canonical(name: str) -> str:
    """The one name of a column: case, quotes, a unit in brackets and the prefix `scalar_` of CloudCompare do not count."""
    plain = re.sub(r"[\[(].*[\])]$", "", name.strip().strip("\"'").lstrip("/#").strip()).strip().lower()
    plain = plain.removeprefix("scalar_") or plain
    return _CANONICAL.get(plain, plain)


def find(names: Sequence[str], wanted: str) -> str | None:
    """The first column that goes by the canonical name, or None."""
    return next((name for name in names if canonical(name) == wanted), None)


def find_all(names: Sequence[str], *wanted: str) -> tuple[str, ...] | None:
    """The columns of all these canonical names, or None where one is missing."""
    found = tuple(find(names, name) for name in wanted)
    return tuple(name for name in found if name is not None) if None not in found else None


def guessed(sample: FloatArray, count: int) -> tuple[str, ...]:
    """Names for `count` columns without a header, told from the first rows.

    sample : (k, count), nan where a value is no number. Three columns of unit length are normals, three of whole numbers 0..255
    colours; a single column after normals is a label, one before colours or alone an intensity; the rest is c4, c5, ...
    """
    names = ["x", "y", "z"]
    while len(names) < count:
        k, left = len(names), count - len(names)
        if left >= 3 and "nx" not in names and _are_unit(sample[:, k : k + 3]):
            names += ["nx", "ny", "nz"]
        elif left >= 3 and "red" not in names and _are_bytes(sample[:, k : k + 3]):
            names += ["red", "green", "blue"]
        elif count == 4 or (left >= 4 and k == 3 and _are_bytes(sample[:, k + 1 : k + 4])):
            names.append("intensity")
        elif left == 1 and names[-1] == "nz":
            names.append("label")
        else:
            names.append(f"c{k + 1}")
    return tuple(names)


def has_number_before(sample: FloatArray) -> bool:
    """Whether the number of the point stands before x, y, z in columns without titles.

    sample : (k, count) first rows, nan where a value is no number. It goes up by one from row to row; a coordinate does so too only in a
    range image, where not all three columns after it have fractions.
    """
    if sample.shape[1] < 4 or len(sample) < _FEWEST_ROWS:
        return False
    return bool((np.diff(sample[:, 0]) == 1.0).all()) and bool((sample[:, 1:4] != np.floor(sample[:, 1:4])).any(axis=0).all())


def _are_unit(vectors: FloatArray) -> bool:
    length = np.sqrt((vectors**2).sum(axis=1))
    is_unit = np.abs(length - 1) <= _UNIT_LENGTH_TOLERANCE
    return bool(len(length)) and bool((is_unit | (length == 0)).all()) and 2 * int(is_unit.sum()) >= len(length)


def _are_bytes(values: FloatArray) -> bool:
    return bool(len(values)) and bool(((values >= 0) & (values <= 255) & (values == np.floor(values))).all())
