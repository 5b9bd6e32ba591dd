"""PLY (Turk 1994): text and both byte orders, any property types, lists anywhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, require
from scan2fea.io import columns
from scan2fea.io.numbers import TextTable, flat_numbers, forget, mapped, shown
from scan2fea.io.polygons import triangulated
from scan2fea.io.source import ROWS_PER_PIECE, Column, Piece, Source
from scan2fea.io.tokens import WHITESPACE
from scan2fea.kernel.jit import jit
from scan2fea.types import ByteArray, FloatArray, IntArray

_LONGEST_HEADER = 1 << 20
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
    "int64": "i8", "uint64": "u8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LIST_NAMES = ("vertex_indices", "vertex_index")
MISS_COLUMNS = ("sensor_x", "sensor_y", "sensor_z", "direction_x", "direction_y", "direction_z")


@dataclass(frozen=True)
class _Property:
    """type : code of numpy.   count : code of the length of a list, "" for a number."""

    name: str
    type: str
    count: str = ""


@dataclass(frozen=True)
class _Element:
    name: str
    rows: int
    properties: tuple[_Property, ...]

    @property
    def has_lists(self) -> bool:
        return any(p.count for p in self.properties)

    @property
    def smallest_row(self) -> int:
        """Bytes of a row whose lists are empty (binary)."""
        return sum(np.dtype(p.count or p.type).itemsize for p in self.properties)


@dataclass(frozen=True)
class _Header:
    """columns : of the range image that the file is, 0 where it states none."""

    path: Path
    order: str
    elements: tuple[_Element, ...]
    start: int
    columns: int

    def number_of(self, name: str) -> int | None:
        return next((k for k, element in enumerate(self.elements) if element.name == name), None)


def open_ply(path: Path, size: int) -> Source:
    """A PLY file. Raises FormatError where the header is not sound or promises more than the file can hold."""
    data = mapped(path)
    header = _header(path, data)
    place = header.number_of("vertex")
    if place is None:
        raise FormatError(f"{path} has no element 'vertex': it holds no points")
    vertex = header.elements[place]
    names = tuple(p.name for p in vertex.properties)
    require(columns.find_all(names, "x", "y", "z"), FormatError, f"{path}: its vertices have {', '.join(names)}: properties x, y and z are needed")
    _require_room(header, size)
    body = _Body(header, data)

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        yield from body.vertices(place, wanted)
        yield from body.misses(wanted & frozenset(names))

    face = header.number_of("face")
    has_faces = face is not None and header.elements[face].rows > 0 and _face_list(header.elements[face]) is not None
    faces = (lambda: body.faces(face or 0)) if has_faces else None
    return Source(columns=names, pieces=pieces, n_points=vertex.rows, faces=faces, grid=cache(body.grid))


def _face_list(face: _Element) -> int | None:
    return next((k for k, p in enumerate(face.properties) if p.count and p.name in _LIST_NAMES), None)


def _header(path: Path, data: ByteArray) -> _Header:
    head = data[:_LONGEST_HEADER].tobytes()
    end = head.find(b"end_header")
    line_end = head.find(b"\n", end)
    require(end >= 0 and line_end >= 0, FormatError, f"{path}: no end_header within its first {len(head)} bytes: the header is cut off or damaged")
    order, wide = None, 0
    elements: list[_Element] = []
    for line in head[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            if words[:2] == ["obj_info", "num_cols"] and words[-1].isdigit():
                wide = int(words[-1])
            continue
        if words[0] == "format" and len(words) >= 2 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].lstrip("+-").isdigit():
            elements.append(_Element(words[1], int(words[2]), ()))
            require(elements[-1].rows >= 0, FormatError, f"{path} promises {words[2]} rows of {words[1]}: its header is damaged")
        elif words[0] == "property" and elements and (added := _property(words)) is not None:
            last = elements.pop()
            elements.append(_Element(last.name, last.rows, (*last.properties, added)))
        else:
            raise FormatError(f"{path}: its header holds {shown(line.encode())}, which is not PLY: export it again")
    if order is None:
        raise FormatError(f"{path}: its header has no line 'format': ascii, binary_little_endian or binary_big_endian is needed")
    return _Header(path, order, tuple(elements), line_end + 1, wide)


def _property(words: list[str]) -> _Property | None:
    if len(words) == 3 and words[1] in _TYPES:
        return _Property(words[2], _TYPES[words[1]])
    if len(words) == 5 and words[1] == "list" and words[3] in _TYPES and _TYPES.get(words[2], "f")[0] in "iu":
        return _Property(words[4], _TYPES[words[3]], _TYPES[words[2]])
    return None


def _require_room(header: _Header, size: int) -> None:
    """Refuse a header that promises more rows than the bytes after it can hold, before anything is allocated."""
    left = size - header.start
    for element in header.elements:
        least = element.smallest_row if header.order else max(1, 2 * len(element.properties) - 1)
        most = left // max(least, 1)
        if header.order or element.name in ("vertex", "face"):
            require(
                element.rows <= most + (0 if header.order else 1),
                FormatError,
                f"{header.path} promises {element.rows} rows of {element.name}, but its {size} bytes hold at most {most}: it is cut off or damaged",
            )
        left -= element.rows * least


@dataclass(frozen=True)
class _Body:
    """The rows after the header."""

    header: _Header
    data: ByteArray

    def vertices(self, place: int, wanted: frozenset[str]) -> Iterator[Piece]:
        vertex = self.header.elements[place]
        before = any(element.has_lists for element in self.header.elements[:place])
        if vertex.has_lists or (before and not self.header.order):
            yield from self._listed(vertex, place, wanted)
        elif self.header.order:
            yield from self._binary(vertex, place, wanted)
        else:
            yield from self._text(vertex, place, wanted)

    def misses(self, wanted: frozenset[str]) -> Iterator[Piece]:
        """The rays without return of the element `miss` that `write_scan_ply` adds."""
        place = self.header.number_of("miss")
        miss = self.header.elements[place] if place is not None else None
        if place is None or miss is None or miss.has_lists or not set(MISS_COLUMNS) <= {p.name for p in miss.properties}:
            return
        for piece in (self._binary if self.header.order else self._text)(miss, place, frozenset(MISS_COLUMNS)):
            values = np.stack([np.asarray(piece.columns[name], float) for name in MISS_COLUMNS], axis=1)
            nothing = np.full(len(values), np.nan)
            yield Piece(
                points=np.full((len(values), 3), np.nan),
                columns={name: nothing for name in wanted},
                sensor=values[:, :3],
                is_miss=np.ones(len(values), bool),
                direction=values[:, 3:],
            )

    def faces(self, place: int) -> IntArray:
        """Triangles of the element `face`; polygons are cut from their first corner."""
        face = self.header.elements[place]
        k = _face_list(face)
        if k is None:
            return np.zeros((0, 3), np.int64)
        if self.header.order:
            quick = self._triangles(face, place, k)
            if quick is not None:
                return quick
        values, starts, counts = self._lists(place)
        return triangulated(*self._corners(values, starts[:, k], counts[:, k], face.properties[k].type))

    def grid(self) -> tuple[IntArray, IntArray] | None:
        """Row and column of every vertex in the element `range_grid`, whose cells hold one vertex or none; None where it is not there or damaged."""
        place, vertex = self.header.number_of("range_grid"), self.header.number_of("vertex")
        if place is None or vertex is None or self.header.columns < 1:
            return None
        cells, n = self.header.elements[place], self.header.elements[vertex].rows
        if len(cells.properties) != 1 or not cells.properties[0].count:
            return None
        try:
            values, starts, counts = self._lists(place)
        except FormatError:
            return None
        cell = np.flatnonzero(counts[:, 0] == 1)
        index = np.asarray(self._corners(values, starts[cell, 0], counts[cell, 0], cells.properties[0].type)[0], float)
        if not ((index >= 0) & (index < n)).all():
            return None
        row, column = np.full((2, n), -1, np.int64)
        row[index.astype(np.int64)], column[index.astype(np.int64)] = np.divmod(cell, self.header.columns)
        return row, column

    def _binary(self, vertex: _Element, place: int, wanted: frozenset[str]) -> Iterator[Piece]:
        dtype = self._dtype(vertex)
        start = self._start(place)
        for row in range(0, vertex.rows, ROWS_PER_PIECE):
            n = min(ROWS_PER_PIECE, vertex.rows - row)
            rows = self.data[start + row * dtype.itemsize : start + (row + n) * dtype.itemsize].view(dtype)
            yield _piece(vertex, {p.name: rows[f"f{k}"] for k, p in enumerate(vertex.properties)}, wanted)
            forget(self.data)

    def _text(self, vertex: _Element, place: int, wanted: frozenset[str]) -> Iterator[Piece]:
        names = tuple(p.name for p in vertex.properties)
        table = TextTable(self.header.path, self.data, self._start(place), len(self.data), WHITESPACE, ord("."), len(names), names)
        xyz = columns.find_all(names, "x", "y", "z") or ()
        chosen = tuple(k for k, name in enumerate(names) if name in wanted or name in xyz)
        position, left = table.start, vertex.rows
        while left:
            values, position = table.rows(position, min(left, ROWS_PER_PIECE), chosen)
            left -= len(values)
            require(
                left == 0 or len(values) == ROWS_PER_PIECE,
                FormatError,
                f"{self.header.path} promises {vertex.rows} vertices, but holds {vertex.rows - left}: it is cut off; export it again",
            )
            yield _piece(vertex, {names[j]: values[:, k] for k, j in enumerate(chosen)}, wanted)
            forget(self.data)

    def _listed(self, vertex: _Element, place: int, wanted: frozenset[str]) -> Iterator[Piece]:
        values, starts, counts = self._lists(place)
        read: dict[str, Column] = {}
        for k, p in enumerate(vertex.properties):
            if not p.count:
                read[p.name] = self._corners(values, starts[:, k], counts[:, k], p.type)[0]
        yield _piece(vertex, read, wanted)

    def _start(self, place: int) -> int:
        """First byte of an element."""
        start = self.header.start
        for number, element in enumerate(self.header.elements[:place]):
            if not element.rows:
                continue
            if not self.header.order:
                start = self._skipped_lines(start, element.rows)
            elif element.has_lists:
                start = self._offsets(number, start)[2]
            else:
                start += element.rows * element.smallest_row
        return start

    def _skipped_lines(self, start: int, rows: int) -> int:
        """Start of the line `rows` lines further on."""
        for block in range(start, len(self.data), 1 << 24):
            ends = np.flatnonzero(self.data[block : block + (1 << 24)] == 10)
            if len(ends) >= rows:
                return block + int(ends[rows - 1]) + 1
            rows -= len(ends)
        return len(self.data)

    def _dtype(self, element: _Element) -> np.dtype[Any]:
        return np.dtype([(f"f{k}", self.header.order + p.type) for k, p in enumerate(element.properties)])

    def _triangles(self, face: _Element, place: int, k: int) -> IntArray | None:
        """The faces at one go where all are triangles and no other list stands beside them; else None."""
        if sum(1 for p in face.properties if p.count) != 1:
            return None
        fields: list[Any] = []
        for j, p in enumerate(face.properties):
            fields += [(f"n{j}", self.header.order + p.count)] if p.count else []
            fields += [(f"f{j}", self.header.order + p.type, (3,)) if p.count else (f"f{j}", self.header.order + p.type)]
        dtype = np.dtype(fields)
        start = self._start(place)
        stop = start + face.rows * dtype.itemsize
        if stop > len(self.data):
            return None
        rows = self.data[start:stop].view(dtype)
        if not bool((rows[f"n{k}"] == 3).all()):
            return None
        return rows[f"f{k}"].astype(np.int64)

    def _lists(self, place: int) -> tuple[FloatArray | ByteArray, IntArray, IntArray]:
        """Values (numbers of the text, or bytes), and start and count of every property of every row of an element that has lists."""
        if self.header.order:
            starts, counts, _ = self._offsets(place, self._start(place))
            return self.data, starts, counts
        needed = self.header.elements[: place + 1]
        values, _ = flat_numbers(self.header.path, self.data, self.header.start, len(self.data), np.iinfo(np.int64).max)
        position = 0
        starts = counts = np.zeros((0, 0), np.int64)
        for element in needed:
            is_list = np.array([bool(p.count) for p in element.properties])
            starts, counts = np.empty((2, element.rows, len(is_list)), np.int64)
            position = _walk_numbers(values, position, is_list, starts, counts)
            require(position >= 0, FormatError, self._cut(element))
        return values, starts, counts

    def _offsets(self, place: int, start: int) -> tuple[IntArray, IntArray, int]:
        element = self.header.elements[place]
        sizes = np.array([np.dtype(p.type).itemsize for p in element.properties])
        count_sizes = np.array([np.dtype(p.count).itemsize if p.count else 0 for p in element.properties])
        starts, counts = np.empty((2, element.rows, len(sizes)), np.int64)
        end = _walk_bytes(self.data, start, self.header.order == ">", sizes, count_sizes, starts, counts)
        require(end >= 0, FormatError, self._cut(element))
        return starts, counts, end

    def _cut(self, element: _Element) -> str:
        where = f"{self.header.path} promises {element.rows} rows of {element.name}"
        return f"{where}, but ends within them, or a list is longer than the file: it is cut off or damaged"

    def _corners(self, values: FloatArray | ByteArray, starts: IntArray, counts: IntArray, kind: str) -> tuple[npt.NDArray[Any], IntArray]:
        """The values of all lists in a row, and their counts."""
        total = int(counts.sum())
        first = np.cumsum(counts) - counts
        within = np.arange(total) - np.repeat(first, counts)
        if not self.header.order:
            numbers = values[np.repeat(starts, counts) + within]
            return numbers if kind[0] == "f" else numbers.astype(np.int64), counts
        dtype = np.dtype(self.header.order + kind)
        offset = np.repeat(starts, counts) + within * dtype.itemsize
        raw = values[offset[:, None] + np.arange(dtype.itemsize)]
        return np.ascontiguousarray(raw).view(dtype).reshape(-1).astype(np.float64 if kind[0] == "f" else np.int64), counts


def _piece(vertex: _Element, read: dict[str, Column], wanted: frozenset[str]) -> Piece:
    xyz = columns.find_all(tuple(p.name for p in vertex.properties), "x", "y", "z") or ()
    points = np.empty((len(next(iter(read.values()))), 3))
    for k, name in enumerate(xyz):
        points[:, k] = read[name]
    native = {name: column.astype(column.dtype.newbyteorder("=")) for name, column in read.items() if name in wanted}
    return Piece(points=points, columns=native)


@jit
def _walk_numbers(values: FloatArray, position: int, is_list: npt.NDArray[np.bool_], starts: IntArray, counts: IntArray) -> int:
    """Start and count of each property of each row among the numbers of a text; returns the next number, -1 where they end too early."""
    for row in range(len(starts)):
        for k in range(len(is_list)):
            n = 1
            if is_list[k]:
                if position >= len(values) or not 0 <= values[position] <= len(values):
                    return -1
                n = int(values[position])
                position += 1
            starts[row, k], counts[row, k] = position, n
            position += n
            if position > len(values):
                return -1
    return position


@jit
def _walk_bytes(data: ByteArray, position: int, is_big: bool, sizes: IntArray, count_sizes: IntArray, starts: IntArray, counts: IntArray) -> int:
    """The same among bytes; count_sizes : bytes of the length of a list, 0 for a single value."""
    end = len(data)
    for row in range(len(starts)):
        for k in range(len(sizes)):
            n = 1
            width = count_sizes[k]
            if width:
                if position + width > end:
                    return -1
                n = 0
                for j in range(width):
                    n |= int(data[position + (width - 1 - j if is_big else j)]) << (8 * j)
                position += width
                if not 0 <= n <= end:
                    return -1
            starts[row, k], counts[row, k] = position, n
            position += n * sizes[k]
            if position > end:
                return -1
    return position
