"""How an exact solid is made, in words that a mesher and a CAD kernel both understand: a base, and what is then done to it.

Everything is in the frame of the shape, metres. `simulation` makes triangles of it, `cad` true faces; neither knows of the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scan2fea.types import FloatArray, TriangleMesh, Value

Polynomial = Mapping[tuple[int, int, int], float]  # exponents of x, y, z -> factor


@dataclass(frozen=True, eq=False, kw_only=True)
class Stroke(Value):
    """Part of a profile in (radius, z): a line, or part of the half of an ellipse, centred on the axis, that lies at radius >= 0.

    start, end : (2,).   centre, semi_axes : (2,) of the ellipse, None for a line.
    """

    start: FloatArray
    end: FloatArray
    centre: FloatArray | None = None
    semi_axes: FloatArray | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Turned(Value):
    """A closed solid of revolution about z. profile : from a place on the axis to another one; the axis closes it. names : of the faces, one each."""

    profile: tuple[Stroke, ...]
    names: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Swept(Value):
    """A section of kernel.outline along z, from 0 to the length."""

    family: str
    values: Mapping[str, float]
    fillet_m: float
    length_m: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Hole(Value):
    """A round hole. start : (3,) on one plane face.   through : (3,) from there to the parallel one."""

    start: FloatArray
    through: FloatArray
    radius_m: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Plain(Value):
    """A solid of plane faces, as exact triangles, and the round holes through it."""

    mesh: TriangleMesh
    holes: tuple[Hole, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Star(Value):
    """All points r <= radius(u) in the directions of unit vectors u."""

    radius: Polynomial


Base = Turned | Swept | Plain | Star


@dataclass(frozen=True, eq=False, kw_only=True)
class Carved(Value):
    """What lies beyond ALL of the planes is gone. normals : (k, 3).   offsets : (k,), normal . x > offset is beyond."""

    normals: FloatArray
    offsets: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Sagged(Value):
    """Moved along `direction` (3,) by a parabola over z: nothing at `low` and `high`, `depth_m` in the middle."""

    direction: FloatArray
    depth_m: float
    low: float
    high: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Twisted(Value):
    """Turned about z, from nothing at `low` to `angle_rad` at `high`."""

    angle_rad: float
    low: float
    high: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Dented(Value):
    """Pushed along `axis` (3,) unit by depth (1 - r^2 / radius^2)^2 at the distance r from the line through `at`; only what lies within `reach_m`
    of `at` along the line gives way.
    """

    at: FloatArray
    axis: FloatArray
    radius_m: float
    depth_m: float
    reach_m: float


Bend = Sagged | Twisted
Change = Carved | Bend | Dented


def bent(points: FloatArray, bend: Bend) -> FloatArray:
    """(n, 3) places of the solid after a sag or twist."""
    s = (points[:, 2] - bend.low) / (bend.high - bend.low)
    if isinstance(bend, Sagged):
        return np.asarray(points + (4 * bend.depth_m * s * (1 - s))[:, None] * bend.direction)
    x, y, z = points.T
    turn = bend.angle_rad * s
    return np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y, z], axis=1)


def around(points: FloatArray, dent: Dented) -> tuple[FloatArray, FloatArray]:
    """(n,) 1 - r^2 / radius^2, positive within the dent's cylinder, and (n,) place along its line."""
    away = points - dent.at
    along = away @ dent.axis
    return 1 - ((away - along[:, None] * dent.axis) ** 2).sum(axis=1) / dent.radius_m**2, along


def evaluated(polynomial: Polynomial, u: FloatArray) -> FloatArray:
    """(n,) values of a polynomial at (n, 3)."""
    total = np.zeros(len(u))
    for (a, b, c), factor in polynomial.items():
        total += factor * u[:, 0] ** a * u[:, 1] ** b * u[:, 2] ** c
    return total


def star_points(radius: Polynomial, u: FloatArray) -> FloatArray:
    """(n, 3) points of a star's surface in the directions of (n, 3) unit vectors."""
    return np.asarray(evaluated(radius, u)[:, None] * u)
