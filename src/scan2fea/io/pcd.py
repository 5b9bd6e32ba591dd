"""PCD, the format of the Point Cloud Library: ascii, binary and binary_compressed (LZF by field).

VIEWPOINT tells where the sensor stood. Points are taken as already in the world frame, as PCL writes them: its rotation is not applied, and a
translation of zero is the default of the format and means unknown.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import EmptyScanError, FormatError, require
from scan2fea.io import columns
from scan2fea.io.numbers import TextTable, forget, mapped, number, shown
from scan2fea.io.source import ROWS_PER_PIECE, Column, Piece, Source
from scan2fea.io.tokens import WHITESPACE
from scan2fea.kernel.jit import jit
from scan2fea.types import ByteArray, FloatArray

_LONGEST_HEADER = 1 << 16
_TYPES = {
    ("F", 4): "<f4", ("F", 8): "<f8", ("I", 1): "i1", ("I", 2): "<i2", ("I", 4): "<i4", ("I", 8): "<i8",
    ("U", 1): "u1", ("U", 2): "<u2", ("U", 4): "<u4", ("U", 8): "<u8",
}  # fmt: skip
_MOST_PER_BYTE = 256  # LZF: three bytes stand for at most 264


@dataclass(frozen=True)
class _Field:
    name: str
    type: str
    count: int

    @property
    def bytes(self) -> int:
        return np.dtype(self.type).itemsize * self.count


@dataclass(frozen=True)
class _Header:
    path: Path
    fields: tuple[_Field, ...]
    n: int
    viewpoint: FloatArray
    encoding: str
    start: int

    @property
    def row_bytes(self) -> int:
        return sum(field.bytes for field in self.fields)


def open_pcd(path: Path, size: int) -> Source:
    """A PCD file. Raises FormatError where the header is not sound or promises more than the file can hold."""
    data = mapped(path)
    header = _header(path, data)
    names = tuple(field.name for field in header.fields)
    require(columns.find_all(names, "x", "y", "z"), FormatError, f"{path}: its FIELDS are {' '.join(names)}: x, y and z are needed")
    require(header.n >= 0, FormatError, f"{path} promises {header.n} points: its header is damaged")
    if header.n == 0:
        raise EmptyScanError(f"{path} promises 0 points: export it again")
    left = size - header.start
    most = {"ascii": left // (2 * len(names)) + 1, "binary": left // header.row_bytes}.get(header.encoding, left * _MOST_PER_BYTE // header.row_bytes)
    require(
        header.n <= most,
        FormatError,
        f"{path} promises {header.n} points, but its {size} bytes hold at most {most}: it is cut off or damaged",
    )
    sensor = header.viewpoint if bool((header.viewpoint != 0).any()) else None
    coloured = tuple(c for name in names for c in (("red", "green", "blue") if name.lower() in ("rgb", "rgba") else (name,)))

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        for fields in _READERS[header.encoding](header, data, wanted):
            yield _piece(header, fields, wanted, sensor)

    return Source(columns=coloured, pieces=pieces, n_points=header.n, pose_given=sensor is not None)


def _piece(header: _Header, read: dict[str, Column], wanted: frozenset[str], sensor: FloatArray | None) -> Piece:
    xyz = columns.find_all(tuple(field.name for field in header.fields), "x", "y", "z") or ()
    points = np.empty((len(read[xyz[0]]), 3))
    for k, name in enumerate(xyz):
        points[:, k] = read[name]
    kept: dict[str, Column] = {}
    for name, column in read.items():
        if name.lower() in ("rgb", "rgba"):
            kept.update(zip(("red", "green", "blue"), _unpacked(column), strict=True))
        else:
            kept[name] = column.astype(column.dtype.newbyteorder("="))
    return Piece(points=points, columns={name: column for name, column in kept.items() if name in wanted}, sensor=sensor)


def _unpacked(packed: Column) -> tuple[Column, Column, Column]:
    """Red, green and blue out of 0xAARRGGBB, kept in the bits of a float32 or an integer."""
    if packed.dtype.kind == "f":
        bits = packed.astype(np.float32).view(np.uint32)
    else:
        bits = packed.astype(np.int64).astype(np.uint32)
    return tuple(((bits >> shift) & 255).astype(np.uint8) for shift in (16, 8, 0))  # type: ignore[return-value]


def _header(path: Path, data: ByteArray) -> _Header:
    head = data[:_LONGEST_HEADER].tobytes()
    words: dict[str, list[str]] = {}
    position = 0
    while "DATA" not in words:
        end = head.find(b"\n", position)
        require(end >= 0, FormatError, f"{path}: no line DATA within its first {len(head)} bytes: the header is cut off or damaged")
        line = head[position:end].decode("latin-1").strip()
        position = end + 1
        if line and not line.startswith("#"):
            key, *values = line.split()
            require(
                key.isalpha() and key.isupper(), FormatError, f"{path}: its header holds {shown(line.encode())}, which is not PCD: export it again"
            )
            words[key] = values
    return _sound(path, words, position)


def _sound(path: Path, words: dict[str, list[str]], start: int) -> _Header:
    names = words.get("FIELDS") or words.get("COLUMNS") or []
    require(names, FormatError, f"{path}: its header has no FIELDS: export it again")
    sizes, types = words.get("SIZE", ["4"] * len(names)), words.get("TYPE", ["F"] * len(names))
    counts = words.get("COUNT", ["1"] * len(names))
    require(
        len(names) == len(sizes) == len(types) == len(counts),
        FormatError,
        f"{path}: FIELDS, SIZE, TYPE and COUNT have {len(names)}, {len(sizes)}, {len(types)} and {len(counts)} entries: export it again",
    )
    fields = []
    for name, size, kind, count in zip(_distinct(names), sizes, types, counts, strict=True):
        code = _TYPES.get((kind.upper(), int(size) if size.isdigit() else 0))
        if code is None or not count.isdigit() or int(count) > 1 << 16:
            raise FormatError(f"{path}: field {name} of TYPE {kind}, SIZE {size}, COUNT {count} is not PCD: export it again")
        fields.append(_Field(name, code, int(count)))
    encoding = " ".join(words["DATA"]).lower()
    require(encoding in _READERS, FormatError, f"{path}: DATA {encoding!r} is not known: ascii, binary or binary_compressed is needed")
    return _Header(path, tuple(fields), _n_points(path, words), _viewpoint(path, words), encoding, start)


def _distinct(names: list[str]) -> list[str]:
    return [name if name != "_" and name not in names[:k] else f"{name}{k + 1}" for k, name in enumerate(names)]


def _n_points(path: Path, words: dict[str, list[str]]) -> int:
    try:
        if "POINTS" in words:
            return int(words["POINTS"][0])
        return int(words["WIDTH"][0]) * int(words.get("HEIGHT", ["1"])[0])
    except (KeyError, IndexError, ValueError) as error:
        raise FormatError(f"{path}: its header states no number of POINTS: export it again") from error


def _viewpoint(path: Path, words: dict[str, list[str]]) -> FloatArray:
    values = [number(word.encode()) for word in words.get("VIEWPOINT", ["0"] * 7)]
    position = [value for value in values[:3] if value is not None and np.isfinite(value)]
    require(len(position) == 3, FormatError, f"{path}: VIEWPOINT {' '.join(words.get('VIEWPOINT', []))} is not seven numbers: export it again")
    return np.array(position, float)


def _ascii(header: _Header, data: ByteArray, wanted: frozenset[str]) -> Iterator[dict[str, Column]]:
    names = tuple(field.name if k == 0 else f"{field.name}[{k}]" for field in header.fields for k in range(field.count))
    first = re.search(rb"\S[^\n]*", data[header.start : header.start + _LONGEST_HEADER].tobytes())
    separator = ord(",") if first and b"," in first.group() else WHITESPACE
    table = TextTable(header.path, data, header.start, len(data), separator, ord("."), len(names), names)
    kinds = {field.name: field.type for field in header.fields}
    position, left = header.start, header.n
    while left:
        values, position = table.rows(position, min(left, ROWS_PER_PIECE), tuple(range(len(names))))
        left -= len(values)
        require(
            left == 0 or len(values) == ROWS_PER_PIECE,
            FormatError,
            f"{header.path} promises {header.n} points, but holds {header.n - left}: it is cut off; export it again",
        )
        yield {name: _typed(values[:, k], name, kinds) for k, name in enumerate(names) if name in kinds}
        forget(data)


def _typed(values: FloatArray, name: str, kinds: dict[str, str]) -> Column:
    """Packed colours back in the type that holds their bits."""
    if name.lower() in ("rgb", "rgba"):
        whole = bool((np.floor(values) == values).all()) and kinds[name][-2] == "f" and bool((np.abs(values) >= 1).any())
        return values.astype(np.int64) if whole or kinds[name][-2] != "f" else values.astype(np.float32)
    return values


def _binary(header: _Header, data: ByteArray, wanted: frozenset[str]) -> Iterator[dict[str, Column]]:
    dtype: Any = np.dtype([(f"f{k}", field.type, (field.count,)) for k, field in enumerate(header.fields)])
    for row in range(0, header.n, ROWS_PER_PIECE):
        n = min(ROWS_PER_PIECE, header.n - row)
        start = header.start + row * dtype.itemsize
        rows = data[start : start + n * dtype.itemsize].view(dtype)
        yield {field.name: rows[f"f{k}"][:, 0] for k, field in enumerate(header.fields) if field.count}
        forget(data)


def _compressed(header: _Header, data: ByteArray, wanted: frozenset[str]) -> Iterator[dict[str, Column]]:
    packed, whole = (int(v) for v in data[header.start : header.start + 8].view("<u4")) if len(data) >= header.start + 8 else (0, 0)
    begin = header.start + 8
    expected = header.n * header.row_bytes
    require(
        whole == expected and begin + packed <= len(data),
        FormatError,
        f"{header.path} promises {packed} bytes that unpack to {whole}, but {len(data) - begin} are there and {expected} are needed: it is damaged",
    )
    out = np.empty(whole, np.uint8)
    require(
        _decompress(data[begin : begin + packed], out) == whole, FormatError, f"{header.path}: its compressed points are damaged: export it again"
    )
    read: dict[str, Column] = {}
    position = 0
    for field in header.fields:
        block = out[position : position + header.n * field.bytes]
        position += len(block)
        if field.count:
            read[field.name] = block.view(field.type)[:: field.count]
    yield read


_READERS = {"ascii": _ascii, "binary": _binary, "binary_compressed": _compressed}


@jit
def _decompress(packed: ByteArray, out: ByteArray) -> int:
    """LZF (Lehmann): literal runs and back references; returns the bytes written, -1 where the stream is not sound."""
    i, o = 0, 0
    n, m = len(packed), len(out)
    while i < n:
        control = int(packed[i])
        i += 1
        if control < 32:
            length = control + 1
            if i + length > n or o + length > m:
                return -1
            for k in range(length):
                out[o + k] = packed[i + k]
            i += length
        else:
            length = control >> 5
            if length == 7:
                if i >= n:
                    return -1
                length += int(packed[i])
                i += 1
            if i >= n:
                return -1
            source = o - ((control & 31) << 8) - int(packed[i]) - 1
            i += 1
            length += 2
            if source < 0 or o + length > m:
                return -1
            for k in range(length):
                out[o + k] = out[source + k]
        o += length
    return o
