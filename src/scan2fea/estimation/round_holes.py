"""The round holes of a member, and its scan as it would be without them.

What is no cylinder right through a wall is not told, and the member with it: it is left to reconstruction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from scan2fea.estimation.bored import CHANCE, Mouth, mouths
from scan2fea.estimation.hole_fit import REACH, RING, FittedHole, fitted_hole, with_others
from scan2fea.estimation.swept import Sweep, sweep_of_member
from scan2fea.estimation.walls import Wall
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.sections import ROUND
from scan2fea.types import BoolArray, FloatArray, IntArray, Member, Rays, RoundHole, Scan

_POINTS = 400_000  # asked at most
_SIGHT_LINES = 4  # through a hole that its points do not tell
_LIKELY = 1e-2  # chance of a hole in a wall that has none, where others have
_ALIKE = 0.2  # of the radius: holes of one size
_AS_BARE = 0.9  # of the radius of the circle without points


def round_holes(points: FloatArray, member: Member, seed: int = 0, rays: Rays | None = None) -> tuple[FittedHole, ...]:
    """The holes of a member with flat walls, by its points (n, 3) and the sight lines there are. Empty where it has none, or one that is not round or
    does not go through: where its points do not tell that, sight lines must have.

    It begins with those that chance leaves in no wall, by what its faces and its inside lack, or by how much likelier the points are with them. Then
    others are likely: what chance would leave one time in `_LIKELY`, and every place as bare as a hole, must be one too, or none is told; and of all
    else that might be a hole, what is as wide as one that is told.
    """
    if member.family in ROUND:
        return ()
    points = points[sampled_rows(len(points), _POINTS, seed)]
    local = sweep_of_member(member).coordinates(points)
    fitted: dict[tuple[Any, ...], FittedHole | None] = {}

    def there(chance: float) -> list[tuple[Mouth, FittedHole | None]]:
        """The places that one wall in so many would show by chance, and the hole at each, if it is one."""
        found = []
        for mouth, others in with_others(mouths(member, local, member.sigma_m, chance=chance)):
            at = (mouth.wall.name, *mouth.place.tolist())
            if at not in fitted:
                hole = fitted_hole(mouth, others, member.sigma_m, seed)
                is_hole = hole is not None and (hole.is_told or _is_seen_through(hole, points, member, rays))
                fitted[at] = hole if is_hole else None
            found.append((mouth, fitted[at]))
        return found

    sure, any_like = there(CHANCE), there(1.0)
    sure += [(mouth, hole) for mouth, hole in any_like if hole is not None and hole.is_telling]
    if not sure:
        return ()
    bare = _AS_BARE * min(mouth.radius_m for mouth, _ in sure)
    must = [*sure, *there(_LIKELY), *((mouth, hole) for mouth, hole in any_like if mouth.radius_m > bare)]
    if any(hole is None for _, hole in must):
        return ()
    found = [hole for _, hole in must if hole is not None]
    found += [hole for _, hole in any_like if hole is not None and any(abs(hole.radius_m / other.radius_m - 1) < _ALIKE for other in found)]
    return tuple(hole for k, hole in enumerate(found) if not any(_is_same(hole, other) for other in found[:k]))


def _is_same(hole: FittedHole, other: FittedHole) -> bool:
    same_wall = hole.wall.name == other.wall.name and np.array_equal(hole.wall.start, other.wall.start)
    return same_wall and float(np.linalg.norm(hole.place - other.place)) < other.radius_m


def _is_seen_through(hole: FittedHole, points: FloatArray, member: Member, rays: Rays | None) -> bool:
    """Whether sight lines went through a hole, clear of its rim."""
    if rays is None:
        return False
    (there,) = in_world((hole,), points, member)
    clear = replace(there, radius_m=hole.radius_m - REACH * member.sigma_m)
    return int(_through(rays, (clear,), 0.0).sum()) >= _SIGHT_LINES


# ------------------------------------------------------------------ the member without them


def plugged(scan: Scan, member: Member, holes: Sequence[FittedHole], seed: int = 0) -> Scan:
    """The scan as the member would have shown without its holes: no point in them, on their sides or seen through them, and points on both faces
    across their mouths, as dense and scattered as around. A new point has everything but its place from the nearest of its face; its ray is its own.
    """
    sweep = sweep_of_member(member)
    points = np.asarray(scan.cloud.points)
    local = sweep.coordinates(points)
    gone, dark = np.zeros(len(points), bool), np.zeros(0, bool)
    if scan.rays is not None:
        dark = _through(scan.rays, in_world(holes, points, member), member.sigma_m)
        gone |= (scan.cloud.ray >= 0) & dark[scan.cloud.ray]
    rows, places = [], []
    rng = np.random.default_rng([seed, 11])
    for hole in holes:
        wall = _laid(hole.wall, local)
        x = np.stack([wall.along, wall.z], 1)
        rho = np.hypot(*(x - hole.place).T)
        under = [wall.depth - p[0] - x @ p[1:] for p in hole.planes]
        within = (under[0] > -REACH * member.sigma_m) & (under[1] < REACH * member.sigma_m)
        cut = hole.radius_m + 2 * member.sigma_m
        gone |= within & (rho < cut)
        for plane, off in zip(hole.planes, under, strict=True):
            ring = np.flatnonzero((np.abs(off) < REACH * member.sigma_m) & (rho >= cut) & (rho < RING * cut))
            ring = ring[(x[ring, 0] > wall.low) & (x[ring, 0] < wall.high)]
            new, source = _across(hole.place, cut, x[ring], ring, rng)
            depth = plane[0] + new @ plane[1:] + member.sigma_m * rng.standard_normal(len(new))
            at = wall.start + new[:, :1] * wall.unit + depth[:, None] * wall.into
            rows.append(source)
            places.append(points[source] + _in_world(sweep, local[source], np.column_stack([at, new[:, 1]])))
    keep = np.flatnonzero(~gone)
    return _joined(scan, keep, np.concatenate(rows).astype(np.int64), np.concatenate(places), dark)


def _through(rays: Rays, holes: Sequence[RoundHole], sigma_m: float) -> BoolArray:
    """(m,) whether a ray went through a hole, or by less than two deviations of the noise past it, and on beyond it."""
    gone = np.zeros(len(rays), bool)
    for hole in holes:
        along = hole.through / np.linalg.norm(hole.through)
        off = hole.start + hole.through / 2 - rays.origin
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (off @ along) / (rays.direction @ along)
            past = np.linalg.norm(np.cross(far[:, None] * rays.direction - off, along), axis=1) < hole.radius_m + 2 * sigma_m
        gone |= past & (far > 0) & ~(far + np.linalg.norm(hole.through) > rays.range_m)
    return gone


def _joined(scan: Scan, keep: IntArray, source: IntArray, places: FloatArray, dark: BoolArray) -> Scan:
    """The rows of the cloud that are kept, and new points at places (k, 3) with all else from the rows `source` (k,).

    dark : (m,) rays that are none any more.
    """
    cloud = scan.cloud.take(np.concatenate([keep, source])).replaced(points=np.concatenate([scan.cloud.points[keep], places]))
    if scan.rays is None:
        return Scan(cloud=cloud)
    known = np.flatnonzero(scan.cloud.ray[source] >= 0)
    old = scan.cloud.ray[source[known]]
    rows = np.concatenate([np.flatnonzero(~dark), old])
    number = np.cumsum(~dark) - 1
    ray = np.where(cloud.ray >= 0, number[cloud.ray], -1)
    ray[len(keep) + known] = int((~dark).sum()) + np.arange(len(known))
    columns: dict[str, Any] = {f.name: getattr(scan.rays, f.name) for f in fields(scan.rays)}
    taken: dict[str, Any] = {name: None if column is None else column[rows] for name, column in columns.items()}
    rays = Rays(**taken)
    way = places[known] - rays.origin[-len(known) :] if len(known) else np.zeros((0, 3))
    far = np.linalg.norm(way, axis=1)
    direction, range_m, first = np.array(rays.direction), np.array(rays.range_m), len(rays) - len(known)
    direction[first:], range_m[first:] = way / np.maximum(far, 1e-300)[:, None], far
    return Scan(cloud=cloud.replaced(ray=ray), rays=replace(rays, direction=direction, range_m=range_m))


def _laid(wall: Wall, local: FloatArray) -> Wall:
    off = local[:, :2] - wall.start
    return replace(wall, along=off @ wall.unit, depth=off @ wall.into, z=local[:, 2])


def _across(middle: FloatArray, radius: float, x: FloatArray, rows: IntArray, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
    """(k, 2) places spread over a disc as densely as points x (n, 2) lie in the ring around it, up to `RING` radii; (k,) the nearest of `rows`."""
    if not len(x):
        return np.zeros((0, 2)), np.zeros(0, np.int64)
    n = round(len(x) / (RING**2 - 1))
    rho, turn = radius * np.sqrt(rng.random(n)), 2 * math.pi * rng.random(n)
    new = middle + np.stack([rho * np.cos(turn), rho * np.sin(turn)], 1)
    return new, rows[np.linalg.norm(new[:, None] - x[None], axis=2).argmin(1)] if n else np.zeros(0, np.int64)


def _in_world(sweep: Sweep, old: FloatArray, new: FloatArray) -> FloatArray:
    """(k, 3) the way from places old to places new nearby, both (k, 3) across, across and along."""
    way = new - old
    along = sweep.T_world_frame[:3, 2]
    return sweep.in_world(old[:, 2], way[:, :2]) + way[:, 2:] * along


def in_world(holes: Sequence[FittedHole], points: FloatArray, member: Member) -> tuple[RoundHole, ...]:
    """The holes where they are, by the points (n, 3) that told them."""
    sweep = sweep_of_member(member)
    local = sweep.coordinates(points)
    out = []
    for hole in holes:
        wall = hole.wall
        near = int(np.argmin(np.abs(local[:, 2] - hole.place[1]) + np.linalg.norm(local[:, :2] - wall.start - hole.place[0] * wall.unit, axis=1)))
        depth = np.array([p[0] + hole.place @ p[1:] for p in hole.planes])
        at = wall.start + hole.place[0] * wall.unit + depth[:, None] * wall.into
        ends = points[near] + _in_world(sweep, local[[near, near]], np.column_stack([at, np.full(2, hole.place[1])]))
        std = np.sqrt(np.diag(hole.covariance))
        sure = {"std_m": float(std[2]), "place_std_m": float(std[:2].max())}
        way = ends[1] - ends[0]
        out.append(RoundHole(face=wall.name, start=ends[0], through=way, radius_m=hole.radius_m, n_points=hole.n_points, **sure))
    return tuple(out)
