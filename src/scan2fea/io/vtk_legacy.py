"""Legacy VTK files (.vtk), text or binary: points, polygons and the arrays of the points (VTK File Formats, Kitware).

Versions up to 5.1; POLYDATA, UNSTRUCTURED_GRID and STRUCTURED_GRID. Cells that are no faces are passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from scan2fea.errors import EmptyScanError, FormatError, require
from scan2fea.io.numbers import flat_numbers, forget, line_number, mapped, shown
from scan2fea.io.polygons import triangulated
from scan2fea.io.source import ROWS_PER_PIECE, Column, Piece, Source
from scan2fea.types import ByteArray, FloatArray, IntArray

_TYPES = {
    "unsigned_char": "u1", "char": "i1", "unsigned_short": "u2", "short": "i2", "unsigned_int": "u4", "int": "i4", "unsigned_long": "u8",
    "long": "i8", "float": "f4", "double": "f8", "vtkidtype": "i8", "vtktypeint64": "i8", "vtktypeint32": "i4", "vtktypeuint8": "u1",
}  # fmt: skip
_DATASETS = ("POLYDATA", "UNSTRUCTURED_GRID", "STRUCTURED_GRID")
_CELLS = ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS", "CELLS")
_FACE_TYPES = (5, 7, 9)  # triangle, polygon, quadrilateral
_LONGEST_LINE = 1 << 12


@dataclass(frozen=True)
class _Array:
    """n rows of `width` numbers from byte `start`. code : numpy's letter and size of the type."""

    start: int
    n: int
    width: int
    code: str


@dataclass
class _Content:
    """What was found while the keywords were walked; never leaves this file."""

    points: _Array | None = None
    columns: dict[str, tuple[_Array, int]] = field(default_factory=dict)  # name -> array and component
    cells: dict[str, tuple[_Array, _Array | None]] = field(default_factory=dict)  # by keyword: counts with corners, or offsets and corners
    cell_types: _Array | None = None


def open_vtk(path: Path, size: int) -> Source:
    """A legacy VTK file. Raises FormatError where a keyword is none, or what it promises is not there; EmptyScanError without points."""
    walk = _Walk(path, mapped(path))
    content = walk.walked()
    points = content.points
    if points is None or points.n == 0:
        raise EmptyScanError(f"{path} has no POINTS: export it again")
    names = ("x", "y", "z", *content.columns)

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        chosen = {name: content.columns[name] for name in content.columns if name in wanted}
        arrays = list({array.start: array for array, _ in chosen.values()}.values())
        for xyz, *others in zip(walk.rows(points), *(walk.rows(array) for array in arrays), strict=True):
            at = {array.start: rows for array, rows in zip(arrays, others, strict=True)}
            columns: dict[str, Column] = {name: np.ascontiguousarray(at[array.start][:, k]) for name, (array, k) in chosen.items()}
            yield Piece(points=xyz, columns=columns)
            forget(walk.data)

    has_faces = "POLYGONS" in content.cells or ("CELLS" in content.cells and content.cell_types is not None)
    notes = ("its triangle strips were passed over",) if "TRIANGLE_STRIPS" in content.cells else ()
    return Source(columns=names, pieces=pieces, n_points=points.n, faces=(lambda: walk.faces(content)) if has_faces else None, notes=notes)


class _Walk:
    """From keyword to keyword. Never leaves this file."""

    def __init__(self, path: Path, data: ByteArray) -> None:
        self.path, self.data, self.at = path, data, 0
        head = [self._line() for _ in range(3)]
        kind = head[2].strip().upper()
        require(kind in ("ASCII", "BINARY"), FormatError, f"{path}: its third line is {shown(kind.encode())}, not ASCII or BINARY: it is damaged")
        self.is_text = kind == "ASCII"

    def walked(self) -> _Content:
        """Where everything lies."""
        content, rows, about = _Content(), 0, ""
        while (words := self._words()) is not None:
            key = words[0].upper()
            if key == "DATASET":
                says = f"{self.path} holds DATASET {' '.join(words[1:])[:40]}: {', '.join(_DATASETS)} have points; convert it"
                require(len(words) > 1 and words[1].upper() in _DATASETS, FormatError, says)
            elif key == "POINTS":
                content.points = self._array(self._count(words, 1), 3, words[2:3])
            elif key in _CELLS:
                content.cells[key] = self._cells(words)
            elif key == "CELL_TYPES":
                content.cell_types = self._array(self._count(words, 1), 1, ["int"])
            elif key in ("POINT_DATA", "CELL_DATA"):
                rows, about = self._count(words, 1), key
            elif key == "METADATA":
                self._pass_block()
            elif key != "DIMENSIONS":
                self._attribute(words, rows, content if about == "POINT_DATA" else _Content())
        self._require_rows(content)
        return content

    def _require_rows(self, content: _Content) -> None:
        n = content.points.n if content.points is not None else 0
        wrong = next((name for name, (array, _) in content.columns.items() if array.n != n), None)
        if wrong is not None:
            raise FormatError(f"{self.path}: {wrong} has {content.columns[wrong][0].n} rows for {n} points: it is damaged")

    def _attribute(self, words: list[str], rows: int, content: _Content) -> None:
        key, name = words[0].upper(), words[1] if len(words) > 1 else ""
        if key == "SCALARS":
            width = self._count(words, 3) if len(words) > 3 else 1
            before = self.at
            if (self._words() or [""])[0].upper() != "LOOKUP_TABLE":
                self.at = before
            self._named(content, name, self._array(rows, width, words[2:3]))
        elif key == "LOOKUP_TABLE":
            self._array(self._count(words, 2), 4, ["float" if self.is_text else "unsigned_char"])
        elif key == "COLOR_SCALARS":
            array = self._array(rows, self._count(words, 2), ["float" if self.is_text else "unsigned_char"])
            self._named(content, ("red", "green", "blue") if array.width in (3, 4) else name, array)
        elif key in ("NORMALS", "VECTORS"):
            self._named(content, ("nx", "ny", "nz") if key == "NORMALS" else name, self._array(rows, 3, words[2:3]))
        elif key in ("TENSORS", "TENSORS6"):
            self._array(rows, 9 if key == "TENSORS" else 6, words[2:3])
        elif key == "TEXTURE_COORDINATES":
            self._array(rows, self._count(words, 2), words[3:4])
        elif key == "FIELD":
            self._field(self._count(words, 2), content if rows else _Content())
        else:
            says = f"{self.path}, line {self._line_number()}: {shown(words[0].encode())} is no keyword of VTK: it is cut off, damaged or not text"
            raise FormatError(says)

    def _field(self, n_arrays: int, content: _Content) -> None:
        for _ in range(n_arrays):
            own = self._words() or []
            if own and own[0].upper() == "METADATA":
                self._pass_block()
                own = self._words() or []
            require(len(own) == 4, FormatError, f"{self.path}, line {self._line_number()}: an array of a FIELD is 'name width rows type'")
            self._named(content, own[0], self._array(self._count(own, 2), self._count(own, 1), own[3:]))

    def _pass_block(self) -> None:
        """Lines up to a blank one."""
        while self._line(ends=True).strip():
            pass

    def _named(self, content: _Content, name: str | tuple[str, ...], array: _Array) -> None:
        titles = (name,) if isinstance(name, str) and array.width == 1 else tuple(f"{name}_{k + 1}" for k in range(array.width))
        titles = name if isinstance(name, tuple) else titles
        for k, title in enumerate(titles[: array.width]):
            content.columns.setdefault(title, (array, k))

    # -------------------------------------------------------------- cells

    def _cells(self, words: list[str]) -> tuple[_Array, _Array | None]:
        n, size = self._count(words, 1), self._count(words, 2)
        before = self.at
        own = self._words() or [""]
        if own[0].upper() == "OFFSETS":  # version 5: n is one more than there are cells
            offsets = self._array(n, 1, own[1:2])
            own = self._words() or [""]
            require(own[0].upper() == "CONNECTIVITY", FormatError, f"{self.path}, line {self._line_number()}: CONNECTIVITY is missing: it is damaged")
            return offsets, self._array(size, 1, own[1:2])
        self.at = before
        return self._array(size, 1, ["int"]), None

    def faces(self, content: _Content) -> IntArray:
        """(m, 3) triangles of the polygons, or of the cells that are faces."""
        corners, counts = self._corners(*(content.cells.get("POLYGONS") or content.cells["CELLS"]))
        if "POLYGONS" not in content.cells and content.cell_types is not None:
            kinds = self._whole(content.cell_types).ravel().astype(np.int64)
            require(len(kinds) == len(counts), FormatError, f"{self.path}: {len(kinds)} CELL_TYPES for {len(counts)} cells: it is damaged")
            keep = np.isin(kinds, _FACE_TYPES)
            corners, counts = corners[np.repeat(keep, counts)], counts[keep]
        return triangulated(corners, counts)

    def _corners(self, first: _Array, second: _Array | None) -> tuple[IntArray, IntArray]:
        values = self._whole(first).ravel().astype(np.int64)
        if second is not None:
            counts = np.diff(values)
            corners = self._whole(second).ravel().astype(np.int64)
            sound = len(values) and values[0] == 0 and bool((counts >= 0).all()) and values[-1] == len(corners)
            require(sound, FormatError, f"{self.path}: the OFFSETS of its cells do not rise from 0 to their number of corners: it is damaged")
            return corners, counts
        counts_list, at, is_corner = [], 0, np.ones(len(values), bool)
        flat = values.tolist()
        while at < len(flat):
            says = f"{self.path}: a cell has {flat[at]} corners, more than are left: it is damaged"
            require(0 <= flat[at] <= len(flat) - at - 1, FormatError, says)
            counts_list.append(flat[at])
            is_corner[at] = False
            at += flat[at] + 1
        return values[is_corner], np.array(counts_list, np.int64)

    # -------------------------------------------------------------- numbers and words

    def _array(self, n: int, width: int, kind: list[str]) -> _Array:
        """The array that begins here; the walk goes on behind it."""
        name = kind[0].lower() if kind else ""
        says = f"{self.path}, line {self._line_number()}: {shown(name.encode())} is no type of VTK that holds numbers: it is damaged"
        require(name in _TYPES, FormatError, says)
        array = _Array(self.at, n, width, _TYPES[name])
        least = 2 if self.is_text else int(array.code[1:])
        left = len(self.data) - self.at
        promised = f"{self.path}, line {self._line_number()}: {n} rows of {width} numbers are promised, {left} bytes left: it is cut off or damaged"
        require(n * width * least <= left + 1, FormatError, promised)
        if self.is_text:
            for _ in self.rows(array):
                pass
            self.at = self._after
        else:
            self.at += n * width * least
        return array

    def rows(self, array: _Array) -> Iterator[FloatArray]:
        """(k, width) rows of an array in order, a piece at a time."""
        at = array.start
        for first in range(0, max(array.n, 1), ROWS_PER_PIECE):
            n = min(ROWS_PER_PIECE, array.n - first)
            if self.is_text:
                values, at = flat_numbers(self.path, self.data, at, len(self.data), n * array.width) if n else (np.zeros(0), at)
                require(len(values) == n * array.width, FormatError, f"{self.path} ends within an array of {array.n} rows: it is cut off")
            else:
                length = n * array.width * int(array.code[1:])
                raw = self.data[at : at + length].view(_big_endian(array.code))
                with np.errstate(invalid="ignore"):  # bytes that are no number
                    values = np.asarray(raw, np.float64)
                at += length
            yield values.reshape(n, array.width)
        self._after = at

    def _whole(self, array: _Array) -> FloatArray:
        return np.concatenate(list(self.rows(array)))

    def _count(self, words: list[str], k: int) -> int:
        token = words[k] if k < len(words) else ""
        says = f"{self.path}, line {self._line_number()}: {shown(token.encode())} after {words[0][:20]} is no count: it is damaged"
        require(token.isascii() and token.isdigit() and len(token) < 19, FormatError, says)
        return int(token)

    def _words(self) -> list[str] | None:
        """The words of the next line that has any, None at the end."""
        while self.at < len(self.data):
            words = self._line(ends=True).split()
            if words:
                return words
        return None

    def _line(self, ends: bool = False) -> str:
        raw = self.data[self.at : self.at + _LONGEST_LINE].tobytes()
        end = raw.find(b"\n")
        is_last = self.at + len(raw) == len(self.data)
        says = f"{self.path}: no line ends within {len(raw)} bytes of byte {self.at}: it is cut off or damaged"
        require(end >= 0 or (ends and is_last), FormatError, says)
        end = end if end >= 0 else len(raw)
        self.at += end + 1
        return raw[:end].decode("latin-1")

    def _line_number(self) -> int:
        return line_number(self.data, max(self.at - 1, 0)) if self.is_text else 0


def _big_endian(code: str) -> npt.DTypeLike:
    """Binary VTK is big endian."""
    return np.dtype(f">{code}")
