"""Points as lines of text: XYZ, TXT, CSV, ASC, PTS and their kin, with any separator and with or without a line of names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.errors import EmptyScanError, FormatError, require
from scan2fea.io import columns
from scan2fea.io.numbers import TextTable, forget, mapped, number, shown, split_line
from scan2fea.io.planar_scan import PlanarColumns, planar_columns, planar_piece
from scan2fea.io.source import ROWS_PER_PIECE, Column, Piece, Source
from scan2fea.io.tokens import WHITESPACE
from scan2fea.types import ByteArray
from scan2fea.units import METRES_PER_UNIT

_HEAD = 1 << 16  # bytes in which the first rows must lie
_SAMPLE = 200  # rows from which unnamed columns are told
_COMMENTS = ("#", "%", "//")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
_THOUSANDS = re.compile(r'"[+-]?\d{1,3}(,\d{3})+(\.\d*)?"')
_BRACKET = re.compile(r"\s*[\[(]\s*([^\])]*?)\s*[\])]")  # of a title: the unit, as in X [mm]
_UNITS = {"metre": "m", "meter": "m", "metres": "m", "meters": "m", "inch": "in", "feet": "ft", "foot": "ft", "usft": "ft_us"}


def open_text(path: Path, size: int) -> Source:
    """A file of lines. Raises FormatError (binary, UTF-16, no line end, no x y z, a promised count that cannot be), EmptyScanError."""
    layout = _layout(path, size)
    table = layout.table
    if layout.n_points is not None:
        most = (table.stop - table.start) // (2 * 3) + 1  # a coordinate takes two bytes at least
        require(
            0 <= layout.n_points <= most,
            FormatError,
            f"{path} promises {layout.n_points} points, but its {size} bytes hold at most {most}: it is cut off or not a scan",
        )

    planar = None if columns.find_all(table.names, "x", "y", "z") else planar_columns(table.names)

    def pieces(wanted: frozenset[str]) -> Iterator[Piece]:
        return _pieces(layout, wanted, planar)

    notes = layout.notes + (planar.notes if planar is not None else ())
    return Source(columns=table.names, pieces=pieces, n_points=layout.n_points, unit=layout.unit, notes=notes)


@dataclass(frozen=True)
class _Layout:
    """Where the rows begin, what their columns are, the count a PTS file begins with, and the unit that the titles of x, y and z state."""

    table: TextTable
    n_points: int | None
    notes: tuple[str, ...]
    unit: str


@dataclass(frozen=True)
class _Line:
    start: int
    text: str
    number: int


def _pieces(layout: _Layout, wanted: frozenset[str], planar: PlanarColumns | None) -> Iterator[Piece]:
    table, left = layout.table, layout.n_points
    xyz = (columns.find_all(table.names, "x", "y", "z") or ()) if planar is None else (planar.angle, planar.range)
    others = tuple(name for name in table.names if name in wanted and name not in xyz)
    numbers = tuple(table.names.index(name) for name in xyz + others)
    position, read = table.start, 0
    while True:
        limit = ROWS_PER_PIECE if left is None else min(left, ROWS_PER_PIECE)
        values, position = table.rows(position, limit, numbers)
        read += len(values)
        if len(values):
            beside: dict[str, Column] = {name: values[:, len(xyz) + k] for k, name in enumerate(others)}
            if planar is None:
                yield Piece(points=values[:, :3], columns=beside)
            else:
                yield planar_piece(str(table.path), values[:, 0], values[:, 1], bool(planar.in_degrees), beside)
            forget(table.text)
        if left is not None:
            left -= len(values)
            require(
                left == 0 or len(values) == limit,
                FormatError,
                f"{table.path} promises {read + left} points, but holds {read}: it is cut off; export it again",
            )
            if left == 0:
                left, position = _next_block(table, position)
        if left == 0 or (left is None and len(values) < limit):
            return


def _next_block(table: TextTable, position: int) -> tuple[int | None, int]:
    """The count that begins another block of a PTS file and the position after it; 0 at the end."""
    rest = table.text[position : min(position + _HEAD, table.stop)].tobytes()
    first = next((line for line in rest.split(b"\n") if line.strip()), b"")
    if not first:
        return 0, position
    tokens = first.split()
    if len(tokens) == 1 and tokens[0].isdigit():
        return int(tokens[0]), position + rest.index(first) + len(first)
    return None, position  # rows beyond the count: read them all


def _layout(path: Path, size: int) -> _Layout:
    text = mapped(path)
    head = text[:_HEAD].tobytes()
    require_text(path, head, size)
    start = 3 if head.startswith(b"\xef\xbb\xbf") else 0
    lines = list(_lines(head, start, complete=size <= _HEAD))
    require(lines, EmptyScanError, f"{path} holds no rows of numbers, only blank lines and comments: export it again")
    titles: list[_Line] = []
    n_points = None
    for place, line in enumerate(lines):
        if line.text.startswith(_COMMENTS):
            titles.append(line)
        elif (count := _count(line.text, [later.text for later in lines[place + 1 : place + 3]])) is not None:
            n_points = count
        elif _is_row(line.text):
            table, notes = _table(path, text, size, line, titles)
            return _Layout(table, n_points, notes, _unit(table.names, titles))
        else:
            titles.append(line)
    if n_points == 0:
        raise EmptyScanError(f"{path} promises 0 points: export it again")
    if len(titles) == 1 and columns.find_all(split_line(titles[0].text.encode(), _separator(titles[0].text)[0]), "x", "y", "z"):
        raise EmptyScanError(f"{path} has a line of names, but no rows: export it again")
    raise FormatError(f"{path} holds no rows of numbers: line {lines[0].number} is {shown(lines[0].text.encode())}; is it a scan?")


def require_text(path: Path, head: bytes, size: int) -> None:
    """Refuse a file whose first bytes are not lines of UTF-8 text."""
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or (head[1::2].count(0) > len(head) // 4 and head[0::2].count(0) < len(head) // 16):
        raise FormatError(f"{path} is UTF-16 text: save it as UTF-8")
    control = re.search(rb"[\x00-\x08\x0e-\x19\x1b-\x1f\x7f]", head)
    require(
        control is None, FormatError, f"{path} is not text: byte {control.start() if control else 0} is a control character; is its suffix right?"
    )
    if b"\n" not in head and size > _HEAD:
        raise FormatError(f"{path}: no line ends within its first {_HEAD} bytes: save it with one point per line")
    if b"\n" not in head and b"\r" in head.strip():
        raise FormatError(f"{path}: its lines end with CR alone: save it with LF or CRLF")


def _lines(head: bytes, start: int, complete: bool) -> Iterator[_Line]:
    """Lines of the head that are not blank; the last one only where it is whole."""
    position = start
    parts = head[start:].split(b"\n")
    for k, part in enumerate(parts if complete else parts[:-1]):
        text = part.decode("utf-8", "replace").strip()
        if text:
            yield _Line(position, text, k + 1)
        position += len(part) + 1


def _separator(line: str) -> tuple[int, str]:
    """The separator of a line of values, and its decimal sign."""
    tokens = line.split()
    if len(tokens) >= 3 and all(_DECIMAL_COMMA.fullmatch(token) for token in tokens):
        return WHITESPACE, ","
    for candidate in ";,|":
        if candidate in line:
            parts = [part.strip() for part in line.split(candidate)]
            comma = candidate != "," and "." not in line and any(_DECIMAL_COMMA.fullmatch(part) for part in parts)
            return ord(candidate), "," if comma else "."
    return (9 if "\t\t" in line else WHITESPACE), "."


def _is_row(line: str) -> bool:
    """At least three numbers, and not mostly words."""
    separator, point = _separator(line)
    tokens = split_line(line.encode(), separator)
    values = [token for token in tokens if token and number(token.encode(), point) is not None]
    return len(values) >= 3 and 2 * len(values) >= len(tokens)


def _count(line: str, following: list[str]) -> int | None:
    """The whole number alone on a line before rows, as PTS files begin; None otherwise."""
    if not re.fullmatch(r"[+-]?\d+", line) or (following and not _is_row(following[0])):
        return None
    return int(line)


def _table(path: Path, text: ByteArray, size: int, first: _Line, titles: list[_Line]) -> tuple[TextTable, tuple[str, ...]]:
    separator, point = _separator(first.text)
    if (number_of := _THOUSANDS.search(first.text)) is not None:
        raise FormatError(f"{path}, line {first.number}: {number_of[0]} has separators of thousands: export it without them")
    tokens = split_line(first.text.encode(), separator)
    bare = TextTable(path, text, first.start, size, separator, ord(point), len(tokens))
    names, notes = _names(path, bare, tokens, titles)
    require(
        columns.find_all(names, "x", "y", "z") or planar_columns(names),
        FormatError,
        f"{path}: its columns are {', '.join(names)[:200]}: columns named x, y and z are needed, or angle and range",
    )
    return TextTable(path, text, first.start, size, separator, ord(point), len(tokens), names), notes


def _names(path: Path, table: TextTable, tokens: list[str], titles: list[_Line]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the columns: from the last line above the rows that has as many words, else told from the first rows."""
    for line in reversed(titles):
        words = _titles(line)
        is_comment = line.text.startswith(_COMMENTS)
        if is_comment and not columns.find_all(words, "x", "y", "z") and planar_columns(words) is None:
            continue
        if len(words) == len(tokens):
            return _distinct(words), ()
        if columns.find_all(words, "x", "y", "z"):
            require(
                len(words) < len(tokens),
                FormatError,
                f"{path}, line {line.number} names {len(words)} columns, but the rows have {len(tokens)}: name every column",
            )
            return _distinct(words + [f"c{k + 1}" for k in range(len(words), len(tokens))]), ()
    numeric = tuple(k for k, token in enumerate(tokens) if number(token.encode(), chr(table.point)) is not None)
    sample = np.full((_SAMPLE, len(tokens)), np.nan)
    rows = table.sample(_SAMPLE, numeric, _HEAD)
    sample[: len(rows), list(numeric)] = rows
    passed = [line for line in titles if not line.text.startswith(_COMMENTS)]
    notes = tuple(f"line {line.number} ({shown(line.text.encode())}) was passed over" for line in passed)
    before = int(columns.has_number_before(sample[: len(rows)]))
    if before:
        notes += ("column 1 goes up by one from row to row: taken for the number of the point, x, y and z for those after it",)
    names = ("number",)[:before] + columns.guessed(sample[: len(rows), before:], len(tokens) - before)
    if path.suffix.lower() == ".xyzc" and len(names) == 4:  # the suffix says what the fourth column is
        names = ("x", "y", "z", "label")
    return names, notes


def _titles(line: _Line) -> list[str]:
    """The names on a line of titles; what stands in brackets belongs to the name before it."""
    text = line.text.lstrip("#%/ ")
    return split_line(_BRACKET.sub(lambda found: f"[{found[1].replace(' ', '')}]", text).encode(), _separator(_BRACKET.sub("", text))[0])


def _unit(names: tuple[str, ...], titles: list[_Line]) -> str:
    """The unit in brackets after x, y and z where one line of titles has the same after all three and it is known; else ""."""
    for line in reversed(titles):
        words = _titles(line)
        xyz = columns.find_all(words, "x", "y", "z") if tuple(words) == names[: len(words)] else None
        found = {m[1].lower() if (m := _BRACKET.search(word)) else "" for word in xyz or ()}
        if len(found) == 1:
            unit = found.pop()
            unit = _UNITS.get(unit, unit)
            return unit if unit in METRES_PER_UNIT else ""
    return ""


def _distinct(names: list[str]) -> tuple[str, ...]:
    """Names made unique: a column without a name, or with that of an earlier one, gets its number."""
    seen: list[str] = []
    for k, name in enumerate(names):
        seen.append(name if name and name not in seen else f"{name or 'c'}_{k + 1}" if name else f"c{k + 1}")
    return tuple(seen)
