"""The residuals of points against a fitted member, unrolled: along the axis, around the outline, and off its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.estimation.grid import inside
from scan2fea.estimation.solid import Solid
from scan2fea.kernel.sweep import axis_at
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

CHUNK = 20_000


@dataclass(frozen=True, eq=False, kw_only=True)
class ResidualField(Value):
    """Per point: z_m along the axis, around_m along the outline of its loop, off_m from the nearest face (negative inside the member).

    edge : the edge of the polygons it is nearest to, counted through all loops.   face : index into `names`.
    """

    z_m: FloatArray
    around_m: FloatArray
    off_m: FloatArray
    edge: IntArray
    face: IntArray
    names: tuple[str, ...]


def residual_field(points: FloatArray, solid: Solid) -> ResidualField:
    """The field of (n, 3) points in the frame of the world; ends are not faces here: what lies beyond them keeps its z outside 0 ... length."""
    local = applied(inverse(solid.sweep.T_world_member), points)
    section = in_section(solid, local)
    start = np.concatenate(solid.loops)
    end = np.concatenate([np.roll(loop, -1, axis=0) for loop in solid.loops])
    length = np.linalg.norm(end - start, axis=1)
    first = np.concatenate([np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1))[:-1]]) for p in solid.loops])
    edge, distance, along = np.zeros(len(section), np.int64), np.zeros(len(section)), np.zeros(len(section))
    for k in range(0, len(section), CHUNK):
        rows = slice(k, k + CHUNK)
        share = np.clip(((section[rows, None] - start) * (end - start)).sum(-1) / length**2, 0, 1)
        gap = np.linalg.norm(section[rows, None] - (start + share[..., None] * (end - start)), axis=2)
        edge[rows] = gap.argmin(axis=1)
        at = np.arange(len(gap)), edge[rows]
        distance[rows], along[rows] = gap[at], first[edge[rows]] + share[at] * length[edge[rows]]
    names = solid.shape.names
    of_edge = np.array([names.index(name) for loop in solid.loop_names for name in loop], np.int64)
    is_inside: BoolArray = np.zeros(len(section), bool)
    is_inside[inside(list(solid.loops), section)] = True
    return ResidualField(z_m=local[:, 2], around_m=along, off_m=np.where(is_inside, -distance, distance), edge=edge, face=of_edge[edge], names=names)


def in_section(solid: Solid, local: FloatArray) -> FloatArray:
    """(n, 2) places in the section of points (n, 3) in the frame of the member: bow, twist and growth undone."""
    offset, roll = axis_at(solid.sweep, local[:, 2])
    x, y = (local[:, :2] - offset).T
    cos, sin = np.cos(roll), np.sin(roll)
    xy = np.stack([cos * x + sin * y, -sin * x + cos * y], axis=1)
    return xy if solid.sweep.stretch is None else solid.sweep.stretch.undone(xy, solid.sweep.growth(local[:, 2]))
