"""Round holes through the walls of a member: middle and radius, and how far to trust them.

Around a mouth (`bored.py`) points lie on two faces that end at the rim, and on the side of the hole between them; all of it blurred by the noise.
With u = (rho - r) / sigma at a distance rho from the middle, and depth d under the first face of a wall t thick, the density of points is

    faces   lambda_k [Phi(u) + sigma phi(u) / (2 r)] phi(d_k / sigma) / sigma         k = 1, 2; the second term: a rim is curved
    side    lambda_3 sqrt(r / rho) phi(u) / sigma [Phi(d / sigma) - Phi((d - t) / sigma)]
    strays  lambda_4

and the densities lambda, each as its own surface was seen, are those that make the points likeliest (expectation maximisation). The likelihood of
middle and radius is then climbed; its curvature gives their covariance. Noise far below the distance between points would leave steps, not slopes:
the points are blurred by chance first, a known width.

A hole is a cylinder where no harmonic of its rim departs from the circle, nor one mouth from the other, by more than chance and mill tolerance. It
goes through where both faces lack the points that those around foretell, or one does and points lie on its side. A member with others is left to
reconstruction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr

from scan2fea.estimation.bored import CHANCE, Mouth, mouths
from scan2fea.estimation.swept import Sweep, sweep_of_member
from scan2fea.estimation.walls import Wall
from scan2fea.kernel.sections import ROUND
from scan2fea.types import BoolArray, FloatArray, IntArray, Member, Rays, RoundHole, Scan, Value

_RING = 2.0  # radii: as far as points tell of a hole
_REACH = 4.0  # standard deviations of noise
_BLUR = 0.05  # of the distance between points: the least blur
_ROUNDS = 12  # of expectation maximisation
_EMPTY = 0.15  # of the points that a face would have in a hole
_FORETOLD = 8.0  # points that each face would have in it: none by chance in 3e-4
_HARMONICS = (2, 3, 4)  # of the rim: slots, triangles, squares
_CHANCE = 20.0  # twice the logarithm of a ratio of likelihoods, two freedoms: 1 in 20,000
_UNROUND = 0.04  # of the radius: what mills and torches allow
_NARROW = 0.25  # of the radius: a ring of the faces so wide must be free all around
_DEEP, _ON_SIDE = 0.2, 6  # of the wall, under both faces: points there are of the side of a hole; so many tell it
_LIKELY = 1e-2  # chance of a hole in a wall that has none, where others have
_ALIKE = 0.2  # of the radius: holes of one size
_AS_BARE = 0.8  # of the radius of the circle without points
_NOISE = 0.16  # of the wall: beyond it depths tell little (at 0.2 and 0.31 one hole of two was told, at 0.31 2 deviations too small)
_LEAST = 12  # points on a face around a hole
_STEP = 0.2  # of the blur: for derivatives
_MOST_FACES_OFF = 0.25  # of the wall: a face's own plane may lie so far off the member's


@dataclass(frozen=True, eq=False, kw_only=True)
class _Around(Value):
    """The points about a mouth. x : (n, 2) in the plane of the wall, from the middle of the mouth, m.   depth : (n,) under the first face.
    wall_m : how far the second lies under it.   reach_m : of the ring.   sigma_m : blur.   planes : (2, 3) depth of each face, 1, x, y.
    """

    x: FloatArray
    depth: FloatArray
    wall_m: float
    reach_m: float
    sigma_m: float
    planes: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedHole(Value):
    """A hole and the wall it goes through. place : (2,) of its middle, along the face and along the member, m.   planes : as in `_Around`."""

    wall: Wall
    place: FloatArray
    radius_m: float
    covariance: FloatArray
    planes: FloatArray
    n_points: int


def round_holes(points: FloatArray, member: Member, seed: int = 0) -> tuple[FittedHole, ...]:
    """The holes of a member with flat walls, by its points (n, 3). Empty where it has none, or one that is not round or does not go through.

    Where one is told others are likely: what chance would leave one time in `_LIKELY`, and every place as bare as a hole, must be one too, or none is
    told; and of all else that might be a hole, what is as wide as one that is told.
    """
    if member.family in ROUND:
        return ()
    local = sweep_of_member(member).coordinates(points)
    found: list[FittedHole] = []
    bare = math.inf  # radius of the smallest place without points in a hole
    for chance in (CHANCE, _LIKELY, 1.0):
        there = mouths(member, local, member.sigma_m, chance=chance)
        for mouth in there:
            if any(_is_same(mouth, hole) for hole in found):
                continue
            hole = _hole(mouth, [m for m in there if m is not mouth and m.wall.name == mouth.wall.name], member.sigma_m, seed)
            is_likely = chance < 1.0 or mouth.radius_m > _AS_BARE * bare
            if hole is None and is_likely:
                return ()
            if hole is not None and (is_likely or any(abs(hole.radius_m / other.radius_m - 1) < _ALIKE for other in found)):
                found.append(hole)
                bare = min(bare, mouth.radius_m)
        if not found:
            return ()
    return tuple(found)


def _is_same(mouth: Mouth, hole: FittedHole) -> bool:
    """Whether a mouth lies in a hole that is told."""
    same_wall = mouth.wall.name == hole.wall.name and np.array_equal(mouth.wall.start, hole.wall.start)
    return same_wall and float(np.linalg.norm(mouth.place - hole.place)) < hole.radius_m


def _hole(mouth: Mouth, others: Sequence[Mouth], sigma_m: float, seed: int) -> FittedHole | None:
    fitted = _fitted(mouth, others, sigma_m, seed)
    if fitted is not None:  # noise makes the empty circle smaller than the hole, so that its ring holds the side
        mouth = _moved(mouth, fitted[1])
        fitted = _fitted(mouth, others, sigma_m, seed)
    if fitted is None:
        return None
    around, theta = fitted
    mouth = _moved(mouth, theta)
    if not _is_round(around, theta) or not _goes_through(around, theta):
        return None
    covariance = _covariance(around, theta)
    if covariance is None:
        return None
    rho = np.hypot(*(around.x - theta[:2]).T)
    planes = _at(around.planes, theta[:2] - mouth.place)
    n_points = int((np.abs(rho - theta[2]) < _REACH * around.sigma_m).sum())
    return FittedHole(wall=mouth.wall, place=mouth.place, radius_m=mouth.radius_m, covariance=covariance, planes=planes, n_points=n_points)


def _fitted(mouth: Mouth, others: Sequence[Mouth], sigma_m: float, seed: int) -> tuple[_Around, FloatArray] | None:
    """The points about a mouth, and the likeliest circle in them; None where there is none."""
    around = _around(mouth, others, sigma_m, seed)
    theta = None if around is None else _climbed(around, np.array([0.0, 0.0, mouth.radius_m]))
    return None if around is None or theta is None else (around, theta)


def _moved(mouth: Mouth, theta: FloatArray) -> Mouth:
    return replace(mouth, place=mouth.place + theta[:2], radius_m=float(theta[2]))


def _at(planes: FloatArray, shift: FloatArray) -> FloatArray:
    """(2, 3) the same planes where the origin lies at -shift: at(x) = p . (1, x + shift)."""
    return np.column_stack([planes[:, 0] + planes[:, 1:] @ shift, planes[:, 1:]])


def _around(mouth: Mouth, others: Sequence[Mouth], sigma_m: float, seed: int) -> _Around | None:
    """The points about a mouth; None where no face of its wall, or no ring around it, is told."""
    wall, radius = mouth.wall, mouth.radius_m
    if sigma_m > _NOISE * wall.wall_m:
        return None
    clear = min([mouth.place[0] - wall.low, wall.high - mouth.place[0], *(float(np.linalg.norm(m.place - mouth.place)) - m.radius_m for m in others)])
    reach = min(_RING * radius, clear)
    x = np.stack([wall.along, wall.z], 1) - mouth.place
    near = np.flatnonzero((np.einsum("ij,ij->i", x, x) < reach**2) & (wall.depth > -_slack(wall, sigma_m)))
    near = near[wall.depth[near] < wall.wall_m + _slack(wall, sigma_m)]
    x, depth = x[near], wall.depth[near]
    ring = np.hypot(*x.T) > min(radius + _REACH * sigma_m, (radius + reach) / 2)  # clear of its side
    found = [_plane(x[ring], depth[ring], at, wall, sigma_m) for at in (0.0, wall.wall_m)]
    if all(plane is None for plane in found):
        return None
    planes = np.stack([np.array([at, 0.0, 0.0]) if plane is None else plane for plane, at in zip(found, (0.0, wall.wall_m), strict=True)])
    spacing = math.sqrt(2 * math.pi * (reach**2 - radius**2) / max(len(x), 1))
    blur = math.sqrt(max((_BLUR * spacing) ** 2 - sigma_m**2, 0.0))
    rng = np.random.default_rng([seed, len(x)])
    x, depth = x + blur * rng.standard_normal(x.shape), depth + blur * rng.standard_normal(len(x))
    sigma = math.hypot(sigma_m, blur)
    if reach < (1 + _NARROW) * radius or reach - radius < 2 * sigma:
        return None
    inside = np.einsum("ij,ij->i", x, x) < reach**2
    return _Around(x=x[inside], depth=depth[inside], wall_m=wall.wall_m, reach_m=reach, sigma_m=sigma, planes=planes)


def _slack(wall: Wall, sigma_m: float) -> float:
    return _REACH * sigma_m + _MOST_FACES_OFF * wall.wall_m


def _plane(x: FloatArray, depth: FloatArray, at: float, wall: Wall, sigma_m: float) -> FloatArray | None:
    """(3,) the plane of the points of a face of a wall, depth = p . (1, x, y); None where too few tell it."""
    rows = np.abs(depth - at) < min(_REACH * sigma_m + _MOST_FACES_OFF * wall.wall_m, wall.wall_m / 2)
    plane = np.array([at, 0.0, 0.0])
    for _ in range(3):
        if rows.sum() < _LEAST:
            return None
        design = np.column_stack([np.ones(len(x)), x])
        plane = np.linalg.lstsq(design[rows], depth[rows], rcond=None)[0]
        rows = np.abs(depth - design @ plane) < min(3 * sigma_m + 0.02 * wall.wall_m, wall.wall_m / 2)
    return plane


def _terms(around: _Around, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(4, n) densities of the two faces, the side and strays at the points, each of unit lambda; (4,) the mass of each.

    theta : (3,) middle and radius, or (4 + 2 m,) with cosine and sine of m harmonics of the rim, and how much wider than in the middle of the wall
    the hole is at its first face.
    """
    sigma, wall = around.sigma_m, around.wall_m
    off = around.x - theta[:2]
    rho = np.hypot(off[:, 0], off[:, 1])
    u = (rho - theta[2]) / sigma
    under = [around.depth - p[0] - around.x @ p[1:] for p in around.planes]
    wider = 0.0
    if len(theta) > 3:
        turn = np.arctan2(off[:, 1], off[:, 0])
        u -= sum(theta[3 + 2 * k] * np.cos(m * turn) + theta[4 + 2 * k] * np.sin(m * turn) for k, m in enumerate(_HARMONICS)) / sigma
        wider = float(theta[-1]) / sigma
    at = [u - wider, u + wider, u - wider * np.clip(1 - 2 * under[0] / wall, -1, 1)]  # at either face, and at its depth
    phi = [np.exp(-(v**2) / 2) / math.sqrt(2 * math.pi) for v in at]
    flat = [np.exp(-((d / sigma) ** 2) / 2) / (math.sqrt(2 * math.pi) * sigma) for d in under]
    face_1, face_2 = ((ndtr(at[k]) + sigma / (2 * theta[2]) * phi[k]) * flat[k] for k in (0, 1))
    side = np.sqrt(theta[2] / np.maximum(rho, 1e-3 * theta[2])) * phi[2] / sigma * (ndtr(under[0] / sigma) - ndtr(under[1] / sigma))
    bulge = math.pi / 2 * float((theta[3:] ** 2).sum())
    face = math.pi * (around.reach_m**2 - theta[2] ** 2) - bulge
    deep = wall + 2 * _REACH * sigma
    cone = 2 * math.pi * theta[2] * wider * sigma
    mass = np.array([face - cone, face + cone, 2 * math.pi * theta[2] * wall, math.pi * around.reach_m**2 * deep])
    return np.stack([face_1, face_2, side, np.ones(len(rho))]), mass


def _log_likelihood(around: _Around, theta: FloatArray) -> float:
    """Of the points, with the densities that make them likeliest."""
    if not 0 < theta[2] < around.reach_m - float(np.hypot(*theta[:2])):
        return -math.inf
    terms, mass = _terms(around, theta)
    share = np.full(4, 0.25)
    each = terms / mass[:, None]
    for _ in range(_ROUNDS):
        weighted = share[:, None] * each
        total = np.maximum(weighted.sum(0), 1e-300)
        share = (weighted / total).mean(1)
    return float(np.log(np.maximum(share @ each, 1e-300)).sum())


def _climbed(around: _Around, start: FloatArray) -> FloatArray | None:
    """The likeliest middle and radius (and harmonics), None where there are none."""
    step = 0.5 * around.sigma_m + 0.02 * start[2]
    simplex = np.vstack([start, start + step * np.eye(len(start))])
    limits: dict[str, Any] = {"xatol": 1e-3 * around.sigma_m, "fatol": 1e-3, "maxiter": 400 * len(start), "initial_simplex": simplex}
    found: Any = minimize(lambda theta: -_log_likelihood(around, theta), start, method="Nelder-Mead", options=limits)  # type: ignore[call-overload]
    return np.asarray(found.x) if found.success and math.isfinite(found.fun) else None


def _slopes(around: _Around, theta: FloatArray, rows: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """First and second derivatives (k,), (k, k) of the log-likelihood by some of its parameters, by differences."""
    far = _STEP * around.sigma_m
    step = far * np.eye(len(theta))[list(rows)]
    at = _log_likelihood(around, theta)
    first, second = np.zeros(len(rows)), np.zeros((len(rows), len(rows)))
    for i, one in enumerate(step):
        up, down = _log_likelihood(around, theta + one), _log_likelihood(around, theta - one)
        first[i], second[i, i] = (up - down) / (2 * far), (up + down - 2 * at) / far**2
        for j, other in enumerate(step[:i]):
            corners = [s * t * _log_likelihood(around, theta + s * one + t * other) for s in (1, -1) for t in (1, -1)]
            second[i, j] = second[j, i] = sum(corners) / (4 * far**2)
    return first, second


def _covariance(around: _Around, theta: FloatArray) -> FloatArray | None:
    """(3, 3) of middle and radius, by the curvature of the likelihood; None where it has none."""
    _, second = _slopes(around, theta, range(3))
    if not np.isfinite(second).all() or np.linalg.eigvalsh(-second).min() <= 0:
        return None
    return np.asarray(np.linalg.inv(-second))


def _is_round(around: _Around, theta: FloatArray) -> bool:
    """Whether no harmonic of the rim departs from a circle, nor one mouth from the other, by more than chance and mill tolerance (score test)."""
    wavy = np.r_[theta, np.zeros(2 * len(_HARMONICS) + 1)]
    for rows in (*((3 + 2 * k, 4 + 2 * k) for k in range(len(_HARMONICS))), (len(wavy) - 1,)):
        first, second = _slopes(around, wavy, rows)
        if not np.isfinite(second).all() or np.linalg.eigvalsh(-second).min() <= 0:
            return False
        size = np.linalg.solve(-second, first)
        if float(first @ size) > _CHANCE and float(np.linalg.norm(size)) > _UNROUND * theta[2]:
            return False
    return True


def _goes_through(around: _Around, theta: FloatArray) -> bool:
    """Whether each face would have had points in the hole, as those around it foretell, and hardly any lies there at any depth. Where one face was
    not seen around it, points on the side of the hole stand for that: nobody measured a side of what is only bare.
    """
    rho = np.hypot(*(around.x - theta[:2]).T)
    core, rim = max(theta[2] - 3 * around.sigma_m, 0.5 * theta[2]), theta[2] + around.sigma_m
    under = [around.depth - plane[0] - around.x @ plane[1:] for plane in around.planes]
    share = theta[2] ** 2 / (around.reach_m**2 - rim**2)
    foretold = [float(((np.abs(depth) < 3 * around.sigma_m) & (rho > rim)).sum()) * share for depth in under]
    clear = max(3 * around.sigma_m, _DEEP * around.wall_m)
    on_side = (under[0] > clear) & (under[1] < -clear) & (np.abs(rho - theta[2]) < _REACH * around.sigma_m)
    if max(foretold) < _FORETOLD or (min(foretold) < _FORETOLD and on_side.sum() < _ON_SIDE):
        return False
    inside = int((rho < core).sum())
    return bool(inside <= 1 + _EMPTY * sum(foretold) * float(core / theta[2]) ** 2)


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
        within = (under[0] > -_REACH * member.sigma_m) & (under[1] < _REACH * member.sigma_m)
        cut = hole.radius_m + 2 * member.sigma_m
        gone |= within & (rho < cut)
        for plane, off in zip(hole.planes, under, strict=True):
            ring = np.flatnonzero((np.abs(off) < _REACH * member.sigma_m) & (rho >= cut) & (rho < _RING * cut))
            ring = ring[(x[ring, 0] > wall.low) & (x[ring, 0] < wall.high)]
            new, source = _across(hole.place, cut, x[ring], ring, rng)
            depth = plane[0] + new @ plane[1:] + member.sigma_m * rng.standard_normal(len(new))
            at = wall.start + new[:, :1] * wall.unit + depth[:, None] * wall.into
            rows.append(source)
            places.append(points[source] + _in_world(sweep, local[source], np.column_stack([at, new[:, 1]])))
    keep = np.flatnonzero(~gone)
    return _joined(scan, keep, np.concatenate(rows).astype(np.int64), np.concatenate(places), dark)


def _through(rays: Rays, holes: Sequence[RoundHole], sigma_m: float) -> BoolArray:
    """(m,) whether a ray went through a hole, wherever it came to an end behind it."""
    gone = np.zeros(len(rays), bool)
    for hole in holes:
        along = hole.through / np.linalg.norm(hole.through)
        off = hole.start + hole.through / 2 - rays.origin
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (off @ along) / (rays.direction @ along)
            past = np.linalg.norm(np.cross(far[:, None] * rays.direction - off, along), axis=1) < hole.radius_m + 2 * sigma_m
        gone |= past & (far > 0) & ~(far > rays.range_m)
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
    """(k, 2) places spread over a disc as densely as points x (n, 2) lie in the ring around it, up to `_RING` radii; (k,) the nearest of `rows`."""
    if not len(x):
        return np.zeros((0, 2)), np.zeros(0, np.int64)
    n = round(len(x) / (_RING**2 - 1))
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
