"""One round hole through a wall of a member: middle and radius, how far to trust them, and whether it is one.

Around a mouth (`bored.py`) points lie on two faces that end at the rim, and on the side of the hole between them; all of it blurred by the noise.
With u = (rho - r) / sigma at a distance rho from the middle, and depth d under the first face of a wall t thick, the density of points is

    faces   lambda_k [Phi(u) + sigma phi(u) / (2 r)] phi(d_k / sigma) / sigma         k = 1, 2; the second term: a rim is curved
    side    lambda_3 sqrt(r / rho) phi(u) / sigma [Phi(d / sigma) - Phi((d - t) / sigma)]
    strays  lambda_4

and the densities lambda, each as its own surface was seen, are those that make the points likeliest (expectation maximisation). The likelihood of
middle and radius is then climbed; its curvature gives their covariance. Noise far below the distance between points would leave steps, not slopes:
the points are blurred by chance first, a known width.

A hole is a cylinder where no harmonic of its rim departs from the circle, nor one mouth from the other, by more than chance and mill tolerance. Its
points tell that it goes through where both faces lack what those around foretell, or one does and points lie on its side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr

from scan2fea.estimation.bored import Mouth, mouths
from scan2fea.estimation.walls import Wall
from scan2fea.kernel.sections import ROUND
from scan2fea.types import FloatArray, Member, Value

RING = 2.0  # radii: as far as points tell of a hole
REACH = 4.0  # standard deviations of noise
_BLUR = 0.05  # of the distance between points: the least blur
_ROUNDS = 12  # of expectation maximisation
_EMPTY = 0.15  # of the points that a face would have in a hole
_FORETOLD = 8.0  # points that each face would have in it: none by chance in 3e-4
_HARMONICS = (2, 3, 4, 5, 6)  # of the rim: slots, triangles, squares, hexagons
_CHANCE = 20.0  # twice the logarithm of a ratio of likelihoods, two freedoms: 1 in 20,000
_WIDER = (0.05, 0.1)  # of the radius: widths of the rim in which its shape is looked at
_UNROUND = 0.04  # of the radius: what mills and torches allow
_NARROW = 0.25  # of the radius: a ring of the faces so wide must be free all around
_DEEP, _ON_SIDE = 0.2, 6  # of the wall, under both faces: points there are of the side of a hole; so many tell it
_NONE = 1e-4  # of the radius: a hole that is none
_TELLING = 24.0  # of the gain: whole walls had up to 18 (stations), holes of 5 spacings under noise of 0.16 of the wall 22 to 76
_UNEVEN = 16.0  # times as many: where points are uneven, whose lack says less
_NOISE = 0.18  # of the wall: beyond it depths tell little (at 0.2 and 0.31 one hole of two was told, at 0.31 2 deviations too small)
_LEAST = 12  # points on a face around a hole
_STEP = 0.2  # of the blur: for derivatives
_MOST_FACES_OFF = 0.25  # of the wall: a face's own plane may lie so far off the member's


@dataclass(frozen=True, eq=False, kw_only=True)
class _Around(Value):
    """The points about a mouth. x : (n, 2) in the plane of the wall, from the middle of the mouth, m.   depth : (n,) under the first face.
    wall_m : how far the second lies under it.   reach_m : of the ring.   sigma_m : blur, width_m that across the rim.
    planes : (2, 3) depth of each face, 1, x, y.
    """

    x: FloatArray
    depth: FloatArray
    wall_m: float
    reach_m: float
    sigma_m: float
    width_m: float
    planes: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedHole(Value):
    """A hole and the wall it goes through. place : (2,) of its middle, along the face and along the member, m.   planes : as in `_Around`.
    is_told : whether its points alone tell that it goes through.   gain : logarithm of how many times likelier its points are than without it.
    """

    wall: Wall
    place: FloatArray
    radius_m: float
    uneven: float
    covariance: FloatArray
    planes: FloatArray
    n_points: int
    is_told: bool
    gain: float

    @property
    def is_telling(self) -> bool:
        """Whether a wall without holes would not have it."""
        return self.is_told and self.gain > max(_TELLING, _UNEVEN * self.uneven)


def fitted_hole(mouth: Mouth, others: Sequence[Mouth], sigma_m: float, seed: int = 0) -> FittedHole | None:
    """The hole at a mouth of a wall; None where there is no round one. others : mouths beside it, whose rims its ring keeps clear of."""
    fitted = _fitted(mouth, others, sigma_m, seed)
    if fitted is not None:  # noise makes the empty circle smaller than the hole, so that its ring holds the side
        mouth = _moved(mouth, fitted[1])
        fitted = _fitted(mouth, others, sigma_m, seed)
    if fitted is None:
        return None
    around, theta = fitted
    mouth = _moved(mouth, theta)
    told = _goes_through(around, theta) if _is_round(around, theta) else None
    if told is None:
        return None
    covariance = _covariance(around, theta)
    if covariance is None:
        return None
    rho = np.hypot(*(around.x - theta[:2]).T)
    planes = _at(around.planes, theta[:2] - mouth.place)
    n_points = int((np.abs(rho - theta[2]) < REACH * around.sigma_m).sum())
    gain = _log_likelihood(around, theta) - _log_likelihood(around, np.array([0.0, 0.0, _NONE * theta[2]]))
    where: dict[str, Any] = {"wall": mouth.wall, "place": mouth.place, "radius_m": mouth.radius_m, "uneven": mouth.uneven}
    return FittedHole(**where, covariance=covariance, planes=planes, n_points=n_points, is_told=told, gain=gain)


def telling_holes(member: Member, local: FloatArray, sigma_m: float, seed: int = 0) -> list[FittedHole]:
    """The holes in flat walls whose points are so much likelier with them that no wall without holes shows them.

    local : (n, 3) points in the member's frame.
    """
    if member.family in ROUND:
        return []
    fitted = [fitted_hole(mouth, others, sigma_m, seed) for mouth, others in with_others(mouths(member, local, sigma_m, chance=1.0))]
    return [hole for hole in fitted if hole is not None and hole.is_telling]


def with_others(found: Sequence[Mouth]) -> list[tuple[Mouth, list[Mouth]]]:
    """Each mouth, and the others of its wall."""
    return [(mouth, [m for m in found if m is not mouth and m.wall.name == mouth.wall.name]) for mouth in found]


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
    reach = min(RING * radius, clear)
    x = np.stack([wall.along, wall.z], 1) - mouth.place
    near = np.flatnonzero((np.einsum("ij,ij->i", x, x) < reach**2) & (wall.depth > -_slack(wall, sigma_m)))
    near = near[wall.depth[near] < wall.wall_m + _slack(wall, sigma_m)]
    x, depth = x[near], wall.depth[near]
    ring = np.hypot(*x.T) > min(radius + REACH * sigma_m, (radius + reach) / 2)  # clear of its side
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
    return _Around(x=x[inside], depth=depth[inside], wall_m=wall.wall_m, reach_m=reach, sigma_m=sigma, width_m=sigma, planes=planes)


def _slack(wall: Wall, sigma_m: float) -> float:
    return REACH * sigma_m + _MOST_FACES_OFF * wall.wall_m


def _plane(x: FloatArray, depth: FloatArray, at: float, wall: Wall, sigma_m: float) -> FloatArray | None:
    """(3,) the plane of the points of a face of a wall, depth = p . (1, x, y); None where too few tell it."""
    rows = np.abs(depth - at) < min(REACH * sigma_m + _MOST_FACES_OFF * wall.wall_m, wall.wall_m / 2)
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
    sigma, width, wall = around.sigma_m, around.width_m, around.wall_m
    off = around.x - theta[:2]
    rho = np.hypot(off[:, 0], off[:, 1])
    u = (rho - theta[2]) / width
    under = [around.depth - p[0] - around.x @ p[1:] for p in around.planes]
    wider = 0.0
    if len(theta) > 3:
        turn = np.arctan2(off[:, 1], off[:, 0])
        u -= sum(theta[3 + 2 * k] * np.cos(m * turn) + theta[4 + 2 * k] * np.sin(m * turn) for k, m in enumerate(_HARMONICS)) / width
        wider = float(theta[-1]) / width
    at = [u - wider, u + wider, u - wider * np.clip(1 - 2 * under[0] / wall, -1, 1)]  # at either face, and at its depth
    phi = [np.exp(-(v**2) / 2) / math.sqrt(2 * math.pi) for v in at]
    flat = [np.exp(-((d / sigma) ** 2) / 2) / (math.sqrt(2 * math.pi) * sigma) for d in under]
    face_1, face_2 = ((ndtr(at[k]) + width / (2 * theta[2]) * phi[k]) * flat[k] for k in (0, 1))
    side = np.sqrt(theta[2] / np.maximum(rho, 1e-3 * theta[2])) * phi[2] / width * (ndtr(under[0] / sigma) - ndtr(under[1] / sigma))
    bulge = math.pi / 2 * float((theta[3:] ** 2).sum())
    face = math.pi * (around.reach_m**2 - theta[2] ** 2) - bulge
    deep = wall + 2 * REACH * sigma
    cone = 2 * math.pi * theta[2] * wider * width
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
    far = _STEP * around.width_m
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
    """Whether no harmonic of the rim departs from a circle, nor one mouth from the other, by more than chance and mill tolerance (score test).

    Seen so narrowly that a rim lies beside the circle it is none of it, and its points are strays: wider looks, for which chance is less, see it too.
    """
    wavy = np.r_[theta, np.zeros(2 * len(_HARMONICS) + 1)]
    for width in (around.sigma_m, *(w * theta[2] for w in _WIDER if w * theta[2] > around.sigma_m)):
        looked = replace(around, width_m=width)
        for rows in (*((3 + 2 * k, 4 + 2 * k) for k in range(len(_HARMONICS))), (len(wavy) - 1,)):
            first, second = _slopes(looked, wavy, rows)
            if not np.isfinite(second).all() or np.linalg.eigvalsh(-second).min() <= 0:
                return False
            size = np.linalg.solve(-second, first)
            if float(first @ size) > _CHANCE and float(np.linalg.norm(size)) > _UNROUND * theta[2]:
                return False
    return True


def _goes_through(around: _Around, theta: FloatArray) -> bool | None:
    """Whether the points tell that a hole goes through; None where it is none.

    It is one where a face would have had points in it, as those around foretell, and hardly any lies there at any depth. It goes through where both
    faces would have, or points lie on its side: nobody measured a side of what is only bare.
    """
    rho = np.hypot(*(around.x - theta[:2]).T)
    core, rim = max(theta[2] - 3 * around.sigma_m, 0.5 * theta[2]), theta[2] + around.sigma_m
    under = [around.depth - plane[0] - around.x @ plane[1:] for plane in around.planes]
    share = theta[2] ** 2 / (around.reach_m**2 - rim**2)
    foretold = [float(((np.abs(depth) < 3 * around.sigma_m) & (rho > rim)).sum()) * share for depth in under]
    inside = int((rho < core).sum())
    if max(foretold) < _FORETOLD or inside > 1 + _EMPTY * sum(foretold) * float(core / theta[2]) ** 2:
        return None
    clear = max(3 * around.sigma_m, _DEEP * around.wall_m)
    on_side = (under[0] > clear) & (under[1] < -clear) & (np.abs(rho - theta[2]) < REACH * around.sigma_m)
    return min(foretold) >= _FORETOLD or int(on_side.sum()) >= _ON_SIDE
