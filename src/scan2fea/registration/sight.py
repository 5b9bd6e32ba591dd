"""What a station saw through: surface of another frame that stands in its free space, in one piece, cannot be there.

A box looks from behind as it does from the front, and a frame that is turned by half a turn lies on it as well as the right one. What differs is a
notch, a step, a leg: a place that beams of one station passed through and where the other frame has surface. Strays and mixed pixels lie there too,
but one by one; a surface does so with its neighbours. Told only of stations whose beams are even: where they are not, a hole among them says nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.near_tree import NearTree, near_tree, nearest_of
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.types import FloatArray, IntArray, Value

BEAMS = 8  # around a direction: those of a raster that enclose it
UNEVEN = 0.25 / math.sqrt(BEAMS)  # of the logarithm of the angle to the eighth: half of what it is by chance, of beams without order in an even fan
MORE_EVEN = 1.25  # times than in space: noise makes the distances of points on a ball less even than their directions
FOLDED = 0.05  # of the beams end so much nearer or farther than two of four neighbours, in logarithm of range
MOST_FOLDED = 0.25
STRAYS = 0.01  # the limit of verification for points that are no surface
MOST = 0.05  # the limit of docs/design.md for rays that pass through a nearer surface
TOGETHER = 5  # of the eight nearest: a cell on the straight border of a patch of 3 x 3
_ENCLOSED = 1.2  # of a gap: in a square raster the eighth is 1.58 steps away at most, a gap is 1.41
TOLERANCE_EDGES = 0.5  # what the refinement and the means of cells leave open; an edge is at least three deviations of the noise
SAMPLE = 60_000
DRAWN = 3_000


@dataclass(frozen=True, eq=False, kw_only=True)
class View(Value):
    """The beams of a station, and points of the frame.

    station : (3,).   beams : tree of the unit directions from it.   range_m : (n,).   gap : (n,) distance of each direction to its eighth neighbour.
    surface : tree of the points.   drawn : (m, 3) some of them.   around : (m, 8) rows of `drawn` nearest to each.
    """

    station: FloatArray
    beams: NearTree
    range_m: FloatArray
    gap: FloatArray
    surface: NearTree
    drawn: FloatArray
    around: IntArray


def view_of(points: FloatArray, station: FloatArray) -> View | None:
    """What was seen from `station` (3,); None for too few points (n, 3), and where they are not what even beams from there end at."""
    if not is_station(points - station):
        return None
    points = points[sampled_rows(len(points), SAMPLE, 0)]
    range_m = np.linalg.norm(points - station, axis=1)
    points, range_m = points[range_m > 0], range_m[range_m > 0]
    direction = (points - station) / range_m[:, None]
    beams = near_tree(direction)
    gap = k_nearest(direction, BEAMS + 1, tree=beams)[0][:, -1]
    drawn = points[sampled_rows(len(points), DRAWN, 0)]
    around = k_nearest(drawn, BEAMS + 1)[1][:, 1:]
    return View(station=station, beams=beams, range_m=range_m, gap=gap, surface=near_tree(points), drawn=drawn, around=around)


def is_station(points: FloatArray) -> bool:
    """True where points (n, 3) were measured from the origin: seen from there, and from nowhere else, they are as dense as the beams of a scanner.

    The angle from a point to its eighth neighbour goes with distance and slant of the surface unless the origin is where the beams came from. Points
    that lie as evenly in space tell nothing: those of a ball round the origin do from there too.
    """
    range_m = np.linalg.norm(points, axis=1)
    points, range_m = points[range_m > 0], range_m[range_m > 0]
    if len(points) <= BEAMS:
        return False
    direction = points / range_m[:, None]
    rows = sampled_rows(len(points), DRAWN, 0)
    angle, near = k_nearest(direction, BEAMS + 1, direction[rows])
    apart_m = k_nearest(points, BEAMS + 1, points[rows])[0]
    # of narrow things most points lie at a border, where the eighth is farther: there the second does
    is_even = any(_scatter(angle[:, k]) <= min(UNEVEN, _scatter(apart_m[:, k]) / MORE_EVEN) for k in (2, BEAMS))
    apart = np.sort(np.abs(np.log(range_m[near[:, 1:5]] / range_m[rows][:, None])), axis=1)[:, 1]
    return is_even and float((apart > FOLDED).mean()) <= MOST_FOLDED


def _scatter(angle: FloatArray) -> float:
    """Robust standard deviation of the logarithm."""
    size = np.log(np.maximum(angle, 1e-300))
    return 1.4826 * float(np.median(np.abs(size - np.median(size))))


def is_seen_through(a: View, b: View, T_a_b: FloatArray, tolerance_m: float) -> bool:
    """True where surface of one stands, in one piece, in space that the other station saw empty.

    T_a_b : takes points of b to the frame of a.   tolerance_m : what lies farther before a surface is not on it.
    Where more than strays lie there one by one, and more so than in pieces (leaves), pieces say little: then only many do.
    """
    (n, single, piece), (m, other_single, other_piece) = _through(a, b, T_a_b, tolerance_m), _through(b, a, inverse(T_a_b), tolerance_m)
    allowed = MOST if single + other_single > max(STRAYS * (n + m), piece + other_piece) else 0.0
    return piece > allowed * n or other_piece > allowed * m


def _through(view: View, other: View, T_view_other: FloatArray, tolerance_m: float) -> tuple[int, int, int]:
    """How many points of the other frame this station looks at, and how many of them it looked through: one by one, and in one piece."""
    moved = applied(T_view_other, other.drawn)
    own = moved - view.station
    far = np.maximum(np.linalg.norm(own, axis=1), 1e-300)
    n = len(view.range_m)
    angle, near = k_nearest(np.zeros((n, 3)), BEAMS, own / far[:, None], tree=view.beams)
    within = angle[:, -1] <= _ENCLOSED * view.gap[near[:, 0]]
    through = within & (view.range_m[near].min(axis=1) > far + tolerance_m)
    rows = np.flatnonzero(through)
    through[rows] = ~np.isfinite(nearest_of(view.surface, moved[rows], tolerance_m)[0])
    piece = int((through & (through[other.around].sum(axis=1) >= TOGETHER)).sum())
    return int(within.sum()), int(through.sum()) - piece, piece
