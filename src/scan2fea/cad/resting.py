"""The planes that an object rests on: no scanner sees them, but where the support was seen they are known better than any other face."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.surfaces import PLANE, Surface
from scan2fea.types import FloatArray, Value

PARALLEL = float(np.cos(np.radians(2.0)))
LEAST_POINTS = 12


@dataclass(frozen=True, eq=False, kw_only=True)
class Resting(Value):
    """surface : plane of the support, its normal out of the object.   points : (k, 3) inferred on it."""

    surface: Surface
    points: FloatArray

    def is_that(self, other: Surface, reach_m: float) -> bool:
        """Is a plane found in the surface the one the object rests on?"""
        parallel = other.kind == PLANE and float(other.axis @ self.surface.axis) > PARALLEL
        return parallel and abs(float(self.surface.distance(other.point[None])[0])) <= reach_m


def resting_planes(points: FloatArray, normals: FloatArray, tolerance_m: float) -> list[Resting]:
    """Points (k, 3) inferred on supports with their normals (k, 3) out of the object, put together by plane; the largest first."""
    left = np.arange(len(points))
    found: list[Resting] = []
    while len(left):
        first = left[0]
        same = (normals[left] @ normals[first] > PARALLEL) & (np.abs((points[left] - points[first]) @ normals[first]) <= tolerance_m)
        rows, left = left[same], left[~same]
        if len(rows) >= LEAST_POINTS:
            axis = normals[rows].mean(0)
            plane = Surface(kind=PLANE, point=points[rows].mean(0), axis=axis / np.linalg.norm(axis))
            found.append(Resting(surface=plane, points=points[rows]))
    return sorted(found, key=lambda r: -len(r.points))


def nearest_points(resting: Sequence[Resting], surface: Surface, reach_m: float) -> FloatArray:
    """(k, 3) the inferred points of the support that `surface` is the plane of; none where it is no support's."""
    own = [r.points for r in resting if r.is_that(surface, reach_m)]
    return np.concatenate(own) if own else np.zeros((0, 3))
