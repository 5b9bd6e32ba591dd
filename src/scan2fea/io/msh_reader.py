"""Gmsh MSH in: 4.1 text and binary, 2.2 text; triangles and tetrahedra of either order."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, require
from scan2fea.io.msh import CELLS, TET10_ORDER
from scan2fea.io.volume import Blocks
from scan2fea.types import FloatArray

Array = npt.NDArray[Any]
_LARGEST = 1 << 32


def read_msh(path: Path, size: int) -> Blocks:
    """Nodes, cells and names of a MSH file. Raises FormatError where it is not sound, of another version, or holds other cells."""
    require(size <= _LARGEST, FormatError, f"{path} has {size} bytes, at most {_LARGEST} are read")
    content = path.read_bytes()
    try:
        head = _section(content, b"MeshFormat").split()
        version, is_binary = head[0].decode(), int(head[1]) == 1
        require(
            version == "4.1" or (version.startswith("2") and not is_binary),
            FormatError,
            f"{path} is MSH {version} {'binary' if is_binary else 'text'}: 4.1, and 2.2 as text, are read; save it again as 4.1",
        )
        numbers = _Numbers(is_binary)
        if version == "4.1":
            tags = numbers.physical(_section(content, b"Entities")) if b"$Entities" in content else {}
            nodes, row = numbers.nodes(_section(content, b"Nodes"))
            cells = numbers.elements(path, _section(content, b"Elements"), row, tags)
        else:
            nodes, row = _nodes_2(_section(content, b"Nodes"))
            cells = _elements_2(path, _section(content, b"Elements"), row)
    except (ValueError, IndexError, KeyError, struct.error, OverflowError, MemoryError) as error:
        raise FormatError(f"{path} is no sound MSH file ({' '.join(str(error).split())[:100]}): export it again") from error
    return Blocks(path=path, nodes=nodes, cells=cells, names=_names(content))


def _section(content: bytes, name: bytes) -> bytes:
    start = content.find(b"$" + name)
    stop = content.find(b"$End" + name, start)
    if start < 0 or stop < 0:
        raise ValueError(f"no whole section ${name.decode()}")
    return content[content.index(b"\n", start) + 1 : stop]


def _names(content: bytes) -> dict[int, str]:
    """Physical names of surfaces."""
    if b"$PhysicalNames" not in content:
        return {}
    found = re.findall(rb'^\s*2\s+(\d+)\s+"([^"]*)"', _section(content, b"PhysicalNames"), re.MULTILINE)
    return {int(tag): name.decode("utf-8", "replace") for tag, name in found}


def _rows(tags: Array) -> Array:
    """Number of a node in the file -> its row."""
    row = np.full(int(tags.max(initial=0)) + 1 if int(tags.max(initial=0)) < 64 * (len(tags) + 1024) else 0, -1, np.int64)
    if not len(row):
        raise ValueError("node numbers have gaps too wide")
    row[tags] = np.arange(len(tags))
    return row


class _Numbers:
    """A stream of integers and floats, text or binary, in the order MSH 4.1 writes them."""

    def __init__(self, is_binary: bool) -> None:
        self.is_binary = is_binary
        self.words: list[bytes] = []
        self.raw = b""
        self.position = 0

    def _open(self, section: bytes) -> None:
        self.position = 0
        self.raw = section
        self.words = [] if self.is_binary else section.split()

    def _take(self, code: str, count: int) -> Array:
        if not self.is_binary:
            words = self.words[self.position : self.position + count]
            if len(words) < count or count < 0:
                raise ValueError("a section ends too early")
            self.position += count
            return np.array(words, dtype="S32").astype(np.float64 if code == "<f8" else np.int64)
        dtype = np.dtype(code)
        stop = self.position + count * dtype.itemsize
        if stop > len(self.raw) or count < 0:
            raise ValueError("a section ends too early")
        values = np.frombuffer(self.raw, dtype, count, self.position)
        self.position = stop
        return values.astype(np.float64 if code == "<f8" else np.int64)

    def physical(self, section: bytes) -> dict[int, int]:
        """Surface -> its first physical group."""
        self._open(section)
        counts = self._take("<u8", 4)
        tags: dict[int, int] = {}
        for dimension in range(4):
            for _ in range(int(counts[dimension])):
                tag = int(self._take("<i4", 1)[0])
                self._take("<f8", 3 if dimension == 0 else 6)
                groups = self._take("<i4", int(self._take("<u8", 1)[0]))
                if dimension:
                    self._take("<i4", int(self._take("<u8", 1)[0]))
                if dimension == 2 and len(groups):
                    tags[tag] = int(groups[0])
        return tags

    def nodes(self, section: bytes) -> tuple[FloatArray, Array]:
        self._open(section)
        n_blocks = int(self._take("<u8", 4)[0])
        tags, points = [], []
        for _ in range(n_blocks):
            _, _, parametric = self._take("<i4", 3)
            n = int(self._take("<u8", 1)[0])
            if parametric:
                raise ValueError("parametric nodes")
            tags.append(self._take("<u8", n))
            points.append(self._take("<f8", 3 * n).reshape(-1, 3))
        return np.concatenate(points), _rows(np.concatenate(tags))

    def elements(self, path: Path, section: bytes, row: Array, tags: dict[int, int]) -> tuple[tuple[str, Array, Array], ...]:
        self._open(section)
        n_blocks = int(self._take("<u8", 4)[0])
        cells = []
        for _ in range(n_blocks):
            dimension, entity, kind = (int(v) for v in self._take("<i4", 3))
            n = int(self._take("<u8", 1)[0])
            name, width = _cell(path, kind)
            block = row[self._take("<u8", n * (1 + width)).reshape(-1, 1 + width)[:, 1:]]
            tag = tags.get(entity, entity) if dimension == 2 else 0
            cells.append((name, block[:, TET10_ORDER] if name == "tet10" else block, np.full(n, tag)))
        return tuple(cells)


def _cell(path: Path, kind: int) -> tuple[str, int]:
    require(kind in CELLS, FormatError, f"{path} holds elements of Gmsh type {kind}: triangles and tetrahedra are read")
    return CELLS[kind]


def _nodes_2(section: bytes) -> tuple[FloatArray, Array]:
    words = section.split()
    n = int(words[0])
    values = np.array(words[1 : 1 + 4 * n], dtype="S32").astype(float)
    if len(values) != 4 * n or n < 0:
        raise ValueError("$Nodes ends too early")
    table = values.reshape(-1, 4)
    return table[:, 1:], _rows(table[:, 0].astype(np.int64))


def _elements_2(path: Path, section: bytes, row: Array) -> tuple[tuple[str, Array, Array], ...]:
    lines = [line.split() for line in section.split(b"\n") if line.strip()]
    if len(lines) - 1 < int(lines[0][0]):
        raise ValueError("$Elements ends too early")
    grouped: dict[int, tuple[list[list[int]], list[int]]] = {}
    for words in lines[1 : 1 + int(lines[0][0])]:
        values = [int(word) for word in words]
        _, width = _cell(path, values[1])
        n_tags = values[2]
        nodes = values[3 + n_tags :]
        if len(nodes) != width:
            raise ValueError(f"element {values[0]} has {len(nodes)} nodes")
        rows, tags = grouped.setdefault(values[1], ([], []))
        rows.append(nodes)
        tags.append(values[3] if n_tags else 0)
    cells = []
    for kind, (rows, tags) in grouped.items():
        block = row[np.array(rows)]
        cells.append((CELLS[kind][0], block[:, TET10_ORDER] if kind == 11 else block, np.array(tags, np.int64)))
    return tuple(cells)
