"""Where each input stood, from a file. The format is known by its content, never guessed from a tie.

==============  ==========================================  =================================================================
format          one line                                    meaning
==============  ==========================================  =================================================================
Stanford .conf  ``bmesh FILE tx ty tz qx qy qz qw``         x_world = R(conj(q)) x + t, matched by file name
graph           ``v_NUMBER tx ty tz qx qy qz qw``           x_world = R(q) x + t, matched by the last number in the file name
TUM             ``time tx ty tz qx qy qz qw``               x_world = R(q) x + t, one row per input, in input order
KITTI           12 numbers                                  upper three rows of the matrix, one row per input, in input order; of more rows than
                                                            inputs, row k (from 0) for a file whose name is the number k (000042.bin)
matrices        4 rows of 4 numbers each, or .npy           x_world = T x, one per input, in input order
==============  ==========================================  =================================================================
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scan2fea.errors import FormatError, InputError, require
from scan2fea.kernel.transforms import inverse, is_rigid, quaternion_to_matrix, rigid
from scan2fea.types import FloatArray, Trajectory

_LARGEST_BYTES = 100_000_000  # a file of poses is small: what is larger is something else


def read_poses(path: Path, names: Sequence[str], calibration: Path | None = None) -> tuple[FloatArray | None, ...]:
    """T_world_frame (4, 4) of each input, None for one that the file does not name.

    names : file names of the inputs, in input order.   calibration : calib.txt of KITTI, whose line `Tr` takes the points to the camera that the
    poses are of; the world is then that of the points of row 0.
    Raises InputError where the file cannot be read, names none of the inputs or holds another
    number of poses than there are inputs; FormatError where a line is not what its format says.
    """
    found = _read(path, names)
    if calibration is None:
        return found
    T_camera_frame = read_calibration(calibration)
    return tuple(None if T is None else inverse(T_camera_frame) @ T @ T_camera_frame for T in found)


def read_calibration(path: Path) -> FloatArray:
    """T_camera_frame (4, 4) of a calib.txt of KITTI: the 12 numbers after `Tr:` or `Tr_velo_to_cam:`. Raises InputError, FormatError."""
    require(path.is_file(), InputError, f"{path}: no such file of calibration")
    require(path.stat().st_size <= _LARGEST_BYTES, FormatError, f"{path}: {path.stat().st_size} bytes is no file of calibration")
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: is no text; the calibration of KITTI is calib.txt") from error
    for i, line in enumerate(lines, start=1):
        name, colon, numbers = line.partition(":")
        if colon and name.strip() in ("Tr", "Tr_velo_to_cam"):
            values = _numbers(path, i, numbers.split())
            require(len(values) == 12, FormatError, f"{path}, line {i}: {name.strip()} has {len(values)} numbers, 12 are needed")
            return _matrices(path, values.reshape(1, 3, 4))[0]
    raise FormatError(f"{path}: has no line Tr: or Tr_velo_to_cam:, which takes the points to the camera")


def read_trajectory(path: Path) -> Trajectory | None:
    """The way of one sensor from a file of the TUM form; None for any other file of poses.

    Raises FormatError, for times that do not rise too: which pose was when is then not known.
    """
    if not path.is_file() or path.suffix.lower() == ".npy" or path.stat().st_size > _LARGEST_BYTES:
        return None
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        return None
    rows = [(i, line.split()) for i, line in enumerate(lines, start=1) if line.strip() and not line.lstrip().startswith("#")]
    if len(rows) < 2 or any(len(words) != 8 or words[0].startswith("v") for _, words in rows):
        return None
    time = np.array([_numbers(path, i, words[:1])[0] for i, words in rows])
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        (line, _), late, early = rows[int(back[0]) + 1], float(time[back[0]]), float(time[back[0] + 1])
        raise FormatError(f"{path}, line {line}: its time {early:g} s is not after the {late:g} s before it: sort the poses by time")
    T = np.array([_quaternion_pose(path, i, words[1:]) for i, words in rows])
    return Trajectory(T_world_frame=T, placed=np.ones(len(T), bool), time_s=time)


def _read(path: Path, names: Sequence[str]) -> tuple[FloatArray | None, ...]:
    require(path.is_file(), InputError, f"{path}: no such file of poses")
    require(path.stat().st_size <= _LARGEST_BYTES, FormatError, f"{path}: {path.stat().st_size} bytes is no file of poses")
    if path.suffix.lower() == ".npy":
        return _in_order(path, _npy(path), names)
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: is no text; poses come as bun.conf, TUM, KITTI, graph.txt, 4 x 4 matrices or .npy") from error
    lines = [(i, line.split()) for i, line in enumerate(text.splitlines(), start=1) if line.strip() and not line.lstrip().startswith("#")]
    if any(words[0] == "bmesh" for _, words in lines):
        named = {words[1]: _quaternion_pose(path, i, words[2:], conjugate=True) for i, words in lines if words[0] == "bmesh" and len(words) > 1}
        return _by_name(path, named, names)
    if any(re.fullmatch(r"v_?\d+", words[0]) for _, words in lines):
        numbered = {int(words[0].lstrip("v_")): _quaternion_pose(path, i, words[1:]) for i, words in lines if re.fullmatch(r"v_?\d+", words[0])}
        return _by_number(path, numbered, names)
    rows = _rows(path, lines)
    if len(lines[0][1]) == 12 and len(rows) > len(names) and all(Path(name).stem.isdigit() for name in names):
        return _by_row(path, rows, names)
    return _in_order(path, rows, names)


def _by_row(path: Path, rows: Sequence[FloatArray], names: Sequence[str]) -> tuple[FloatArray | None, ...]:
    numbers = [int(Path(name).stem) for name in names]
    outside = [name for name, k in zip(names, numbers, strict=True) if k >= len(rows)]
    require(not outside, InputError, f"{path}: holds {len(rows)} poses, none for {', '.join(outside[:3])}: it is of other frames")
    return tuple(rows[k] for k in numbers)


def _quaternion_pose(path: Path, line: int, words: Sequence[str], conjugate: bool = False) -> FloatArray:
    values = _numbers(path, line, words)
    require(len(values) == 7, FormatError, f"{path}, line {line}: a pose is tx ty tz qx qy qz qw, found {len(values)} numbers")
    q = values[3:]
    require(np.linalg.norm(q) > 0, FormatError, f"{path}, line {line}: the quaternion is zero")
    R = quaternion_to_matrix(q)
    return rigid(R.T if conjugate else R, values[:3])


def _numbers(path: Path, line: int, words: Sequence[str], hint: str = "") -> FloatArray:
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise FormatError(f"{path}, line {line}: {error}{hint}") from error
    require(np.isfinite(values).all(), FormatError, f"{path}, line {line}: holds a number that is not finite")
    return values


def _rows(path: Path, lines: Sequence[tuple[int, list[str]]]) -> list[FloatArray]:
    """Poses of a file of plain numbers: 8 a row (TUM), 12 a row (KITTI) or 4 x 4."""
    hint = "; a row of poses holds numbers alone, or begins with bmesh NAME (bun.conf) or v_NUMBER (graph.txt)"
    rows = [(i, _numbers(path, i, words, hint)) for i, words in lines]
    widths = {len(values) for _, values in rows}
    fits = len(widths) == 1 and widths <= {4, 8, 12, 16}
    require(fits, FormatError, f"{path}: rows of {sorted(widths)} numbers; poses have 4 (x 4 rows), 8, 12 or 16")
    width = widths.pop()
    if width == 8:
        return [_quaternion_pose(path, i, [str(v) for v in values[1:].tolist()]) for i, values in rows]
    if width == 4:
        require(len(rows) % 4 == 0, FormatError, f"{path}: {len(rows)} rows of 4 numbers are not whole 4 x 4 matrices")
        stacked = np.array([values for _, values in rows]).reshape(-1, 4, 4)
    else:
        stacked = np.array([values for _, values in rows]).reshape(len(rows), width // 4, 4)
    return _matrices(path, stacked)


def _npy(path: Path) -> list[FloatArray]:
    try:
        stacked = np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise FormatError(f"{path}: cannot be read as .npy ({error})") from error
    fits = stacked.ndim in (2, 3) and stacked.shape[-2:] in ((4, 4), (3, 4)) and np.issubdtype(stacked.dtype, np.number)
    require(fits, FormatError, f"{path}: an array of shape {stacked.shape}; poses are (4, 4) or (k, 4, 4)")
    return _matrices(path, np.asarray(stacked, float).reshape(-1, *stacked.shape[-2:]))


def _matrices(path: Path, stacked: FloatArray) -> list[FloatArray]:
    poses = []
    for number, T in enumerate(stacked):
        full = T if len(T) == 4 else np.vstack([T, [0.0, 0.0, 0.0, 1.0]])
        require(is_rigid(full), FormatError, f"{path}: matrix {number} is no rigid motion (a rotation, a translation, last row 0 0 0 1)")
        poses.append(np.asarray(full, float))
    return poses


def _in_order(path: Path, poses: Sequence[FloatArray], names: Sequence[str]) -> tuple[FloatArray | None, ...]:
    says = f"{path}: holds {len(poses)} poses for {len(names)} inputs; it must hold one per input, in input order"
    require(len(poses) == len(names), InputError, says)
    return tuple(poses)


def _by_name(path: Path, named: dict[str, FloatArray], names: Sequence[str]) -> tuple[FloatArray | None, ...]:
    found = tuple(named.get(Path(name).name) for name in names)
    require(any(T is not None for T in found), InputError, f"{path}: names none of the inputs; it has {', '.join(list(named)[:5])}")
    return found


def _by_number(path: Path, numbered: dict[int, FloatArray], names: Sequence[str]) -> tuple[FloatArray | None, ...]:
    digits = [re.findall(r"\d+", Path(name).stem) for name in names]
    found = tuple(numbered.get(int(d[-1])) if d else None for d in digits)
    says = f"{path}: numbers none of the inputs; the last number in a file's name must be a vertex of it"
    require(any(T is not None for T in found), InputError, says)
    return found
