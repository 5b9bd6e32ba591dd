"""What a user writes for a known section: "L127x127x6.35", "RHS 100x60x5", "L5x5x1/4 in", "HE 140 A", "W8X31"."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass

from scan2fea.errors import UsageError, require
from scan2fea.estimation.table import Shape, Table, shipped_table
from scan2fea.kernel.sections import PARAMETERS, check_section
from scan2fea.types import Value
from scan2fea.units import METRES_PER_UNIT

# letters of a designation -> family, and what its numbers are, in order
_FORMS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "L": ("L", ("a", "b", "t")),
    "I": ("I", ("h", "b", "tw", "tf")),
    "C": ("C", ("h", "b", "tw", "tf")),
    "T": ("T", ("h", "b", "tw", "tf")),
    "RHS": ("RHS", ("h", "b", "t")),
    "SHS": ("RHS", ("h", "b", "t")),
    "CHS": ("CHS", ("d", "t")),
    "FL": ("rect", ("b", "t")),
    "RECT": ("rect", ("b", "t")),
    "RD": ("round", ("d",)),
    "ROUND": ("round", ("d",)),
}
UNITS = ("mm", "cm", "m", "in")
_TEXT = re.compile(r"^\s*([A-Za-z]+)\s*((?:[0-9][0-9./\- ]*[xX×*]?\s*)*)\s*(mm|cm|m|in|\")?\s*$")
_NUMBER = re.compile(r"^(?:(\d+)[- ])?(\d+)/(\d+)$")


@dataclass(frozen=True, kw_only=True)
class Designation(Value):
    """parameters : metres; those that are given are not fitted.   shape : the size of the table it names, or None."""

    text: str
    family: str
    parameters: Mapping[str, float]
    shape: Shape | None


def parse_designation(text: str, table: Table | None = None) -> Designation:
    """The section a designation stands for: a name of the table, or letters and outer sizes in millimetres (or a unit at the end).

    Letters alone ("L") give the family and no dimension. Two numbers of L or RHS are its equal sides and its thickness. Raises UsageError with the
    forms there are, the nearest name of the table, the dimension that makes no section, or a fraction without a unit: those are inches as a rule.
    """
    sizes = shipped_table() if table is None else table
    found = sizes.named(text)
    if found is not None:
        return Designation(text=text, family=found.family, parameters=dict(found.parameters), shape=found)
    match = _TEXT.match(text)
    letters = match[1].upper() if match else ""
    if match is None or letters not in _FORMS:
        raise UsageError(_unknown(text, sizes))
    family, names = _FORMS[letters]
    unit = {"": "mm", '"': "in"}.get(match[3] or "", match[3] or "mm")
    says = f"--member {text!r} has a fraction but no unit: write {text.strip()} in, or millimetres as decimals"
    require(match[3] or "/" not in match[2], UsageError, says)
    numbers = [_number(part, text) for part in re.split(r"[xX×*]", match[2]) if part.strip()]
    if not numbers:
        return Designation(text=text, family=family, parameters={}, shape=None)
    if family in ("L", "RHS") and len(numbers) == 2:
        numbers.insert(1, numbers[0])
    says = f"--member {text!r}: {letters} takes {len(names)} numbers, {' x '.join(names)}; there are {len(numbers)}"
    require(len(numbers) == len(names), UsageError, says)
    values = {name: number * METRES_PER_UNIT[unit] for name, number in zip(names, numbers, strict=True)}
    if letters == "SHS":
        values = {"h": values["h"], "b": values["h"], "t": values["t"]}
    check_section(family, values)
    return Designation(text=text, family=family, parameters={name: values[name] for name in PARAMETERS[family]}, shape=None)


def _number(text: str, whole: str) -> float:
    """A decimal number or a fraction: 6.35, 1/4, 3-1/2, 3 1/2."""
    plain = text.strip()
    fraction = _NUMBER.match(plain)
    try:
        if fraction:
            return int(fraction[1] or 0) + int(fraction[2]) / int(fraction[3])
        return float(plain)
    except (ValueError, ZeroDivisionError):
        raise UsageError(f"--member {whole!r}: {plain!r} is not a number; write 6.35, 1/4 or 3-1/2") from None


def _unknown(text: str, table: Table) -> str:
    near = difflib.get_close_matches(text.upper(), [shape.name.upper() for shape in table.shapes], n=1, cutoff=0.6)
    hint = f"; did you mean {near[0]}?" if near else ""
    forms = "; ".join(f"{letters} {' x '.join(names)}" for letters, (_, names) in _FORMS.items())
    return f"--member {text!r} names no section of {table.source}{hint} Write a name of that table, or sizes in mm (or end with in): {forms}"
