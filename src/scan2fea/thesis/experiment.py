"""What an experiment is, and what it gives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scan2fea.thesis.bench import Bench, ThesisOptions

Cell = str | int | float | bool | None
Chore = tuple[str, ...]


def _nothing(_: ThesisOptions) -> tuple[Chore, ...]:
    return ()


@dataclass(frozen=True, kw_only=True)
class Table:
    """head : names of the columns.   rows : a cell of each column; None is "not told"."""

    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Made:
    """What came of an experiment: a picture (PNG), a table, or both; says : sentences below it; failed : why it gave nothing, else empty."""

    picture: bytes = b""
    table: Table | None = None
    says: tuple[str, ...] = ()
    failed: str = ""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One numbered thing of the thesis.

    id : "F4.9", "T4.1", or of what the thesis leaves blank: "S4.4" (section), "H1" (hypothesis).   section : where it stands.
    needs : what it shares with others, or takes long, by the options of the run; see chores.
    """

    id: str
    section: str
    title: str
    make: Callable[[Bench], Made]
    needs: Callable[[ThesisOptions], Sequence[Chore]] = _nothing
