"""What must hold in a LAZ file before its chunks are unpacked: lazrs believes every size that it reads and takes memory for it."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import IO

import numpy as np

from scan2fea.errors import FormatError, require

LASZIP = ("laszip encoded", 22204)
_VARIABLE_CHUNKS = 0xFFFFFFFF
_LAYERED = 3  # compressor of LAS 1.4 point formats: every chunk lists the sizes of its layers
# layers of the items of a point (LASzip 3): point, RGB, RGB and NIR, wave packet; extra bytes have one each
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_EXTRA_BYTES = 14
_MOST_POINTS_PER_BYTE = 4096  # a point takes some bits at least: no scan has thousands of equal points in a row


def require_sound_chunks(path: Path, size: int, handle: IO[bytes], start: int, n: int, row_bytes: int, how: bytes) -> None:
    """Check the record that says how points are packed, the table of chunks and the sizes in each chunk. Raises FormatError."""
    require(len(how) >= 34, FormatError, f"{path} is compressed, but its LASzip record is missing or cut off: copy it again")
    compressor, chunk_size, n_items = struct.unpack_from("<H", how)[0], struct.unpack_from("<I", how, 12)[0], struct.unpack_from("<H", how, 32)[0]
    items = [struct.unpack_from("<HHH", how, 34 + 6 * k) for k in range(min(n_items, (len(how) - 34) // 6))]
    packed = sum(width for _, width, _ in items)
    require(
        len(items) == n_items and packed == row_bytes and chunk_size > 0,
        FormatError,
        f"{path}: its LASzip record describes {packed} bytes per point in {n_items} items, the header {row_bytes}: it is damaged",
    )
    table = _table_position(path, size, handle, start)
    handle.seek(table)
    _, n_chunks = struct.unpack("<II", handle.read(8))
    most = n if chunk_size == _VARIABLE_CHUNKS else -(-n // chunk_size)
    least = 1 if chunk_size == _VARIABLE_CHUNKS else most
    room = table - start - 8
    require(
        least <= n_chunks <= most and n_chunks * row_bytes <= room and n <= room * _MOST_POINTS_PER_BYTE,
        FormatError,
        f"{path} promises {n} points in {most} chunks, but its table lists {n_chunks} chunks in {room} bytes: it is cut off or damaged",
    )
    chunks = _chunks(path, handle, start, how)
    points, sizes = sum(chunk[0] for chunk in chunks), sum(chunk[1] for chunk in chunks)
    require(
        sizes <= room and (chunk_size != _VARIABLE_CHUNKS or points == n),
        FormatError,
        f"{path}: its chunks hold {points} points in {sizes} bytes, {n} in {room} are needed: it is damaged",
    )
    if compressor == _LAYERED or any(kind >= min(_LAYERS) for kind, _, _ in items):
        layers = sum(width if kind == _EXTRA_BYTES else _LAYERS.get(kind, 0) for kind, width, _ in items)
        _require_layers(path, handle, start + 8, chunks, row_bytes, layers)


def _table_position(path: Path, size: int, handle: IO[bytes], start: int) -> int:
    handle.seek(start)
    table = int.from_bytes(handle.read(8), "little", signed=True)
    if table == -1:  # written by a stream that could not go back: the place stands at the end of the file
        handle.seek(size - 8)
        table = int.from_bytes(handle.read(8), "little", signed=True)
    require(
        start + 8 <= table <= size - 8,
        FormatError,
        f"{path}: its table of chunks should lie at byte {table} of {size}: it is cut off or damaged",
    )
    return table


def _chunks(path: Path, handle: IO[bytes], start: int, how: bytes) -> list[tuple[int, int]]:
    """Points and bytes of each chunk."""
    import lazrs

    handle.seek(start)
    try:
        return [(int(points), int(n_bytes)) for points, n_bytes in lazrs.read_chunk_table(handle, lazrs.LazVlr(how))]
    except (lazrs.LazrsError, OSError, ValueError, RuntimeError, OverflowError) as error:
        raise FormatError(f"{path}: its table of chunks is damaged ({error}): copy it again") from error


def _require_layers(path: Path, handle: IO[bytes], position: int, chunks: list[tuple[int, int]], row_bytes: int, layers: int) -> None:
    """A chunk is its first point, its count, the sizes of its layers, and these."""
    for number, (_, n_bytes) in enumerate(chunks):
        handle.seek(position + row_bytes)
        head = handle.read(4 + 4 * layers)
        total = row_bytes + 4 + 4 * layers + int(np.frombuffer(head[4 : len(head) // 4 * 4], "<u4").sum(dtype=np.int64))
        require(
            len(head) == 4 + 4 * layers and total <= n_bytes,
            FormatError,
            f"{path}: chunk {number + 1} of {len(chunks)} promises {total} bytes and has {n_bytes}: it is damaged",
        )
        position += n_bytes
