"""Nastran decks in: the cards of case control and bulk data, and the mesh of tetrahedra, shells and bars that they hold."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scan2fea.errors import FormatError, require
from scan2fea.io.volume import Blocks
from scan2fea.types import Value

_LARGEST = 1 << 30
# card -> (cell, nodes, field of the first node)
_CELLS = {
    "CTRIA3": ("triangle", 3, 3), "CTRIA6": ("triangle6", 6, 3), "CQUAD4": ("quad", 4, 3), "CQUAD8": ("quad8", 8, 3), "CTRIAR": ("triangle", 3, 3),
    "CQUADR": ("quad", 4, 3), "CBAR": ("line", 2, 3), "CBEAM": ("line", 2, 3),
}  # fmt: skip
_OTHERS = ("CHEXA", "CPENTA", "CPYRAM", "CROD", "CONROD", "CTUBE", "CTRIAX6", "CSHEAR")


@dataclass(frozen=True, eq=False, kw_only=True)
class NastranDeck(Value):
    """blocks : the mesh.   control : lines before BEGIN BULK, upper case.   bulk : each card as its fields, its name first."""

    blocks: Blocks
    control: tuple[str, ...]
    bulk: tuple[tuple[str, ...], ...]


def read_bdf(path: Path, size: int) -> NastranDeck:
    """Raises FormatError where the deck is not sound or not ended, includes other files, or has other elements or nodes in systems of their own."""
    require(size <= _LARGEST, FormatError, f"{path} has {size} bytes, at most {_LARGEST} are read")
    lines = [line.split("$")[0].rstrip() for line in path.read_text(encoding="latin-1").splitlines()]
    begins = next((k for k, line in enumerate(lines) if re.match(r"\s*BEGIN\s+BULK", line, re.IGNORECASE)), -1)
    require(begins >= 0, FormatError, f"{path} has no BEGIN BULK: it is no Nastran deck")
    included = next((line.strip() for line in lines if re.match(r"\s*INCLUDE\b", line, re.IGNORECASE)), "")
    require(not included, FormatError, f"{path} includes another file ({included}): give the deck as one file")
    bulk = tuple(_cards(lines[begins + 1 :]))
    blocks = _mesh(path, bulk)
    ends = any(re.match(r"\s*ENDDATA\b", line, re.IGNORECASE) for line in lines[begins + 1 :])
    require(ends, FormatError, f"{path} has no ENDDATA behind its bulk data: it is cut short")
    return NastranDeck(blocks=blocks, control=tuple(line.strip().upper() for line in lines[:begins] if line.strip()), bulk=bulk)


def number(word: str) -> float:
    """A real of Nastran, whose exponent may lack its letter: 7.85-9. Raises ValueError."""
    return float(re.sub(r"(?<=[\d.])([+-]\d+)$", r"e\1", word.upper().replace("D", "E")))


def _cards(lines: list[str]) -> Iterator[tuple[str, ...]]:
    """Cards with the fields of their further lines; trailing empty fields left out."""
    card: list[str] = []
    for line in lines:
        if not line.strip():
            continue
        fields = _fields(line)
        if fields[0] == "" or fields[0][0] in "+*":
            card += fields[1:]
            continue
        if card:
            yield _trimmed(card)
        if fields[0].upper() == "ENDDATA":
            return
        card = [fields[0].upper().rstrip("*"), *fields[1:]]
    if card:
        yield _trimmed(card)


def _trimmed(card: list[str]) -> tuple[str, ...]:
    while card and not card[-1]:
        card.pop()
    return tuple(card)


def _fields(line: str) -> list[str]:
    """The name and the eight fields (four of 16 characters) of a line."""
    if "," in line:
        words = [word.strip() for word in line.split(",")]
        width = 4 if "*" in words[0] else 8
        return [words[0], *(words[1 : 1 + width] + [""] * width)[:width]]
    text = line.expandtabs(8)
    step, width = (16, 4) if "*" in text[:8] else (8, 8)
    return [text[:8].strip(), *(text[8 + step * k : 8 + step * (k + 1)].strip() for k in range(width))]


def _mesh(path: Path, bulk: tuple[tuple[str, ...], ...]) -> Blocks:
    grids: list[tuple[int, float, float, float]] = []
    cells: dict[str, list[tuple[int, ...]]] = {}
    try:
        for card in bulk:
            name = card[0]
            if name == "GRID":
                basic = len(card) < 3 or card[2] in ("", "0")
                require(basic, FormatError, f"{path}: node {card[1]} is given in a system of its own: export it in the basic one")
                x, y, z = (number(word) if word else 0.0 for word in (*card[3:6], "", "", "")[:3])
                grids.append((int(card[1]), x, y, z))
            elif name == "CTETRA":
                own = [int(word) for word in card[3:13] if word]
                require(len(own) in (4, 10), FormatError, f"{path}: CTETRA {card[1]} has {len(own)} nodes: 4 or 10 are read")
                cells.setdefault("tet" if len(own) == 4 else "tet10", []).append((int(card[1]), *own))
            elif name in _CELLS:
                kind, n, first = _CELLS[name]
                cells.setdefault(kind, []).append((int(card[1]), *(int(word) for word in card[first : first + n])))
            elif name in _OTHERS:
                raise FormatError(f"{path} has elements {name}: CTETRA, {', '.join(_CELLS)} are read")
    except (ValueError, IndexError) as error:
        raise FormatError(f"{path}: a card {name} cannot be read ({error}): it is cut off or damaged") from error
    require(grids and cells, FormatError, f"{path} has {len(grids)} GRID and {sum(map(len, cells.values()))} elements: it is no mesh")
    table = np.array(sorted(grids))
    numbers = table[:, 0].astype(np.int64)
    require(not bool((np.diff(numbers) == 0).any()), FormatError, f"{path} numbers nodes twice")
    rows = {kind: np.array(own, np.int64) for kind, own in cells.items()}
    place = {kind: np.minimum(np.searchsorted(numbers, own[:, 1:]), len(numbers) - 1) for kind, own in rows.items()}
    found = tuple((kind, np.where(numbers[place[kind]] == own[:, 1:], place[kind], -1), np.zeros(len(own), np.int64)) for kind, own in rows.items())
    own_numbers = tuple(own[:, 0] for own in rows.values())
    once, count = np.unique(np.concatenate(own_numbers), return_counts=True)
    require(int(count.max()) == 1, FormatError, f"{path} numbers element {once[count.argmax()]} twice")
    return Blocks(path=path, nodes=table[:, 1:], cells=found, names={}, node_numbers=numbers, cell_numbers=own_numbers)
