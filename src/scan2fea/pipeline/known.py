"""[[object]] tables of the configuration: what is known of single objects. docs/estimation.md shows one."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from scan2fea.errors import UsageError, require
from scan2fea.kernel.sections import PARAMETERS
from scan2fea.options import option


@dataclass(frozen=True, kw_only=True)
class KnownObject:
    """What is known of one object."""

    id: int | None = option(None, "number of the object, as in report.json")
    at: tuple[float, float, float] | None = option(None, "a place (x, y, z) in the inputs: the object whose centre is nearest is meant", unit="m")
    family: str = option("", "family of its section", choices=("", *PARAMETERS))
    member: str = option("", "its section: L127x127x6.35 (mm), HE 140 A; its dimensions are held and tested")
    step: str = option("", "STEP file of the drawing: laid onto the points and compared face by face; of a member its section is held and tested")
    tolerance: float | None = option(None, "what a face may lie off the drawing; ISO 2768-1 class m of its size without", unit="m")
    fixed: Mapping[str, float] = field(
        default_factory=dict, metadata={"doc": "dimensions that are held and tested, such as { t = 0.00635, length = 3.0 }", "unit": "m"}
    )
    nominal: Mapping[str, float] = field(
        default_factory=dict, metadata={"doc": "dimensions that are measured, then compared with these", "unit": "m"}
    )
    whole: bool = option(False, "nothing hid it from the scan and nothing was cut off it: faces, and the member, end where the scan of them does")


# ------------------------------------------------------------------ reading and writing


def known_object(row: Any, number: int) -> KnownObject:
    """One table as read from TOML. Raises UsageError that names the table, the key and what is allowed."""
    where = f"[[object]] table {number}"
    require(isinstance(row, Mapping), UsageError, f"{where}: expected a table, not {row!r}")
    names = [f.name for f in dataclasses.fields(KnownObject)]
    for key in row:
        near = difflib.get_close_matches(str(key), names, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"use {', '.join(names)}"
        require(key in names, UsageError, f"{where}: key {key!r} is not known; {hint}")
    values = {key: value for key, value in row.items() if value is not None}
    if "id" in values:
        says = f"{where}: id = {values['id']!r}; it is a number from 1 on"
        require(type(values["id"]) is int and values["id"] >= 1, UsageError, says)
    if "at" in values:
        values["at"] = _place(values["at"], where)
    for key in ("family", "member", "step"):
        require(isinstance(values.get(key, ""), str), UsageError, f"{where}: {key} = {values.get(key)!r}; expected text")
    for key in ("fixed", "nominal"):
        values[key] = _dimensions(values.get(key, {}), key, where)
    give = values.get("tolerance")
    is_length = give is None or (isinstance(give, int | float) and not isinstance(give, bool) and math.isfinite(give) and give > 0)
    require(is_length, UsageError, f"{where}: tolerance = {give!r}; it is a positive number of metres")
    require(give is None or bool(values.get("step")), UsageError, f"{where}: a tolerance needs a drawing (step)")
    require(isinstance(values.get("whole", False), bool), UsageError, f"{where}: whole = {values.get('whole')!r}; it is true or false")
    known = KnownObject(**values)
    require((known.id is None) != (known.at is None), UsageError, f"{where}: give either id or at, to say which object is meant")
    says = f"{where}: family = {known.family!r}; use one of {', '.join(PARAMETERS)}"
    require(known.family in ("", *PARAMETERS), UsageError, says)
    require(not (known.member and known.step), UsageError, f"{where}: give member or step, not both")
    return known


def _place(value: Any, where: str) -> tuple[float, float, float]:
    says = f"{where}: at = {value!r}; expected three coordinates"
    require(isinstance(value, list | tuple) and len(value) == 3, UsageError, says)
    require(all(isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) for x in value), UsageError, says)
    return (float(value[0]), float(value[1]), float(value[2]))


def _dimensions(value: Any, key: str, where: str) -> dict[str, float]:
    require(isinstance(value, Mapping), UsageError, f"{where}: {key} = {value!r}; write {key} = {{ t = 0.00635 }} (metres)")
    known = {name for names in PARAMETERS.values() for name in names} | {"length"}
    for name, size in value.items():
        require(name in known, UsageError, f"{where}: {key}: {name!r} is no dimension; use {', '.join(sorted(known))}")
        number = isinstance(size, int | float) and not isinstance(size, bool) and math.isfinite(size) and size > 0
        require(number, UsageError, f"{where}: {key}: {name} = {size!r}; it is a positive number of metres")
    return {name: float(size) for name, size in value.items()}


def table_lines(objects: Sequence[KnownObject], comments: bool) -> list[str]:
    """The tables as TOML; without any, how one is written."""
    lines: list[str] = []
    if comments:
        lines.append("# What is known of single objects: any number of tables [[object]] with the keys")
        for f in dataclasses.fields(KnownObject):
            unit = f" [{f.metadata['unit']}]" if f.metadata.get("unit") else ""
            lines.append(f"# {f.name}: {f.metadata['doc']}{unit}")
        lines.append("")
    for known in objects:
        lines.append("[[object]]")
        for f in dataclasses.fields(KnownObject):
            value = getattr(known, f.name)
            if value:
                lines.append(f"{f.name} = {_toml(value)}")
        lines.append("")
    return lines


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {size!r}" for name, size in value.items()) + " }"
    if isinstance(value, tuple):
        return "[" + ", ".join(repr(x) for x in value) + "]"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'
    return repr(value)
