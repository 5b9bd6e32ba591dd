"""The particle filter (Gordon, Salmond, Smith 1993): the place of a scanner of one beam on a map that is known, from nowhere.

The thesis names it and leaves it empty (2.2). Each sweep is weighed by how near its ends lie to the map (likelihood field: Thrun, Burgard, Fox,
Probabilistic Robotics 2005, 6.4); the number of particles follows how far they are spread (KLD sampling: Fox 2003); where sweeps fit worse than they
used to, some are drawn anew where the sweep fits (augmented MCL: the same book, 8.3.5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import FusionError, InputError, require
from scan2fea.fusion.options import FusionOptions
from scan2fea.fusion.particle_kernels import bins_of, likeness, moved_on, systematic
from scan2fea.kernel.trajectories import interpolated
from scan2fea.types import FloatArray, RangeLog, Trajectory, Value

RAYS = 180  # of a sweep, at most
STRANGE = 0.1  # share of rays that meet what is not on the map
INDEPENDENT = 30.0  # rays that count: neighbours go wrong together
REACH_SIGMA = 6.0
START_M, START_RAD, MOST = 0.15, math.radians(6.0), 300_000  # between particles at the start, and how many at most
BIN_M, BIN_RAD = 0.25, math.radians(10.0)
_KLD_ERROR, _KLD_SURE = 0.05, 2.33  # of the distribution, with 99 %
_SLOW, _FAST = 0.02, 0.2
_STEP_M, _STEP_RAD = 0.01, math.radians(0.3)  # noise of every step
_WAY_SHARE, _TURN_SHARE = 0.1, 0.1  # of the way and of the turn of a step
_SPEED, _TURNING = 1.0, 1.0  # m/s, rad/s: what is not known where there is no odometry
_DRAWN = 20  # candidates for each particle that is drawn anew
FOUND_M = 0.3  # a place less sure than this is none
_CELLS = 40_000_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Field(Value):
    """Log-likelihood of the end of a ray by cell of a map. log : (h, w), row = y.   low : (2,).   edge_m : of a cell.   least : elsewhere."""

    log: FloatArray
    low: FloatArray
    edge_m: float
    least: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Located(Value):
    """trajectory : one pose per sweep (z = 0, turn about z), placed where its standard deviation is below `FOUND_M`.
    effective : (s,) effective number of particles before each resampling, 1 / sum w^2.   n_particles : (s,).   n_resampled : how often.
    n_redrawn : particles drawn anew where sweeps fitted worse than before.
    found_s : when the place was first known after the first sweep, nan for never.
    """

    trajectory: Trajectory
    effective: FloatArray
    n_particles: FloatArray
    n_resampled: int
    n_redrawn: int
    found_s: float


def likelihood_field(points: FloatArray, sigma_m: float) -> Field:
    """Of a map of points (n, 2). Raises InputError for a map without points or beyond 40 million cells."""
    from scipy.ndimage import distance_transform_edt

    require(len(points) > 0, InputError, "the map holds no point at the height of the scanner: see fusion.map_low_m and fusion.map_high_m")
    edge, margin = 0.5 * sigma_m, 2 * REACH_SIGMA * sigma_m
    low = points.min(axis=0) - margin
    shape = np.ceil((points.max(axis=0) + margin - low) / edge).astype(int) + 1
    says = f"a map of {shape[0] * edge:.0f} x {shape[1] * edge:.0f} m in cells of {edge:.3g} m is too large: raise fusion.range_m or crop it"
    require(int(shape[0]) * int(shape[1]) <= _CELLS, InputError, says)
    empty = np.ones((shape[1], shape[0]), bool)
    cell = ((points - low) / edge).astype(int)
    empty[cell[:, 1], cell[:, 0]] = False
    distance = np.minimum(distance_transform_edt(empty) * edge, REACH_SIGMA * sigma_m)
    log = np.log((1 - STRANGE) * np.exp(-0.5 * (distance / sigma_m) ** 2) + STRANGE)
    return Field(log=log, low=low, edge_m=edge, least=math.log(STRANGE))


def particle(ranges: RangeLog, points: FloatArray, odometry: Trajectory | None = None, options: FusionOptions = FusionOptions()) -> Located:
    """The pose of the scanner at the end of each sweep on the map `points` (n, 2).

    odometry : poses of the scanner of which the steps count; without it the motion is open. Raises InputError for a map or a log that is empty,
    FusionError where no sweep has a return.
    """
    require(len(ranges) > 0, InputError, "the log of ranges holds no sweep")
    field = likelihood_field(points, options.range_m)
    rng = np.random.default_rng([options.seed, 7])
    box = np.stack([points.min(axis=0), points.max(axis=0)])
    time = ranges.time_s[ranges.first[1:] - 1]
    steps, extra = _steps(time, odometry)
    n_most = int(np.clip(np.prod(np.maximum(box[1] - box[0], START_M)) / START_M**2 * 2 * math.pi / START_RAD, options.particles, MOST))
    state = _anywhere(box, n_most, rng)
    weight = np.full(n_most, 1.0 / n_most)
    n, slow, fast, n_resampled, n_redrawn = len(ranges), 0.0, 0.0, 0, 0
    pose, covariance, effective, n_particles = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros(n), np.zeros(n)
    seen = False
    for k in range(n):
        if k > 0:
            state = moved_on(state, steps[k - 1], extra[k - 1], rng.standard_normal((len(state), 3)))
        angle, distance = _rays(ranges, k)
        if len(angle):
            seen = True
            fit = likeness(state, angle, distance, field.log, field.low, field.edge_m, field.least)
            power = min(1.0, INDEPENDENT / len(angle))
            weight = weight * np.exp(power * (fit - fit.max()))
            mean_fit = float(np.exp((weight / weight.sum()) @ fit / len(angle)))
            weight = weight / weight.sum()
            slow = mean_fit if slow == 0.0 else slow + _SLOW * (mean_fit - slow)
            fast = mean_fit if fast == 0.0 else fast + _FAST * (mean_fit - fast)
        pose[k], covariance[k] = _estimate(state, weight)
        effective[k], n_particles[k] = 1.0 / float((weight**2).sum()), len(state)
        if effective[k] < 0.5 * len(state):
            wanted = _number(state, weight, box, options.particles, n_most)
            state = state[systematic(weight, float(rng.random()), wanted)]
            n_resampled += 1
            n_new = int(wanted * max(0.0, 1.0 - fast / slow)) if len(angle) else 0
            if n_new:
                candidates = _anywhere(box, _DRAWN * n_new, rng)
                fit = likeness(candidates, angle, distance, field.log, field.low, field.edge_m, field.least)
                chance = np.exp(power * (fit - fit.max()))
                state[rng.permutation(wanted)[:n_new]] = candidates[systematic(chance / chance.sum(), float(rng.random()), n_new)]
                n_redrawn += n_new
            weight = np.full(wanted, 1.0 / wanted)
    require(seen, FusionError, "no sweep of the log of ranges has a return: nothing tells the place")
    trajectory = _trajectory(time, pose, covariance)
    known = np.flatnonzero(trajectory.placed)
    return Located(
        trajectory=trajectory,
        effective=effective,
        n_particles=n_particles,
        n_resampled=n_resampled,
        n_redrawn=n_redrawn,
        found_s=float(time[known[0]] - ranges.time_s[0]) if len(known) else math.nan,
    )


def _anywhere(box: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
    """(n, 3) places and headings spread evenly."""
    drawn: FloatArray = rng.random((n, 3))
    drawn[:, :2] = box[0] + drawn[:, :2] * (box[1] - box[0])
    drawn[:, 2] *= 2 * math.pi
    return drawn


def _rays(ranges: RangeLog, k: int) -> tuple[FloatArray, FloatArray]:
    """Angles and ranges of the returns of sweep k, at most `RAYS` spread evenly over them."""
    rows = np.arange(ranges.first[k], ranges.first[k + 1])
    rows = rows[np.isfinite(ranges.range_m[rows])]
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(RAYS, len(rows))).astype(int))] if len(rows) else rows
    return ranges.angle[rows], ranges.range_m[rows]


def _steps(time_s: FloatArray, odometry: Trajectory | None) -> tuple[FloatArray, FloatArray]:
    """(s - 1, 3) steps in the frame of the scanner before them, and their standard deviations: along both axes and the turn."""
    dt = np.diff(time_s)
    if odometry is None or odometry.time_s is None:
        sigma = np.stack([_SPEED * dt, _SPEED * dt, _TURNING * dt], axis=1)
        return np.zeros((len(dt), 3)), sigma + np.array([_STEP_M, _STEP_M, _STEP_RAD])
    T = interpolated(odometry, np.clip(time_s, odometry.time_s[0], odometry.time_s[-1])).T_world_frame
    step = np.linalg.inv(T[:-1]) @ T[1:]
    turn = np.arctan2(step[:, 1, 0], step[:, 0, 0])
    way = np.linalg.norm(step[:, :2, 3], axis=1)
    sigma = np.stack([_STEP_M + _WAY_SHARE * way, _STEP_M + _WAY_SHARE * way, _STEP_RAD + _TURN_SHARE * np.abs(turn)], axis=1)
    return np.column_stack([step[:, 0, 3], step[:, 1, 3], turn]), sigma


def _number(state: FloatArray, weight: FloatArray, box: FloatArray, least: int, most: int) -> int:
    """How many particles the spread asks for (KLD sampling)."""
    bins = bins_of(state[weight > weight.max() * 1e-6], box[0], BIN_M, BIN_RAD)
    k = len(np.unique(bins))
    if k < 2:
        return least
    a = 2.0 / (9.0 * (k - 1))
    return int(np.clip((k - 1) / (2 * _KLD_ERROR) * (1 - a + math.sqrt(a) * _KLD_SURE) ** 3, least, most))


def _estimate(state: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The mean of the particles around the likeliest bin, and the second moments (3, 3) of all about it."""
    bins = bins_of(state, state[:, :2].min(axis=0), BIN_M, BIN_RAD)
    _, packed = np.unique(bins, return_inverse=True)
    best = state[np.flatnonzero(packed == np.argmax(np.bincount(packed, weight)))]
    centre = best.mean(axis=0)
    centre[2] = math.atan2(np.sin(best[:, 2]).mean(), np.cos(best[:, 2]).mean())
    for _ in range(2):
        away = _differences(state, centre)
        near = weight * ((np.abs(away[:, :2]) < 2 * BIN_M).all(axis=1) & (np.abs(away[:, 2]) < 2 * BIN_RAD))
        centre = centre + near @ away / max(float(near.sum()), 1e-300)
    away = _differences(state, centre)
    return centre, (away * weight[:, None]).T @ away


def _differences(state: FloatArray, centre: FloatArray) -> FloatArray:
    away: FloatArray = state - centre
    away[:, 2] = np.mod(away[:, 2] + math.pi, 2 * math.pi) - math.pi
    return away


def _trajectory(time_s: FloatArray, pose: FloatArray, covariance: FloatArray) -> Trajectory:
    T = np.tile(np.eye(4), (len(pose), 1, 1))
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1], T[:, :2, 3] = c, -s, s, c, pose[:, :2]
    P = np.zeros((len(pose), 6, 6))
    axes = np.array([0, 1, 5])
    P[:, axes[:, None], axes] = covariance
    placed = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1]) < FOUND_M
    return Trajectory(T_world_frame=T, placed=placed, time_s=time_s, covariance=P)
