"""Which side of a cloud is outside, when nobody says where it was seen from.

A ball too big to slip between the points rolls in from outside, through the Delaunay tets of the cloud (Edelsbrunner and Muecke 1994: the
outer alpha shape). Where it arrives is outside; the side of a point that it meets sooner is the point's outward side. Rounds of
winding-number consistency (`winding.py`) then settle the points that lie between two sheets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.delaunay import Tetrahedralisation, tetrahedralise
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.normals import pca_normals
from scan2fea.options import option
from scan2fea.reconstruction.basins import parted
from scan2fea.reconstruction.flooding import Setting, depths, reached, spread
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

AXIS_NEIGHBORS = 18
GROWTH = 1.2  # step of the ball's radius
LARGEST_BALL = 4.0  # spacings
LEAK_FREE, LEAK_TOLERATED = 0.01, 0.15  # share of points with flood on both sides
NEAR, BEHIND = 0.5, 0.8  # spacings: "flood right beside the point", "flood right behind a wall of the void"
VOID_VOLUME = 200.0  # cubic spacings: smaller unflooded pockets are what every wall is full of
CAVITY_SHARE = 0.3
SAME_BALL = 0.05  # two radii nearer than this give one answer
REACH = 60.0  # spacings a walk goes in search of the flood


@dataclass(frozen=True, kw_only=True)
class OutsideOptions:
    ball: tuple[float, ...] = option((1.4, 1.15, 2.0), "first radii of the rolling ball tried, in spacings, best first")
    seed: int = option(0, "seed of the jitter of the triangulation", minimum=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Flood(Value):
    """One answer to "which side is outside".

    signed : (n, 3) unit outward axis, zero where the flood does not tell.   outside : (m,) tets of the raw points the ball reached.
    open_both : (n,) points with flood right beside them on both sides.   ball_m : radius of the ball.   first_ball : the one it grew from, in
    spacings.
    n_cavities : voids the ball cannot enter that were taken as empty.   core_solid : True where such voids were filled instead.   is_parted : True
    where insides that the ball enters through gaps were told from the outside.
    """

    signed: FloatArray
    outside: BoolArray
    open_both: BoolArray
    ball_m: float
    first_ball: float
    n_cavities: int
    core_solid: bool
    is_parted: bool = False

    @property
    def leak_share(self) -> float:
        return float(self.open_both.mean())


def prepare(points: FloatArray, seed: int = 0) -> Setting:
    """Triangulate and find the axes. points : (n, 3). Raises ReconstructionError for fewer than 20 points or no extent."""
    enough = AXIS_NEIGHBORS + 1
    require(len(points) >= enough, ReconstructionError, f"{len(points)} points are too few to find a surface: at least {enough} are needed")
    h = spacing(points)
    return Setting.of(tetrahedralise(points, h, seed), pca_normals(points, AXIS_NEIGHBORS), h)


def floods(setting: Setting, options: OutsideOptions = OutsideOptions()) -> Iterator[Flood]:
    """Answers, most likely first: each first ball, and again with enclosed voids solid where any was found. Equal answers come once."""
    given: list[float] = []
    for first in options.ball:
        found = flood(setting, first, core_solid=False)
        if any(abs(found.ball_m / radius - 1.0) < SAME_BALL for radius in given):
            continue
        given.append(found.ball_m)
        yield found
        if found.n_cavities:
            yield flood(setting, first, core_solid=True)


def flood(setting: Setting, first_ball: float, core_solid: bool) -> Flood:
    """Roll the ball in from outside, growing it while it leaks through the sampling (reconstruction.md (e), steps 2 to 4).

    Where it still leaks in, insides are told from the outside (`basins.py`) if that stops most of it.
    """
    radius, outside, both = _grown(setting, first_ball, rolled_in)
    is_parted = False
    if both.mean() > LEAK_FREE:
        apart = _grown(setting, first_ball, parted)
        is_parted = bool(apart[2].mean() <= 0.5 * both.mean())
        radius, outside, both = apart if is_parted else (radius, outside, both)
    outside, n_cavities = emptied(setting, outside, radius, core_solid)
    plus, minus = depths(setting, outside, REACH * setting.spacing_m)
    sign = (plus < minus).astype(float) - (minus < plus)
    return Flood(
        signed=setting.axis * sign[:, None],
        outside=outside,
        open_both=both,
        ball_m=radius,
        first_ball=first_ball,
        n_cavities=n_cavities,
        core_solid=core_solid and n_cavities > 0,
        is_parted=is_parted,
    )


def rolled_in(setting: Setting, radius: float) -> BoolArray:
    """(m,) tets that a ball of `radius` reaches from outside."""
    return reached(setting.tetra, radius)


def entered(setting: Setting, radius: float, like: Flood) -> BoolArray:
    """(m,) tets that are outside, in another triangulation, by a ball of `radius` and the way of an answer."""
    outside = (parted if like.is_parted else rolled_in)(setting, radius)
    return emptied(setting, outside, radius, like.core_solid)[0]


def _grown(setting: Setting, first_ball: float, roll: Callable[[Setting, float], BoolArray]) -> tuple[float, BoolArray, BoolArray]:
    """The radius that the ball has grown to, the tets it is in, and the points it is beside on both sides."""
    h = setting.spacing_m
    radius = first_ball * h
    outside = roll(setting, radius)
    both = _on_both_sides(setting, outside)
    while both.mean() > LEAK_FREE and radius * GROWTH <= LARGEST_BALL * h:
        grown = roll(setting, radius * GROWTH)
        still = _on_both_sides(setting, grown)
        if both.mean() <= LEAK_TOLERATED and still.mean() > 0.5 * both.mean():
            break  # not a leak through the sampling: faces one point row wide, which a larger ball would only shut in
        radius, outside, both = radius * GROWTH, grown, still
    return radius, outside, both


def emptied(setting: Setting, outside: BoolArray, radius: float, core_solid: bool) -> tuple[BoolArray, int]:
    """The reached tets and, unless `core_solid`, those of the enclosed voids that are empty; and how many such voids there are."""
    cavities = _cavities(setting, outside, radius)
    if not cavities or core_solid:
        return outside, len(cavities)
    return np.asarray(outside | np.isin(_voids(setting.tetra, outside, radius), cavities)), len(cavities)


def _on_both_sides(setting: Setting, outside: BoolArray) -> BoolArray:
    near = NEAR * setting.spacing_m
    plus, minus = depths(setting, outside, near)
    return (plus <= near) & (minus <= near)


def _voids(tetra: Tetrahedralisation, outside: BoolArray, radius: float) -> IntArray:
    """(m,) number of the void (from 1) each tet belongs to: tets the ball fits in and can roll between, but not reach; 0 elsewhere."""
    label = spread(tetra.points, tetra.tets, tetra.neighbors, tetra.circumradius, np.zeros(len(tetra), np.bool_), radius)
    return np.asarray(np.where(outside, 0, label + 1))


def _cavities(setting: Setting, outside: BoolArray, radius: float) -> list[int]:
    """Voids that are empty: most of their points have a wall behind them, not the flood."""
    tetra, h = setting.tetra, setting.spacing_m
    label = _voids(tetra, outside, radius)
    volume = np.bincount(label, weights=tetra.volumes)
    large = [int(v) for v in np.flatnonzero(volume > VOID_VOLUME * h**3) if v > 0]
    kept = []
    for void in large:
        vertices = np.unique(tetra.tets[label == void])
        plus, minus = depths(setting, outside, BEHIND * h, vertices[vertices < tetra.n_input])
        if len(plus) and np.mean(np.minimum(plus, minus) <= BEHIND * h) < CAVITY_SHARE:
            kept.append(void)
    return kept
