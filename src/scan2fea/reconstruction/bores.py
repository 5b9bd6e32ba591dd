"""Round holes through flat walls whose own points tell no normals: where both faces of a wall are empty, and what lies on the hole's wall.

With points half a wall apart a bore has a dozen points on its wall, and their normals are blended with those of the faces. But the faces know where
the hole is (`empty_places`), and points between the faces then tell centre and radius, along the direction that the faces give.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.empty_circles import empty_circles
from scan2fea.kernel.jit import jit
from scan2fea.kernel.surface_fit import descend
from scan2fea.kernel.surfaces import CYLINDER, ROUNDS, Surface
from scan2fea.reconstruction.plane_growing import FACING, Planes
from scan2fea.reconstruction.round_growing import off_round_m, radius_std
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

EMPTY = 6.0  # points of both faces that a circle lacks: what lies on the hole's wall then proves it, between the faces no point lies by chance
HELD_EMPTY = 3.0  # the same where the points on the wall are counted first (`every_bore`): a hole of 1.6 spacings
AROUND = 8  # sectors round a hole, each with points of the faces, and of at least half with points of its wall
BESIDE_EDGE = 6  # of these, where the points on the wall are counted first: a bolt hole beside the edge of a plate has hardly any on one side
WIDE = 2.5  # times the radius of an empty circle: how far these points of the faces may lie
SAME_RADIUS = 0.25  # of the larger: two bores on one axis whose radii differ by more are steps
ALONG = 0.9  # cosine between the axes of bores that may be one
CLEAR, DEEP = 1.5, 3.0  # sigma below both faces that points of the wall lie, and that some do: of the faces one in a thousand
LEAST_DEEP = 3  # of these
LEAST_CIRCLE, LEAST_POINTS = 3, 5  # of the wall: what a circle needs, and two more
RADIUS_KNOWN = 0.08  # std of a radius, of it
EXACTLY = 0.02  # spacings: the same for exact points
NARROWER, WIDER = 0.3, 1.3  # times the radius of its empty circle, and the noise that carries points of the rim into it, a hole may be
CHOICES = 8  # of the points that lie on a hole
FAR = 3.0  # times the circle that a hole begins with: points farther away are not on it


@dataclass(frozen=True, eq=False, kw_only=True)
class Near(Value):
    """Places in a plane, and a tree of them: which lie in a circle costs no look at the others.   places : (n, 2)."""

    places: FloatArray
    tree: cKDTree

    @classmethod
    def of(cls, places: FloatArray) -> Near:
        return cls(places=places, tree=cKDTree(places))

    def within(self, middle: FloatArray, outer: float, inner: float = 0.0) -> IntArray:
        """(k,) rows, ascending, of the places from `inner` to `outer` away from a middle (2,)."""
        if outer < 0.0:
            return np.zeros(0, np.int64)
        rows = np.array(self.tree.query_ball_point(middle, outer, return_sorted=True), np.int64)
        return np.asarray(rows[np.linalg.norm(self.places[rows] - middle, axis=1) >= inner])


@dataclass(frozen=True, eq=False, kw_only=True)
class Bore(Value):
    """surface : the hole.   wall : (k, 3) points on it, those between two faces that tell it.   deep : (k,) those that no noise carried off a face.

    depth_m : from one of these faces to the other.
    around : sectors of AROUND in which that of the two with fewer has points beside the hole.   beside : points of the faces in the ring up to twice
    its radius, of as many as the spacing lets expect; 1 at most. What is seen at a slant, or from few places, has fewer; so has the wall of the hole.
    """

    surface: Surface
    wall: FloatArray
    deep: BoolArray
    depth_m: float
    around: int
    beside: float


def wall_bores(points: FloatArray, planes: Planes, spacing_m: float, sigma_m: float) -> list[Bore]:
    """Round holes between parallel faces of walls, those of most points first. points : (n, 3) raw, in the rows of planes.label."""
    return distinct_bores(every_bore(points, planes, spacing_m, sigma_m))


def every_bore(points: FloatArray, planes: Planes, spacing_m: float, sigma_m: float, deepest_m: float = math.inf, held: float = 0.0) -> list[Bore]:
    """As `wall_bores`, each as every pair of faces tells it that lie at most `deepest_m` apart.

    held : of the points due on the wall of a hole as wide as the empty circle: where less lies in it and on it, it is not looked at.
    """
    found: list[Bore] = []
    for i in range(len(planes)):
        for j in range(i + 1, len(planes)):
            if planes.normal[i] @ planes.normal[j] < FACING and 0 < _apart_m(points, planes, i, j) <= deepest_m:
                found += _between(points, planes, i, j, spacing_m, sigma_m, held)
    return found


def distinct_bores(bores: list[Bore]) -> list[Bore]:
    """Of bores that overlap the one with most points. Those on one axis through two walls are two: the flanges of an I, the walls of a tube."""
    kept: list[Bore] = []
    for bore in sorted(bores, key=lambda bore: -len(bore.wall)):
        if not any(is_same(bore.surface, other.surface) and meet(bore, other) for other in kept):
            kept.append(bore)
    return kept


def meet(one: Bore, other: Bore) -> bool:
    """Do the points on two walls lie at one place along the axis?"""
    first, second = (own @ other.surface.axis for own in (one.wall, other.wall))
    return bool(first.min() <= second.max() and second.min() <= first.max())


def distinct_cylinders(bores: list[Bore], off_m: float) -> list[Surface]:
    """The cylinders of bores, one for those on one axis through two walls, where the points of all lie within `off_m` of it."""
    kept: list[Surface] = []
    for bore in distinct_bores(bores):
        if not any(is_same(bore.surface, s) and float(np.median(np.abs(s.distance(bore.wall)))) <= off_m for s in kept):
            kept.append(bore.surface)
    return kept


def _apart_m(points: FloatArray, planes: Planes, i: int, j: int) -> float:
    """How far plane j lies behind plane i, under the points of this one."""
    return -float(planes.plane(j).distance(points[planes.label == i]).mean())


def is_same(one: Surface, other: Surface) -> bool:
    """Do two bores overlap, one along the other?"""
    alike = abs(one.radius - other.radius) < SAME_RADIUS * max(one.radius, other.radius) and one.sense == other.sense
    return alike and on_one_axis(one, other)


def on_one_axis(one: Surface, other: Surface) -> bool:
    """Does one bore lie in the other, or go on from it?"""
    apart = one.point - other.point
    across = np.linalg.norm(apart - (apart @ other.axis) * other.axis)
    return bool(abs(one.axis @ other.axis) > ALONG and across < max(one.radius, other.radius))


def _between(points: FloatArray, planes: Planes, i: int, j: int, spacing_m: float, sigma_m: float, held: float) -> list[Bore]:
    plane = planes.plane(i)
    axes = plane.axes()
    on = (planes.label == i) | (planes.label == j)
    depth = -np.maximum(plane.distance(points), planes.plane(j).distance(points))
    between = depth > CLEAR * sigma_m + EXACTLY * spacing_m
    is_deep = depth[between] > DEEP * sigma_m + EXACTLY * spacing_m
    flat = points[on] @ axes.T
    middle, radius = empty_circles(flat)
    if not len(middle) or not between.any():
        return []
    density = 2.0 * _density(points[planes.label == i] @ axes.T, spacing_m)
    large = np.flatnonzero(np.pi * density * radius**2 >= (HELD_EMPTY if held else EMPTY))
    sectors = BESIDE_EDGE if held else AROUND
    near_flat, wall, out = Near.of(flat), points[between], list[Bore]()
    near_wall, faces = Near.of(wall @ axes.T), [Near.of(points[planes.label == k] @ axes.T) for k in (i, j)]
    if held:
        due = 2.0 * math.pi * radius[large] * max(0.0, _apart_m(points, planes, i, j) - 2.0 * CLEAR * sigma_m) / spacing_m**2
        due *= _beside(near_flat, middle[large], radius[large], spacing_m)
        within = near_wall.tree.query_ball_point(middle[large], radius[large] + off_round_m(spacing_m, sigma_m), return_length=True)
        large = large[np.asarray(within) >= held * due / WIDER]  # of a hole to one side of the circle, and narrower
    large = large[np.argsort(-radius[large], kind="stable")]
    is_free, circles = np.ones(len(large), bool), Near.of(middle[large])  # of the circles taken before
    for number, k in enumerate(large):
        if not is_free[number] or len(_sectors(near_flat.places[near_flat.within(middle[k], WIDE * radius[k])] - middle[k])) < sectors:
            continue
        taken = circles.within(middle[k], radius[k])
        is_free[taken[np.linalg.norm(circles.places[taken] - middle[k], axis=1) < radius[k]]] = False
        start = Surface(kind=CYLINDER, point=middle[k] @ axes + plane.offset * plane.normal, axis=plane.normal, radius=float(radius[k]), sense=-1)
        hole = _fitted(start, wall, near_wall, is_deep, near_flat, axes, spacing_m, sigma_m)
        if hole is not None:
            centre, wide = hole[0].point @ axes.T, WIDE * hole[0].radius
            around = min(len(_sectors(own.places[own.within(centre, wide)] - centre)) for own in faces)
            apart_m = -float(planes.plane(j).distance(start.point[None])[0])
            beside = float(_beside(near_flat, centre[None], np.array([hole[0].radius]), spacing_m)[0])
            out.append(Bore(surface=hole[0], wall=wall[hole[1]], deep=is_deep[hole[1]], depth_m=apart_m, around=around, beside=beside))
    return out


def _density(flat: FloatArray, spacing_m: float) -> float:
    """Points per area of one face, by the squares of a grid of three spacings that hold any."""
    cells = np.unique(np.floor(flat / (3.0 * spacing_m)).astype(np.int64), axis=0)
    return len(flat) / (len(cells) * 9.0 * spacing_m**2)


def _beside(flat: Near, middle: FloatArray, radius: FloatArray, spacing_m: float) -> FloatArray:
    """(k,) of the points of two faces due in the ring round each circle, up to twice its radius, the share that lies there; 1 at most."""
    outer, inner = (np.asarray(flat.tree.query_ball_point(middle, times * radius, return_length=True), float) for times in (2.0, 1.0))
    return np.asarray(np.minimum(1.0, (outer - inner) * spacing_m**2 / (6.0 * math.pi * radius**2)))


def _sectors(across: FloatArray) -> FloatArray:
    return np.unique(np.floor(np.arctan2(across[:, 1], across[:, 0]) / (2 * np.pi) * AROUND))


def _fitted(
    start: Surface, wall: FloatArray, near: Near, is_deep: BoolArray, flat: Near, axes: FloatArray, spacing_m: float, sigma_m: float
) -> tuple[Surface, IntArray] | None:
    """The cylinder through points between the faces that lie in and at an empty circle, and their rows; None where they tell no circle.

    Where faces have few points the circle lies to one side of the hole: what begins is then tried a spacing wider.
    """
    off = off_round_m(spacing_m, sigma_m)
    rows = near.within(start.point @ axes.T, FAR * (start.radius + off + spacing_m))
    if len(rows) < LEAST_POINTS or is_deep[rows].sum() < LEAST_DEEP:
        return None
    code, first = start.packed()
    for wide in (0.0, spacing_m):
        found, rms, is_own = _settled(code, first, wall[rows], near.places[rows], np.ascontiguousarray(axes), off, wide, sigma_m)
        own = rows[is_own]
        if len(own) >= LEAST_POINTS and is_deep[own].sum() >= LEAST_DEEP:
            surface = replace(start, point=found[:3], radius=float(found[6]), rms_m=rms)
            if _is_hole(surface, wall[own], near, flat, axes, off, sigma_m):
                return surface, own
    return None


@jit
def _settled(
    code: int, first: FloatArray, wall: FloatArray, places: FloatArray, axes: FloatArray, off: float, wide: float, sigma: float
) -> tuple[FloatArray, float, BoolArray]:
    """((8,) `Surface.packed`, its rms, the points on it): fitted in turn with those that lie on it; none where it gets lost.

    wall : (n, 3).   places : (n, 2) the same across the axis, along `axes`.   wide : beyond the empty circle, of the points that begin.
    """
    here, own, before = first.copy(), np.zeros(len(wall), np.bool_), np.zeros(len(wall), np.bool_)
    may = np.array([True, True, False, False, True])
    low, high, rms = np.zeros(3), np.zeros(3), 0.0
    for step in range(CHOICES):
        inner, outer = (here[6] - off, here[6] + off) if step else (0.0, here[6] + off + wide)
        u, v = (here[:3] * axes[0]).sum(), (here[:3] * axes[1]).sum()
        for p in range(len(wall)):
            apart = math.hypot(places[p, 0] - u, places[p, 1] - v)
            own[p] = inner <= apart <= outer
        if own.sum() < LEAST_CIRCLE:  # a few on the way: those off the wall that began with it had drawn it from the others
            own[:] = False
            break
        if (own == before).all():
            break
        x = wall[own]
        lift = 0.0  # to the middle of the points
        for a in range(3):
            low[a], high[a] = x[:, a].min(), x[:, a].max()
            lift += (x[:, a].mean() - here[a]) * here[3 + a]
        for a in range(3):
            here[a] += lift * here[3 + a]
        size = math.sqrt(((high - low) ** 2).sum())
        here, cost = descend(code, here, x, np.ones(len(x)), may, size if size > 0.0 else 1.0, ROUNDS)
        rms = math.sqrt(cost / len(x))
        if not (here[6] > 0.0 and NARROWER * first[6] < here[6] < WIDER * first[6] + sigma):
            own[:] = False
            break
        for p in range(len(own)):
            before[p] = own[p]
    return here, rms, own


def _is_hole(surface: Surface, own: FloatArray, wall: Near, flat: Near, axes: FloatArray, off: float, sigma_m: float) -> bool:
    """Points all round it, a radius that they tell, and hardly any point in it, of the faces or between them."""
    middle = surface.point @ axes.T
    inside = sum(len(every.within(middle, surface.radius - off)) for every in (flat, wall))
    all_round = len(_sectors(own @ axes.T - middle)) >= AROUND / 2
    known = radius_std(surface, own, sigma_m) <= RADIUS_KNOWN * surface.radius
    return bool(all_round and known and inside <= 0.05 * len(own))
