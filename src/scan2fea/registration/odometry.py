"""Many sweeps of one moving sensor, without poses: each against the map of those before it, then all at once against the planes of the whole.

The sensor moves evenly within a sweep; from sweep to sweep its speed changes by what a carrier can do (`ACCELERATION`, `TURNING`), which holds it
where the scene does not. In the end the poses are kept whose map is sharpest: the mean entropy of its neighbourhoods (Droeschel, Behnke 2014).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.normals import pca_normals
from scan2fea.kernel.transforms import applied, inverse, rigid
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.registration.icp import orthonormal, robust_scale, tukey
from scan2fea.registration.joint import JointResult, joint
from scan2fea.registration.motion import deskewed, moved
from scan2fea.types import FloatArray, IntArray, Value

ACCELERATION, TURNING = 3.0, 4.0  # m/s2 and rad/s2: standard deviations of what carriers on wheels, sledges and in hands do
POINTS = 3_000  # of a sweep that are matched
SIGMAS = 3.0
STANDS = 3.0
AGREE = 0.1
MAP_SWEEPS = 30
REACH_EDGES = 5.0
NORMAL_NEIGHBOURS = 20
DEPENDENT = 5.0  # points of a sweep go together in their errors: so many count as one
_ITERATIONS, _FIRST_ROUNDS, _ROUNDS = 30, 4, 2
_JOINT_ROUNDS, _NO_BETTER = 12, 3
_ENTROPY_POINTS, _ENTROPY_EDGES, _LEAST_NEAR = 6_000, 2.0, 8


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweeps(Value):
    """Points of k sweeps. points : (n, 3) each in the frame of the sensor at its moment.   sweep : (n,) rising from 0.   share : (n,) of the sweep's
    time that had passed.   period_s : of a sweep.
    """

    points: FloatArray
    sweep: IntArray
    share: FloatArray
    period_s: float

    def __len__(self) -> int:
        return int(self.sweep[-1]) + 1


@dataclass(frozen=True, eq=False, kw_only=True)
class Odometry(Value):
    """T_world_knot : (k + 1, 4, 4) the sensor at the start of each sweep and at the end of the last; the world is its frame at the first.
    std_m, std_rad : (k + 1,) relative to the first.   entropy : of the map.   disagreement_m : of the ways found forwards and backwards in time, at
    the pose where it is largest.
    """

    T_world_knot: FloatArray
    std_m: FloatArray
    std_rad: FloatArray
    entropy: float
    disagreement_m: float

    @property
    def is_sure(self) -> bool:
        """True where both ways are one: they differ by no more than a tenth of the way, or by what chance makes of it."""
        way = float(np.linalg.norm(np.diff(self.T_world_knot[:, :3, 3], axis=0), axis=1).sum())
        chance = math.sqrt(max(float(np.nanmax(self.std_m)) ** 2 - 0.5 * self.disagreement_m**2, 0.0))
        return self.disagreement_m <= max(AGREE * way, STANDS * chance)

    @property
    def stands(self) -> bool:
        """True where no pose is farther from the first than three standard deviations: a sensor that does not move explains the sweeps."""
        shift = np.linalg.norm(self.T_world_knot[:, :3, 3], axis=1)
        turn = np.linalg.norm(Rotation.from_matrix(self.T_world_knot[:, :3, :3]).as_rotvec(), axis=1)
        return bool((shift <= STANDS * self.std_m).all() and (turn <= STANDS * self.std_rad).all())


def odometry(sweeps: Sweeps, sigma_m: float) -> Odometry:
    """The way of the sensor, found forwards and again backwards in time; the sharper map is kept. sigma_m : noise of a range.

    What the two differ by at a pose is not chance alone: it is added to its standard deviation. Whether they are one way at all is `disagreement_m`.
    """
    forward, back = _one_way(sweeps, sigma_m), _one_way(_reversed(sweeps), sigma_m)
    T = inverse(back.T_world_knot[-1]) @ back.T_world_knot[::-1]
    apart = inverse_all(forward.T_world_knot) @ T
    off_m = np.linalg.norm(apart[:, :3, 3], axis=1)
    off_rad = np.linalg.norm(Rotation.from_matrix(apart[:, :3, :3]).as_rotvec(), axis=1)
    sharper = forward.T_world_knot if forward.entropy <= back.entropy else T
    return Odometry(
        T_world_knot=np.array([orthonormal(pose) for pose in sharper]),
        std_m=np.hypot(forward.std_m, off_m / math.sqrt(2.0)),
        std_rad=np.hypot(forward.std_rad, off_rad / math.sqrt(2.0)),
        entropy=min(forward.entropy, back.entropy),
        disagreement_m=float(off_m.max()),
    )


def _reversed(sweeps: Sweeps) -> Sweeps:
    order = np.arange(len(sweeps.points))[::-1]
    return Sweeps(points=sweeps.points[order], sweep=len(sweeps) - 1 - sweeps.sweep[order], share=1.0 - sweeps.share[order], period_s=sweeps.period_s)


def inverse_all(T: FloatArray) -> FloatArray:
    """Of rigid motions (k, 4, 4)."""
    return np.array([inverse(pose) for pose in T])


def _one_way(sweeps: Sweeps, sigma_m: float) -> Odometry:
    few = _thinned(sweeps, sigma_m)
    edge = few.edge_m
    T = _in_turn(few.sweeps, edge, sigma_m)
    best, entropy = T, _entropy(few.sweeps, T, edge)
    result: JointResult | None = None
    since = 0
    for round_ in range(_JOINT_ROUNDS):
        spread = max(1.0, 2.0 * 0.9**round_) * sigma_m
        found = joint(few.sweeps.points, few.sweeps.sweep, few.sweeps.share, T, edge, spread, sigma_m, _freedom(sweeps.period_s))
        T, own = found.T_world_knot, _entropy(few.sweeps, found.T_world_knot, edge)
        since += 1
        if own < entropy:
            best, entropy, result, since = T, own, found, 0
        elif result is None:
            result = found
        if since == _NO_BETTER:
            break
    std = result.std if result is not None else np.full((len(T), 2), np.nan)
    return Odometry(T_world_knot=best, std_m=std[:, 1], std_rad=std[:, 0], entropy=entropy, disagreement_m=0.0)


def _freedom(period_s: float) -> tuple[float, float]:
    """Standard deviations of the change of a step from one sweep to the next: rad, m."""
    return TURNING * period_s**2, ACCELERATION * period_s**2


@dataclass(frozen=True, eq=False, kw_only=True)
class _Few(Value):
    sweeps: Sweeps
    edge_m: float


def _thinned(sweeps: Sweeps, sigma_m: float) -> _Few:
    """One measured point per voxel of each sweep, of an edge that leaves about POINTS of the largest and spans three sigma."""
    bounds = np.searchsorted(sweeps.sweep, np.arange(len(sweeps) + 1))
    largest = int(np.argmax(np.diff(bounds)))
    own = sweeps.points[bounds[largest] : bounds[largest + 1]]
    edge = max(SIGMAS * sigma_m, 1e-4 * float(np.ptp(own, axis=0).max()))
    while (n := voxel_mean(own, edge).n_cells) > 1.1 * POINTS:
        edge *= max(1.05, math.sqrt(n / POINTS))
    dense = voxel_mean(own, SIGMAS * sigma_m).n_cells if sigma_m > 0 else len(own)
    kept: list[IntArray] = []
    for a, b in pairwise(bounds.tolist()):
        rows = np.arange(a, b) if dense <= POINTS else a + np.sort(voxel_mean(sweeps.points[a:b], edge).first_row)
        kept.append(rows)
    rows = np.concatenate(kept)
    few = Sweeps(points=sweeps.points[rows], sweep=sweeps.sweep[rows], share=sweeps.share[rows], period_s=sweeps.period_s)
    return _Few(sweeps=few, edge_m=edge)


# ------------------------------------------------------------------ one after the other


def _in_turn(sweeps: Sweeps, edge: float, sigma_m: float) -> FloatArray:
    """(k + 1, 4, 4) knots: each sweep against the map of the sweeps before it, begun where an even motion would bring it."""
    bounds = np.searchsorted(sweeps.sweep, np.arange(len(sweeps) + 1))
    parts = [(sweeps.points[a:b], sweeps.share[a:b]) for a, b in pairwise(bounds.tolist())]
    T, step = [np.eye(4)], np.eye(4)
    steps = [step]
    for k in range(1, len(parts)):
        predicted = T[-1] @ step
        found = predicted
        world: _Map | None = None
        for _ in range(_FIRST_ROUNDS if k < 3 else _ROUNDS):
            if world is None or k == 1:
                steps[0] = step if k == 1 else steps[0]
                world = _Map([applied(T[j], deskewed(*parts[j], steps[j])) for j in range(max(0, k - MAP_SWEEPS), k)], edge)
            reach = REACH_EDGES * edge
            source = deskewed(*parts[k], step)
            found = _matched(source, world, found, reach, sigma_m, None if k == 1 else (predicted, *_freedom(sweeps.period_s)))
            step = inverse(T[-1]) @ found
        if k == 1:
            steps[0] = step
        T.append(found)
        steps.append(step)
    return np.array([*T, T[-1] @ step])


class _Map:
    """Points, normals and tree of the sweeps so far. Never leaves this file."""

    def __init__(self, parts: Sequence[FloatArray], edge: float) -> None:
        self.points = voxel_mean(np.concatenate(parts), edge).mean
        self.normals = pca_normals(self.points, NORMAL_NEIGHBOURS)
        self.tree = cKDTree(self.points)


def _matched(
    source: FloatArray, world: _Map, T_start: FloatArray, reach: float, sigma_m: float, prior: tuple[FloatArray, float, float] | None
) -> FloatArray:
    """The pose of a sweep by point to plane, held near a predicted one (pose, rad, m) where there is one."""
    T = T_start
    for _ in range(_ITERATIONS):
        own = applied(T, source)
        distance, near = world.tree.query(own, k=1, distance_upper_bound=reach, workers=1)
        rows = np.flatnonzero(np.isfinite(np.asarray(distance)))
        if len(rows) < 6:
            return T
        normal, to = world.normals[np.asarray(near)[rows]], world.points[np.asarray(near)[rows]]
        across = np.einsum("nc,nc->n", own[rows] - to, normal)
        scale = max(robust_scale(across), 0.5 * sigma_m, 1e-9)
        middle = own[rows].mean(axis=0)
        J = np.concatenate([np.cross(own[rows] - middle, normal), normal], axis=1)
        weight = tukey(across, scale) / (scale**2 * DEPENDENT)
        A, b = J.T @ (J * weight[:, None]), J.T @ (weight * across)
        if prior is not None:
            there = applied(prior[0] @ inverse(T), middle[None])[0]
            off = np.concatenate([Rotation.from_matrix(T[:3, :3] @ prior[0][:3, :3].T).as_rotvec(), middle - there])
            hold = np.repeat([1 / prior[1] ** 2, 1 / prior[2] ** 2], 3)
            A, b = A + np.diag(hold), b + hold * off
        x = -np.linalg.solve(A + 1e-9 * np.trace(A) / 6 * np.eye(6), b)
        R = Rotation.from_rotvec(x[:3]).as_matrix()
        T = orthonormal(rigid(R, middle + x[3:] - R @ middle) @ T)
        if float(np.abs(x).max()) < 1e-5:
            break
    return T


# ------------------------------------------------------------------ how sharp a map is


def _entropy(sweeps: Sweeps, T_world_knot: FloatArray, edge: float) -> float:
    """Mean differential entropy of the neighbourhoods of the map, nats; a sharper map has less. The same points are asked whatever the poses."""
    points = moved(sweeps.points, T_world_knot, sweeps.sweep, sweeps.share)
    rows = sampled_rows(len(points), _ENTROPY_POINTS, 0)
    tree = cKDTree(points)
    floor = (1e-3 * edge) ** 2 * np.eye(3)
    total, n = 0.0, 0
    hoods: Any = tree.query_ball_point(points[rows], _ENTROPY_EDGES * edge, workers=1)
    for near in hoods:
        if len(near) >= _LEAST_NEAR:
            total += 0.5 * float(np.linalg.slogdet(2 * math.pi * math.e * (np.cov(points[near].T) + floor))[1])
            n += 1
    return total / n if n else math.inf
