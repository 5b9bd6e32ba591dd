"""The axis of a pipe with elbows from its points: straight runs found as cylinders, put in a chain, and joined by circular bends.

Tube benders' co-ordinates: the corners in which the lines of successive runs meet, and the radius of each bend (XYZR). The points of either skin give
the same axis; those that were seen of one side only, too.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from scan2fea.kernel.bends import straightened
from scan2fea.kernel.noise import noise_sigma, sampled_rows, spacing
from scan2fea.kernel.pipe_runs import WIDE, Run, mode, runs_of, skins
from scan2fea.kernel.transforms import applied, compose, inverse, rigid
from scan2fea.types import Bend, FloatArray, Value

_MOST = 30_000  # points that are looked at
_FITTED = 3_000  # points of a fit
_MEET = 0.25  # of the radius by which the lines of runs may pass each other
_FARTHEST = 24.0  # radii from a run's end to the corner: bends of 12 diameters
_LEAST_TURN, _MOST_TURN = math.radians(4.0), math.radians(150.0)
_TIGHTEST = 1.2  # of the radius: a bend below folds its inner side (elbows have 2 and 3)
_HELD = 0.75  # of the points lie on its skins (of paths that are right at least 0.96, of wrong ones at most 0.56)
_ON = 0.9  # of the points lie on the skins or between them
_SIGMAS = 2.5
_GRAIN = 0.02  # of a spacing: what points of no noise may lie off
_MOST_RUNS = 12
_EXPLAINED = 1.2  # misfit that noise leaves: no more bends are looked for
_NARROWER = (0.03, 0.005)  # of the radius: how far off a better guess, and a good one
_TAILS = 10.0  # a band over the distance beyond which points weigh less
_STEPS = 40  # of the descent

_Path = tuple[FloatArray, tuple[Bend, ...]]  # the frame in which an axis begins, its bends


@dataclass(frozen=True, eq=False, kw_only=True)
class PipePath(Value):
    """T_world_path : (4, 4) frame in which the axis begins, along z.   length_m : to the last point.   radius_m : of one of its skins."""

    T_world_path: FloatArray
    bends: tuple[Bend, ...]
    length_m: float
    radius_m: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fitted(Value):
    """misfit : mean square of the distances from the skins over the noise, large ones for their size only; 0.8 for Gaussian noise."""

    path: PipePath
    bic: float
    misfit: float


def pipe_path(points: FloatArray, seed: int = 0) -> PipePath | None:
    """The axis of the one pipe with bends that nearly all points (n, 3) lie on; None where they are anything else, or one straight run."""
    some = points[sampled_rows(len(points), _MOST, seed)]
    h, sigma = spacing(some, seed), noise_sigma(points, seed=seed)
    if not h > 0:
        return None
    tolerance = _SIGMAS * (sigma if np.isfinite(sigma) else 0.0) + _GRAIN * h
    runs = runs_of(some, h, tolerance, seed)
    best: _Fitted | None = None
    for k in range(2, min(len(runs), _MOST_RUNS) + 1):  # what is taken for a run within a bend comes last: it is short
        chain = _chain(runs[:k])
        found = None if chain is None else _fitted(some, *_corners(chain), runs[0].radius, tolerance, seed)
        if found is not None and (best is None or found.bic < best.bic):
            best = found
        if best is not None and best.misfit < _EXPLAINED:
            break
    return None if best is None else best.path


# ------------------------------------------------------------------ the chain


def _chain(runs: Sequence[Run]) -> list[tuple[Run, int]] | None:
    """The runs in order, each with the end by which it is entered; None where they make no single chain."""
    links = []
    for i, j in itertools.combinations(range(len(runs)), 2):
        for a, b in itertools.product((0, 1), repeat=2):
            gap = _gap(runs[i], a, runs[j], b)
            if gap is not None:
                links.append((gap, (i, a), (j, b)))
    links.sort()
    after: dict[tuple[int, int], tuple[int, int]] = {}
    part = list(range(len(runs)))
    for _, one, other in links:
        if one in after or other in after or part[one[0]] == part[other[0]]:
            continue
        after[one], after[other] = other, one
        part = [part[one[0]] if p == part[other[0]] else p for p in part]
    if len(set(part)) != 1:
        return None
    entered = min((k, e) for k in range(len(runs)) for e in (0, 1) if (k, e) not in after)
    chain = [(runs[entered[0]], entered[1])]
    while (entered[0], 1 - entered[1]) in after:
        entered = after[entered[0], 1 - entered[1]]
        chain.append((runs[entered[0]], entered[1]))
    return chain


def _gap(one: Run, a: int, other: Run, b: int) -> float | None:
    """How far the corner of two runs lies beyond these ends, together; None where their lines do not meet there, or not in a bend."""
    p, q, u, v = one.end(a), other.end(b), one.outward(a), other.outward(b)
    cosine = float(u @ v)
    turn = math.acos(min(max(-cosine, -1.0), 1.0))
    if not _LEAST_TURN <= turn <= _MOST_TURN:
        return None
    s, t = np.linalg.lstsq(np.stack([u, -v], axis=1), q - p, rcond=None)[0]
    apart = float(np.linalg.norm(p + s * u - q - t * v))
    radius = one.radius
    slack = radius  # runs may have grown a little into the bend, or stop before it
    if apart > _MEET * radius or min(s, t) < -slack or max(s, t) > _FARTHEST * radius:
        return None
    return float(s + t)


def _corners(chain: Sequence[tuple[Run, int]]) -> tuple[FloatArray, FloatArray]:
    """First end, corners and last end (k, 3); the radius (k - 2,) of each bend that begins where the nearer run stops."""
    corners, radii = [chain[0][0].end(chain[0][1])], []
    for (one, entered), (other, enters) in itertools.pairwise(chain):
        p, q, u, v = one.end(1 - entered), other.end(enters), one.outward(1 - entered), other.outward(enters)
        s, t = np.linalg.lstsq(np.stack([u, -v], axis=1), q - p, rcond=None)[0]
        corners.append(0.5 * (p + s * u + q + t * v))
        half = 0.5 * math.acos(min(max(-float(u @ v), -1.0), 1.0))
        radii.append(max(0.5 * (s + t), 0.2 * one.radius) / math.tan(half))
    corners.append(chain[-1][0].end(1 - chain[-1][1]))
    return np.array(corners), np.array(radii)


# ------------------------------------------------------------------ all together


def _fitted(
    points: FloatArray, corners: FloatArray, radii: FloatArray, radius: float, tolerance: float, seed: int
) -> _Fitted | None:
    """All corners, bends and the radius of the skin by least squares on what lies on it; None where too little does."""
    some = points[sampled_rows(len(points), _FITTED, seed)]
    n, scale = len(corners), tolerance / _SIGMAS
    across = [_frame(_unit(corners[1] - corners[0]))[:, :2], _frame(_unit(corners[-1] - corners[-2]))[:, :2]]  # ways the outer corners may go
    theta = np.concatenate([np.zeros(2), corners[1:-1].ravel(), np.zeros(2), np.log(radii), [radius]])

    def path_of(theta: FloatArray) -> _Path | None:
        first, last = corners[0] + across[0] @ theta[:2], corners[-1] + across[1] @ theta[3 * n - 4 : 3 * n - 2]
        return _path(np.vstack([first, theta[2 : 3 * n - 4].reshape(-1, 3), last]), np.exp(theta[3 * n - 2 : -1]))

    def residual(theta: FloatArray, own: FloatArray) -> FloatArray:
        path = path_of(theta)
        return np.full(len(own), 1e3 * radius) if path is None else _off(own, *path) - theta[-1]

    for band in (WIDE * radius, *(max(tolerance, share * radius) for share in _NARROWER), tolerance):
        found = path_of(theta)
        if found is None:
            return None
        off = _off(some, *found)
        near = off[np.abs(off - radius) < WIDE * radius]
        if not len(near):
            return None
        theta[-1] = mode(near, tolerance)
        own = some[np.abs(off - theta[-1]) < band]
        if len(own) < 3 * len(theta):
            return None
        with np.errstate(over="ignore"):  # a step into bends without end: none such exist, and it is taken back
            fit = least_squares(residual, theta, args=(own,), x_scale="jac", loss="soft_l1", f_scale=max(scale, band / _TAILS), max_nfev=_STEPS)
        theta = fit.x
    found = path_of(theta)
    if found is None or min(bend.radius_m for bend in found[1]) < _TIGHTEST * theta[-1]:
        return None
    T, bends = found
    off = _off(some, T, bends)
    radii_m = skins(off, float(theta[-1]), tolerance)
    on_skins = np.abs(off[:, None] - radii_m).min(axis=1) < tolerance
    if on_skins.mean() < _HELD or np.mean(off < radii_m.max() + tolerance) < _ON:
        return None
    variance = 2 * float(fit.cost) / max(len(own) - len(theta), 1)
    jacobian = np.asarray(fit.jac, float)
    covariance = variance * np.linalg.pinv(jacobian.T @ jacobian)
    far = np.abs(off[:, None] - radii_m).min(axis=1) / scale
    misfit = 2 * float(np.mean(np.sqrt(1 + far**2) - 1))
    bic = misfit * len(some) + len(theta) * math.log(len(some))
    way = straightened(bends, applied(inverse(T), points))[:, 2]
    low = float(np.quantile(way, 1e-3))
    T = compose(T, rigid(np.eye(3), np.array([0.0, 0.0, low])))
    length = float(np.quantile(way, 1 - 1e-3)) - low
    path = PipePath(T_world_path=T, bends=_with_std(bends, low, path_of, theta, covariance), length_m=length, radius_m=float(theta[-1]))
    return _Fitted(path=path, bic=bic, misfit=misfit)


def _with_std(
    bends: Sequence[Bend], low: float, path_of: Callable[[FloatArray], _Path | None], theta: FloatArray, covariance: FloatArray
) -> tuple[Bend, ...]:
    """The bends from `low` on, with the standard deviations of radius and angle."""
    base = np.array([[b.radius_m, b.angle_rad] for b in bends])
    slope = np.zeros((len(theta), *base.shape))
    for k in range(len(theta)):
        step = 1e-6 * max(abs(float(theta[k])), 1.0)
        moved = theta.copy()
        moved[k] += step
        path = path_of(moved)
        if path is not None:
            slope[k] = (np.array([[b.radius_m, b.angle_rad] for b in path[1]]) - base) / step
    std = np.sqrt(np.maximum(np.einsum("kbi,kl,lbi->bi", slope, covariance, slope), 0.0))
    return tuple(
        replace(b, start_m=b.start_m - low, radius_std_m=float(s[0]), angle_std_rad=float(s[1])) for b, s in zip(bends, std, strict=True)
    )


def _path(corners: FloatArray, radii: FloatArray) -> _Path | None:
    """Frame of the first end, and the bends, of corners (n, 3), ends among them, and radii (n - 2,); None where bends overlap."""
    n = len(corners)
    ways = np.diff(corners, axis=0)
    length = np.linalg.norm(ways, axis=1)
    if not (length > 0).all():
        return None
    ways = ways / length[:, None]
    turn = np.arccos(np.clip((ways[:-1] * ways[1:]).sum(axis=1), -1.0, 1.0))
    cut = np.concatenate([[0.0], radii * np.tan(0.5 * turn), [0.0]])
    straight = length - cut[:-1] - cut[1:]
    if (straight < 0).any() or (turn < 1e-6).any():
        return None
    frame = _frame(ways[0])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = frame, corners[0]
    bends, at = [], 0.0
    for k in range(n - 2):
        inward = ways[k + 1] - (ways[k + 1] @ ways[k]) * ways[k]
        inward /= np.linalg.norm(inward)
        at += float(straight[k])
        roll = math.atan2(float(inward @ frame[:, 1]), float(inward @ frame[:, 0]))
        bends.append(Bend(start_m=at, angle_rad=float(turn[k]), radius_m=float(radii[k]), roll_rad=roll))
        at += bends[-1].length_m
        about = np.cross(ways[k], inward)
        along = inward * np.cos(turn[k]) - ways[k] * np.sin(turn[k])
        x = frame[:, 0]
        x = (x @ about) * about + (x @ inward) * along
        frame = np.stack([x, np.cross(ways[k + 1], x), ways[k + 1]], axis=1)
    return T, tuple(bends)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


def _frame(along: FloatArray) -> FloatArray:
    """(3, 3) columns x, y, z with z along."""
    x = np.eye(3)[int(np.argmin(np.abs(along)))]
    x = x - (x @ along) * along
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(along, x), along], axis=1)


def _off(points: FloatArray, T: FloatArray, bends: tuple[Bend, ...]) -> FloatArray:
    """(n,) distance of points from the axis."""
    local = straightened(bends, applied(inverse(T), points))
    return np.asarray(np.hypot(local[:, 0], local[:, 1]))
