"""Many sweeps of one moving sensor, without poses: each against the map of those before it, then all at once against the surfaces of the whole.

The sensor moves evenly within a sweep; from sweep to sweep its speed changes by what a carrier can do (`ACCELERATION`, `TURNING`) at most, and by
what the sweeps themselves tell (`joint`). A motion too small to be seen from one sweep to the next is lost in the pattern of the rings, which travels
with the sensor: sweeps are then taken several apart, until what they measure has changed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from scan2fea.errors import InternalError
from scan2fea.kernel.normals import pca_normals
from scan2fea.kernel.trajectories import between
from scan2fea.kernel.transforms import applied, inverse, rigid
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.registration.agreement import Agreement, Fans, agreement
from scan2fea.registration.borders import Ends, surface_ends
from scan2fea.registration.icp import orthonormal, robust_scale, tukey
from scan2fea.registration.joint import joint
from scan2fea.registration.motion import deskewed
from scan2fea.registration.sweeps import POINTS, SIGMAS, VISIBLE, Sweeps, change, edge_of, least_sigma, strides_of
from scan2fea.registration.told import deviations, from_first, middles, poses_at
from scan2fea.types import FloatArray, IntArray, Value

ACCELERATION, TURNING = 3.0, 4.0  # m/s2 and rad/s2: standard deviations of what carriers on wheels, sledges and in hands do
STANDS = 3.0
AGREE = 0.1
LOST = 0.5  # of a sweep contradicted by another: the search has lost its way, and no adjustment of all poses brings it back
OPEN_EDGES = 1.0  # a slide that the surfaces hold no better than this is open
MAP_SWEEPS = 30
REACH_EDGES = 5.0
NORMAL_NEIGHBOURS = 20
DEPENDENT = 5.0  # points of a sweep go together in their errors: so many count as one
_HELD = 0.5  # of a carrier's freedom: a sweep that is added is held no tighter than this, however evenly the sensor moved before
_ITERATIONS, _FIRST_ROUNDS = 30, 4
_EVERY, _WIDER = 5, (1.5, 1.2, 1.0)  # sweeps after which the last are adjusted together; how much wider planes may grow in each round of it
_SETTLING, _ROUNDS = 1, 4  # of all sweeps: the planes are grown anew in each, and the poses of the last rounds are averaged


@dataclass(frozen=True, eq=False, kw_only=True)
class Odometry(Value):
    """T_world_knot : (k + 1, 4, 4) the sensor at the start of each sweep and at the end of the last, between which its returns are placed.
    T_world_sweep, middle : (k, 4, 4) and (k,) where it was in the middle of the returns of each sweep, and at which share of the sweep's time that
    was; the world is its frame at the first.   std_m, std_rad : (k,) of these, relative to the first.   disagreement_m : of the ways found forwards
    and backwards in time, at the pose where it is largest.   changed : share of the beams whose range is not that of the first sweep in the last one,
    beyond noise and beyond what changes from one sweep to the next.   slide_m, slide : how well the surfaces alone hold a drift, and the direction
    (3,) in which they do so least; `open_m` is what they must hold.   stride : sweeps from one step of the search to the next.   used : share of
    points on surfaces.   agreement : of distant sweeps with each other under these poses.
    """

    T_world_knot: FloatArray
    T_world_sweep: FloatArray
    middle: FloatArray
    std_m: FloatArray
    std_rad: FloatArray
    disagreement_m: float
    changed: float
    slide_m: float
    slide: FloatArray
    open_m: float
    stride: int
    used: float
    agreement: Agreement

    @property
    def is_open(self) -> bool:
        """True where the surfaces leave a direction in which the sensor may have slid."""
        return self.slide_m > self.open_m

    @property
    def is_sure(self) -> bool:
        """True where both ways are one (they differ by no more than a tenth of the way, or by what chance makes of it), no direction is open and
        distant sweeps agree.
        """
        way = float(np.linalg.norm(np.diff(self.T_world_sweep[:, :3, 3], axis=0), axis=1).sum())
        chance = math.sqrt(max(float(np.nanmax(self.std_m)) ** 2 - 0.5 * self.disagreement_m**2, 0.0))
        one_way = self.disagreement_m <= max(AGREE * way, STANDS * chance)
        return one_way and self.agreement.holds and not self.is_open and not self.is_stuck

    @property
    def is_stuck(self) -> bool:
        """True where no motion was found although the ranges changed: it is hidden from the search, not absent."""
        return self._seems_still and self.changed > VISIBLE

    @property
    def stands(self) -> bool:
        """True where no pose is farther from the first than three standard deviations, and the beams say so too: their ranges have not changed."""
        return self._seems_still and self.changed <= VISIBLE

    @property
    def _seems_still(self) -> bool:
        shift = np.linalg.norm(self.T_world_sweep[:, :3, 3], axis=1)
        turn = np.linalg.norm(Rotation.from_matrix(self.T_world_sweep[:, :3, :3]).as_rotvec(), axis=1)
        return bool((shift[1:] <= STANDS * self.std_m[1:]).all() and (turn[1:] <= STANDS * self.std_rad[1:]).all())


def odometry(sweeps: Sweeps, sigma_m: float) -> Odometry:
    """The way of the sensor, found forwards and again backwards in time. sigma_m : noise of a range.

    What the two differ by at a pose is not chance alone: it is added to its standard deviation. Whether they are one way at all is `disagreement_m`.
    """
    few = _thinned(sweeps, sigma_m)
    fans = Fans(sweeps.points, sweeps.sweep, sweeps.share, sigma_m, sweeps.gap_rad)
    sigma = least_sigma(sigma_m, few.edge_m)
    changed = change(sweeps, sigma)
    back = _reversed(few.sweeps)
    stride, starts = _begun(sweeps, few.sweeps, back, few.edge_m, sigma, fans)
    ends = None if sweeps.ring is None else surface_ends(sweeps.points, sweeps.ring, sweeps.sweep, sweeps.share, sigma)
    there = _adjusted(few.sweeps, starts[0], few.edge_m, sigma, ends)
    again = _adjusted(back, starts[1], few.edge_m, sigma, None if ends is None else ends.reversed(len(sweeps)))
    middle = middles(sweeps.sweep, sweeps.share)
    ways = [np.array([from_first(T, middle) for T in rounds]) for rounds in (there.rounds, [_turned(T) for T in again.rounds])]
    means = [poses_at(_mean(rounds), middle) for rounds in ways]
    off = _apart(*means)
    # of one way: the two begin at other sweeps, and what they differ by is told apart
    scatter = np.sqrt(np.mean([_apart(means[0], poses_at(T, middle)) ** 2 for T in ways[0]], axis=0))
    std = np.sqrt(deviations(there.T_world_knot, there.covariance, middle) ** 2 + scatter**2 + 0.5 * off**2)
    T = from_first(_mean(np.concatenate(ways)), middle)
    return Odometry(
        T_world_knot=T,
        T_world_sweep=poses_at(T, middle),
        middle=middle,
        std_m=std[:, 1],
        std_rad=std[:, 0],
        disagreement_m=float(off[:, 1].max()),
        changed=changed,
        slide_m=there.slide_m,
        slide=there.slide,
        open_m=OPEN_EDGES * few.edge_m,
        stride=stride,
        used=there.used,
        agreement=agreement(fans, T),
    )


def _turned(T_world_knot: FloatArray) -> FloatArray:
    """A way found backwards in time, forwards and in the frame of its first knot."""
    turned: FloatArray = inverse(T_world_knot[-1]) @ T_world_knot[::-1]
    return turned


def _begun(sweeps: Sweeps, few: Sweeps, back: Sweeps, edge: float, sigma_m: float, fans: Fans) -> tuple[int, tuple[FloatArray, FloatArray]]:
    """Sweeps per step of the search, and the ways it found forwards and backwards: of the fewest sweeps with which both are one way.

    A way under which a sweep contradicts most of another is lost. Where no two are one way, those that differ least, or are lost least.
    """
    best: tuple[tuple[float, float], int, tuple[FloatArray, FloatArray]] | None = None
    for stride in strides_of(sweeps, sigma_m):
        there, again = (_each(_in_turn(_strided(each, stride), edge, sigma_m), stride, len(each)) for each in (few, back))
        off = float(_apart(there, _turned(again))[:, 1].max())
        way = max(float(np.linalg.norm(T[:, :3, 3], axis=1).max()) for T in (there, again))
        against = float(np.nan_to_num(agreement(fans, there).contradicted, nan=0.0))
        lost = against > LOST
        rank = (against if lost else 0.0, off)
        if best is None or rank < best[0]:
            best = (rank, stride, (there, again))
        if not lost and off <= max(AGREE * way, SIGMAS * sigma_m):
            break
    if best is None:
        raise InternalError("a search of no strides")
    return best[1:]


def _apart(T_a: FloatArray, T_b: FloatArray) -> FloatArray:
    """(k, 2) rad and m between poses."""
    apart = np.array([inverse(a) @ b for a, b in zip(T_a, T_b, strict=True)])
    turn = np.linalg.norm(Rotation.from_matrix(apart[:, :3, :3]).as_rotvec(), axis=1)
    return np.stack([turn, np.linalg.norm(apart[:, :3, 3], axis=1)], axis=1)


def _mean(rounds: FloatArray) -> FloatArray:
    """(k, 4, 4) mean poses of (r, k, 4, 4)."""
    R = [Rotation.from_matrix(rounds[:, k, :3, :3]).mean().as_matrix() for k in range(rounds.shape[1])]
    return np.array([rigid(turn, shift) for turn, shift in zip(R, rounds[:, :, :3, 3].mean(axis=0), strict=True)])


def _strided(sweeps: Sweeps, m: int) -> Sweeps:
    """Every m-th sweep, with steps of m sweeps."""
    if m == 1:
        return sweeps
    kept = sweeps.sweep % m == 0
    return Sweeps(points=sweeps.points[kept], sweep=sweeps.sweep[kept] // m, share=sweeps.share[kept] / m, period_s=sweeps.period_s * m)


def _each(T: FloatArray, m: int, n: int) -> FloatArray:
    """Poses (n + 1, 4, 4) of all sweeps from those of steps of m sweeps, evenly between them."""
    at = np.arange(n + 1) / m
    first = np.minimum(at.astype(np.int64), len(T) - 2)
    R, x = between(T, first, at - first)
    return np.array([rigid(turn, shift) for turn, shift in zip(R, x, strict=True)])


def _reversed(sweeps: Sweeps) -> Sweeps:
    order = np.arange(len(sweeps.points))[::-1]
    return Sweeps(points=sweeps.points[order], sweep=len(sweeps) - 1 - sweeps.sweep[order], share=1.0 - sweeps.share[order], period_s=sweeps.period_s)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Way(Value):
    """T_world_knot : the last of `rounds` (r, k + 1, 4, 4).   covariance : of its knots but the first."""

    T_world_knot: FloatArray
    rounds: FloatArray
    covariance: FloatArray
    slide_m: float
    slide: FloatArray
    used: float


def _adjusted(sweeps: Sweeps, T: FloatArray, edge: float, sigma_m: float, ends: Ends | None) -> _Way:
    """All knots at once, a few times over."""
    most = _freedom(sweeps.period_s)
    freedom, rounds = most, []
    for _ in range(_SETTLING + _ROUNDS):
        found = joint(sweeps.points, sweeps.sweep, sweeps.share, T, edge, sigma_m, sigma_m, freedom, most=most, ends=ends)
        T, freedom = found.T_world_knot, found.freedom
        rounds.append(T)
    kept = np.array(rounds[_SETTLING:])
    return _Way(T_world_knot=T, rounds=kept, covariance=found.covariance, slide_m=found.slide_m, slide=found.slide, used=found.used)


def _freedom(period_s: float) -> tuple[float, float]:
    """Standard deviations of the change of a step from one sweep to the next: rad, m."""
    return TURNING * period_s**2, ACCELERATION * period_s**2


@dataclass(frozen=True, eq=False, kw_only=True)
class _Few(Value):
    sweeps: Sweeps
    edge_m: float


def _thinned(sweeps: Sweeps, sigma_m: float) -> _Few:
    """One measured point per voxel of each sweep, of an edge that leaves about POINTS of the largest and spans three sigma."""
    bounds, own = sweeps.bounds(), sweeps.largest()
    edge = edge_of(sweeps, sigma_m)
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
    """(k + 1, 4, 4) knots: each sweep against the map of those before it, begun where an even motion would bring it; every few sweeps the last ones
    are adjusted together.
    """
    bounds = np.searchsorted(sweeps.sweep, np.arange(len(sweeps) + 1)).tolist()
    parts = [(sweeps.points[a:b], sweeps.share[a:b]) for a, b in pairwise(bounds)]
    most = _freedom(sweeps.period_s)
    T, freedom = [np.eye(4), np.eye(4)], most  # the end of the last sweep is the last
    for k in range(1, len(parts) + 1):
        if k < len(parts):
            held = None if k == 1 else (max(freedom[0], _HELD * most[0]), max(freedom[1], _HELD * most[1]))
            T = _added(parts, T, edge, sigma_m, held)
        if k >= _EVERY and (k % _EVERY == 0 or k == len(parts)):
            low = max(0, k - MAP_SWEEPS)
            rows = slice(bounds[low], bounds[k])
            knots, own = np.array(T[low : k + 1]), most
            for wider in _WIDER:
                found = joint(
                    sweeps.points[rows], sweeps.sweep[rows] - low, sweeps.share[rows], knots, edge, wider * sigma_m, sigma_m, own, most=most
                )
                knots, own = found.T_world_knot, found.freedom
            T[low : k + 1], freedom = list(knots), own
            if k < len(parts):
                T[k + 1] = T[k] @ inverse(T[k - 1]) @ T[k]
    return np.array(T)


def _added(
    parts: Sequence[tuple[FloatArray, FloatArray]], T: list[FloatArray], edge: float, sigma_m: float, held: tuple[float, float] | None
) -> list[FloatArray]:
    """Knots with one more: the end of the sweep before is where it begins against the map, its own end where the motion goes on evenly."""
    k = len(T) - 1
    predicted = T[k]
    found, step = predicted, inverse(T[k - 1]) @ predicted
    low = max(0, k - MAP_SWEEPS)
    world: _Map | None = None
    for _ in range(_FIRST_ROUNDS if k < 3 else 1):
        if world is None or k == 1:  # the first sweep is not known to move before the second is placed
            steps = [*(inverse(a) @ b for a, b in pairwise(T[low:k])), step]
            world = _Map([applied(T[low + i], deskewed(*parts[low + i], steps[i])) for i in range(k - low)], edge)
        prior = None if held is None else (predicted, *held)
        found = _matched(deskewed(*parts[k], step), world, found, REACH_EDGES * edge, sigma_m, prior)
        step = inverse(T[k - 1]) @ found
    return [*T[:k], found, found @ step]


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
