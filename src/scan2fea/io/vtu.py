"""VTU, the XML format of VTK for volumes: base64 blocks out; text, base64 and appended blocks, plain or zlib, in."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ElementTree
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, InternalError, require
from scan2fea.io.files import replacing
from scan2fea.io.volume import Blocks
from scan2fea.types import TetMesh

Array = npt.NDArray[Any]
_TYPES = {"Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4", "Int64": "i8", "UInt64": "u8",
          "Float32": "f4", "Float64": "f8"}  # fmt: skip
_NAMES = {code: name for name, code in _TYPES.items()}
# VTK cell type -> its name in Blocks and its nodes
_CELLS = {5: ("triangle", 3), 22: ("triangle6", 6), 10: ("tet", 4), 24: ("tet10", 10), 1: ("point", 1), 3: ("line", 2), 21: ("line3", 3)}
_LARGEST = 1 << 32


def write_vtu(path: Path, tets: TetMesh, point_data: Mapping[str, Array] = {}, cell_data: Mapping[str, Array] = {}) -> None:
    """Tets with values at nodes and in elements: name -> (n,) or (n, k). Raises InternalError where the lengths differ."""
    n_nodes, n_tets, width = len(tets.nodes), len(tets.tets), tets.tets.shape[1]
    with replacing(path) as handle:

        def put(text: str) -> None:
            handle.write(text.encode())

        def put_array(name: str, values: Array, rows: int) -> None:
            require(len(values) == rows, InternalError, f"{name} has {len(values)} rows, {rows} are needed")
            handle.write(_data_array(name, values))

        put('<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n')
        put(f'<UnstructuredGrid>\n<Piece NumberOfPoints="{n_nodes}" NumberOfCells="{n_tets}">\n<PointData>\n')
        for name, values in point_data.items():
            put_array(name, np.asarray(values), n_nodes)
        put("</PointData>\n<CellData>\n")
        for name, values in cell_data.items():
            put_array(name, np.asarray(values), n_tets)
        put("</CellData>\n<Points>\n")
        put_array("Points", tets.nodes, n_nodes)
        put("</Points>\n<Cells>\n")
        put_array("connectivity", tets.tets.reshape(-1), n_tets * width)
        put_array("offsets", np.arange(1, n_tets + 1, dtype=np.int64) * width, n_tets)
        put_array("types", np.full(n_tets, 10 if width == 4 else 24, np.uint8), n_tets)
        put("</Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n")


def _data_array(name: str, values: Array) -> bytes:
    array = values.astype(np.uint8) if values.dtype.kind == "b" else values
    raw = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<")).tobytes()
    parts = f' NumberOfComponents="{array.shape[1]}"' if array.ndim == 2 else ""
    escaped = name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    head = f'<DataArray type="{_NAMES[array.dtype.str[1:]]}" Name="{escaped}"{parts} format="binary">'
    return head.encode() + base64.b64encode(len(raw).to_bytes(8, "little") + raw) + b"</DataArray>\n"


def read_vtu(path: Path, size: int) -> Blocks:
    """Points and cells of a VTU file. Raises FormatError where it is not sound or holds other cells than triangles and tets."""
    require(size <= _LARGEST, FormatError, f"{path} has {size} bytes, at most {_LARGEST} are read")
    content = path.read_bytes()
    require(b"<!DOCTYPE" not in content and b"<!ENTITY" not in content, FormatError, f"{path}: its XML defines entities: export it again")
    try:
        file = _File(path, content)
        piece = file.only("UnstructuredGrid/Piece")
        points = file.array(file.only("Points/DataArray", piece)).reshape(-1, 3).astype(float)
        named = {str(node.get("Name")): file.array(node) for node in piece.findall("Cells/DataArray")}
        connectivity, offsets, types = (named[name].astype(np.int64).reshape(-1) for name in ("connectivity", "offsets", "types"))
    except (ElementTree.ParseError, KeyError, ValueError, TypeError, IndexError, zlib.error) as error:
        raise FormatError(f"{path} is no sound VTU file ({' '.join(str(error).split())[:100]}): export it again") from error
    return Blocks(path=path, nodes=points, cells=_blocks(path, connectivity, offsets, types), names={})


def _blocks(path: Path, connectivity: Array, offsets: Array, types: Array) -> tuple[tuple[str, Array, Array], ...]:
    starts = np.concatenate([[0], offsets[:-1]])
    blocks = []
    for kind in np.unique(types).tolist():
        own = np.flatnonzero(types == kind)
        require(kind in _CELLS, FormatError, f"{path} holds {len(own)} cells of VTK type {kind}: triangles and tetrahedra are read")
        name, width = _CELLS[kind]
        sound = bool(((offsets[own] - starts[own] == width) & (starts[own] >= 0) & (offsets[own] <= len(connectivity))).all())
        require(sound, FormatError, f"{path}: a cell of VTK type {kind} has not {width} nodes: it is damaged")
        blocks.append((name, connectivity[starts[own][:, None] + np.arange(width)], np.zeros(len(own), np.int64)))
    return tuple(blocks)


class _File:
    """An XML file of VTK and the bytes appended to it."""

    def __init__(self, path: Path, content: bytes) -> None:
        start = content.find(b"<AppendedData")
        self.appended = b""
        self.is_base64 = False
        if start >= 0:
            mark = content.index(b"_", content.index(b">", start)) + 1
            self.is_base64 = b'"base64"' in content[start:mark]
            self.appended = content[mark:]
            content = content[:start] + b"</VTKFile>"
        self.root = ElementTree.fromstring(content)
        require(self.root.get("type") == "UnstructuredGrid", FormatError, f"{path} holds {self.root.get('type')}: UnstructuredGrid is read")
        self.order = ">" if self.root.get("byte_order") == "BigEndian" else "<"
        self.header = np.dtype(self.order + _TYPES[self.root.get("header_type") or "UInt32"])
        compressor = self.root.get("compressor")
        self.is_compressed = compressor is not None
        require(compressor in (None, "vtkZLibDataCompressor"), FormatError, f"{path} is packed by {compressor}: export it with zlib or without")

    def only(self, where: str, parent: Any = None) -> Any:
        found = (self.root if parent is None else parent).findall(where)
        if len(found) != 1:
            raise ValueError(f"{len(found)} elements {where} where 1 is needed")
        return found[0]

    def array(self, node: Any) -> Array:
        dtype = np.dtype(self.order + _TYPES[node.get("type")])
        kind = node.get("format")
        if kind == "ascii":
            return np.array((node.text or "").split(), dtype=dtype.newbyteorder("="))
        if kind == "binary":
            raw = self._decoded(re.sub(rb"\s", b"", (node.text or "").encode()), is_base64=True)
        else:
            raw = self._decoded(self.appended[int(node.get("offset")) :], is_base64=self.is_base64)
        return np.frombuffer(raw, dtype)

    def _decoded(self, block: bytes, is_base64: bool) -> bytes:
        """The bytes of one block: a count of bytes before them, or the sizes of its zlib parts."""
        wide = self.header.itemsize
        if not self.is_compressed:
            n = int(np.frombuffer(_taken(block, 0, wide, is_base64), self.header)[0])
            return _taken(block, 0, wide + n, is_base64)[wide:]
        n_parts = int(np.frombuffer(_taken(block, 0, wide, is_base64), self.header)[0])
        head = np.frombuffer(_taken(block, 0, wide * (3 + n_parts), is_base64), self.header).astype(np.int64)
        begin = -(-len(head) * wide // 3) * 4 if is_base64 else len(head) * wide  # the header is encoded on its own
        raw = _taken(block[begin:], 0, int(head[3:].sum()), is_base64)
        ends = np.cumsum(head[3:])
        return b"".join(zlib.decompress(raw[end - size : end]) for end, size in zip(ends.tolist(), head[3:].tolist(), strict=True))


def _taken(block: bytes, start: int, stop: int, is_base64: bool) -> bytes:
    raw = base64.b64decode(block[: -(-stop // 3) * 4]) if is_base64 else block[:stop]
    if len(raw) < stop or stop < 0:
        raise ValueError("a block of data ends too early")
    return raw[start:stop]
