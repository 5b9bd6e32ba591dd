"""Volume, area, centroid and inertia of solids from formulas, never from a mesh: what a mesh of the same solid is measured against.

A solid is a sum of signed parts (an angle is two blocks, a bracket is an angle less its holes). Volume, first and second moments about one
origin add up; the area does not, so each shape states its own.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from scan2fea.kernel.construction import Polynomial, evaluated
from scan2fea.types import FloatArray, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Moments(Value):
    """volume_m3, area_m2.   first : (3,) integral of x over the solid, m4.   second : (3, 3) integral of x x^T, m5."""

    volume_m3: float
    area_m2: float
    first: FloatArray
    second: FloatArray

    @property
    def centroid(self) -> FloatArray:
        """(3,) metres."""
        return self.first / self.volume_m3

    @property
    def inertia(self) -> FloatArray:
        """(3, 3) inertia tensor about the centroid for unit density, m5."""
        about = self.second - np.outer(self.first, self.first) / self.volume_m3
        return np.asarray(np.trace(about) * np.eye(3) - about)

    def moved(self, T_target_source: FloatArray) -> Moments:
        """The same solid after a rigid motion."""
        R, t = T_target_source[:3, :3], T_target_source[:3, 3]
        turned = R @ self.first
        second = R @ self.second @ R.T + np.outer(turned, t) + np.outer(t, turned) + self.volume_m3 * np.outer(t, t)
        return replace(self, first=turned + self.volume_m3 * t, second=second)

    def with_area(self, area_m2: float) -> Moments:
        return replace(self, area_m2=area_m2)


def together(*parts: Moments) -> Moments:
    """Parts that do not overlap, as one. Its area is left at nan: parts share faces."""
    return Moments(
        volume_m3=math.fsum(p.volume_m3 for p in parts),
        area_m2=math.nan,
        first=np.sum([p.first for p in parts], axis=0),
        second=np.sum([p.second for p in parts], axis=0),
    )


def without(whole: Moments, *parts: Moments) -> Moments:
    """A solid less parts that lie inside it."""
    gone = [replace(p, volume_m3=-p.volume_m3, first=-p.first, second=-p.second) for p in parts]
    return together(whole, *gone)


def block(low: npt.ArrayLike, high: npt.ArrayLike) -> Moments:
    """A box between two corners."""
    a, b = np.asarray(low, float), np.asarray(high, float)
    size, middle = b - a, (a + b) / 2
    volume = float(np.prod(size))
    second = volume * (np.outer(middle, middle) + np.diag(size**2) / 12)
    area = 2 * float(size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    return Moments(volume_m3=volume, area_m2=area, first=volume * middle, second=second)


def rod(radius: float, length: float) -> Moments:
    """A cylinder about z from 0 to `length`."""
    volume = math.pi * radius**2 * length
    second = volume * np.diag([radius**2 / 4, radius**2 / 4, length**2 / 3])
    area = 2 * math.pi * radius * (radius + length)
    return Moments(volume_m3=volume, area_m2=area, first=volume * np.array([0, 0, length / 2]), second=second)


def ball(radius: float) -> Moments:
    volume = 4 / 3 * math.pi * radius**3
    return Moments(volume_m3=volume, area_m2=4 * math.pi * radius**2, first=np.zeros(3), second=volume * radius**2 / 5 * np.eye(3))


def dish(radius: float, depth: float) -> Moments:
    """The lower half of an ellipsoid of semi-axes radius, radius, depth: its pole at the origin, its flat side at z = depth.

    Its area is that of the curved side alone: half the surface of an oblate or prolate spheroid.
    """
    volume = 2 / 3 * math.pi * radius**2 * depth
    from_flat = Moments(
        volume_m3=volume,
        area_m2=half_spheroid_area(radius, depth),
        first=volume * np.array([0, 0, -3 / 8 * depth]),
        second=volume / 5 * np.diag([radius**2, radius**2, depth**2]),
    )
    up = np.eye(4)
    up[2, 3] = depth
    return from_flat.moved(up)


def half_spheroid_area(radius: float, depth: float) -> float:
    """Area of half a spheroid with equator `radius` and polar semi-axis `depth`."""
    if depth == radius:
        return 2 * math.pi * radius**2
    if depth < radius:
        e = math.sqrt(1 - (depth / radius) ** 2)
        return math.pi * radius**2 * (1 + (1 - e**2) / e * math.atanh(e))
    e = math.sqrt(1 - (radius / depth) ** 2)
    return math.pi * radius**2 * (1 + depth / (radius * e) * math.asin(e))


def spandrel(corner: npt.ArrayLike, towards: npt.ArrayLike, radius: float, length: float) -> Moments:
    """A root fillet along z from 0 to `length`: the square of side `radius` at a corner less the quarter disc about its far corner.

    corner : (2,).   towards : (2,) of +1 or -1, the quadrant the square lies in.
    """
    c, s = np.asarray(corner, float), np.asarray(towards, float)
    ends = np.stack([c, c + radius * s])
    square = block([*ends.min(0), 0.0], [*ends.max(0), length])
    area = math.pi * radius**2 / 4
    centre = c + radius * s
    at = -s * 4 * radius / (3 * math.pi)  # centroid of the quarter disc from its centre, which opens back to the corner
    own = np.array([[math.pi * radius**4 / 16, s[0] * s[1] * radius**4 / 8], [s[0] * s[1] * radius**4 / 8, math.pi * radius**4 / 16]])
    plane = own + area * (np.outer(at, centre) + np.outer(centre, at) + np.outer(centre, centre))
    second = np.zeros((3, 3))
    second[:2, :2] = plane * length
    second[2, :2] = second[:2, 2] = area * (centre + at) * length**2 / 2
    second[2, 2] = area * length**3 / 3
    quarter = Moments(
        volume_m3=area * length, area_m2=math.nan, first=np.array([*(area * length * (centre + at)), area * length**2 / 2]), second=second
    )
    return without(square, quarter)


def star(radius: Polynomial, area_m2: float = math.nan) -> Moments:
    """The body r <= radius(u) about the origin, u a unit vector and `radius` a polynomial in its coordinates.

    Volume r^3 / 3, first moments r^4 / 4 u and second moments r^5 / 5 u u^T, integrated over the sphere term by term (Folland 2001).
    """
    powers: dict[int, Polynomial] = {1: radius}
    for n in (2, 3, 4, 5):
        powers[n] = _product(powers[n - 1], radius)
    unit = [tuple(int(i == k) for i in range(3)) for k in range(3)]
    first = np.array([_over_sphere(_product(powers[4], {unit[k]: 1.0})) / 4 for k in range(3)])  # type: ignore[dict-item]
    second = np.array([[_over_sphere(_product(_product(powers[5], {unit[i]: 1.0}), {unit[j]: 1.0})) / 5 for j in range(3)] for i in range(3)])  # type: ignore[dict-item]
    return Moments(volume_m3=_over_sphere(powers[3]) / 3, area_m2=area_m2, first=first, second=second)


def gradient(polynomial: Polynomial, u: FloatArray) -> FloatArray:
    """(n, 3) derivatives of a polynomial at (n, 3)."""
    columns = []
    for k in range(3):
        lowered: dict[tuple[int, int, int], float] = {}
        for exponents, factor in polynomial.items():
            if exponents[k]:
                down = [*exponents]
                down[k] -= 1
                lowered[down[0], down[1], down[2]] = factor * exponents[k]
        columns.append(evaluated(lowered, u))
    return np.stack(columns, axis=1)


def _product(p: Polynomial, q: Polynomial) -> Polynomial:
    out: dict[tuple[int, int, int], float] = {}
    for ((a, b, c), f), ((d, e, g), h) in itertools.product(p.items(), q.items()):
        key = (a + d, b + e, c + g)
        out[key] = out.get(key, 0.0) + f * h
    return out


def _over_sphere(polynomial: Polynomial) -> float:
    """Integral over the unit sphere: a monomial with an odd exponent gives 0, else 2 prod gamma((e + 1) / 2) / gamma(sum (e + 1) / 2)."""
    terms = []
    for exponents, factor in polynomial.items():
        if not any(e % 2 for e in exponents):
            halves = [(e + 1) / 2 for e in exponents]
            terms.append(factor * 2 * math.prod(math.gamma(h) for h in halves) / math.gamma(sum(halves)))
    return math.fsum(terms)
