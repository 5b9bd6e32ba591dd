"""PLY out: binary little endian, coordinates as double; the same value gives the same bytes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InternalError, require
from scan2fea.io.files import replacing
from scan2fea.io.ply import MISS_COLUMNS
from scan2fea.types import PointCloud, Scan, TriangleMesh

Array = npt.NDArray[Any]
_ROWS = 1 << 20  # rows laid out in memory at a time
_NAMES = {"f4": "float", "f8": "double", "i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint"}


def write_cloud_ply(path: Path, cloud: PointCloud, columns: Mapping[str, Array] = {}) -> None:
    """Points with normals, colour, intensity and label where the cloud has them, and further `columns` name -> (n,).

    A further column replaces one of the cloud of the same name. Raises InternalError where a column has another length.
    """
    _write(path, [("vertex", {**_columns_of(cloud), **columns}, len(cloud))])


def write_scan_ply(path: Path, scan: Scan, columns: Mapping[str, Array] = {}, lengths: str = "metres") -> None:
    """A scan as a scanner would give it: points with sensor_x, sensor_y, sensor_z and further `columns`, and an element `miss` of
    the rays without return.

    `read_scan` gives points, sensors and misses back. lengths : what the header says of them.
    """
    columns = {**_columns_of(scan.cloud), **columns}
    elements = []
    if scan.rays is not None:
        sensors = scan.sensors()
        columns.update({name: sensors[:, k] for k, name in enumerate(MISS_COLUMNS[:3])})
        misses = np.flatnonzero(np.isnan(scan.rays.range_m))
        if len(misses):
            values = np.concatenate([scan.rays.origin[misses], scan.rays.direction[misses]], axis=1)
            elements.append(("miss", {name: values[:, k] for k, name in enumerate(MISS_COLUMNS)}, len(misses)))
    _write(path, [("vertex", columns, len(scan.cloud)), *elements], lengths)


def write_mesh_ply(path: Path, mesh: TriangleMesh) -> None:
    """Vertices (and deviation_m) and triangles (and origin: 0 measured, 1 interpolated, 2 invented; and region), indices as they are."""
    columns: dict[str, Array] = {name: mesh.vertices[:, k] for k, name in enumerate("xyz")}
    if mesh.deviation_m is not None:
        columns["deviation_m"] = mesh.deviation_m
    faces: dict[str, Array] = {"vertex_indices": mesh.faces.astype(np.int32)}
    if mesh.face_origin is not None:
        faces["origin"] = mesh.face_origin.astype(np.uint8)
    if mesh.face_region is not None:
        faces["region"] = mesh.face_region
    _write(path, [("vertex", columns, len(mesh.vertices)), ("face", faces, len(mesh.faces))])


def _columns_of(cloud: PointCloud) -> dict[str, Array]:
    columns: dict[str, Array] = {name: cloud.points[:, k] for k, name in enumerate("xyz")}
    if cloud.normals is not None:
        columns.update({name: cloud.normals[:, k] for k, name in enumerate(("nx", "ny", "nz"))})
    if cloud.colour is not None:
        columns.update({name: cloud.colour[:, k] for k, name in enumerate(("red", "green", "blue"))})
    if cloud.intensity is not None:
        columns["intensity"] = cloud.intensity
    if cloud.label is not None:
        columns["label"] = cloud.label
    return columns


def _stored(name: str, values: Array, rows: int) -> Array:
    """A column in a type that PLY has; whole numbers beyond 32 bits become double."""
    array = np.asarray(values)
    require(len(array) == rows, InternalError, f"column {name} has {len(array)} rows, {rows} are needed")
    if array.dtype.kind == "b":
        return array.astype(np.uint8)
    if array.dtype.kind in "iu" and array.dtype.itemsize == 8:
        fits = rows == 0 or (int(array.min()) >= -(2**31) and int(array.max()) < 2**31)
        return array.astype(np.int32 if fits else np.float64)
    require(array.dtype.kind in "iuf", InternalError, f"column {name} holds {array.dtype}: numbers are needed")
    return array


def _write(path: Path, elements: list[tuple[str, Mapping[str, Array], int]], lengths: str = "metres") -> None:
    header = ["ply", "format binary_little_endian 1.0", f"comment scan2fea, {lengths}"]
    stored: list[tuple[dict[str, Array], int]] = []
    for element, columns, rows in elements:
        header.append(f"element {element} {rows}")
        kept = {name: _stored(name, values, rows) for name, values in columns.items()}
        for name, array in kept.items():
            kind = _NAMES[array.dtype.str[1:]]
            header.append(f"property list uchar {kind} {name}" if array.ndim == 2 else f"property {kind} {name}")
        stored.append((kept, rows))
    with replacing(path) as handle:
        handle.write(("\n".join([*header, "end_header"]) + "\n").encode())
        for kept, rows in stored:
            for start in range(0, rows, _ROWS):
                handle.write(_laid_out({name: array[start : start + _ROWS] for name, array in kept.items()}))


def _laid_out(columns: Mapping[str, Array]) -> bytes:
    fields: list[Any] = []
    for k, array in enumerate(columns.values()):
        code = "<" + array.dtype.str[1:]
        fields += [(f"n{k}", "u1"), (f"f{k}", code, array.shape[1:])] if array.ndim == 2 else [(f"f{k}", code)]
    table = np.empty(len(next(iter(columns.values()))), np.dtype(fields))
    for k, array in enumerate(columns.values()):
        table[f"f{k}"] = array
        if array.ndim == 2:
            table[f"n{k}"] = array.shape[1]
    return table.tobytes()
