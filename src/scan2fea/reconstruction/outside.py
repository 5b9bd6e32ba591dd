"""Which side of a cloud is outside, when nobody says where it was seen from.

A ball too big to slip between the points rolls in from outside, through the Delaunay tets of the cloud (Edelsbrunner and Muecke 1994: the
outer alpha shape). Where it arrives is outside; the side of a point that it meets sooner is the point's outward side. Rounds of
winding-number consistency (`winding.py`) then settle the points that lie between two sheets.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.delaunay import FACETS, Tetrahedralisation, depth_to, tetrahedralise
from scan2fea.kernel.jit import jit
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.normals import pca_normals
from scan2fea.options import option
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
class Setting(Value):
    """What every candidate shares: tets, the axis of each point (sign unknown), the spacing; first, incident: `tetra.incidence()`."""

    tetra: Tetrahedralisation
    axis: FloatArray
    spacing_m: float
    first: IntArray
    incident: IntArray

    @classmethod
    def of(cls, tetra: Tetrahedralisation, axis: FloatArray, spacing_m: float) -> Setting:
        first, incident = tetra.incidence()
        return cls(tetra=tetra, axis=axis, spacing_m=spacing_m, first=first, incident=incident)


@dataclass(frozen=True, eq=False, kw_only=True)
class Flood(Value):
    """One answer to "which side is outside".

    signed : (n, 3) unit outward axis, zero where the flood does not tell.   outside : (m,) tets of the raw points the ball reached.
    open_both : (n,) points with flood right beside them on both sides.   ball_m : radius of the ball.   first_ball : the one it grew from, in
    spacings.
    n_cavities : voids the ball cannot enter that were taken as empty.   core_solid : True where such voids were filled instead.
    """

    signed: FloatArray
    outside: BoolArray
    open_both: BoolArray
    ball_m: float
    first_ball: float
    n_cavities: int
    core_solid: bool

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
    """Roll the ball in from outside, growing it while it leaks through the sampling (reconstruction.md (e), steps 2 to 4)."""
    h = setting.spacing_m
    radius = first_ball * h
    outside, both = _roll_and_test(setting, radius)
    while both.mean() > LEAK_FREE and radius * GROWTH <= LARGEST_BALL * h:
        grown, still = _roll_and_test(setting, radius * GROWTH)
        if both.mean() <= LEAK_TOLERATED and still.mean() > 0.5 * both.mean():
            break  # not a leak through the sampling: faces one point row wide, which a larger ball would only shut in
        radius, outside, both = radius * GROWTH, grown, still
    outside, n_cavities = emptied(setting, outside, radius, core_solid)
    plus, minus = _depths(setting, outside, REACH * h)
    sign = (plus < minus).astype(float) - (minus < plus)
    return Flood(
        signed=setting.axis * sign[:, None],
        outside=outside,
        open_both=both,
        ball_m=radius,
        first_ball=first_ball,
        n_cavities=n_cavities,
        core_solid=core_solid and n_cavities > 0,
    )


def reached(tetra: Tetrahedralisation, radius: float) -> BoolArray:
    """(m,) tets that a ball of `radius` reaches from outside, through facets and tets of larger circumradius."""
    label = _spread(tetra.points, tetra.tets, tetra.neighbors, tetra.circumradius, tetra.is_box.copy(), radius)
    return np.asarray(label == 0)


def emptied(setting: Setting, outside: BoolArray, radius: float, core_solid: bool) -> tuple[BoolArray, int]:
    """The reached tets and, unless `core_solid`, those of the enclosed voids that are empty; and how many such voids there are."""
    cavities = _cavities(setting, outside, radius)
    if not cavities or core_solid:
        return outside, len(cavities)
    return np.asarray(outside | np.isin(_voids(setting.tetra, outside, radius), cavities)), len(cavities)


def _roll_and_test(setting: Setting, radius: float) -> tuple[BoolArray, BoolArray]:
    outside = reached(setting.tetra, radius)
    near = NEAR * setting.spacing_m
    plus, minus = _depths(setting, outside, near)
    return outside, (plus <= near) & (minus <= near)


def _depths(setting: Setting, mask: BoolArray, cap: float, rows: IntArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Way from the points of `rows` (all) to the masked tets along their axis and against it; inf beyond `cap`."""
    tetra = setting.tetra
    asked = np.arange(tetra.n_input, dtype=np.int64) if rows is None else rows
    both = np.vstack([setting.axis[asked], -setting.axis[asked]])
    plus, minus = np.split(
        depth_to(tetra.points, tetra.tets, tetra.neighbors, setting.first, setting.incident, np.tile(asked, 2), both, mask, cap), 2
    )
    return plus, minus


def _voids(tetra: Tetrahedralisation, outside: BoolArray, radius: float) -> IntArray:
    """(m,) number of the void (from 1) each tet belongs to: tets the ball fits in and can roll between, but not reach; 0 elsewhere."""
    label = _spread(tetra.points, tetra.tets, tetra.neighbors, tetra.circumradius, np.zeros(len(tetra), np.bool_), radius)
    return np.asarray(np.where(outside, 0, label + 1))


def _cavities(setting: Setting, outside: BoolArray, radius: float) -> list[int]:
    """Voids that are empty: most of their points have a wall behind them, not the flood."""
    tetra, h = setting.tetra, setting.spacing_m
    label = _voids(tetra, outside, radius)
    volume = np.bincount(label, weights=tetra.volumes())
    large = [int(v) for v in np.flatnonzero(volume > VOID_VOLUME * h**3) if v > 0]
    kept = []
    for void in large:
        vertices = np.unique(tetra.tets[label == void])
        plus, minus = _depths(setting, outside, BEHIND * h, vertices[vertices < tetra.n_input])
        if len(plus) and np.mean(np.minimum(plus, minus) <= BEHIND * h) < CAVITY_SHARE:
            kept.append(void)
    return kept


@jit
def _facet_radius2(points: FloatArray, a: int, b: int, c: int) -> float:
    """Squared circumradius of a triangle: (|u| |v| |u - v| / (2 |u x v|))^2; inf if it is flat."""
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    twice2 = nx * nx + ny * ny + nz * nz
    if twice2 <= 0.0:
        return np.inf
    sides = (ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz) * ((ux - vx) ** 2 + (uy - vy) ** 2 + (uz - vz) ** 2)
    return float(sides / (4.0 * twice2))


@jit
def _spread(points: FloatArray, tets: IntArray, neighbors: IntArray, radii: FloatArray, start: BoolArray, radius: float) -> IntArray:
    """Label the tets a ball can be in: 0 reached from `start`; without any start each connected set gets its own number, from 0; -1 too tight."""
    label = np.full(len(tets), -1, np.int64)
    stack = np.zeros(len(tets), np.int64)
    height, n_labels = 0, 0
    seeded = start.any()
    for t in range(len(tets)):
        if start[t]:
            label[t] = 0
            stack[height] = t
            height += 1
    for seed in range(len(tets)):
        if height == 0:
            if seeded:
                break
            if label[seed] >= 0 or radii[seed] <= radius:
                continue
            label[seed] = n_labels
            stack[0] = seed
            height = 1
        current = 0 if seeded else n_labels
        while height > 0:
            height -= 1
            t = stack[height]
            for i in range(4):
                other = neighbors[t, i]
                if other < 0 or label[other] >= 0 or radii[other] <= radius:
                    continue
                if _facet_radius2(points, tets[t, FACETS[i, 0]], tets[t, FACETS[i, 1]], tets[t, FACETS[i, 2]]) <= radius * radius:
                    continue
                label[other] = current
                stack[height] = other
                height += 1
        n_labels += 1
    return label
