"""Lines of fea.supports and fea.loads that name a set which no object has: what they ask for was done nowhere, and the run must not pass for done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scan2fea.fea import ALL, LOWEST, FeaOptions, parse_loads, parse_supports
from scan2fea.pipeline.results import MAX_NAMES

Row = Mapping[str, Any]


def asked_in_vain(options: FeaOptions, objects: Sequence[Row]) -> list[str]:
    """One sentence for each such line. objects : the rows of report.json; a line says nothing of those that were not solved."""
    supports = [(line.number, line.set_name) for line in parse_supports(options.supports) or ()]
    named = list(zip(options.supports, supports, strict=True)) if supports else []
    loads = [(line.number, ALL if line.load.kind == "gravity" else line.load.set_name) for line in parse_loads(options.loads)]
    named += zip(options.loads, loads, strict=True)
    solved = {row["id"]: _sets(row) for row in objects if row.get("fea")}
    return [f"{line!r}: {_says(number, name)}" for line, (number, name) in named if solved and not _serves(number, name, solved)]


def _sets(row: Row) -> set[str] | None:
    """None where the row may leave some out."""
    names = {str(one["name"]) for one in row["fea"].get("sets") or []}
    return None if len(names) >= MAX_NAMES else names | {ALL, LOWEST}


def _serves(number: int | None, name: str, solved: Mapping[int, set[str] | None]) -> bool:
    return any(sets is None or name in sets for one, sets in solved.items() if number in (None, one))


def _says(number: int | None, name: str) -> str:
    return f"no object has a set {name}" if number is None else f"object {number} was not solved, or has no set {name}"
