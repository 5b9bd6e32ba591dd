"""The table of standard sections: the one that is shipped, or a CSV file of the user's.

`sections.csv` holds sizes of rolled, hollow and solid shapes: outer dimensions, thicknesses, root radius, area. Facts from the AISC Shapes Database
(W, M, S, HP, C, MC, L, WT, MT, ST, HSS, Pipe; walls of HSS and Pipe are design values, 0.93 of nominal) and from the tables of European
manufacturers as collected by the structural community (HE, IPE, IPN, UPN, UPE, UAP, CAE and CAI angles, TEAE, TCAR and TREC, TRON, PLAT, CARR, ROND).
"""

from __future__ import annotations

import csv
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from scan2fea.errors import InputError, UsageError, require
from scan2fea.kernel.sections import PARAMETERS, check_section, section, section_area
from scan2fea.types import Value
from scan2fea.units import METRES_PER_UNIT

SHIPPED = "sections.csv"
UNITS = ("mm", "cm", "m", "in")
WALLS = ("t", "tw", "tf")
THIN_MM = 1.0  # structural walls are thicker: hot-rolled from 1.5 mm, cold-formed from 1.2 mm; an inch table has quarters and thirds
AREA_AGREES = 0.25  # of the dimensions' own area: tapered flanges and rounded toes make up to 10 %, a wrong unit a factor


@dataclass(frozen=True, kw_only=True)
class Shape(Value):
    """One standard size. parameters : metres.   root_radius_m : nan where the table has none."""

    name: str
    standard: str
    family: str
    parameters: Mapping[str, float]
    root_radius_m: float


@dataclass(frozen=True, kw_only=True)
class Table(Value):
    """shapes : in the order of the file.   source : where they come from, for messages."""

    shapes: tuple[Shape, ...]
    source: str

    def of(self, family: str) -> tuple[Shape, ...]:
        return tuple(shape for shape in self.shapes if shape.family == family)

    def named(self, name: str) -> Shape | None:
        """The shape of that name, whatever its spaces and case."""
        wanted = _plain(name)
        return next((shape for shape in self.shapes if _plain(shape.name) == wanted), None)


def _plain(name: str) -> str:
    return "".join(name.split()).upper().replace("×", "X").replace(",", ".")


@functools.cache
def shipped_table() -> Table:
    """AISC and European shapes, read once in a process. That their areas fit their dimensions is a matter of the tests."""
    return _parsed(shipped_text(), SHIPPED)[0]


def shipped_text() -> str:
    """The CSV text of the shipped table."""
    return resources.files("scan2fea.estimation").joinpath(SHIPPED).read_text(encoding="utf-8")


def read_table(path: Path | None) -> Table:
    """A table of the user's, the shipped one for None. Raises InputError as `parse_table`, or where the file cannot be read."""
    if path is None:
        return shipped_table()
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a table of sections ({error}); give a CSV file in UTF-8") from error
    return parse_table(text, str(path))


def parse_table(text: str, source: str) -> Table:
    """The table of a CSV text with the columns family, name and h, a, b, d, tw, tf, t, each with its unit: t_mm, t_cm, t_m or t_in.

    standard, r_mm and area_mm2 (same units) are optional. Raises InputError naming line and column: a column that a family needs is missing, a
    dimension is no positive number, dimensions make no section, areas contradict them, or millimetres are inches.
    """
    table, rows = _parsed(text, source)
    _areas_agree(rows, table.shapes, source)
    return table


def _parsed(text: str, source: str) -> tuple[Table, list[dict[str, str | None]]]:
    """The table and its lines as they stand there."""
    rows: list[dict[str, str | None]] = list(csv.DictReader(text.splitlines()))
    require(rows, InputError, f"{source}: the table of sections is empty; it needs a line of column names and one line for each section")
    columns = [name.strip() for name in rows[0] if name is not None]
    for needed in ("family", "name"):
        require(needed in columns, InputError, f"{source}: the column {needed!r} is missing; there are {', '.join(columns)}")
    units = {name: _unit_of(name, columns) for name in ("h", "a", "b", "d", "tw", "tf", "t", "r")}
    shapes = tuple(
        _shape({(k or "").strip(): v for k, v in row.items()}, units, columns, f"{source}, line {i}") for i, row in enumerate(rows, start=2)
    )
    _not_inches(shapes, source)
    return Table(shapes=shapes, source=source), rows


def _unit_of(name: str, columns: Sequence[str]) -> str | None:
    return next((unit for unit in UNITS if f"{name}_{unit}" in columns), None)


def _shape(row: Mapping[str, str | None], units: Mapping[str, str | None], columns: Sequence[str], where: str) -> Shape:
    family, name = (row.get("family") or "").strip(), (row.get("name") or "").strip()
    require(family in PARAMETERS, InputError, f"{where}: family {family!r} is unknown; use one of {', '.join(PARAMETERS)}")
    require(name, InputError, f"{where}: the section has no name")
    parameters = {}
    for key in PARAMETERS[family]:
        unit = units[key]
        says = f"{where}: section {name} of family {family} needs the column '{key}_mm' (or _cm, _m, _in); there are {', '.join(columns)}"
        if unit is None:
            raise InputError(says)
        parameters[key] = _length(row.get(f"{key}_{unit}"), unit, f"{where}: {key}_{unit} of {name}")
    try:
        check_section(family, parameters)
    except UsageError as error:
        raise InputError(f"{where}: {name} is no section: {error}") from None
    unit = units["r"]
    radius = row.get(f"r_{unit}") if unit else None
    root = _length(radius, str(unit), f"{where}: r_{unit} of {name}") if (radius or "").strip() else math.nan
    parameters |= _thickness(name, parameters)
    return Shape(name=name, standard=(row.get("standard") or "").strip(), family=family, parameters=parameters, root_radius_m=root)


def _thickness(name: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """tf of sloping flanges in the middle of what stands out of the web, metres, where EN 10365 states it elsewhere: of IPN a quarter of the breadth
    from the middle (14 %), of UPN up to 300 half of it from the web's outer face (8 %). S and C shapes have their mean thickness there (ASTM A6).
    """
    key = _plain(name)
    if key.startswith("IPN"):
        return {"tf": parameters["tf"] - 0.14 * parameters["tw"] / 4}
    if key.startswith("UPN") and parameters["h"] <= 0.3:
        return {"tf": parameters["tf"] - 0.08 * parameters["tw"] / 2}
    return {}


def _length(text: str | None, unit: str, what: str) -> float:
    try:
        value = float((text or "").strip())
    except ValueError:
        raise InputError(f"{what} is {text!r}, which is not a number; write digits with a decimal point") from None
    require(math.isfinite(value) and value > 0, InputError, f"{what} is {value:g}; a dimension must be positive")
    return value * METRES_PER_UNIT[unit]


def _not_inches(shapes: Sequence[Shape], source: str) -> None:
    walls = [min(value for key, value in shape.parameters.items() if key in WALLS) for shape in shapes if shape.family not in ("round", "rect")]
    if not walls:
        return
    middle = float(np.median(walls)) / METRES_PER_UNIT["mm"]
    says = (
        f"{source}: half of the walls are thinner than {middle:.3g} mm: these look like inches; name the columns h_in, t_in, ... or multiply by 25.4"
    )
    require(middle >= THIN_MM, InputError, says)


def _areas_agree(rows: Sequence[Mapping[str, str | None]], shapes: Sequence[Shape], source: str) -> None:
    """Where areas are given, most must agree with the dimensions of their own line: else a unit or a column is wrong."""
    unit = next((u for u in UNITS if f"area_{u}2" in rows[0]), None)
    if unit is None:
        return
    off: list[tuple[float, str]] = []
    for row, shape in zip(rows, shapes, strict=True):
        text = (row.get(f"area_{unit}2") or "").strip()
        if text:
            area = _length(text, unit, f"{source}: area_{unit}2 of {shape.name}") * METRES_PER_UNIT[unit]
            off.append((abs(math.log(area / section_area(section(shape.family, shape.parameters)))), shape.name))
    wrong = [name for gap, name in off if gap > math.log1p(AREA_AGREES)]
    first = wrong[0] if wrong else ""
    says = f"{source}: {len(wrong)} of {len(off)} areas do not fit the dimensions of their line (first {first}): a unit or a column is wrong"
    require(len(wrong) <= len(off) / 2, InputError, says)
