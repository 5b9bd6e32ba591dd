"""E57 (ASTM E2807) through libE57 (pye57): every scan with its pose, rays without return as misses.

Read piece by piece into float64: a header that promises more points than the file can hold never gets memory for them.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.errors import EmptyScanError, FormatError, require
from scan2fea.io.misses import GridAngles, GridSweep
from scan2fea.io.source import ROWS_PER_PIECE, Column, Piece, Source
from scan2fea.kernel.transforms import quaternion_to_matrix
from scan2fea.types import BoolArray, FloatArray

_PAGE, _PAYLOAD = 1024, 1020  # bytes of a page with and without its checksum
_LARGEST_XML = 1 << 26
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
# what is read, and the column it becomes
_COLUMNS = {"intensity": "intensity", "colorRed": "red", "colorGreen": "green", "colorBlue": "blue",
            "nor:normalX": "nx", "nor:normalY": "ny", "nor:normalZ": "nz"}  # fmt: skip
_GRID = ("rowIndex", "columnIndex")
_NO_RETURN, _NOTHING = 1, 2  # invalid states: the direction alone is known; nothing is


@dataclass(frozen=True)
class _Scan:
    number: int
    fields: tuple[str, ...]
    n: int
    T_world_scanner: FloatArray
    has_pose: bool

    @property
    def is_spherical(self) -> bool:
        return not all(name in self.fields for name in _CARTESIAN)


def open_e57(path: Path, size: int) -> Source:
    """An E57 file. Raises FormatError where the file is not sound, EmptyScanError without scans."""
    _require_sound(path, size)
    scans = _scans(path, size)
    if not scans or sum(scan.n for scan in scans) == 0:
        raise EmptyScanError(f"{path} holds {len(scans)} scans without points: export it again")
    present = {name for scan in scans for name in scan.fields}
    names = ("x", "y", "z", *(column for field, column in _COLUMNS.items() if field in present))

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        for scan in scans:
            yield from _pieces(path, scan, tuple(field for field, column in _COLUMNS.items() if column in wanted))

    is_posed = any(scan.has_pose and not np.array_equal(scan.T_world_scanner, np.eye(4)) for scan in scans)
    return Source(columns=names, pieces=pieces, n_points=sum(scan.n for scan in scans), unit="m", pose_given=is_posed)


def _require_sound(path: Path, size: int) -> None:
    """The file header against the size, and its XML without document types, before libE57 is asked."""
    with path.open("rb") as handle:
        head = handle.read(48)
        require(len(head) == 48, FormatError, f"{path} has {size} bytes, an E57 header has 48: it is cut off")
        _, _, length, offset, xml_length, page = struct.unpack("<IIQQQQ", head[8:])
        require(page == _PAGE, FormatError, f"{path} has pages of {page} bytes, E57 has {_PAGE}: its header is damaged")
        require(length <= size, FormatError, f"{path} promises {length} bytes, but has {size}: it is cut off; copy it again")
        pages = -(-xml_length // _PAYLOAD)
        require(
            xml_length <= _LARGEST_XML and 48 <= offset <= size and offset + pages * 4 + xml_length <= size + _PAGE,
            FormatError,
            f"{path}: its description of {xml_length} bytes should lie at byte {offset} of {size}: it is cut off or damaged",
        )
        first = offset // _PAGE * _PAGE
        handle.seek(first)
        raw = handle.read((pages + 2) * _PAGE)
    xml = b"".join(raw[k : k + _PAYLOAD] for k in range(0, len(raw), _PAGE))[offset - first :][:xml_length]
    require(b"<!" not in xml.replace(b"<!--", b"").replace(b"<![CDATA[", b""), FormatError, f"{path}: its XML defines entities: export it again")


def _scans(path: Path, size: int) -> list[_Scan]:
    import pye57

    try:
        with pye57.E57(str(path)) as file:
            nodes = file.data3d if file.root.isDefined("data3D") else ()
            return [_scan(path, size, pye57.ScanHeader(nodes[k]), k) for k in range(len(nodes))]
    except (pye57.libe57.E57Exception, ValueError, RuntimeError, TypeError, KeyError) as error:
        raise FormatError(f"{path} is no sound E57 file ({_said(error)}): export it again") from error


def _scan(path: Path, size: int, header: Any, number: int) -> _Scan:
    fields = tuple(header.point_fields)
    n = int(header.point_count)
    # a record of a sound scan takes one bit at least
    require(0 <= n <= 8 * size, FormatError, f"{path} promises {n} points in scan {number + 1}, more than its {size} bytes can hold: it is damaged")
    usable = all(name in fields for name in _CARTESIAN) or all(name in fields for name in _SPHERICAL)
    require(usable or n == 0, FormatError, f"{path}: scan {number + 1} has {', '.join(fields)}: cartesian or spherical coordinates are needed")
    pose = np.eye(4)
    has_pose = bool(header.has_pose())
    if has_pose:
        node = header.node["pose"]
        if node.isDefined("rotation"):
            pose[:3, :3] = _rotation(path, np.array([node["rotation"][k].value() for k in "wxyz"], float))
        if node.isDefined("translation"):
            pose[:3, 3] = [node["translation"][k].value() for k in "xyz"]
        require(bool(np.isfinite(pose).all()), FormatError, f"{path}: the pose of scan {number + 1} is not finite: export it again")
    return _Scan(number, fields, n, pose, has_pose)


def _rotation(path: Path, q: FloatArray) -> FloatArray:
    """Rotation matrix of a quaternion w x y z, made unit."""
    length = float(np.sqrt((q**2).sum()))
    require(np.isfinite(length) and length > 0, FormatError, f"{path}: the rotation {q.tolist()} of a scan is no quaternion: export it again")
    return quaternion_to_matrix(q[[1, 2, 3, 0]])


def _pieces(path: Path, scan: _Scan, extra: tuple[str, ...]) -> Iterator[Piece]:
    """The scan piece by piece. Where rays brought nothing back and no direction, the angles of the grid are learnt once, from the whole scan."""
    state = "sphericalInvalidState" if scan.is_spherical else "cartesianInvalidState"
    located = [*(_SPHERICAL if scan.is_spherical else _CARTESIAN), *(f for f in (*_GRID, state) if f in scan.fields)]
    has_grid = all(name in located for name in _GRID)
    learnt: list[GridAngles | None] = []

    def angles() -> GridAngles | None:
        if not learnt:
            learnt.append(_learnt(path, scan, located, state) if has_grid else None)
        return learnt[0]

    for read in _buffers(path, scan, [*located, *(f for f in extra if f in scan.fields)]):
        yield _piece(scan, read, state, extra, angles)


def _learnt(path: Path, scan: _Scan, fields: list[str], state: str) -> GridAngles | None:
    sweep = GridSweep(scan.n)
    for read in _buffers(path, scan, fields):
        local = _local(scan, read)
        row, column = (read[name].astype(np.int64) for name in _GRID)
        sweep.add(local, ~_is_miss(scan, read, state, local) & np.isfinite(local).all(axis=1), row, column)
    return sweep.angles()


def _buffers(path: Path, scan: _Scan, fields: list[str]) -> Iterator[dict[str, FloatArray]]:
    import pye57
    from pye57 import libe57

    if scan.n == 0:
        return
    capacity = min(ROWS_PER_PIECE, scan.n)
    try:
        with pye57.E57(str(path)) as file:
            arrays = {name: np.empty(capacity) for name in fields}
            buffers = libe57.VectorSourceDestBuffer()
            for name, array in arrays.items():
                buffers.append(libe57.SourceDestBuffer(file.image_file, name, array, capacity, True, True))
            reader = pye57.ScanHeader(file.data3d[scan.number]).points.reader(buffers)
            total = 0
            while (n := int(reader.read())) > 0:
                total += n
                yield {name: array[:n].copy() for name, array in arrays.items()}
            reader.close()
    except (libe57.E57Exception, ValueError, RuntimeError, TypeError, KeyError) as error:
        raise FormatError(f"{path} is damaged in scan {scan.number + 1} ({_said(error)}): export it again") from error
    require(total == scan.n, FormatError, f"{path} promises {scan.n} points in scan {scan.number + 1}, but holds {total}: it is cut off")


def _piece(scan: _Scan, read: dict[str, FloatArray], state: str, extra: tuple[str, ...], angles: Callable[[], GridAngles | None]) -> Piece:
    local = _local(scan, read)
    is_grid = all(name in read for name in _GRID)
    rotation, origin = scan.T_world_scanner[:3, :3], scan.T_world_scanner[:3, 3]
    is_placed = scan.has_pose and not np.array_equal(scan.T_world_scanner, np.eye(4))
    has_sensor = is_placed or scan.is_spherical or (is_grid and scan.has_pose)
    kept: dict[str, Column] = {_COLUMNS[name]: _small(read[name]) if name.startswith("color") else read[name] for name in extra if name in read}
    kept.update({_COLUMNS[name]: np.full(len(local), np.nan) for name in extra if name not in read})
    if is_placed and all(name in kept for name in ("nx", "ny", "nz")):
        normals = np.stack([kept["nx"], kept["ny"], kept["nz"]], axis=1) @ rotation.T
        kept.update({name: normals[:, k] for k, name in enumerate(("nx", "ny", "nz"))})
    is_miss, direction = _misses(scan, read, state, local, angles)
    return Piece(
        points=local @ rotation.T + origin if is_placed else local,
        columns=kept,
        sensor=origin if has_sensor else None,
        is_miss=is_miss,
        direction=None if direction is None else direction @ rotation.T,
    )


def _local(scan: _Scan, read: dict[str, FloatArray]) -> FloatArray:
    """Points in the frame of the scanner."""
    if scan.is_spherical:
        return _looking(read) * read[_SPHERICAL[0]][:, None]
    local = np.empty((len(read[_CARTESIAN[0]]), 3))
    for k, name in enumerate(_CARTESIAN):
        local[:, k] = read[name]
    return local


def _looking(read: dict[str, FloatArray]) -> FloatArray:
    """Directions of spherical coordinates."""
    _, azimuth, elevation = (read[name] for name in _SPHERICAL)
    return np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1)


def _small(colour: FloatArray) -> Column:
    """Whole numbers of a colour in two bytes instead of eight."""
    whole = colour.astype(np.uint16) if bool(((colour >= 0) & (colour <= 65535)).all()) else colour
    return whole if np.array_equal(whole, colour) else colour


def _is_miss(scan: _Scan, read: dict[str, FloatArray], state: str, local: FloatArray) -> BoolArray:
    """Rays without return: said to be invalid, or at the scanner itself."""
    return np.asarray(((read[state] != 0) if state in read else False) | _at_scanner(scan, local))


def _at_scanner(scan: _Scan, local: FloatArray) -> BoolArray:
    return np.asarray((local[:, 0] == 0) & (local[:, 1] == 0) & (local[:, 2] == 0) & (scan.has_pose or scan.is_spherical))


def _misses(
    scan: _Scan, read: dict[str, FloatArray], state: str, local: FloatArray, angles: Callable[[], GridAngles | None]
) -> tuple[BoolArray | None, FloatArray | None]:
    """Rays without return and the directions of all rays in the frame of the scanner (nan unknown); None where every ray brought a point."""
    is_miss = _is_miss(scan, read, state, local)
    if not bool(is_miss.any()):
        return None, None
    if scan.is_spherical:
        direction = _looking(read)
    else:
        length = np.sqrt((local**2).sum(axis=1, keepdims=True))
        direction = np.divide(local, length, out=np.full_like(local, np.nan), where=np.isfinite(length) & (length > 0))
    if state in read:
        direction[read[state] >= _NOTHING] = np.nan
    if not scan.is_spherical:
        direction[_at_scanner(scan, local)] = np.nan
    unknown = is_miss & np.isnan(direction[:, 0])
    swept = angles() if bool(unknown.any()) else None
    if swept is not None:
        row, column = (read[name][unknown].astype(np.int64) for name in _GRID)
        direction[unknown] = swept.directions(row, column)
    return is_miss, direction


def _said(error: Exception) -> str:
    return " ".join(str(error).split())[:120]
