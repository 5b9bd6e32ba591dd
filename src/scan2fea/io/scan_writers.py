"""Scans out, as scanners write them: PLY, PCD, PTX, LAS and XYZ, by suffix. What a format cannot hold is left out, never bent.

PLY holds everything: sensor, direction, time, ring, object and the misses. PCD: the sensor as VIEWPOINT where all rays start in one point. PTX: the
grid with its misses. LAS: time, ring and object as extra bytes. XYZ: coordinates and object.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InputError, require
from scan2fea.io.files import write_bytes
from scan2fea.io.ply_writer import write_scan_ply
from scan2fea.types import FloatArray, IntArray, Scan

Array = npt.NDArray[Any]
_LAS_STEP_M = 1e-5
_FIXED_DATE = date(2000, 1, 1)  # the same scan gives the same bytes
_NEARLY_ONE_PLACE_M = 1e-9


def write_ply(path: Path, scan: Scan, lengths: str = "metres") -> None:
    """Points with sensor_x|y|z, ray_x|y|z (unit direction), time, ring, object, sigma_m; and the misses."""
    columns: dict[str, Array] = {name: values for name, values in _ray_columns(scan).items() if name != "label"}
    if scan.cloud.label is not None:
        columns["object"] = scan.cloud.label
    write_scan_ply(path, scan, columns, lengths)


def write_xyz(path: Path, scan: Scan) -> None:
    """x y z, and the object where known, one point per line; 1e-9 m."""
    label = scan.cloud.label
    table = scan.cloud.points if label is None else np.column_stack([scan.cloud.points, label])
    stream = io.StringIO()
    np.savetxt(stream, table, fmt=["%.9f"] * 3 + ["%d"] * (table.shape[1] - 3))
    write_bytes(path, stream.getvalue().encode())


def write_pcd(path: Path, scan: Scan) -> None:
    """Binary PCD 0.7, coordinates as double: ring, time, object; VIEWPOINT where all points were seen from one place."""
    columns: dict[str, Array] = {name: scan.cloud.points[:, k] for k, name in enumerate("xyz")}
    extra = _ray_columns(scan)
    columns.update({name: extra[name] for name in ("time", "ring") if name in extra})
    if scan.cloud.label is not None:
        columns["label"] = scan.cloud.label.astype(np.int32)
    place = _one_place(scan)
    if place is None and scan.rays is not None:
        sensors = scan.sensors()
        columns.update({f"sensor_{axis}": sensors[:, k] for k, axis in enumerate("xyz")})
    kinds = {name: np.dtype(values.dtype).newbyteorder("<") for name, values in columns.items()}
    table = np.zeros(len(scan.cloud), np.dtype(list(kinds.items())))
    for name, values in columns.items():
        table[name] = values
    at = "0 0 0" if place is None else " ".join(repr(float(v)) for v in place)
    header = [
        "# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", "FIELDS " + " ".join(kinds),
        "SIZE " + " ".join(str(kind.itemsize) for kind in kinds.values()),
        "TYPE " + " ".join({"f": "F", "i": "I", "u": "U"}[kind.kind] for kind in kinds.values()), "COUNT " + " ".join("1" for _ in kinds),
        f"WIDTH {len(table)}", "HEIGHT 1", f"VIEWPOINT {at} 1 0 0 0", f"POINTS {len(table)}", "DATA binary", "",
    ]  # fmt: skip
    write_bytes(path, "\n".join(header).encode() + table.tobytes())


def write_las(path: Path, scan: Scan) -> None:
    """LAS 1.4, point format 6, steps of 0.01 mm; GPS time, and ring and object as extra bytes. Raises InputError for a larger scan."""
    import laspy

    header = laspy.LasHeader(point_format=6, version="1.4")
    points = scan.cloud.points
    header.scales = np.full(3, _LAS_STEP_M)
    header.offsets = np.floor(points.mean(axis=0)) if len(points) else np.zeros(3)
    reach = float(np.abs(points - header.offsets).max(initial=0.0))
    require(
        reach / _LAS_STEP_M < 2**31, InputError, f"{path}: the scan reaches {reach:.0f} m: LAS with steps of {_LAS_STEP_M} m holds less; write PLY"
    )
    header.creation_date = _FIXED_DATE
    extra = _ray_columns(scan)
    named = {"ring": (np.uint16, extra.get("ring")), "object": (np.int32, scan.cloud.label)}
    for name, (kind, values) in named.items():
        if values is not None:
            header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=kind))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    if "time" in extra:
        las.gps_time = extra["time"]
    for name, (_, values) in named.items():
        if values is not None:
            las[name] = values
    stream = io.BytesIO()
    las.write(stream)
    write_bytes(path, stream.getvalue())


def write_ptx(path: Path, scan: Scan) -> None:
    """The grid of one station, azimuth by azimuth, misses as 0 0 0. Raises InputError for a scan that is no grid of one place."""
    place = _one_place(scan)
    says = f"{path}: PTX holds the grid of one station: this scan is none; write PLY or PCD, or use the sensor terrestrial"
    if scan.rays is None or scan.rays.ring is None or place is None:
        raise InputError(says)
    n_rows = int(scan.rays.ring.max()) + 1
    n_columns, rest = divmod(len(scan.rays), n_rows)
    require(rest == 0 and np.array_equal(scan.rays.ring, np.arange(len(scan.rays)) % n_rows), InputError, says)
    table = np.zeros((len(scan.rays), 4))
    table[:, 3] = 0.5
    table[scan.cloud.ray, :3] = scan.cloud.points - place
    if scan.cloud.intensity is not None:
        table[scan.cloud.ray, 3] = scan.cloud.intensity
    p = " ".join(f"{v:.9f}" for v in place)
    header = [str(n_columns), str(n_rows), p, "1 0 0", "0 1 0", "0 0 1", "1 0 0 0", "0 1 0 0", "0 0 1 0", f"{p} 1"]
    stream = io.StringIO()
    stream.write("\n".join(header) + "\n")
    np.savetxt(stream, table, fmt=["%.6f"] * 4)
    write_bytes(path, stream.getvalue().encode())


SCAN_WRITERS: Mapping[str, Callable[[Path, Scan], None]] = {"ply": write_ply, "pcd": write_pcd, "ptx": write_ptx, "las": write_las, "xyz": write_xyz}


def _ray_columns(scan: Scan) -> dict[str, Array]:
    """Per point: direction, time and ring of its ray; standard deviation where stated."""
    columns: dict[str, Array] = {}
    rays, row = scan.rays, scan.cloud.ray
    if rays is not None:
        direction: FloatArray = rays.direction[row]
        columns.update({f"ray_{axis}": direction[:, k] for k, axis in enumerate("xyz")})
        if rays.time_s is not None:
            columns["time"] = rays.time_s[row]
        if rays.ring is not None:
            ring: IntArray = rays.ring[row]
            columns["ring"] = ring.astype(np.int32)
    if scan.cloud.sigma_along_m is not None:
        columns["sigma_m"] = scan.cloud.sigma_along_m
    return columns


def _one_place(scan: Scan) -> FloatArray | None:
    """(3,) where all rays start, or None."""
    if scan.rays is None or not len(scan.rays):
        return None
    place = scan.rays.origin[0]
    return place if float(np.abs(scan.rays.origin - place).max()) <= _NEARLY_ONE_PLACE_M else None
