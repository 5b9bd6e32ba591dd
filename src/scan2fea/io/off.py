"""OFF: vertices and polygons as text."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scan2fea.errors import EmptyScanError, FormatError, require
from scan2fea.io.numbers import flat_numbers, line_number, mapped, shown
from scan2fea.io.polygons import triangulated
from scan2fea.io.source import Piece, Source
from scan2fea.kernel.jit import jit
from scan2fea.types import ByteArray, FloatArray, IntArray

# values beside the coordinates of a vertex, by the letters before OFF
_EXTRA = {"": 0, "N": 3, "C": 4, "CN": 7, "ST": 2}


def open_off(path: Path, size: int) -> Source:
    """An OFF file. Raises FormatError where it is not one, or ends too early."""
    data = mapped(path)
    head = data[:4096].tobytes()
    words = [line.split(b"#")[0].strip() for line in head.split(b"\n")]
    keyword = next((line for line in words if line), b"")
    prefix, found, rest = keyword.decode("latin-1").upper().partition("OFF")
    if not found or prefix not in _EXTRA or "BINARY" in rest:
        raise FormatError(f"{path} begins with {shown(keyword)}, not with OFF, COFF or NOFF: it is damaged or another format")
    start = head.upper().index(b"OFF") + 3
    counts, start = flat_numbers(path, data, start, len(data), 3)
    require(
        len(counts) == 3 and bool((counts == np.floor(counts)).all()) and bool((counts >= 0).all()), FormatError, f"{path}: its counts are damaged"
    )
    n_vertices, n_faces = int(counts[0]), int(counts[1])
    if n_vertices == 0:
        raise EmptyScanError(f"{path} promises 0 vertices: export it again")
    left = (size - start) // 2 + 1
    require(
        3 * n_vertices + 4 * n_faces <= left,
        FormatError,
        f"{path} promises {n_vertices} vertices and {n_faces} faces, more than its {size} bytes can hold: it is cut off or damaged",
    )
    width = 3 + _EXTRA[prefix]
    vertices, after = flat_numbers(path, data, start, len(data), width * n_vertices)
    require(len(vertices) == width * n_vertices, FormatError, f"{path} promises {n_vertices} vertices, but ends within them: it is cut off")

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        yield Piece(points=vertices.reshape(-1, width)[:, :3])

    def faces() -> IntArray:
        # each face is a line: colours may follow its corners, so lines are counted, not numbers
        values, _ = flat_numbers(path, data, after, len(data), (len(data) - after) // 2 + 1)
        lines = _numbers_per_line(data, after, len(data))
        return _faces(path, values, lines[lines > 0][:n_faces], n_faces)

    return Source(columns=("x", "y", "z"), pieces=pieces, n_points=n_vertices, faces=faces if n_faces else None)


def _faces(path: Path, values: FloatArray, lines: IntArray, n_faces: int) -> IntArray:
    require(len(lines) == n_faces, FormatError, f"{path} promises {n_faces} faces, but holds {len(lines)}: it is cut off")
    first = np.cumsum(lines) - lines
    counts = values[first].astype(np.int64)
    require(
        bool((counts >= 0).all()) and bool((counts < lines).all()),
        FormatError,
        f"{path}: a face has fewer corners than it states: it is cut off or damaged",
    )
    within = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    corners = values[np.repeat(first + 1, counts) + within]
    require(bool(np.isfinite(corners).all()), FormatError, f"{path}: a face refers to a vertex that is not a number: it is damaged")
    return triangulated(corners.astype(np.int64), counts)


@jit
def _per_line(data: ByteArray, start: int, stop: int, out: IntArray) -> int:
    """Numbers in each line, comments left out; returns the lines counted."""
    lines, inside, is_comment = 0, False, False
    out[0] = 0
    for k in range(start, stop):
        c = data[k]
        if c == 10:
            inside, is_comment = False, False
            lines += 1
            out[lines] = 0
        elif c == 35:
            is_comment = True
        elif c == 32 or c == 9 or c == 13:
            inside = False
        elif not inside and not is_comment:
            inside = True
            out[lines] += 1
    return lines + 1


def _numbers_per_line(data: ByteArray, start: int, stop: int) -> IntArray:
    n = line_number(data[start:stop], stop - start)
    out = np.empty(n + 1, np.int64)
    return out[: _per_line(data, start, stop, out)]
