"""A text file of columns with a line of names: logs of instruments."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.errors import EmptyScanError, FormatError, require
from scan2fea.io.files import existing_file
from scan2fea.io.numbers import TextTable, mapped, number, shown, split_line
from scan2fea.io.text import require_text
from scan2fea.io.tokens import WHITESPACE
from scan2fea.types import FloatArray

_HEAD = 1 << 16
_STEP = 1 << 20  # rows per piece


@dataclass(frozen=True)
class Table:
    """names : of the columns, () where no line has any.   rows : (n, columns), nan where there is no value."""

    path: Path
    names: tuple[str, ...]
    rows: FloatArray

    def column(self, name: str) -> FloatArray:
        return np.asarray(self.rows[:, self.names.index(name)])


def head_of(path: Path) -> list[str]:
    """The lines of the first 64 KiB of a text file that are not blank. Raises InputError where it cannot be read, FormatError where it is no text."""
    size = existing_file(path)
    head = mapped(path)[:_HEAD].tobytes() if size else b""
    require_text(path, head, size)
    lines = head.removeprefix(b"\xef\xbb\xbf").decode("utf-8", "replace").split("\n")
    return [line.strip() for line in (lines if size <= _HEAD else lines[:-1]) if line.strip()]


def read_table(path: Path) -> Table:
    """All rows and the names above them. Raises FormatError, EmptyScanError (no rows)."""
    lines = head_of(path)
    first = next((k for k, line in enumerate(lines) if _is_row(line)), None)
    if first is None:
        raise EmptyScanError(f"{path} holds no rows of numbers" + (f": its first line is {shown(lines[0].encode())}" if lines else ": it is empty"))
    separator = _separator(lines[first])
    count = len(split_line(lines[first].encode(), separator))
    names = split_line(lines[first - 1].lstrip("#% ").encode(), separator) if first else []
    if len(names) != count and lines[max(first - 1, 0)].startswith(("#", "%")):
        names = []  # a remark
    require(len(names) in (0, count), FormatError, f"{path} names {len(names)} columns, but its rows have {count}: name every column")
    text = mapped(path)
    start = text[: 4 * _HEAD].tobytes().find(lines[first].encode())
    table = TextTable(path, text, start, len(text), separator, ord("."), count, tuple(names))
    pieces, position = [], start
    while True:
        piece, position = table.rows(position, _STEP, tuple(range(count)))
        pieces.append(piece)
        if len(piece) < _STEP:
            return Table(path, tuple(names), np.concatenate(pieces))


def _separator(line: str) -> int:
    return next((ord(c) for c in ",;\t" if c in line), WHITESPACE)


def _is_row(line: str) -> bool:
    """Three values or more, most of them numbers."""
    tokens = split_line(line.encode(), _separator(line))
    return len(tokens) >= 3 and 2 * sum(bool(t) and number(t.encode()) is not None for t in tokens) > len(tokens)
