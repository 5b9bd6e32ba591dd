"""LAS 1.0 to 1.4, LAZ and COPC.

The header is checked against the size of the file before anything is believed. LAS points are read straight from their records; those of
LAZ come from lazrs, chunk by chunk. Lengths come from integers and stay float64 throughout.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from scan2fea.errors import EmptyScanError, FormatError, require
from scan2fea.io.lascrs import crs_of
from scan2fea.io.laszip import LASZIP, require_sound_chunks
from scan2fea.io.source import ROWS_PER_PIECE, Column, Piece, Source
from scan2fea.types import ByteArray, FloatArray

# smallest record and offset of red of the point formats 0..10 (LAS 1.4 R15, table 7 on)
_RECORD_BYTES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
_RED = {2: 20, 3: 28, 5: 28, 7: 30, 8: 30, 10: 30}
_GPS_TIME = {1: 20, 3: 20, 4: 20, 5: 20, 6: 22, 7: 22, 8: 22, 9: 22, 10: 22}
_EXTRA_TYPES = ("", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8")
_LONGEST_VLR = 1 << 24


@dataclass(frozen=True)
class _Header:
    path: Path
    size: int
    start: int
    point_format: int
    is_compressed: bool
    row_bytes: int
    n: int
    scale: FloatArray
    offset: FloatArray
    records: dict[tuple[str, int], bytes]
    notes: tuple[str, ...]


def open_las(path: Path, size: int) -> Source:
    """A LAS or LAZ file. Raises FormatError where the header is not sound or promises more than the file can hold."""
    with path.open("rb") as handle:
        header = _header(path, size, handle)
        crs = crs_of(header.records)
        if header.is_compressed and header.n:
            require_sound_chunks(path, size, handle, header.start, header.n, header.row_bytes, header.records.get(LASZIP, b""))
    if header.n == 0:
        raise EmptyScanError(f"{path} promises 0 points: export it again")
    dtype = _dtype(header)

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        for raw in _packed_records(header) if header.is_compressed else _plain_records(header):
            rows = raw.view(dtype).reshape(-1)
            points = np.empty((len(rows), 3))
            for k, name in enumerate("xyz"):
                points[:, k] = rows[name] * header.scale[k] + header.offset[k]
            yield Piece(points=points, columns={name: _column(rows, name, header) for name in dtype.names or () if name in wanted})

    return Source(columns=dtype.names or (), pieces=pieces, n_points=header.n, unit=crs.unit, notes=header.notes + crs.notes)


def _header(path: Path, size: int, handle: IO[bytes]) -> _Header:
    head = handle.read(375)
    require(len(head) >= 227, FormatError, f"{path} has {size} bytes, a LAS header has 227: it is cut off")
    version = (head[24], head[25])
    header_size, start, n_vlrs, form, row_bytes, n = struct.unpack_from("<HIIBHI", head, 94)
    require(version[0] == 1 and version[1] <= 4, FormatError, f"{path} is LAS {version[0]}.{version[1]}: versions 1.0 to 1.4 are read; convert it")
    n_evlrs, evlrs = 0, 0
    if version >= (1, 4) and header_size >= 375 and len(head) == 375:
        evlrs, n_evlrs, n = struct.unpack_from("<QIQ", head, 235)
    point_format = form & 0x3F
    require(point_format <= 10, FormatError, f"{path} has point format {point_format}: formats 0 to 10 are known; convert it")
    require(
        227 <= header_size <= start <= size,
        FormatError,
        f"{path}: its header of {header_size} bytes puts the points at byte {start} of {size}: it is cut off or damaged",
    )
    require(
        n_vlrs * 54 <= start - header_size,
        FormatError,
        f"{path} promises {n_vlrs} variable length records, but the {start - header_size} bytes before its points hold at most "
        f"{(start - header_size) // 54}: its header is damaged",
    )
    least = _RECORD_BYTES[point_format]
    require(
        row_bytes >= least, FormatError, f"{path}: its records have {row_bytes} bytes, format {point_format} needs {least}: its header is damaged"
    )
    is_compressed = bool(form & 0xC0)
    require(
        is_compressed or n * row_bytes <= size - start,
        FormatError,
        f"{path} promises {n} points, but its {size} bytes hold at most {(size - start) // row_bytes}: it is cut off or damaged",
    )
    scale, offset = np.array(struct.unpack_from("<3d", head, 131)), np.array(struct.unpack_from("<3d", head, 155))
    sound = bool(np.isfinite(scale).all() and np.isfinite(offset).all() and (scale != 0).all())
    require(sound, FormatError, f"{path}: its scale {scale.tolist()} or offset {offset.tolist()} is not usable: its header is damaged")
    records, notes = _records(handle, header_size, n_vlrs, start, 54)
    more, more_notes = _records(handle, evlrs, n_evlrs, size, 60) if 0 < evlrs < size else ({}, ())
    return _Header(path, size, start, point_format, is_compressed, row_bytes, n, scale, offset, {**more, **records}, notes + more_notes)


def _records(handle: IO[bytes], position: int, count: int, stop: int, head_bytes: int) -> tuple[dict[tuple[str, int], bytes], tuple[str, ...]]:
    """The variable length records, by user and number; the walk ends where one reaches beyond `stop`."""
    found: dict[tuple[str, int], bytes] = {}
    for k in range(min(count, (stop - position) // head_bytes)):
        handle.seek(position)
        head = handle.read(head_bytes)
        user, number = head[2:18].split(b"\0")[0].decode("latin-1"), int.from_bytes(head[18:20], "little")
        length = int.from_bytes(head[20 : 22 if head_bytes == 54 else 28], "little")
        position += head_bytes
        if position + length > stop:
            return found, (f"variable length record {k + 1} of {count} reaches beyond its place: it and those after it were passed over",)
        if length <= _LONGEST_VLR:
            found.setdefault((user, number), handle.read(length))
        position += length
    return found, ()


def _dtype(header: _Header) -> np.dtype[Any]:
    """The columns of a record; bytes between them are passed over."""
    form = header.point_format
    fields: dict[str, tuple[str, int]] = {"x": ("<i4", 0), "y": ("<i4", 4), "z": ("<i4", 8), "intensity": ("<u2", 12)}
    fields["classification"] = ("u1", 15 if form < 6 else 16)
    if form in _GPS_TIME:
        fields["gps_time"] = ("<f8", _GPS_TIME[form])
    if form in _RED:
        fields.update({name: ("<u2", _RED[form] + 2 * k) for k, name in enumerate(("red", "green", "blue"))})
    offset = _RECORD_BYTES[form]
    described = header.records.get(("LASF_Spec", 4), b"")
    for k in range(len(described) // 192):
        entry = described[192 * k : 192 * k + 192]
        kind, name = entry[2], entry[4:36].split(b"\0")[0].decode("latin-1").strip()
        width = np.dtype(_EXTRA_TYPES[kind]).itemsize if 0 < kind < len(_EXTRA_TYPES) else entry[3] if kind == 0 else 0
        if width == 0 or offset + width > header.row_bytes:
            break
        if kind and name and name not in fields:
            fields[name] = (_EXTRA_TYPES[kind], offset)
        offset += width
    names = list(fields)
    layout = {"names": names, "formats": [fields[n][0] for n in names], "offsets": [fields[n][1] for n in names], "itemsize": header.row_bytes}
    return np.dtype(layout)  # type: ignore[call-overload, no-any-return]


def _column(rows: Column, name: str, header: _Header) -> Column:
    if name == "classification" and header.point_format < 6:
        return rows[name] & 31
    return np.ascontiguousarray(rows[name])


def _plain_records(header: _Header) -> Iterator[ByteArray]:
    with header.path.open("rb") as handle:
        handle.seek(header.start)
        for row in range(0, header.n, ROWS_PER_PIECE):
            n = min(ROWS_PER_PIECE, header.n - row) * header.row_bytes
            raw = np.fromfile(handle, np.uint8, n)
            require(len(raw) == n, FormatError, f"{header.path} is cut off at point {row + len(raw) // header.row_bytes}: copy it again")
            yield raw


def _packed_records(header: _Header) -> Iterator[ByteArray]:
    import lazrs

    with header.path.open("rb") as handle:
        handle.seek(header.start)
        read = 0
        try:
            decompressor = lazrs.LasZipDecompressor(handle, header.records[LASZIP])
            while read < header.n:
                raw = np.empty(min(ROWS_PER_PIECE, header.n - read) * header.row_bytes, np.uint8)
                decompressor.decompress_many(raw)
                read += len(raw) // header.row_bytes
                yield raw
        except (lazrs.LazrsError, OSError, ValueError, RuntimeError) as error:
            raise FormatError(f"{header.path} is cut off or damaged after point {read} of {header.n} ({error}): copy it again") from error
