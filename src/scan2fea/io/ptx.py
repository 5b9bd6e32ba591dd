"""PTX (Leica): one or more gridded scans as text, each with the pose of its scanner.

A point of 0 0 0 is a ray that brought nothing back; it is kept as a miss, its direction told from the grid.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.errors import FormatError, require
from scan2fea.io.misses import grid_directions
from scan2fea.io.numbers import TextTable, flat_numbers, line_number, mapped, split_line
from scan2fea.io.source import Column, Piece, Source
from scan2fea.io.text import require_text
from scan2fea.io.tokens import WHITESPACE
from scan2fea.types import ByteArray, FloatArray

_NAMES = {4: ("x", "y", "z", "intensity"), 7: ("x", "y", "z", "intensity", "red", "green", "blue"), 3: ("x", "y", "z")}
_HEADER_NUMBERS = 30  # columns, rows, position, three axes, 4 x 4 matrix
_ORTHONORMAL = 1e-3


@dataclass(frozen=True)
class _Block:
    """One scan. start, position : first byte of the header, of the points.   T_world_scanner : (4, 4)."""

    n_columns: int
    n_rows: int
    T_world_scanner: FloatArray
    position: int
    width: int

    @property
    def n(self) -> int:
        return self.n_columns * self.n_rows

    @property
    def is_placed(self) -> bool:
        return not np.array_equal(self.T_world_scanner, np.eye(4))


def open_ptx(path: Path, size: int) -> Source:
    """A PTX file. Raises FormatError where a header is not sound or promises more points than the file can hold."""
    text = mapped(path)
    require_text(path, text[: 1 << 16].tobytes(), size)
    first = _block(path, text, 0)
    if first is None:
        raise FormatError(f"{path} holds no scan: export it again")
    blocks = [first]
    while (following := _block(path, text, _end(path, text, blocks[-1]))) is not None:
        blocks.append(following)
    width = min(block.width for block in blocks)
    rigid = [np.abs(b.T_world_scanner[:3, :3] @ b.T_world_scanner[:3, :3].T - np.eye(3)).max() < _ORTHONORMAL for b in blocks]
    notes = () if all(rigid) else ("the matrix of a scan is not a rigid motion: it was applied as it is",)

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        for block in blocks:
            yield _piece(path, text, block, wanted)

    return Source(
        columns=_NAMES[width],
        pieces=pieces,
        n_points=sum(block.n for block in blocks),
        pose_given=any(block.is_placed for block in blocks),
        notes=notes,
    )


def _block(path: Path, text: ByteArray, start: int) -> _Block | None:
    """The scan whose header begins at a byte, None at the end of the file."""
    values, position = flat_numbers(path, text, start, len(text), _HEADER_NUMBERS)
    if len(values) == 0:
        return None
    where = f"{path}, line {line_number(text, start)}"
    require(len(values) == _HEADER_NUMBERS, FormatError, f"{where}: the header of a scan ends too early: it is cut off")
    n_columns, n_rows = values[:2]
    left = (len(text) - position) // (2 * 3) + 1
    require(
        n_columns >= 1 and n_rows >= 1 and n_columns % 1 == 0 and n_rows % 1 == 0 and n_columns * n_rows <= left,
        FormatError,
        f"{where}: {n_columns:g} columns of {n_rows:g} points are promised, but the rest of the file holds at most {left}: it is cut off or damaged",
    )
    matrix = values[14:].reshape(4, 4).T  # PTX multiplies rows from the left: its last row is the translation
    require(bool(np.isfinite(matrix).all()), FormatError, f"{where}: the matrix of the scan is not finite: export it again")
    head = text[position : min(position + 4096, len(text))].tobytes()
    line = next((line for line in head.split(b"\n") if line.strip()), b"")
    width = len(split_line(line, WHITESPACE))
    require(width in _NAMES, FormatError, f"{where}: its points have {width} values, PTX has x y z intensity [r g b]: export it again")
    return _Block(int(n_columns), int(n_rows), matrix, position, width)


def _table(path: Path, text: ByteArray, block: _Block) -> TextTable:
    return TextTable(path, text, block.position, len(text), WHITESPACE, ord("."), block.width, _NAMES[block.width])


def _end(path: Path, text: ByteArray, block: _Block) -> int:
    """First byte after the points of a scan. Raises FormatError where there are fewer than promised."""
    position, left = block.position, block.n
    while left and position < len(text):
        part = text[position : position + (1 << 24)]
        ends = np.flatnonzero(part == 10)
        if len(ends) >= left:
            return position + int(ends[left - 1]) + 1
        left -= len(ends) + (position + len(part) == len(text) and len(part) > 0 and int(part[-1]) != 10)
        position += len(part)
    require(left == 0, FormatError, f"{path} promises {block.n} points in a scan, but ends {left} lines before: it is cut off; export it again")
    return position


def _piece(path: Path, text: ByteArray, block: _Block, wanted: frozenset[str]) -> Piece:
    values, _ = _table(path, text, block).rows(block.position, block.n, tuple(range(block.width)))
    require(
        len(values) == block.n, FormatError, f"{path} promises {block.n} points in a scan, but holds {len(values)}: it is cut off; export it again"
    )
    local = values[:, :3]
    is_miss = (local == 0).all(axis=1)
    usable = ~is_miss & np.isfinite(local).all(axis=1)
    order = np.arange(block.n)
    directions = grid_directions(local, usable, order % block.n_rows, order // block.n_rows)
    rotation, origin = block.T_world_scanner[:3, :3], block.T_world_scanner[:3, 3]
    if directions is not None:
        directions = directions @ rotation.T
        directions = directions / np.sqrt((directions**2).sum(axis=1, keepdims=True))
    # the identity is also what a program writes that knows no scanner: then only a true grid tells that the scanner stood at 0
    has_sensor = block.is_placed or directions is not None
    read: dict[str, Column] = {name: values[:, k] for k, name in enumerate(_NAMES[block.width]) if name in wanted}
    return Piece(points=local @ rotation.T + origin, columns=read, sensor=origin if has_sensor else None, is_miss=is_miss, direction=directions)
