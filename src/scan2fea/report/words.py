"""Numbers and sentences of the page and of the console: SI in, millimetres and kilograms out, four significant digits at most."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, TypeGuard

from scan2fea.units import MILLIMETRES_PER_METRE

DIGITS = 4
THIN_SPACE = "\u202f"  # narrow and without a break: 34 812 stays in one line
MINUS = "\u2212"
NOT_KNOWN = "\u2013"
DEGREES = "\u00b0"
CLAUSE = 64  # characters of a reason that the head sentence repeats
_SUPERSCRIPTS = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")

# unit of the record -> (factor, unit on the page)
PAGE_UNITS: Mapping[str, tuple[float, str]] = {
    "m": (MILLIMETRES_PER_METRE, "mm"),
    "m2": (1.0, "m\u00b2"),
    "m3": (1e3, "L"),
    "deg": (1.0, DEGREES),
    "rad": (180 / math.pi, DEGREES),
    "Pa": (1e-6, "MPa"),
    "1": (1.0, ""),
    "-": (1.0, ""),
}


def is_number(value: object) -> TypeGuard[float]:
    """True for a finite number (a boolean is not one)."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def number(value: float | None, digits: int = DIGITS) -> str:
    """`value` to at most `digits` significant digits, thousands apart, no noise of the binary; a dash where it is not known."""
    if value is None or not math.isfinite(value):
        return NOT_KNOWN
    if value == 0:
        return "0"
    size = abs(value)
    exponent = math.floor(math.log10(float(f"{size:.{digits - 1}e}")))  # of the rounded figure: 9.9996 has exponent 1
    if not -4 <= exponent < 7:
        mantissa = f"{size / 10.0**exponent:.{digits - 1}f}".rstrip("0").rstrip(".") if -300 < exponent < 300 else f"{size:.{digits - 1}e}"
        text = f"{mantissa}\u00b710{str(exponent).translate(_SUPERSCRIPTS)}" if "e" not in mantissa else mantissa
    else:
        rounded = round(size, digits - 1 - exponent)
        text = f"{rounded:,.{max(0, digits - 1 - exponent)}f}"
        text = text.rstrip("0").rstrip(".") if "." in text else text
        text = text.replace(",", THIN_SPACE)
    return MINUS + text if value < 0 else text


def count(value: int | None) -> str:
    """A whole number with all its digits: counts are exact."""
    return NOT_KNOWN if value is None else f"{value:,}".replace(",", THIN_SPACE)


_OF_ONE = ("share", "probability")  # units of what is 1 at most


def quantity(value: object, unit: str = "") -> str:
    """A value of the record as the page shows it, with the page's unit."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return NOT_KNOWN
    if not isinstance(value, int | float):
        return str(value)
    if unit in _OF_ONE:
        return percent(float(value))
    factor, shown = PAGE_UNITS.get(unit, (1.0, unit))
    text = count(value) if isinstance(value, int) and factor == 1.0 else number(value * factor)
    return text if not shown or text == NOT_KNOWN else f"{text}{'' if shown == DEGREES else ' '}{shown}"


def millimetres(value: float | None) -> str:
    return quantity(value, "m")


def percent(share: float | None) -> str:
    """A share as per cent: three digits are plenty, and what is not all never reads 100."""
    if share is None or not math.isfinite(share):
        return NOT_KNOWN
    shown = 100 * share
    if 99.95 <= shown < 100 - 1e-9:
        return "> 99.9 %"
    return f"{number(shown, 3)} %" if shown >= 0.01 or shown == 0 else "< 0.01 %"


def volume(value_m3: float | None) -> str:
    """Litres for what a person can lift, cubic metres above, cubic centimetres and millimetres below."""
    if value_m3 is None or not math.isfinite(value_m3):
        return NOT_KNOWN
    for limit, factor, unit in ((1.0, 1.0, "m\u00b3"), (1e-4, 1e3, "L"), (1e-8, 1e6, "cm\u00b3")):
        if abs(value_m3) >= limit:
            return f"{number(value_m3 * factor)} {unit}"
    return f"{number(value_m3 * 1e9)} mm\u00b3"


def with_deviation(value: float, std: float | None) -> str:
    """`127.2 \u00b1 0.4`: digits cut to the standard deviation, of which two are kept where it starts with 1."""
    if std is None or not math.isfinite(std) or std <= 0:
        return number(value)
    exponent = math.floor(math.log10(std))
    place = -exponent + (1 if std / 10.0**exponent < 2 else 0)  # decimal place of the last digit kept
    if not -7 < place < 10:
        return f"{number(value)} \u00b1 {number(std, 2)}"
    decimals = max(0, place)
    return f"{round(value, place):,.{decimals}f} \u00b1 {round(std, place):,.{decimals}f}".replace(",", THIN_SPACE).replace("-", MINUS)


def dimensions(size_m: Iterable[float] | None) -> str:
    """`305 x 127 x 127 mm`."""
    if size_m is None:
        return NOT_KNOWN
    return " \u00d7 ".join(number(value * MILLIMETRES_PER_METRE) for value in size_m) + " mm"


def check_name(name: object) -> str:
    """`shape.measured_area` as words."""
    return str(name).replace("_", " ").replace(".", ": ", 1)


MEASURES: Mapping[str, str] = {
    "stress_p99_pa": "stress that 99 % of the volume stays below",
    "stress_peak_pa": "peak stress away from singular places",
    "stress_peak_jump": "its jump between elements",
    "discretisation": "energy, change by cubic elements",
    "f7_discretisation": "f7, change by cubic elements",
}


def measure_name(name: object) -> str:
    """`displacement_max_m` as words: the unit stands beside the value."""
    if str(name) in MEASURES:
        return MEASURES[str(name)]
    return re.sub(r"_(m|m3|n|j|pa|hz|kg|rad)$", "", str(name)).replace("_", " ")


def plural(n: int, one: str, many: str | None = None) -> str:
    """`1 object`, `3 objects`."""
    return f"{count(n)} {one if n == 1 else many or one + 's'}"


# first failed check -> what a manager reads; a check that is not here speaks with the first clause of its reason
CAUSES: Mapping[str, str] = {
    "unmeasured area": "not seen from all sides",
    "shape.measured_area": "not seen from all sides",
    "open space inside": "not seen from all sides",
    "winding at points": "not seen from all sides",
    "winding agrees with surface": "not seen from all sides",
    "noise against wall": "thinner than the scanner can tell",
    "merged sheets": "thinner than the scanner can tell",
    "spacing against wall": "scanned too coarsely for its wall",
    "cut agrees with normals": "outside not told from inside",
    "two ways of finding the outside agree": "outside not told from inside",
    "deviation p95": "surface too far from the points",
    "shape.deviation_p95": "surface too far from the points",
    "stray points": "points that belong to no surface",
    "points left out side by side": "a part was lost",
    "scanned bores that are closed": "a hole was lost",
    "holes that flat faces close": "a hole was lost",
    "holes that flat faces tell otherwise": "too few points to tell a hole from a gap",
    "holes that nobody saw": "too few points to tell a hole from a gap",
    "surface.boundary_edges": "surface not closed",
    "surface.nonmanifold_edges": "surface not sound",
    "surface.pinched_vertices": "surface not sound",
    "surface.self_intersections": "surface not sound",
    "surface.components": "more than one piece",
    "shape.volume_drift": "meshing changed the shape",
    "shape.thickness_drift": "meshing changed the shape",
    "tets.min_dihedral": "mesh not good enough to solve",
    "tets.max_dihedral": "mesh not good enough to solve",
    "tets.scaled_jacobian": "mesh not good enough to solve",
    "tets.nonpositive": "mesh not good enough to solve",
    "cad.valid": "no sound CAD solid",
    "cad.volume": "no sound CAD solid",
}


def cause(item: Mapping[str, Any]) -> str:
    """Why an object failed, in a few words without figures: what failures are grouped by."""
    first = next((str(check.get("name")) for check in item.get("checks") or [] if not check.get("passed")), "")
    if first in CAUSES:
        return CAUSES[first]
    text = " ".join(str(item.get("reason") or "no reason given").split())
    text = re.split(r"[:;(\u2014]| - |\. |(?<=.{12}), ", text)[0].strip().rstrip(".,") or text
    if first and re.search(r"\d", text):  # a sentence full of figures says less than the name of the check
        return f"check \u201c{check_name(first)}\u201d not passed"
    if len(text) > CLAUSE:
        text = text[:CLAUSE].rsplit(" ", 1)[0] + " \u2026"
    return text


def headline(report: Mapping[str, Any]) -> str:
    """The one sentence a manager reads, from the verdicts alone."""
    objects = report.get("objects") or []
    n, failed = len(objects), [o for o in objects if o.get("verdict") != "converted"]
    if n == 0:
        return _inputs_left_out(report, "No object was found in the scan, so nothing was converted.")
    causes = Counter(cause(o) for o in failed).most_common()
    told = ", ".join(f"{k} {text}" for text, k in causes) if len(failed) > 1 else "".join(text for text, _ in causes)
    if not failed:
        sentence = "The one object was converted." if n == 1 else f"All {n} objects were converted."
    elif len(failed) == n:
        sentence = f"The one object could not be converted: {told}." if n == 1 else f"None of {n} objects could be converted: {told}."
    else:
        sentence = f"{n - len(failed)} of {n} objects converted; {len(failed)} failed: {told}."
    assumed = [o for o in objects if o.get("verdict") == "converted" and unobserved(o)]
    if assumed:
        who = plural(len(assumed), "converted object has a dimension", "converted objects have dimensions")
        sentence += f" {who} from {stand_in(assumed)}: the scan could not tell."
    return _inputs_left_out(report, sentence)


def unobserved(item: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the member's parameters that the data could not tell."""
    parameters = (item.get("member") or {}).get("parameters") or {}
    return tuple(name for name, value in parameters.items() if not value.get("observable", True))


def stand_in(items: Iterable[Mapping[str, Any]]) -> str:
    """What the dimensions that the data could not tell were taken from."""
    rows = [row for item in items for row in ((item.get("member") or {}).get("parameters") or {}).values() if not row.get("observable", True)]
    named = {"catalogue": "a catalogue", "estimate": "an estimate", "fixed": "what was given"}
    sources = {source if (source := str(row.get("source"))) in named else "catalogue" for row in rows}
    if sources == {"estimate"}:
        return "an estimate that the points cannot vouch for"
    return " or ".join(text for source, text in named.items() if source in sources) or "a catalogue"


def worst_check(checks: Iterable[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """The first failed check; where none failed, the one nearest to its limit (in proportion); None where there is none."""
    listed = list(checks)
    for check in listed:
        if not check.get("passed"):
            return check
    with_share = [(share, -i) for i, check in enumerate(listed) if (share := used_share(check)) is not None]
    return listed[-max(with_share)[1]] if with_share else (listed[0] if listed else None)


def used_share(check: Mapping[str, Any]) -> float | None:
    """How much of its limit a passed check uses up, 0..1: value / limit, or limit / value where the limit is a lower one.

    What cannot exceed 1 is the farther from its lower limit the nearer it comes to 1: of it what is missing is compared.
    """
    value, limit = check.get("value"), check.get("limit")
    if not (is_number(value) and is_number(limit)) or value == limit or not limit or not value:
        return None
    if check.get("unit") in _OF_ONE and limit < value <= 1:
        return (1 - float(value)) / (1 - float(limit))
    share = abs(float(value) / float(limit))
    return share if share <= 1 else 1 / share


def failed_first(checks: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The checks in their order, failed ones before the others."""
    return sorted(checks, key=lambda check: bool(check.get("passed")))


def mass_kg(item: Mapping[str, Any]) -> float | None:
    """Mass of an object: as recorded, or from the figures of its self-weight case, or volume times density."""
    fea = item.get("fea") or {}
    if is_number(fea.get("mass_kg")):
        return float(fea["mass_kg"])
    for case in fea.get("cases") or []:
        if "mass" in str(case.get("measure")).lower() and is_number(case.get("value")):
            return float(case["value"])
    density, held = (fea.get("material") or {}).get("density_kg_m3"), (item.get("volume") or {}).get("volume_m3")
    return float(density) * float(held) if is_number(density) and is_number(held) else None


def first_frequency_hz(item: Mapping[str, Any]) -> float | None:
    """The first elastic frequency: as recorded, or from the modal case."""
    fea = item.get("fea") or {}
    recorded = fea.get("frequencies_hz") or []
    if recorded and is_number(recorded[0]):
        return float(recorded[0])
    for case in fea.get("cases") or []:
        if case.get("unit") == "Hz" and is_number(case.get("value")):
            return float(case["value"])
    for case in fea.get("cases") or []:
        if re.search(r"frequenc|_hz", f"{case.get('name')} {case.get('measure')}".lower()) and is_number(case.get("value")):
            return float(case["value"])
    return None


def measured_share(item: Mapping[str, Any]) -> float | None:
    """Share of the surface that the scanner saw."""
    share = ((item.get("surface") or {}).get("area_share") or {}).get("measured")
    if share is None:
        share = (item.get("deviation") or {}).get("measured_area_fraction")
    return float(share) if is_number(share) else None


def number_of(item: Mapping[str, Any]) -> str:
    """`01`: the name of the object's folder."""
    own = item.get("id")
    return f"{own:02d}" if isinstance(own, int) else str(own)


def _inputs_left_out(report: Mapping[str, Any], sentence: str) -> str:
    inputs = report.get("inputs") or []
    unused = [row for row in inputs if row.get("used") is False]
    return sentence if not unused else f"{sentence} {len(unused)} of {plural(len(inputs), 'input')} could not be used."
