"""The walls of a member laid flat: points of two faces that look away from each other, by their place along the first and their depth under it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from scan2fea.estimation.outline import edge_lengths, first_across, inward
from scan2fea.kernel.sections import ROUND, section
from scan2fea.types import FloatArray, Member, Section, Value

_FLAT = 1e-3  # of the cosine between the faces of a wall
_ASKED = 4  # places at which the two faces of a wall lie across from each other


@dataclass(frozen=True, eq=False, kw_only=True)
class Wall(Value):
    """A wall laid flat. name : of its first face.   along, z : (n,) places of points along that face and along the member, m.
    depth : (n,) under it.   wall_m : thickness.   low, high : m, of the stretch that both faces share.   turn : m, once around; 0 of a flat wall.

    start, unit, into : (2,) of a flat wall, in the section: where the first face begins, the way along it, and into the material.
    """

    name: str
    along: FloatArray
    depth: FloatArray
    z: FloatArray
    wall_m: float
    low: float
    high: float
    turn: float = 0.0
    start: FloatArray = field(default_factory=lambda: np.zeros(2))
    unit: FloatArray = field(default_factory=lambda: np.zeros(2))
    into: FloatArray = field(default_factory=lambda: np.zeros(2))


def walls_of(member: Member, local: FloatArray) -> Iterator[Wall]:
    """The walls of a member, and where points local (n, 3) in its frame (across, across, along; m) lie in them."""
    shape = section(member.family, member.values())
    return _round_wall(member, shape, local) if member.family in ROUND else _flat_walls(shape, local)


def _flat_walls(shape: Section, local: FloatArray) -> Iterator[Wall]:
    start = np.concatenate(shape.loops)
    way = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    names = [name for loop in shape.face_names for name in loop]
    lengths = edge_lengths(shape)
    unit = way / lengths[:, None]
    into = inward(shape)
    for i in range(len(start)):
        for j in range(i + 1, len(start)):
            apart = float((start[j] - start[i]) @ into[i])
            if into[i] @ into[j] > _FLAT - 1 or apart <= 0:
                continue
            ends = np.sort([(start[j] - start[i]) @ unit[i], (start[j] + way[j] - start[i]) @ unit[i]])
            low, high = max(0.0, float(ends[0])), min(float(lengths[i]), float(ends[1]))
            if high - low <= apart:  # as thick as wide: no wall
                continue
            asked = start[i] + np.linspace(low, high, _ASKED + 2)[1:-1, None] * unit[i]
            hit, _ = first_across(asked, np.tile(into[i], (_ASKED, 1)), shape, np.full(_ASKED, i))
            if (hit == j).all():  # not through a web to the flange beyond
                off = local[:, :2] - start[i]
                at = {"along": off @ unit[i], "depth": off @ into[i], "z": local[:, 2]}
                yield Wall(name=names[i], **at, wall_m=apart, low=low, high=high, start=start[i], unit=unit[i], into=into[i])


def _round_wall(member: Member, shape: Section, local: FloatArray) -> Iterator[Wall]:
    values = member.values()
    if "t" not in values:
        return
    first, radius = shape.loops[0][0], values["d"] / 2
    angle = np.mod(np.arctan2(local[:, 1], local[:, 0]) - math.atan2(first[1], first[0]), 2 * math.pi)
    turn = 2 * math.pi * radius
    depth = radius - np.hypot(local[:, 0], local[:, 1])
    at = {"along": angle * radius, "depth": depth, "z": local[:, 2]}
    yield Wall(name=shape.face_names[0][0], **at, wall_m=values["t"], low=0.0, high=turn, turn=turn)
