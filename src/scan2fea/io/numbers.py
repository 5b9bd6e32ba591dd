"""Numbers out of text: one reader for every text format, correctly rounded, exact about the line at fault.

Memory is bounded by the rows asked for: the text itself stays on disk (memory map).
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError
from scan2fea.io.tokens import FEW, FULL, MANY, WHITESPACE, parse_flat, parse_rows
from scan2fea.types import ByteArray, FloatArray

_ODD = 4096  # tokens per call that Python converts
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "?", "-nan", "+nan", "1.#qnan", "-1.#ind", "1.#ind", "nan(ind)", "-nan(ind)"})
_LF = 10


@dataclass(frozen=True)
class TextTable:
    """Where the rows of a text file lie and how they are written.

    text : the file as bytes (memory map).   start, stop : bytes of the rows.   separator : WHITESPACE or a character.   columns : values in a line.
    """

    path: Path
    text: ByteArray
    start: int
    stop: int
    separator: int
    point: int
    columns: int
    names: tuple[str, ...] = ()

    def rows(self, position: int, limit: int, wanted: tuple[int, ...]) -> tuple[FloatArray, int]:
        """Up to `limit` rows from a byte position: (k, wanted) values and the next position.

        Raises FormatError with the number of the line where the values are too few, too many, or not numbers.
        """
        keep = np.full(self.columns, -1, np.int64)
        keep[list(wanted)] = np.arange(len(wanted))
        out = np.empty((limit, len(wanted)))
        odd = np.empty((max(_ODD, self.columns), 4), np.int64)
        filled, ended = 0, FULL
        while ended == FULL and filled < limit:
            part = out[filled:]
            position, rows, n_odd, ended = parse_rows(self.text, position, self.stop, self.separator, self.point, keep, part, odd)
            for row, column, first, last in odd[:n_odd].tolist():
                if row < rows:
                    part[row, keep[column]] = self._convert(first, last, column)
            filled += rows
        if ended in (FEW, MANY):
            self._refuse(position, ended)
        return out[:filled], position

    def sample(self, limit: int, wanted: tuple[int, ...], size: int) -> FloatArray:
        """The first rows within `size` bytes, up to `limit`, for a look: nan where a value is no number; stops where a line does not fit."""
        keep = np.full(self.columns, -1, np.int64)
        keep[list(wanted)] = np.arange(len(wanted))
        stop = min(self.stop, self.start + size)
        if stop < self.stop:
            stop = self.start + self.text[self.start : stop].tobytes().rfind(b"\n") + 1
        out, odd = np.empty((limit, len(wanted))), np.empty((limit * self.columns, 4), np.int64)
        _, rows, n_odd, _ = parse_rows(self.text, self.start, stop, self.separator, self.point, keep, out, odd)
        for row, column, first, last in odd[:n_odd].tolist():
            if row < rows:
                value = number(self.text[first:last].tobytes(), chr(self.point))
                out[row, keep[column]] = np.nan if value is None else value
        return out[:rows]

    def _convert(self, first: int, last: int, column: int) -> float:
        value = number(self.text[first : min(last, first + 400)].tobytes(), chr(self.point))
        if value is None:
            token = shown(self.text[first : min(last, first + 80)].tobytes())
            name = f" ({self.names[column]})" if column < len(self.names) else ""
            raise FormatError(
                f"{self.path}, line {line_number(self.text, first)}: {token} in column {column + 1}{name} is not a number: correct or remove the line"
            )
        return value

    def _refuse(self, position: int, ended: int) -> None:
        end = position
        while end < self.stop and end - position < 2000 and self.text[end] != _LF:
            end += 1
        line = self.text[position:end].tobytes()
        found = len(split_line(line, self.separator))
        more = "too few: is the file cut off there?" if ended == FEW else "too many"
        raise FormatError(f"{self.path}, line {line_number(self.text, position)}: {found} values where {self.columns} are expected, {more}")


def flat_numbers(path: Path, text: ByteArray, start: int, stop: int, limit: int) -> tuple[FloatArray, int]:
    """Up to `limit` numbers between blanks, and the position after them. Raises FormatError for a token that is no number."""
    limit = min(limit, (stop - start) // 2 + 1)  # a number takes two bytes at least
    out = np.empty(limit)
    odd = np.empty((_ODD, 4), np.int64)
    filled, position = 0, start
    while filled < limit:
        position, n, n_odd = parse_flat(text, position, stop, out[filled:], odd)
        for k, _, first, last in odd[:n_odd].tolist():
            value = number(text[first : min(last, first + 400)].tobytes(), ".")
            if value is None:
                token = shown(text[first : min(last, first + 80)].tobytes())
                raise FormatError(f"{path}, line {line_number(text, first)}: {token} is not a number: correct or remove the line")
            out[filled + k] = value
        filled += n
        if n == 0 or position >= stop:
            break
    return out[:filled], position


def number(token: bytes, point: str = ".") -> float | None:
    """A token as Python reads it, nan for the usual signs of "no value", None where it is no number."""
    text = token.decode("utf-8", "replace").strip().strip('"').lower()
    if text in _MISSING:
        return float("nan")
    if point != ".":
        text = text.replace(point, ".")
    if "_" in text:
        return None
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return float(text.replace("d", "e", 1))
    except ValueError:
        return None


def split_line(line: bytes, separator: int) -> list[str]:
    """The values of one line as text, without quotes."""
    text = line.decode("utf-8", "replace").strip("\r\n").strip(" ")
    parts = text.split() if separator == WHITESPACE else text.split(chr(separator))
    if separator != WHITESPACE and len(parts) > 1 and not parts[-1].strip():
        parts.pop()
    return [part.strip().strip("\"'").strip() for part in parts]


def line_number(text: ByteArray, position: int) -> int:
    """Number of the line, from 1, that holds a byte."""
    lines = 1
    for start in range(0, position, 1 << 24):
        lines += int(np.count_nonzero(text[start : min(position, start + (1 << 24))] == _LF))
    return lines


def shown(token: bytes) -> str:
    """A token for a message: printable, at most 40 characters."""
    text = token.decode("utf-8", "replace")
    return repr(text if len(text) <= 40 else text[:37] + "...")


def mapped(path: Path) -> ByteArray:
    """The bytes of a file, mapped rather than read."""
    data: npt.NDArray[np.uint8] = np.memmap(path, np.uint8, "r")
    return data.view(np.ndarray)


def forget(data: ByteArray) -> None:
    """Let the system take back the pages of a mapped file that were read (they are read again where needed), where it has such a call."""
    base: object = data
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, mmap.mmap) and hasattr(base, "madvise"):
        base.madvise(mmap.MADV_DONTNEED)
