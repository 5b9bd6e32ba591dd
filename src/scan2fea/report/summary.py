"""What the console says after a run: one line per object."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from scan2fea.report.words import (
    THIN_SPACE,
    count,
    dimensions,
    first_frequency_hz,
    headline,
    mass_kg,
    number,
    number_of,
    stand_in,
    unobserved,
    volume,
)


def summary_lines(report: Mapping[str, Any]) -> tuple[str, ...]:
    """One line per object, converted or failed and why; last the sentence that counts them. A pure function of report.json."""
    lines = [_line(item) for item in report.get("objects") or []]
    return tuple(_plain(line) for line in (*lines, headline(report)))


def _line(item: Mapping[str, Any]) -> str:
    name = f"{number_of(item)} {item.get('kind') or 'object'}"
    if item.get("verdict") != "converted":
        return f"{name}: failed: {item.get('reason') or 'no reason given'}"
    facts = [f"{count(item.get('n_points'))} points", volume((item.get("surface") or {}).get("volume_m3"))]
    if item.get("size_m"):
        facts.append(dimensions(item["size_m"]))
    mass, frequency = mass_kg(item), first_frequency_hz(item)
    facts += [f"{number(mass)} kg"] if mass is not None else []
    facts += [f"f1 {number(frequency)} Hz"] if frequency is not None else []
    facts += [f"not observed: {', '.join(unobserved(item))} (from {stand_in([item])})"] if unobserved(item) else []
    return f"{name}: converted: {', '.join(facts)}"


def _plain(line: str) -> str:
    """For terminals: no control characters from file names, no narrow spaces."""
    return "".join(c if c.isprintable() or c == " " else " " for c in line.replace(THIN_SPACE, " "))
