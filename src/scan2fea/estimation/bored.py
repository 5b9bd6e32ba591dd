"""Holes through a wall of a member that both its faces and its inside tell together: bolt holes a few spacings wide.

One face alone tells a hole where it lacks far more points than chance takes away (`holes.py`); a narrow hole lacks too few. But both faces lack them
at one place, and round it points of the hole's side lie inside the wall, where a whole wall has none but strays and the tail of the noise. The places
are the circles through three points of the two faces that hold no other and have points in every direction. Two chances are multiplied:

    faces     that a circle lacks as many points, by those of the ring around it. Scan lines and uneven scans lack more than points at random: the
              tail of the law is that of the wall's own circles, exponential with the slope from its 90th to its 99th percentile (1 at random: the
              circumcircles of Poisson-Delaunay triangles follow a gamma law of shape 2; Miles, Math. Biosciences 6, 1970).
    inside    that as many points lie inside the wall there: the most of what the whole wall, the points of its faces there and the wall around the
              place make likely, as a Poisson count.

A hole is told where their product is below `_CHANCE` over all circles of the wall (Bonferroni).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import pdtrc

from scan2fea.estimation.holes import Hole
from scan2fea.estimation.outline import edge_lengths, first_across, inward
from scan2fea.kernel.empty_circles import empty_circles
from scan2fea.kernel.planar_grid import PlanarGrid
from scan2fea.kernel.sections import ROUND, section
from scan2fea.types import FloatArray, Member, Section, Value

_CHANCE = 1e-6  # that a wall without a hole shows one
_BESIDE = 3.0  # radii of the place within which the wall around it is asked
_NEAR_SIGMAS = 4.0  # of noise: points of a face
_DEEP_SIGMAS, _DEEP_WALL = 3.0, 0.25  # of noise, and of the wall: points inside it lie deeper under both faces
_SECTORS, _RING = 8, 2.0  # a point in each sector, however it is turned, between the circle and one so much wider
_LOOKS = 64  # directions in which such a circle may leave the wall
_FLAT = 1e-3  # of the cosine between the faces of a wall
_LEAST = 16  # points of a wall
_ASKED = 4  # places at which the two faces of a wall lie across from each other


@dataclass(frozen=True, eq=False, kw_only=True)
class _Wall(Value):
    """A wall laid flat. name : of its first face.   along : (n,) places of points along that face, m.   depth : (n,) under it.   wall_m : thickness.
    low, high : m, of the stretch that both faces share.   turn : m, once around; 0 of a flat wall.
    """

    name: str
    along: FloatArray
    depth: FloatArray
    wall_m: float
    low: float
    high: float
    turn: float = 0.0


def bored(member: Member, local: FloatArray, sigma_m: float, *, faces_tell: bool = True) -> tuple[Hole, ...]:
    """The holes that go through walls of a member, by points local (n, 3) in its own frame: across, across, along; m. sigma_m : noise.

    faces_tell : whether a place without points speaks for a hole; not where rays say that it was not looked at.
    """
    shape, length = section(member.family, member.values()), member.values()["length"]
    own = local[(local[:, 2] > 0) & (local[:, 2] < length)]
    walls = _round_wall(member, shape, own) if member.family in ROUND else _flat_walls(shape, own)
    return tuple(hole for wall in walls for hole in _of_wall(wall, own[:, 2], length, sigma_m, faces_tell))


def _flat_walls(shape: Section, local: FloatArray) -> Iterator[_Wall]:
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
                yield _Wall(name=names[i], along=off @ unit[i], depth=off @ into[i], wall_m=apart, low=low, high=high)


def _round_wall(member: Member, shape: Section, local: FloatArray) -> Iterator[_Wall]:
    values = member.values()
    if "t" not in values:
        return
    first, radius = shape.loops[0][0], values["d"] / 2
    angle = np.mod(np.arctan2(local[:, 1], local[:, 0]) - math.atan2(first[1], first[0]), 2 * math.pi)
    turn = 2 * math.pi * radius
    depth = radius - np.hypot(local[:, 0], local[:, 1])
    yield _Wall(name=shape.face_names[0][0], along=angle * radius, depth=depth, wall_m=values["t"], low=0.0, high=turn, turn=turn)


def _of_wall(wall: _Wall, z: FloatArray, length: float, sigma_m: float, faces_tell: bool) -> list[Hole]:
    over = wall.turn / 2  # of a round wall, so that a hole at its seam is one
    at = np.stack([wall.along, z], 1)
    on = (wall.along > wall.low) & (wall.along < wall.high) & (wall.depth > -_NEAR_SIGMAS * sigma_m)
    on &= wall.depth < wall.wall_m + _NEAR_SIGMAS * sigma_m
    under = np.minimum(wall.depth, wall.wall_m - wall.depth)
    inside = on & (under > max(_DEEP_SIGMAS * sigma_m, _DEEP_WALL * wall.wall_m))
    rim = 0.0 if wall.turn else _NEAR_SIGMAS * sigma_m  # what lies nearer to it may be of a toe, or of an end
    inside &= (wall.along > wall.low + rim) & (wall.along < wall.high - rim)
    inside &= (z > _NEAR_SIGMAS * sigma_m) & (z < length - _NEAR_SIGMAS * sigma_m)
    face, deep = _unrolled(at[on & ~inside], wall, over), _unrolled(at[inside], wall, over)
    if len(face) < _LEAST or not all(np.ptp(row) > 0 for row in face.T):
        return []
    near = PlanarGrid.of(face)
    middle, radius = empty_circles(face, near)
    if not len(radius):
        return []
    clear = np.min([middle[:, 0] - wall.low, wall.high + over - middle[:, 0], middle[:, 1], length - middle[:, 1]], axis=0)
    whole = clear > radius
    if wall.turn:
        whole &= (middle[:, 0] >= over / 2) & (middle[:, 0] < over / 2 + wall.turn)
    rows = np.flatnonzero(whole & (radius >= np.median(radius)))
    if not len(rows):
        return []
    lacking = near.n_within(middle[rows], _RING * radius[rows]) / (_RING**2 - 1)
    faces = _log_tail(lacking) if faces_tell else np.zeros(len(rows))
    reach = radius[rows] + _NEAR_SIGMAS * sigma_m
    found, chance = np.zeros((2, len(rows)))
    if len(deep):
        within = cKDTree(deep)
        found, beside = (_count(within, middle[rows], times * reach) for times in (1.0, _BESIDE))
        shares = (math.pi * reach**2 / ((wall.high + over - wall.low) * length), near.n_within(middle[rows], reach) / len(face))
        chance = np.maximum(len(deep) * np.maximum(*shares), (beside - found) / (_BESIDE**2 - 1))
    told = faces + _log_as_many(found, chance) < math.log(_CHANCE / len(radius))
    rows, found = rows[told], found[told]
    holes, free = list[Hole](), np.ones(len(rows), bool)
    for k in np.lexsort((-radius[rows], -found)):
        row = rows[k]
        wide = _RING * float(radius[row])
        if free[k] and _around(np.concatenate([face, _off_wall(middle[row], wide, wall, over, length)]) - middle[row], wide):
            free &= np.linalg.norm(middle[rows] - middle[row], axis=1) > 2 * radius[row]
            holes.append(Hole(face=wall.name, places=_disc(middle[row], float(radius[row])), cell_m=float(radius[row]) / 2))
    return holes


def _log_tail(lacking: FloatArray) -> FloatArray:
    """(n,) logarithm of the chance that a circle of the wall lacks as many points; of the circles, the larger half are given."""
    low, high = np.percentile(lacking, [80.0, 98.0])  # of the larger half: the 90th and the 99th of all
    slope = max(1.0, float(high - low) / math.log(10.0))
    return np.where(lacking > low, -math.log(10.0) - (lacking - low) / slope, 0.0)


def _log_as_many(found: FloatArray, mean: FloatArray) -> FloatArray:
    """(n,) logarithm of the chance of as many points or more (Poisson); by scipy.special, as scipy.stats takes a fifth of a start of the program."""
    tail, some = np.ones(len(found)), found > 0
    tail[some] = pdtrc(found[some] - 1, mean[some])
    with np.errstate(divide="ignore"):
        return np.log(tail)


def _count(tree: cKDTree, at: FloatArray, reach: FloatArray) -> FloatArray:
    """(k,) points within reach of each place."""
    return np.asarray(tree.query_ball_point(at, reach, return_length=True), float)


def _unrolled(at: FloatArray, wall: _Wall, over: float) -> FloatArray:
    return np.concatenate([at, at[at[:, 0] < over] + [wall.turn, 0.0]]) if wall.turn else at


def _off_wall(middle: FloatArray, reach: float, wall: _Wall, over: float, length: float) -> FloatArray:
    """(k, 2) places at a distance from a middle that lie beyond the wall: nothing is missing there."""
    turn = np.arange(_LOOKS) * 2 * math.pi / _LOOKS
    at = middle + reach * (1 - 1e-9) * np.stack([np.cos(turn), np.sin(turn)], 1)
    aside = (at[:, 0] < wall.low) | (at[:, 0] > wall.high + over)
    return at[((wall.turn == 0.0) & aside) | (at[:, 1] < 0.0) | (at[:, 1] > length)]


def _around(off: FloatArray, reach: float) -> bool:
    """Whether points (n, 2), from the middle of a circle, lie within reach on all sides: a strip that nobody saw lacks them both ways along it."""
    off = off[np.einsum("ij,ij->i", off, off) <= reach**2]
    turn = np.sort(np.arctan2(off[:, 1], off[:, 0]))
    return len(turn) > 0 and bool(np.diff(turn, append=turn[0] + 2 * math.pi).max() <= 2 * math.pi / _SECTORS)


def _disc(middle: FloatArray, radius: float) -> FloatArray:
    """(9, 2) places in a circle."""
    turn = np.arange(8) * math.pi / 4
    return np.concatenate([middle[None], middle + 0.7 * radius * np.stack([np.cos(turn), np.sin(turn)], 1)])
