"""The unit of a LAS file, from its coordinate system: GeoTIFF keys or well-known text."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.units import METRES_PER_UNIT

_PROJECTION = "LASF_Projection"
# GeoTIFF 1.0: keys, and codes of EPSG for units
_MODEL_TYPE, _PROJECTED, _LINEAR_UNIT, _VERTICAL_UNIT = 1024, 3072, 3076, 4099
_UNITS = {9001: "m", 9002: "ft", 9003: "ft_us"}
_GEOGRAPHIC = 2
# EPSG: UTM zones of WGS 84, WGS 72, NAD83, ETRS89, ED50 are metric by definition
_METRIC = ((32601, 32660), (32701, 32760), (32201, 32260), (32301, 32360), (26901, 26923), (25828, 25838), (23028, 23038))
_UNIT = re.compile(r'(?:LENGTH)?UNIT\s*\[\s*"([^"]*)"\s*,\s*([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]{1,3})?)', re.IGNORECASE)
DEGREES = "deg"


@dataclass(frozen=True)
class Crs:
    """unit : a length unit, DEGREES, or "" where the file does not say it."""

    unit: str
    notes: tuple[str, ...] = ()


def crs_of(records: Mapping[tuple[str, int], bytes]) -> Crs:
    """The unit that the records of a LAS file state."""
    text = records.get((_PROJECTION, 2112), b"").split(b"\0")[0].decode("utf-8", "replace")
    if text.strip():
        return _from_text(text)
    keys = _geo_keys(records.get((_PROJECTION, 34735), b""))
    if not keys:
        return Crs("")
    if keys.get(_MODEL_TYPE) == _GEOGRAPHIC:
        return Crs(DEGREES)
    code = keys.get(_PROJECTED, 0)
    unit = _UNITS.get(keys.get(_LINEAR_UNIT, 0), "")
    if not unit and any(first <= code <= last for first, last in _METRIC):
        unit = "m"
    height = _UNITS.get(keys.get(_VERTICAL_UNIT, 0), unit)
    notes = () if height == unit or not unit else (f"heights are stated in {height}, plan coordinates in {unit}: all were taken as {unit}",)
    if not unit:
        notes = (f"the coordinate system (EPSG {code}) does not state its unit: metres were assumed, give --unit otherwise",)
    return Crs(unit, notes)


def _geo_keys(content: bytes) -> dict[int, int]:
    """The keys whose value stands in the directory itself."""
    shorts = np.frombuffer(content[: len(content) // 2 * 2], "<u2")
    n = min(int(shorts[3]), (len(shorts) - 4) // 4) if len(shorts) >= 4 else 0
    return {int(key): int(value) for key, place, _, value in shorts[4 : 4 + 4 * n].reshape(-1, 4) if place == 0}


def _from_text(text: str) -> Crs:
    projected = re.search(r"\b(PROJCS|PROJCRS|PROJECTEDCRS)\s*\[", text, re.IGNORECASE)
    if projected is None:
        is_geographic = re.search(r"\b(GEOGCS|GEOGCRS|GEODCRS|GEODETICCRS)\s*\[", text, re.IGNORECASE) is not None
        return Crs(DEGREES if is_geographic else "")
    part = _bracketed(text, projected.end())
    # the first that is no angle: that of the plan; heights may come after it
    factors = [float(factor) for name, factor in _UNIT.findall(part) if not any(angle in name.lower() for angle in ("deg", "rad", "grad"))]
    unit = _length_unit(factors[0]) if factors else ""
    return Crs(unit, () if unit else ("the coordinate system states no known unit of length: metres were assumed, give --unit otherwise",))


def _bracketed(text: str, start: int) -> str:
    depth = 1
    for k in range(start, len(text)):
        depth += {"[": 1, "]": -1}.get(text[k], 0)
        if depth == 0:
            return text[start:k]
    return text[start:]


def _length_unit(factor: float) -> str:
    return (
        next((name for name in ("m", "ft", "ft_us", "cm", "mm", "km", "in") if abs(METRES_PER_UNIT[name] / factor - 1) < 5e-7), "")
        if factor > 0
        else ""
    )
