"""Holes through a wall of a member that both its faces and its inside tell together: bolt holes a few spacings wide.

One face alone tells a hole where it lacks far more points than chance takes away (`holes.py`); a narrow hole lacks too few. But both faces lack them
at one place, and round it points of the hole's side lie inside the wall, where a whole wall has none but strays and the tail of the noise. The places
are the circles through three points of the two faces that hold no other and have points in every direction. Two chances are multiplied:

    faces     that a circle lacks as many points, by those of the ring around it. Scan lines and uneven scans lack more than points at random: the
              tail of the law is that of the wall's own circles, exponential with the slope from its 90th to its 99th percentile (1 at random: the
              circumcircles of Poisson-Delaunay triangles follow a gamma law of shape 2; Miles, Math. Biosciences 6, 1970).
    inside    that as many points lie inside the wall there: the most of what the whole wall, the points of its faces there and the wall around the
              place make likely, as a Poisson count.

A hole is told where their product is below `CHANCE` over all circles of the wall (Bonferroni).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import pdtrc

from scan2fea.estimation.holes import Hole
from scan2fea.estimation.walls import Wall, walls_of
from scan2fea.kernel.empty_circles import empty_circles
from scan2fea.kernel.planar_grid import PlanarGrid
from scan2fea.types import FloatArray, Member, Value

CHANCE = 1e-6  # that a wall without a hole shows one
_BESIDE = 3.0  # radii of the place within which the wall around it is asked
_NEAR_SIGMAS = 4.0  # of noise: points of a face
_DEEP_SIGMAS, _DEEP_WALL = 3.0, 0.25  # of noise, and of the wall: points inside it lie deeper under both faces
_SECTORS, _RING = 8, 2.0  # a point in each sector, however it is turned, between the circle and one so much wider
_LOOKS = 64  # directions in which such a circle may leave the wall
_LEAST = 16  # points of a wall


@dataclass(frozen=True, eq=False, kw_only=True)
class Mouth(Value):
    """Where a hole goes through a wall. place : (2,) its middle, along the face and along the member, m.   radius_m : of the circle that is empty.

    uneven : how many times more points the circles of its wall lack than at random.
    """

    wall: Wall
    place: FloatArray
    radius_m: float
    uneven: float


def bored(member: Member, local: FloatArray, sigma_m: float, *, faces_tell: bool = True) -> tuple[Hole, ...]:
    """The holes that go through walls of a member, by points local (n, 3) in its own frame: across, across, along; m. sigma_m : noise.

    faces_tell : whether a place without points speaks for a hole; not where rays say that it was not looked at.
    """
    found = mouths(member, local, sigma_m, faces_tell=faces_tell)
    return tuple(hole_of(m.wall, m.place, m.radius_m) for m in found)


def hole_of(wall: Wall, place: FloatArray, radius_m: float) -> Hole:
    """A round hole in a face of a wall. place : (2,) along the face and along the member, m."""
    return Hole(face=wall.name, places=_disc(place, radius_m), cell_m=radius_m / 2)


def mouths(
    member: Member, local: FloatArray, sigma_m: float, *, faces_tell: bool = True, chance: float = CHANCE
) -> tuple[Mouth, ...]:
    """The same, each in its wall, which holds the points between the ends of the member. chance : that a wall without a hole shows one."""
    length = member.values()["length"]
    own = local[(local[:, 2] > 0) & (local[:, 2] < length)]
    return tuple(mouth for wall in walls_of(member, own) for mouth in _of_wall(wall, length, sigma_m, faces_tell, chance))


def _of_wall(wall: Wall, length: float, sigma_m: float, faces_tell: bool, allowed: float) -> list[Mouth]:
    z, over = wall.z, wall.turn / 2  # of a round wall, so that a hole at its seam is one
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
    faces, uneven = _log_tail(lacking) if faces_tell else (np.zeros(len(rows)), 1.0)
    reach = radius[rows] + _NEAR_SIGMAS * sigma_m
    found, chance = np.zeros((2, len(rows)))
    if len(deep):
        within = cKDTree(deep)
        found, beside = (_count(within, middle[rows], times * reach) for times in (1.0, _BESIDE))
        shares = (math.pi * reach**2 / ((wall.high + over - wall.low) * length), near.n_within(middle[rows], reach) / len(face))
        chance = np.maximum(len(deep) * np.maximum(*shares), (beside - found) / (_BESIDE**2 - 1))
    told = faces + _log_as_many(found, chance) < math.log(allowed / len(radius))
    rows, found = rows[told], found[told]
    holes, free = list[Mouth](), np.ones(len(rows), bool)
    for k in np.lexsort((-radius[rows], -found)):
        row = rows[k]
        wide = _RING * float(radius[row])
        if free[k] and _around(np.concatenate([face, _off_wall(middle[row], wide, wall, over, length)]) - middle[row], wide):
            free &= np.linalg.norm(middle[rows] - middle[row], axis=1) > 2 * radius[row]
            holes.append(Mouth(wall=wall, place=middle[row], radius_m=float(radius[row]), uneven=uneven))
    return holes


def _log_tail(lacking: FloatArray) -> tuple[FloatArray, float]:
    """(n,) logarithm of the chance that a circle of the wall lacks as many points, and its slope; of the circles, the larger half are given."""
    low, high = np.percentile(lacking, [80.0, 98.0])  # of the larger half: the 90th and the 99th of all
    slope = max(1.0, float(high - low) / math.log(10.0))
    return np.where(lacking > low, -math.log(10.0) - (lacking - low) / slope, 0.0), slope


def _log_as_many(found: FloatArray, mean: FloatArray) -> FloatArray:
    """(n,) logarithm of the chance of as many points or more (Poisson); by scipy.special, as scipy.stats takes a fifth of a start of the program."""
    tail, some = np.ones(len(found)), found > 0
    tail[some] = pdtrc(found[some] - 1, mean[some])
    with np.errstate(divide="ignore"):
        return np.log(tail)


def _count(tree: cKDTree, at: FloatArray, reach: FloatArray) -> FloatArray:
    """(k,) points within reach of each place."""
    return np.asarray(tree.query_ball_point(at, reach, return_length=True), float)


def _unrolled(at: FloatArray, wall: Wall, over: float) -> FloatArray:
    return np.concatenate([at, at[at[:, 0] < over] + [wall.turn, 0.0]]) if wall.turn else at


def _off_wall(middle: FloatArray, reach: float, wall: Wall, over: float, length: float) -> FloatArray:
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
