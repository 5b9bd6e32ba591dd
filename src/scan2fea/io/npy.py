"""NPY and NPZ of NumPy: arrays of numbers, never of objects."""

from __future__ import annotations

import ast
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, InputError, require
from scan2fea.io import columns
from scan2fea.io.numbers import forget
from scan2fea.io.source import ROWS_PER_PIECE, Column, Piece, Source
from scan2fea.units import BYTES_PER_GIB

Array = npt.NDArray[Any]
_LONGEST_HEADER = 10_000
_LARGEST_ENTRY = 4 * BYTES_PER_GIB  # entries of an archive are unpacked into memory
# names of arrays of several columns in an archive, and the columns they stand for
_GROUPS = {
    "points": ("x", "y", "z"), "xyz": ("x", "y", "z"), "positions": ("x", "y", "z"), "vertices": ("x", "y", "z"), "pos": ("x", "y", "z"),
    "normals": ("nx", "ny", "nz"), "normal": ("nx", "ny", "nz"),
    "colors": ("red", "green", "blue"), "colours": ("red", "green", "blue"), "rgb": ("red", "green", "blue"), "color": ("red", "green", "blue"),
    "sensor": ("sensor_x", "sensor_y", "sensor_z"), "sensors": ("sensor_x", "sensor_y", "sensor_z"),
}  # fmt: skip


def open_npy(path: Path, size: int) -> Source:
    """An array of (n, 3) or more columns, or of records with x, y and z. Raises FormatError, InputError."""
    with path.open("rb") as handle:
        dtype, shape, is_fortran, start = _array_header(handle, f"{path}")
    n_bytes = int(np.prod([dtype.itemsize, *shape], dtype=object))
    require(
        n_bytes <= size - start,
        FormatError,
        f"{path} promises an array of {shape} ({n_bytes} bytes), but holds {size - start} bytes of it: it is cut off or damaged",
    )
    array: Array = np.memmap(path, dtype, "r", start, shape, "F" if is_fortran else "C") if n_bytes else np.empty(shape, dtype)
    return _source(path, _columns_of(path, "points", array))


def open_npz(path: Path, size: int) -> Source:
    """An archive of arrays: points (or xyz, or x, y and z), normals, colors, intensity, label, sensor_x, sensor_y, sensor_z."""
    named: dict[str, Column] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            members = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist() if entry.filename.endswith(".npy")}
            require(members, FormatError, f"{path} holds no arrays (.npy): save it with numpy.savez")
            for name, entry in members.items():
                array = _entry(path, archive, entry)
                if len(members) == 1 or name.lower() in _GROUPS or (array.ndim == 1 and array.dtype.kind in "fiub"):
                    named.update(_columns_of(path, "points" if len(members) == 1 else name, array))
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError, RuntimeError) as error:
        raise FormatError(f"{path} is no sound archive ({error}): save it again") from error
    xyz = columns.find_all(tuple(named), "x", "y", "z")
    n = len(named[xyz[0]]) if xyz else 0
    other = {name: len(column) for name, column in named.items() if len(column) != n}
    wrong = [name for name in other if columns.canonical(name) in _KNOWN]
    require(
        not xyz or not wrong,
        FormatError,
        f"{path}: {wrong[:3]} have {[other[k] for k in wrong[:3]]} rows, the points {n}: one row per point is needed",
    )
    return _source(path, {name: column for name, column in named.items() if not xyz or name not in other})


_KNOWN = ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "intensity", "label", "sensor_x", "sensor_y", "sensor_z")


def _source(path: Path, named: Mapping[str, Column]) -> Source:
    names = tuple(named)
    xyz = columns.find_all(names, "x", "y", "z")
    if xyz is None:
        raise InputError(f"{path}: its columns are {', '.join(names)[:200] or 'none'}: (n, 3) points, or columns x, y and z, are needed")
    n = len(named[xyz[0]])

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        for start in range(0, n, ROWS_PER_PIECE):
            rows = slice(start, start + ROWS_PER_PIECE)
            points = np.stack([np.asarray(named[name][rows], float) for name in xyz], axis=1)
            kept = {name: named[name][rows].astype(named[name].dtype.newbyteorder("=")) for name in names if name in wanted}
            yield Piece(points=points, columns=kept)
            forget(named[xyz[0]])

    return Source(columns=names, pieces=pieces, n_points=n)


def _array_header(handle: IO[bytes], where: str) -> tuple[np.dtype[Any], tuple[int, ...], bool, int]:
    """dtype, shape, order and first byte of an array. Raises FormatError for what is not an array of numbers."""
    try:
        version = np.lib.format.read_magic(handle)
        width = 2 if version == (1, 0) else 4
        length = int.from_bytes(handle.read(width), "little")
        header = ast.literal_eval(handle.read(min(length, _LONGEST_HEADER)).decode("latin-1").strip())
        dtype, shape, is_fortran = np.lib.format.descr_to_dtype(header["descr"]), tuple(header["shape"]), bool(header["fortran_order"])
    except (ValueError, SyntaxError, TypeError, KeyError, RecursionError, OverflowError, MemoryError) as error:
        raise FormatError(f"{where} is no sound NPY array ({' '.join(str(error).split())[:100]}): save it again with numpy.save") from error
    require(not dtype.hasobject, FormatError, f"{where} holds Python objects, which are never loaded: save numbers")
    require(all(isinstance(n, int) and n >= 0 for n in shape), FormatError, f"{where} promises an array of shape {shape}: its header is damaged")
    return dtype, shape, is_fortran, handle.tell()


def _entry(path: Path, archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Array:
    where = f"{path} ({entry.filename})"
    require(
        entry.file_size <= _LARGEST_ENTRY,
        InputError,
        f"{where} unpacks to {entry.file_size} bytes, at most {_LARGEST_ENTRY} are read: save it as .npy",
    )
    with archive.open(entry) as handle:
        dtype, shape, is_fortran, start = _array_header(handle, where)
        n_bytes = int(np.prod([dtype.itemsize, *shape], dtype=object))
        require(
            n_bytes <= entry.file_size - start,
            FormatError,
            f"{where} promises an array of {shape} ({n_bytes} bytes), but holds {entry.file_size - start}: it is cut off or damaged",
        )
        content = handle.read(n_bytes)
    require(len(content) == n_bytes, FormatError, f"{where} is cut off: save it again")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if is_fortran else "C")


def _columns_of(path: Path, name: str, array: Array) -> dict[str, Column]:
    """The columns of one array: records by their names, (n, 3) and wider by what its name or its values tell."""
    if array.dtype.names:
        require(array.ndim == 1, FormatError, f"{path} ({name}) has shape {array.shape}: a list of records is needed")
        fields = [(field, array[field]) for field in array.dtype.names]
        return {k: v for field, column in fields for k, v in _split(field, column).items()}
    require(array.dtype.kind in "fiub", FormatError, f"{path} ({name}) holds {array.dtype}, not numbers: save numbers")
    if array.ndim == 1:
        return {name: array}
    require(array.ndim == 2, FormatError, f"{path} ({name}) has shape {array.shape}: (n, 3) or more columns are needed")
    if name.lower() in _GROUPS and not (name.lower() == "points" and array.shape[1] > 3):
        return _split(name, array)
    require(array.shape[1] >= 3, FormatError, f"{path} ({name}) has shape {array.shape}: (n, 3) or more columns are needed")
    return dict(zip(columns.guessed(np.asarray(array[:200], float), array.shape[1]), array.T, strict=True))


def _split(name: str, array: Array) -> dict[str, Column]:
    if array.ndim == 1:
        return {name: array}
    titles = _GROUPS.get(name.lower(), ())
    width = array.shape[1] if array.ndim == 2 else 0
    return {titles[k] if k < len(titles) else f"{name}_{k + 1}": array[:, k] for k in range(width)}
