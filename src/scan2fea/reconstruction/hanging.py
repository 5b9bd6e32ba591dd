"""The points near a plane or cylinder that hang together with a seed: walked from it over neighbours, so that a small patch costs little."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.surfaces import SMALL, Surface
from scan2fea.types import BoolArray, FloatArray, IntArray, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Among(Value):
    """points, normals : (n, 3).   low, high : (3,) corners of their box.

    first, index : the neighbours of each point, those that count it among theirs included (`joined_both_ways`).
    """

    points: FloatArray
    normals: FloatArray
    low: FloatArray
    high: FloatArray
    first: IntArray
    index: IntArray

    @classmethod
    def of(cls, points: FloatArray, normals: FloatArray, near: IntArray) -> Among:
        """near : (n, k) rows of the neighbours of each point."""
        first, index = joined_both_ways(near)
        columns = {"points": np.ascontiguousarray(points, float), "normals": np.ascontiguousarray(normals, float)}
        return cls(**columns, low=points.min(axis=0), high=points.max(axis=0), first=first, index=index)

    def near(self, seed: int, free: BoolArray, plane: Plane, off: float, own_side: float, reach: float = np.inf) -> IntArray:
        """(k,) rows, ascending, of free points within `off` of the plane and `reach` of the seed, of the plane's side, that hang together with it.

        own_side : least cosine between the normals of a point and the plane.
        """
        return self._walked(seed, free, np.zeros(3), plane.normal, plane.offset, 0, off, own_side, reach)

    def near_round(self, seed: int, free: BoolArray, cylinder: Surface, off: float, own_side: float) -> IntArray:
        """(k,) rows, ascending, of free points within `off` of a cylinder, of its side, that hang together with the seed."""
        return self._walked(seed, free, cylinder.point, cylinder.axis, float(cylinder.radius), cylinder.sense, off, own_side, np.inf)

    def _walked(
        self, seed: int, free: BoolArray, place: FloatArray, axis: FloatArray, size: float, sense: int, off: float, own_side: float, reach: float
    ) -> IntArray:
        columns = self.points, self.normals, self.first, self.index
        place, axis = np.array(place, float), np.array(axis, float)  # of one kind: else the kernel is compiled four times
        return hanging_together(*columns, seed, free, place, axis, size, sense, off, float(own_side), float(reach))


@jit
def joined_both_ways(near: IntArray) -> tuple[IntArray, IntArray]:
    """(first, index): `index[first[i]:first[i + 1]]` are the neighbours near[i] of point i and the points that have i among theirs, some twice."""
    n, k = near.shape
    first = np.zeros(n + 1, np.int64)
    for i in range(n):
        first[i + 1] += k
        for j in range(k):
            first[near[i, j] + 1] += 1
    for i in range(n):
        first[i + 1] += first[i]
    place = first[:-1].copy()
    index = np.zeros(2 * n * k, np.int64)
    for i in range(n):
        for j in range(k):
            other = near[i, j]
            index[place[i]] = other
            place[i] += 1
            index[place[other]] = i
            place[other] += 1
    return first, index


@jit
def hanging_together(
    points: FloatArray,
    normals: FloatArray,
    first: IntArray,
    index: IntArray,
    seed: int,
    free: BoolArray,
    place: FloatArray,
    axis: FloatArray,
    size: float,
    sense: int,
    off: float,
    own_side: float,
    reach: float,
) -> IntArray:
    """(k,) rows, ascending, that links join to the seed over points that are free, within `off` of a surface and `reach` of the seed, of its side.

    place, axis, size : of a plane a place, the normal and the offset from there; of a cylinder a place on the axis, the axis and the radius.
    sense : 0 a plane; +1 a shaft, -1 a hole.   own_side : least cosine between the normals of a point and the surface.
    """
    n = len(points)
    met = np.zeros(n, np.bool_)
    queue = np.empty(n, np.int64)
    queue[0], met[seed] = seed, True
    count, done, kept = 1, 0, 0
    while done < count:
        p = queue[done]
        done += 1
        if not free[p]:
            continue
        x, y, z = points[p, 0] - place[0], points[p, 1] - place[1], points[p, 2] - place[2]
        height = x * axis[0] + y * axis[1] + z * axis[2]
        facing = normals[p, 0] * axis[0] + normals[p, 1] * axis[1] + normals[p, 2] * axis[2]
        if sense != 0:
            x, y, z = x - height * axis[0], y - height * axis[1], z - height * axis[2]
            height = math.sqrt(x * x + y * y + z * z)
            facing = sense * (x * normals[p, 0] + y * normals[p, 1] + z * normals[p, 2]) / max(height, SMALL)
        away2 = 0.0
        for c in range(3):
            away2 += (points[p, c] - points[seed, c]) ** 2
        if abs(height - size) > off or facing < own_side or away2 > reach * reach:
            continue
        queue[kept] = p
        kept += 1
        for o in range(first[p], first[p + 1]):
            if not met[index[o]]:
                met[index[o]] = True
                queue[count] = index[o]
                count += 1
    return np.sort(queue[:kept])
