"""The files of OUT with all that `io` wrote into them (origins of faces, fields of tets); no other layout is read."""

from __future__ import annotations

import base64
import binascii
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, require
from scan2fea.report.solids import Solid
from scan2fea.types import FloatArray, PointCloud, TriangleMesh

Array = npt.NDArray[Any]
_PLY = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"}
_VTK = {"Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4", "Int64": "i8", "UInt64": "u8",
        "Float32": "f4", "Float64": "f8"}  # fmt: skip
_TET, _TET10 = 10, 24  # cell types of VTK


def read_cloud(path: Path) -> PointCloud:
    """Points with colour and the mark of inferred ones; points that are not finite are left out. Raises FormatError."""
    columns = _elements(path).get("vertex", {})
    points = _stack(path, columns, "x", "y", "z")
    colour = np.stack([columns[name] for name in ("red", "green", "blue")], axis=1).astype(np.uint8) if "red" in columns else None
    normals = _stack(path, columns, "nx", "ny", "nz") if "nx" in columns else None
    inferred = columns["is_inferred"].astype(bool) if "is_inferred" in columns else None
    return PointCloud.of(points, colour=colour, normals=normals, is_inferred=inferred).take(np.asarray(np.isfinite(points).all(axis=1)))


def read_surface(path: Path) -> TriangleMesh:
    """Triangles with their origin and region, and the deviation at the vertices, where the file holds them. Raises FormatError."""
    elements = _elements(path)
    vertex, face = elements.get("vertex", {}), elements.get("face", {})
    vertices = _stack(path, vertex, "x", "y", "z")
    require("vertex_indices" in face, FormatError, f"{path}: holds no triangles; run again with --resume")
    faces = face["vertex_indices"].astype(np.int64)
    sound = bool(np.isfinite(vertices).all()) and (faces.size == 0 or (int(faces.min()) >= 0 and int(faces.max()) < len(vertices)))
    require(sound, FormatError, f"{path}: a face refers to a vertex that is not there; run again with --resume")
    whole = {name: face[name].astype(np.int64) if name in face else None for name in ("origin", "region")}
    deviation = vertex["deviation_m"].astype(float) if "deviation_m" in vertex else None
    return TriangleMesh(vertices=vertices, faces=faces, face_origin=whole["origin"], face_region=whole["region"], deviation_m=deviation)


def read_as_built(path: Path) -> tuple[FloatArray, FloatArray]:
    """(n, 3) points and (n,) how far the mean of their neighbours lies off the drawing. Raises FormatError."""
    columns = _elements(path).get("vertex", {})
    require("local_m" in columns, FormatError, f"{path}: has no column local_m; run again with --resume")
    return _stack(path, columns, "x", "y", "z"), columns["local_m"].astype(float)


def read_solid(path: Path) -> Solid:
    """Tets with their fields. Raises FormatError."""
    try:
        piece = ElementTree.fromstring(path.read_bytes()).find("UnstructuredGrid/Piece")
        if piece is None:
            raise ValueError("no piece of an unstructured grid")
        groups = {group.tag: {str(node.get("Name")): _vtk_array(node) for node in group.findall("DataArray")} for group in piece}
        nodes, cells = groups["Points"]["Points"].astype(float), groups["Cells"]
        kinds = np.unique(cells["types"])
        if len(kinds) != 1 or kinds[0] not in (_TET, _TET10):
            raise ValueError(f"cells of VTK types {kinds.tolist()}")
        tets = cells["connectivity"].astype(np.int64).reshape(-1, 4 if kinds[0] == _TET else 10)
        if len(tets) != len(cells["types"]) or nodes.shape[1:] != (3,) or tets.min() < 0 or tets.max() >= len(nodes) or not np.isfinite(nodes).all():
            raise ValueError("nodes and elements do not fit together")
    except (ElementTree.ParseError, KeyError, ValueError, TypeError, IndexError, binascii.Error) as error:
        raise FormatError(f"{path}: is no volume of scan2fea ({error}); run again with --resume") from error
    fields = {name: _rows(groups.get(name, {}), n) for name, n in (("PointData", len(nodes)), ("CellData", len(tets)))}
    return Solid(nodes=nodes, tets=tets, point_data=fields["PointData"], cell_data=fields["CellData"])


def _rows(arrays: Mapping[str, Array], n: int) -> dict[str, FloatArray]:
    return {name: values.astype(float) for name, values in arrays.items() if len(values) == n}


def _vtk_array(node: ElementTree.Element) -> Array:
    """One inline block: base64 of the count of bytes (8 of them) and the bytes."""
    if node.get("format") != "binary":
        raise ValueError(f"a block is {node.get('format')}, not binary")
    raw = base64.b64decode((node.text or "").strip(), validate=True)
    if int.from_bytes(raw[:8], "little") != len(raw) - 8:
        raise ValueError("a block of data ends too early")
    values = np.frombuffer(raw, "<" + _VTK[str(node.get("type"))], offset=8)
    width = int(node.get("NumberOfComponents", "1"))
    return values.reshape(-1, width) if width > 1 else values


def _elements(path: Path) -> dict[str, dict[str, Array]]:
    """Columns of each element of a PLY file as `io` writes it: binary, little endian, lists only of triangles."""
    data = path.read_bytes()
    end = data.find(b"end_header\n")
    lines = data[: max(end, 0)].decode("latin-1").splitlines()
    sound = end > 0 and lines[0] == "ply" and "format binary_little_endian 1.0" in lines
    require(sound, FormatError, f"{path}: is no PLY file of scan2fea; run again with --resume")
    layout: list[tuple[str, int, list[Any]]] = []
    try:
        for words in (line.split() for line in lines[1:]):
            if words[0] == "element":
                layout.append((words[1], int(words[2]), []))
            elif words[0] == "property" and words[1] == "list":
                layout[-1][2].extend([(f"{words[4]} count", "<" + _PLY[words[2]]), (words[4], "<" + _PLY[words[3]], (3,))])
            elif words[0] == "property":
                layout[-1][2].append((words[2], "<" + _PLY[words[1]]))
        elements, start = {}, end + len(b"end_header\n")
        for name, rows, fields in layout:
            table = np.frombuffer(data, np.dtype(fields), rows, start)
            start += table.nbytes
            elements[name] = {field: table[field] for field in table.dtype.names or ()}
            if not all((column == 3).all() for field, column in elements[name].items() if field.endswith(" count")):
                raise ValueError("a face is no triangle")
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise FormatError(f"{path}: is damaged ({error}); run again with --resume") from error
    return elements


def _stack(path: Path, columns: Mapping[str, Array], *names: str) -> FloatArray:
    """(n, 3) of three columns."""
    missing = [name for name in names if name not in columns]
    require(not missing, FormatError, f"{path}: has no column {', '.join(missing)}; run again with --resume")
    return np.stack([columns[name] for name in names], axis=1).astype(float)
