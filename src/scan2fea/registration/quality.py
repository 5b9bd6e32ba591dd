"""How far a registration of two frames can be trusted: overlap, residual, and which directions it leaves open."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.near_tree import NearTree, near_tree, nearest_of
from scan2fea.kernel.transforms import applied, inverse, rotated
from scan2fea.registration.icp import LEAST_PAIRS, is_facing, jacobian, robust_scale, tukey
from scan2fea.registration.pairing import Pairs, pairs_of
from scan2fea.registration.surface import NORMAL_NEIGHBORS, Surface
from scan2fea.types import BoolArray, FloatArray, Value

AGREE_EDGES = 0.75  # surfaces that are one lie within this of each other, across
NEAR_EDGES = 5.0  # and points nearer than this to the other surface should lie on it, were it one
BLOCKS = 4  # per axis: residuals of one block go together (distortion of a scan, one badly seen face)
_OPEN = 4.0  # standard deviations of chance by which the information of a direction must exceed what noise of the normals gives
_LEAST_SHARE = 1e-4  # of the pairs' full information: below it (normals within 0.6 degrees of the plane) a direction is open
CREASE_EDGES = 0.5  # standard deviation of what creases and rims tell
_FULL_RANK = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class Quality(Value):
    """What one link between two frames is worth.

    overlap : share of the smaller frame's points that lie on the other.   consistency : of the points near the other surface, the share that
    lies on it: 1 for one surface, small for two that cross.   blocked : share of the
    points of one frame that stand where the other looked through, nan where no station is known.   residual_m : robust standard deviation across.
     centre : (3,) in the target, about
    which the rest is expressed.   information : (6, 6) of (rotation vector about the centre, translation), open directions zero: how sharply the
    points deny another place.   told : (6, 6), how well they tell it (see `_told`).   covariance : (6, 6), of that; nan rows where open.
    open_directions : (k, 6) unit, rotations times `size_m`: what the
    surfaces do not tell.   size_m : radius of gyration of the matched points.
    """

    overlap: float
    consistency: float
    blocked: float
    residual_m: float
    n_pairs: int
    centre: FloatArray
    information: FloatArray
    told: FloatArray
    covariance: FloatArray
    open_directions: FloatArray
    size_m: float

    @property
    def is_degenerate(self) -> bool:
        return len(self.open_directions) > 0

    @property
    def std_m(self) -> float:
        """Of the place of the centre; nan where a direction is open."""
        return float(np.sqrt(max(np.trace(self.covariance[3:, 3:]), 0.0))) if not self.is_degenerate else math.nan

    @property
    def std_rad(self) -> float:
        return float(np.sqrt(max(np.trace(self.covariance[:3, :3]), 0.0))) if not self.is_degenerate else math.nan


def judge(source: Surface, target: Surface, tree: NearTree, T_target_source: FloatArray) -> Quality:
    """Quality of a motion that ICP has converged to."""
    edge = max(source.edge_m, target.edge_m)
    pairs = pairs_of(source, target, tree, T_target_source, NEAR_EDGES * edge)
    n = len(pairs.across_m)
    near = _near(source, target, tree, T_target_source, NEAR_EDGES * edge)
    on = _lies_on(pairs, target, edge)
    hit = max(int(on.sum()), 0)
    smaller = min(len(source), len(target))
    overlap, consistency = hit / max(smaller, 1), hit / max(near, 1)
    if hit < LEAST_PAIRS or n < LEAST_PAIRS:
        nothing = np.full((6, 6), np.nan)
        return Quality(
            overlap=overlap,
            consistency=consistency,
            blocked=math.nan,
            residual_m=math.nan,
            n_pairs=hit,
            centre=np.zeros(3),
            information=np.zeros((6, 6)),
            told=np.zeros((6, 6)),
            covariance=nothing,
            open_directions=np.eye(6),
            size_m=0.0,
        )
    used = _rows(pairs, on)
    scale = max(robust_scale(used.across_m), 1e-6 * edge)
    centre = used.moved.mean(axis=0)
    size = max(float(np.sqrt(((used.moved - centre) ** 2).sum(axis=1).mean())), 1e-300)
    openings = open_directions(used, centre, size)
    real = np.diag([size] * 3 + [1.0] * 3)
    information = real @ information_of(used, centre, size, scale, openings) @ real
    told, covariance = _told(used, source, target, edge, centre, size, scale, openings)
    return Quality(
        overlap=min(overlap, 1.0),
        consistency=consistency,
        blocked=blocked_share(source, target, T_target_source),
        residual_m=scale,
        n_pairs=hit,
        centre=centre,
        information=information,
        told=told,
        covariance=covariance,
        open_directions=openings,
        size_m=size,
    )


def blocked_share(source: Surface, target: Surface, T_target_source: FloatArray) -> float:
    """The larger of the two shares of points that stand in a line of sight of the other frame's station, before what it saw there."""
    edge = max(source.edge_m, target.edge_m)
    shares = [
        _in_front(applied(T_target_source, source.points), target, edge),
        _in_front(applied(inverse(T_target_source), target.points), source, edge),
    ]
    known = [share for share in shares if np.isfinite(share)]
    return max(known, default=math.nan)


def _in_front(points: FloatArray, seen: Surface, edge: float) -> float:
    """Of the points (in the frame of `seen`) that lie in a direction in which its station saw something, the share nearer by 3 edges."""
    if not np.isfinite(seen.station).all():
        return math.nan
    there, here = seen.points - seen.station, points - seen.station
    far, own = np.linalg.norm(there, axis=1), np.linalg.norm(here, axis=1)
    sure = own > edge
    tree = near_tree(there[far > 0] / far[far > 0, None])
    angle, near = nearest_of(tree, here[sure] / own[sure, None])
    far = far[far > 0][near]
    same = angle * far <= 0.7 * edge
    if same.sum() < LEAST_PAIRS:
        return math.nan
    return float((own[sure][same] < far[same] - 3.0 * edge).mean())


def _near(source: Surface, target: Surface, tree: NearTree, T: FloatArray, reach: float) -> int:
    """Points near the other surface. Two sides of a wall, where the sensors tell them apart, are near each other and yet say nothing."""
    distance, near = nearest_of(tree, applied(T, source.points), reach)
    rows = np.flatnonzero(np.isfinite(distance))
    both = source.is_seen[rows] & target.is_seen[near[rows]]
    cosine = np.einsum("nc,nc->n", rotated(T, source.normals[rows]), target.normals[near[rows]])
    return int((~both | (cosine > 0)).sum())


def _lies_on(pairs: Pairs, target: Surface, edge: float) -> BoolArray:
    """Across within 0.75 edges, beside within 1.5 edges."""
    offset = pairs.moved - target.points[pairs.target]
    aside2 = np.maximum((offset**2).sum(axis=1) - pairs.across_m**2, 0.0)
    return np.asarray((np.abs(pairs.across_m) <= AGREE_EDGES * edge) & (aside2 <= (1.5 * edge) ** 2))


def _rows(pairs: Pairs, mask: BoolArray) -> Pairs:
    return Pairs(
        source=pairs.source[mask],
        target=pairs.target[mask],
        moved=pairs.moved[mask],
        normal=pairs.normal[mask],
        normal_source=pairs.normal_source[mask],
        normal_target=pairs.normal_target[mask],
        across_m=pairs.across_m[mask],
    )


def open_directions(pairs: Pairs, centre: FloatArray, size: float) -> FloatArray:
    """(k, 6) unit motions, rotation times `size` first, that leave the matched surfaces on each other.

    The information of one normal squared would count the noise of the normals as shape: a plane would seem to hold in all directions. The product of
    the two frames' normals has no such bias, because their noise is independent: sum (J_s' J_t + J_t' J_s) / 2. A direction is open where that
    is not larger than chance makes it.
    """
    x = (pairs.moved - centre) / size
    firm = is_facing(pairs)
    if firm.sum() < _FULL_RANK:
        return np.eye(6)
    Js = jacobian(x[firm], pairs.normal_source[firm], np.zeros(3))
    Jt = jacobian(x[firm], pairs.normal_target[firm], np.zeros(3))
    cross = 0.5 * (Js.T @ Jt + Jt.T @ Js) / len(Js)
    values, axes = np.linalg.eigh(cross)
    along_s, along_t = Js @ axes, Jt @ axes
    # an open direction shows noise alone: its products scatter by the variance of the normals' noise; neighbours share 14 points each
    noise = ((along_s - along_t) ** 2).mean(axis=0) / 2.0
    limit = np.maximum(_OPEN * noise * math.sqrt(NORMAL_NEIGHBORS / len(Js)), _LEAST_SHARE)
    return np.asarray(axes[:, values <= limit].T)


def _told(
    used: Pairs, source: Surface, target: Surface, edge: float, centre: FloatArray, size: float, scale: float, openings: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(6, 6) information and covariance of (rotation vector about the centre, translation) without the open directions.

    What smooth surface tells, and the cells of creases and rims no better than half an edge: their normals and means lean to whichever of the faces
    was seen, by station, so that they hold a slide at a place that is off by as much, however many they are.
    """
    smooth = _rows(used, source.is_smooth[used.source] & target.is_smooth[used.target])
    keep = np.eye(6) - openings.T @ openings
    information = keep / (CREASE_EDGES * edge) ** 2
    if len(smooth.across_m) >= LEAST_PAIRS:
        information = information + information_of(smooth, centre, size, scale, open_directions(smooth, centre, size))
    covariance = _pinv(keep @ information @ keep)
    information = _pinv(covariance)
    real = np.diag([1 / size] * 3 + [1.0] * 3)
    covariance, information = real @ covariance @ real, np.linalg.inv(real) @ information @ np.linalg.inv(real)
    if len(openings):
        covariance = np.where(np.any(np.abs(openings) > 1e-3, axis=0)[:, None], np.nan, covariance)
    return information, covariance


def information_of(pairs: Pairs, centre: FloatArray, size: float, scale: float, openings: FloatArray) -> FloatArray:
    """(6, 6) information of (rotation vector about the centre times `size`, translation) without the open directions.

    It allows residuals to go together within a block of the scene (a sandwich of block sums: A^-1 (sum g_b g_b') A^-1, Liang, Zeger
    1986, times b / (b - 6)): thousands of points on one face that is bent by 1 mm do not make a pose sure to a micrometre.
    """
    J = jacobian((pairs.moved - centre) / size, pairs.normal, np.zeros(3))
    w = tukey(pairs.across_m, scale)
    A = J.T @ (J * w[:, None])
    keep = np.eye(6) - openings.T @ openings
    A = keep @ A @ keep
    inverse = np.linalg.pinv(A, rcond=1e-12, hermitian=True)
    low, extent = pairs.moved.min(axis=0), max(float(np.ptp(pairs.moved, axis=0).max()), 1e-300)
    cell = np.minimum((pairs.moved - low) / extent * BLOCKS, BLOCKS - 1).astype(np.int64) @ np.array([1, BLOCKS, BLOCKS**2])
    _, block = np.unique(cell, return_inverse=True)
    b = int(block.max()) + 1
    score = np.zeros((b, 6))
    np.add.at(score, block, J * (w * pairs.across_m)[:, None])
    independent = inverse * scale**2
    sandwich = inverse @ (keep @ (score.T @ score) @ keep) @ inverse * (b / max(b - _FULL_RANK, 1))
    # never surer than independent residuals would be: few blocks may agree by chance
    return _pinv(keep @ (sandwich + independent) @ keep)


def _pinv(C: FloatArray) -> FloatArray:
    """Inverse on what C spans; symmetric."""
    values, axes = np.linalg.eigh(0.5 * (C + C.T))
    usable = values > 1e-10 * max(float(values[-1]), 1e-300)
    found: FloatArray = (axes[:, usable] / values[usable]) @ axes[:, usable].T
    return found
