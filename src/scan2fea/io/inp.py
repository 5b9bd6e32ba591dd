"""Abaqus and CalculiX decks in: nodes, tetrahedra C3D4 and C3D10, shells S3 to S8, beams B31 and B32, springs and masses, of one part."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from scan2fea.errors import FormatError, require
from scan2fea.io.text import require_text
from scan2fea.io.volume import Blocks
from scan2fea.types import FloatArray

Array = npt.NDArray[Any]
_LARGEST = 1 << 31
_CELLS = {
    **{name: ("tet", 4) for name in ("C3D4", "C3D4H", "C3D4T")},
    **{name: ("tet10", 10) for name in ("C3D10", "C3D10M", "C3D10H", "C3D10T", "C3D10MH", "C3D10I")},
    **{name: ("triangle", 3) for name in ("S3", "S3R", "STRI3", "CPS3", "CPE3", "R3D3", "M3D3")},
    **{name: ("triangle6", 6) for name in ("S6", "STRI65", "M3D6")},
    **{name: ("quad", 4) for name in ("S4", "S4R", "S4R5")},
    **{name: ("quad8", 8) for name in ("S8", "S8R", "S8R5")},
    **{name: ("line", 2) for name in ("B31", "B31R", "B31H", "B31OS")},
    **{name: ("line3", 3) for name in ("B32", "B32R", "B32H", "B32OS")},
    **{name: ("point", 1) for name in ("MASS", "ROTARYI", "SPRING1", "DASHPOT1")},
    **{name: ("pair", 2) for name in ("SPRING2", "SPRINGA", "DASHPOT2", "DASHPOTA", "CONN3D2", "GAPUNI")},
}
_KEYWORD = rb"^\*(NODE|ELEMENT|INCLUDE)\b(?!\s*(?:FILE|PRINT|OUTPUT|RESPONSE))([^\n]*)\n"
_BLOCK = re.compile(_KEYWORD + rb"((?:[^*][^\n]*\n?|\n)*)", re.IGNORECASE | re.MULTILINE)


def read_inp(path: Path, size: int) -> Blocks:
    """Nodes and cells of a deck. Raises FormatError where it is not sound, includes other files, or has several parts or other elements."""
    require(size <= _LARGEST, FormatError, f"{path} has {size} bytes, at most {_LARGEST} are read")
    content = path.read_bytes().replace(b"\r\n", b"\n")
    require_text(path, content[: 1 << 16], len(content))
    content = re.sub(rb"^\*\*[^\n]*\n", b"", content if content.endswith(b"\n") else content + b"\n", flags=re.MULTILINE)
    nodes: list[FloatArray] = []
    cells: list[tuple[str, Array]] = []
    cell_numbers: list[Array] = []
    for keyword, options, data in _BLOCK.findall(content):
        word = keyword.upper()
        other = re.search(rb"INPUT\s*=\s*([^,\n]+)", options, re.IGNORECASE)
        if word == b"INCLUDE" or other:
            name = other.group(1).decode(errors="replace").strip().strip('"') if other else "(no name)"
            there = "" if (path.parent / name).is_file() else f", and {name} is not there"
            raise FormatError(f"{path} includes {name} (card *{word.decode().upper()}){there}: give the deck as one file")
        if word == b"NODE":
            nodes.append(_numbers(path, data, 4, "NODE"))
            lines = sum(bool(line.strip(b" ,\t")) for line in data.split(b"\n"))
            require(lines == len(nodes[-1]), FormatError, f"{path}: {lines} lines of NODE hold {4 * len(nodes[-1])} values: plane nodes are not read")
        else:
            kind = re.search(rb"TYPE\s*=\s*(\w+)", options, re.IGNORECASE)
            name = kind.group(1).decode().upper() if kind else "(none)"
            require(name in _CELLS, FormatError, f"{path} has elements {name}: {', '.join(_CELLS)} are read")
            shape, width = _CELLS[name]
            table = _numbers(path, data, 1 + width, name).astype(np.int64)
            cells.append((shape, table[:, 1:]))
            cell_numbers.append(table[:, 0])
    require(nodes and cells, FormatError, f"{path} has {len(nodes)} blocks *NODE and {len(cells)} *ELEMENT: it is no mesh")
    placed = np.concatenate(nodes)
    order = np.argsort(placed[:, 0], kind="stable")
    numbers = placed[order, 0].astype(np.int64)
    require(not bool((np.diff(numbers) == 0).any()), FormatError, f"{path} numbers nodes twice: a deck of several parts is not read")
    own, count = np.unique(np.concatenate(cell_numbers), return_counts=True)
    require(int(count.max(initial=1)) == 1, FormatError, f"{path} numbers element {own[count.argmax()]} twice: a deck of several parts is not read")
    blocks = tuple((shape, _found(numbers, block), np.zeros(len(block), np.int64)) for shape, block in cells)
    return Blocks(path=path, nodes=placed[order, 1:], cells=blocks, names={}, node_numbers=numbers, cell_numbers=tuple(cell_numbers))


def _found(numbers: Array, block: Array) -> Array:
    """Rows of nodes by their numbers, -1 where there is none."""
    place = np.minimum(np.searchsorted(numbers, block), len(numbers) - 1)
    return np.where(numbers[place] == block, place, -1)


def _numbers(path: Path, data: bytes, width: int, what: str) -> FloatArray:
    """Rows of a block; a row may run over several lines."""
    words = [word.strip() for word in data.replace(b"\n", b",").split(b",")]
    try:
        values = np.array([word for word in words if word], dtype="S32").astype(float) if words else np.zeros(0)
    except ValueError as error:
        raise FormatError(f"{path}: a line of {what} is not of numbers ({error}): correct it") from error
    require(len(values) % width == 0, FormatError, f"{path}: a line of {what} has not {width} values: it is cut off or damaged")
    return values.reshape(-1, width)
