"""A scanner of one beam that turns about z: lines of time, angle and range (thesis 2.1.2), told by the names of the columns."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import FormatError, require
from scan2fea.io.source import Column, Piece
from scan2fea.types import FloatArray

_TURNS = 3.0  # an angle beyond is no angle of one sweep in radians
_NAME = re.compile(r"^(?P<what>[a-z ]+?)[_ ]*(?:[\[(]?(?P<unit>rad|radians?|deg|degrees?|m|s)[\])]?)?$")
_ANGLES = ("angle", "azimuth", "bearing", "theta")
_RANGES = ("range", "distance", "dist", "rho")


@dataclass(frozen=True)
class PlanarColumns:
    """Which columns hold angle and range. in_degrees : what the name of the angle says; None where it says nothing (radians)."""

    angle: str
    range: str
    in_degrees: bool | None

    @property
    def notes(self) -> tuple[str, ...]:
        said = f"column {self.angle} names no unit and was taken for radians; name it {self.angle}_deg if it is in degrees"
        return () if self.in_degrees is not None else (said,)


def planar_columns(names: Sequence[str]) -> PlanarColumns | None:
    """Angle and range among names of columns, None where either is missing."""
    angle = found = None
    for name in names:
        match = _NAME.match(name.strip().strip("\"'").lower())
        what, unit = (match["what"].strip(), match["unit"] or "") if match else ("", "")
        if what in _ANGLES and angle is None:
            angle = (name, unit)
        elif what in _RANGES and found is None:
            found = name
    if angle is None or found is None:
        return None
    return PlanarColumns(angle[0], found, angle[1].startswith("deg") if angle[1] else None)


def planar_piece(where: str, angle: FloatArray, distance: FloatArray, in_degrees: bool, beside: dict[str, Column]) -> Piece:
    """Points in the plane z = 0 of the sensor, which stands at the origin; angles count from x towards y. No range (nan, inf or <= 0) is a miss.

    Raises FormatError for an angle that is not finite, or that radians cannot be.
    """
    require(bool(np.isfinite(angle).all()), FormatError, f"{where} holds an angle that is not finite: correct or remove the line")
    largest = float(np.abs(angle).max(initial=0.0))
    turn = 360.0 if in_degrees else 2 * np.pi
    says = f"{where} holds an angle of {largest:.4g} {'degrees' if in_degrees else 'rad'}, beyond {_TURNS:g} turns"
    require(largest <= _TURNS * turn, FormatError, f"{says}: name the column angle_deg or angle_rad after its unit")
    a = np.radians(angle) if in_degrees else angle
    direction = np.stack([np.cos(a), np.sin(a), np.zeros_like(a)], axis=1)
    is_miss = ~(np.isfinite(distance) & (distance > 0))
    points = direction * np.where(is_miss, 0.0, distance)[:, None]
    return Piece(points=points, columns=beside, sensor=np.zeros(3), is_miss=is_miss, direction=direction)
