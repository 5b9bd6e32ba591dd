"""The only file that knows units. Inside scan2fea everything is metres, radians, newtons, pascals, kilograms, seconds."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

from scan2fea.errors import UsageError

METRES_PER_UNIT = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": 0.3048, "ft_us": 1200 / 3937, "um": 1e-6}

MILLIMETRES_PER_METRE = 1000.0
BYTES_PER_GIB = 2**30
BYTES_PER_MIB = 2**20


@dataclass(frozen=True, kw_only=True)
class UnitSystem:
    """A consistent system for decks: multiply an SI value by the factor of its dimension."""

    name: str
    length: float
    force: float
    mass: float

    @property
    def pressure(self) -> float:
        return self.force / self.length**2

    @property
    def density(self) -> float:
        return self.mass / self.length**3

    @property
    def acceleration(self) -> float:
        return self.length


# length, force and mass such that force = mass * length / s^2 holds in each system
UNIT_SYSTEMS = {
    "m-N-Pa": UnitSystem(name="m-N-Pa", length=1.0, force=1.0, mass=1.0),
    "mm-N-MPa": UnitSystem(name="mm-N-MPa", length=1e3, force=1.0, mass=1e-3),
    "in-lbf-psi": UnitSystem(name="in-lbf-psi", length=1 / 0.0254, force=1 / 4.4482216152605, mass=0.0254 / 4.4482216152605),
}


def metres_per(unit: str) -> float:
    """Length of one `unit` in metres. Raises UsageError with the nearest known unit."""
    if unit not in METRES_PER_UNIT:
        near = difflib.get_close_matches(unit, METRES_PER_UNIT, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise UsageError(f"unit {unit!r} is not known: use one of {', '.join(METRES_PER_UNIT)}{hint}")
    return METRES_PER_UNIT[unit]


def unit_system(name: str) -> UnitSystem:
    """The named system of consistent units. Raises UsageError."""
    if name not in UNIT_SYSTEMS:
        raise UsageError(f"units {name!r} are not known: use one of {', '.join(UNIT_SYSTEMS)}")
    return UNIT_SYSTEMS[name]


def radians(degrees: float) -> float:
    return math.radians(degrees)
