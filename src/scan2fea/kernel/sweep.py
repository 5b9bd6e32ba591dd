"""Where the points of a section come to lie when it is swept along the axis of a member: bow, twist and end planes that need not be square."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from scan2fea.errors import StageError, require
from scan2fea.kernel.bends import bent
from scan2fea.kernel.stretch import Stretch, stretch_of
from scan2fea.kernel.transforms import applied
from scan2fea.types import Bend, FloatArray, Member, Value

MIN_END_COSINE = 0.1  # an end plane within 6 degrees of the axis is no end
MAX_STRIPS = 400
BEND_STEP = 0.08  # radians of a bend between two stations: its volume is a tenth of a per cent short then
STALLED = 0.9  # half as many strips again that gain less than 10 % gain nothing


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweep(Value):
    """T_world_member : (4, 4).   length_m.   bow : (2, k), twist : (q,) Legendre coefficients as in `types.Member`.   end_normals : (2, 3).

    stretch : how the places of the section move where it grows, None for a prism; by growth_m (k,) at heights knots_m (k,) from 0 to length.
    bends : of a pipe with elbows; heights are then ways along its axis.
    """

    T_world_member: FloatArray
    length_m: float
    bow: FloatArray
    twist: FloatArray
    end_normals: FloatArray
    stretch: Stretch | None = None
    knots_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    growth_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    bends: tuple[Bend, ...] = ()

    @property
    def is_straight(self) -> bool:
        """Whether its edges are straight lines between knots."""
        return not (np.any(self.bow) or np.any(self.twist) or self.bends)

    @property
    def is_prism(self) -> bool:
        return self.is_straight and self.stretch is None

    @property
    def knot_shares(self) -> FloatArray:
        """(k,) shares of the way where the section starts to change otherwise, or a bend begins or ends; ends included."""
        if self.bends:
            return np.array([0.0, *(at / self.length_m for b in self.bends for at in (b.start_m, b.start_m + b.length_m)), 1.0])
        return np.array([0.0, 1.0]) if self.stretch is None else np.asarray(self.knots_m / self.length_m)

    def growth(self, z: FloatArray) -> FloatArray:
        """(...) what the dimension has grown at heights z."""
        return np.asarray(np.interp(z, self.knots_m, self.growth_m))


def sweep_of(member: Member) -> Sweep:
    """The sweep of a member. Raises StageError where its length or its end planes make no solid."""
    length = member.values().get("length", float("nan"))
    require(np.isfinite(length) and length > 0, StageError, f"the member has a length of {length} m; it must be positive")
    normals = np.asarray(member.end_normals, float)
    unit = normals / np.linalg.norm(normals, axis=1)[:, None]
    change = member.change
    says = f"an end plane of the member stands within 6 degrees of its axis (normals {np.round(unit, 3).tolist()}): it cannot end the member"
    require(unit[0, 2] <= -MIN_END_COSINE and unit[1, 2] >= MIN_END_COSINE, StageError, says)
    return Sweep(
        T_world_member=np.asarray(member.T_world_member, float),
        length_m=float(length),
        bow=np.asarray(member.bow, float).reshape(2, -1),
        twist=np.asarray(member.twist, float).ravel(),
        end_normals=unit,
        stretch=None if change is None else stretch_of(member.family, member.values(), change.dimension, change.side),
        knots_m=np.zeros(0) if change is None else np.asarray(change.z_m, float),
        growth_m=np.zeros(0) if change is None else np.asarray(change.value_m, float) - member.values()[change.dimension],
        bends=member.bends,
    )


def axis_at(sweep: Sweep, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(..., 2) offset of the axis and (...) roll, radians, at heights z."""
    t = 2 * z / sweep.length_m - 1
    nothing = np.zeros(2)
    offset = np.stack([np.polynomial.legendre.legval(t, np.concatenate([nothing, row])) for row in sweep.bow], axis=-1)
    return offset, np.polynomial.legendre.legval(t, np.concatenate([nothing[:1], sweep.twist]))


def ends_at(sweep: Sweep, section: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,), (n,) heights z at which the ways of the points (n, 2) of the section pass through the two end planes.

    The planes go through the axis at its first and last height. Exact for straight members; of bent ones by fixed-point iteration, which
    contracts by bend times slope of the plane. Raises StageError where the planes cross within the section.
    """
    heights = []
    for normal, at in zip(sweep.end_normals, (0.0, sweep.length_m), strict=True):
        origin = axis_at(sweep, np.array([at]))[0][0]
        z = np.full(len(section), at)
        for _ in range(1 if sweep.is_prism else 20):
            z = at - (_across(sweep, section, z) - origin) @ normal[:2] / normal[2]
        heights.append(z)
    first, last = heights
    require((last > first).all(), StageError, f"the end planes of the member cross within its section: it is too short ({sweep.length_m:.6g} m)")
    return first, last


def _across(sweep: Sweep, section: FloatArray, z: FloatArray) -> FloatArray:
    """(..., n, 2) x and y of the points (n, 2) of the section at heights z (..., n), in the frame of the member."""
    offset, roll = axis_at(sweep, z)
    cos, sin = np.cos(roll), np.sin(roll)
    x, y = section[:, 0], section[:, 1]
    if sweep.stretch is not None:
        moves, growth = sweep.stretch.moves(section), sweep.growth(z)
        x, y = x + growth * moves[:, 0], y + growth * moves[:, 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1) + offset


def swept_points(sweep: Sweep, section: FloatArray, share: FloatArray) -> FloatArray:
    """(m, n, 3) metres in the world: the points (n, 2) of the section at each of (m,) shares of the way from the first end plane to the last."""
    first, last = ends_at(sweep, section)
    z = _heights(sweep, first, last, share)
    local = np.concatenate([_across(sweep, section, z), z[..., None]], axis=-1)
    local = bent(sweep.bends, local) if sweep.bends else local
    return applied(sweep.T_world_member, local.reshape(-1, 3)).reshape(local.shape)


def _heights(sweep: Sweep, first: FloatArray, last: FloatArray, share: FloatArray) -> FloatArray:
    """(m, n) heights at shares (m,) of the ways from first to last (n,); where the section changes the knots stay planes across the axis."""
    if sweep.stretch is None:
        return np.asarray((1 - share[:, None]) * first + share[:, None] * last)
    at = np.repeat(sweep.knots_m[:, None], len(first), axis=1)
    at[0], at[-1] = first, last
    knots = sweep.knot_shares
    k = np.clip(np.searchsorted(knots, share, side="right") - 1, 0, len(knots) - 2)
    part = ((share - knots[k]) / (knots[k + 1] - knots[k]))[:, None]
    return np.asarray((1 - part) * at[k] + part * at[k + 1])


def swept_volume(sweep: Sweep, area_m2: float, centroid: FloatArray) -> float:
    """Volume, m3: area x length at the centroid (2,) of the section.

    Sections move and turn in their own planes, so that volume is the integral of the height between the end planes over the section; that height is
    linear in the place, exactly so for straight members and square ends.
    """
    first, last = ends_at(sweep, centroid[None])
    return area_m2 * float(last[0] - first[0])


def stations(sweep: Sweep, loops: Sequence[FloatArray], tolerance_m: float) -> tuple[FloatArray, float]:
    """(m,) shares 0 ... 1, evenly spread, and how far strips of triangles between them leave the bent member over the polygons, metres.

    That is at most the tolerance, but where more strips do not help: lines across an oblique end of a twisted member are bent themselves.
    """
    if sweep.is_straight:
        return sweep.knot_shares, 0.0
    if sweep.bends:
        share = shares_with_knots(sweep, 1)
        return share, _largest_gap(sweep, np.concatenate(loops), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops]), share)
    section, after = np.concatenate(loops), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    n_strips, last = 1, np.inf
    while True:
        share = shares_with_knots(sweep, n_strips)
        worst = _largest_gap(sweep, section, after, share)
        if worst <= tolerance_m or worst > STALLED * last or n_strips >= MAX_STRIPS:
            return share, worst
        last = worst
        n_strips = min(MAX_STRIPS, int(np.ceil(n_strips * min(2.0, max(1.5, np.sqrt(worst / tolerance_m))))))


def shares_with_knots(sweep: Sweep, n: int) -> FloatArray:
    """(m + 1,) shares of the way, evenly spread between the knots, about n strips in all."""
    knots = sweep.knot_shares
    least = [1, *(k for b in sweep.bends for k in (math.ceil(b.angle_rad / BEND_STEP), 1))]
    strips = least if sweep.bends else [1] * (len(knots) - 1)
    parts = [
        np.linspace(a, b, max(m, int(np.ceil(n * (b - a) - 1e-9))) + 1)[:-1] for (a, b), m in zip(pairwise(knots), strips, strict=True)
    ]
    return np.concatenate([*parts, [1.0]])


def _largest_gap(sweep: Sweep, section: FloatArray, after: FloatArray, share: FloatArray) -> float:
    """Distance of the corners from their chords, and of the faces between corners and those after them from the diagonals of their strips."""
    knot, beyond = swept_points(sweep, section, share), swept_points(sweep, after, share)
    along = _unit(knot[1:] - knot[:-1])
    normal = _unit(np.cross(along, beyond[:-1] - knot[:-1]))
    worst = 0.0
    for s in (0.2, 0.4, 0.5, 0.6, 0.8):
        here = (1 - s) * share[:-1] + s * share[1:]
        off = swept_points(sweep, section, here) - knot[:-1]
        worst = max(worst, float(np.linalg.norm(np.cross(off, along), axis=-1).max()))
        off = swept_points(sweep, (1 - s) * section + s * after, here) - ((1 - s) * knot[:-1] + s * beyond[1:])
        worst = max(worst, float(np.abs((off * normal).sum(-1)).max()))
    return worst


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
