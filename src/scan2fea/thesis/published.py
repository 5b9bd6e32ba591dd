"""What the thesis prints, from published.toml: facts by their own numbers."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Printed:
    """A row of tables 4.1 to 4.7.

    mesh : "AF" (advancing front) or "SS2", "SS4", "SS15" (scale space).   stage : "initial" or "optimised".   q1 .. q4 : of the worst element.
    shells : "bounded surfaces".   converts : whether Fusion made a solid of it.
    """

    mesh: str
    stage: str
    q1: float
    q2: float
    q3: float
    q4: float
    shells: int
    converts: bool

    def measures(self) -> tuple[float, float, float, float]:
        return self.q1, self.q2, self.q3, self.q4


@dataclass(frozen=True, kw_only=True)
class PrintedTable:
    id: str
    section: str
    title: str
    rows: tuple[Printed, ...]


@dataclass(frozen=True, kw_only=True)
class Blank:
    """What the thesis leaves to be written.   asks : what is missing there.   at : experiments that answer it."""

    section: str
    asks: str
    at: tuple[str, ...]


@cache
def _tree() -> Mapping[str, Any]:
    return tomllib.loads(resources.files("scan2fea.thesis").joinpath("published.toml").read_text(encoding="utf-8"))


def source() -> str:
    """Author and title."""
    return str(_tree()["source"])


def stated(name: str) -> float:
    """A figure of the thesis's sentences."""
    return float(_tree()["stated"][name])


def shape_printed() -> dict[str, float]:
    """Dimension -> inches that the estimation of figure 3.6 came to."""
    return {name: float(value) for name, value in _tree()["shape"].items()}


@cache
def printed_tables() -> Mapping[str, PrintedTable]:
    """Tables 4.1 to 4.7 by number, "T4.1" to "T4.7"."""
    return {
        item["id"]: PrintedTable(id=item["id"], section=item["section"], title=item["title"], rows=tuple(Printed(**row) for row in item["rows"]))
        for item in _tree()["table"]
    }


@cache
def blanks() -> tuple[Blank, ...]:
    """In the order of the text."""
    return tuple(Blank(section=item["section"], asks=item["asks"], at=tuple(item["at"])) for item in _tree()["blank"])
