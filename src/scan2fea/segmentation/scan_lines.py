"""Parts that only the gap between two scan lines keeps apart: a rotating LiDAR's rings lie farther apart than their own points do.

A ring sees nothing up to the next one. Where two parts lie one above the other as the sensor sees them, no farther apart than adjacent rings are at
that range, and as near as neighbours are along and across the ring, nothing tells them apart: they are one. Side by side they stay two.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.spanning_tree import tree_parts
from scan2fea.types import BoolArray, FloatArray, IntArray, Rays, Scan

_SLACK = 1.25  # of the gap between two rings: they are not quite where their mean is
_SHARE = 0.1  # of the smaller part that must have a neighbour in the other
_NEAREST = 8
_LEAST_OF_RING = 8


def across_lines(scan: Scan, parts: Sequence[IntArray], radius_m: float) -> tuple[list[IntArray], BoolArray]:
    """The parts (rows of the cloud), with those put together that are adjacent rings of one thing, and which points (n,) are on such.

    They stay as they are where rings are not known.
    """
    joined = np.zeros(len(scan.cloud), bool)
    known = np.flatnonzero(scan.cloud.ray >= 0)
    if scan.rays is None or scan.rays.ring is None or len(parts) < 2 or not len(known):
        return list(parts), joined
    number = np.full(len(scan.cloud), -1)
    for k, rows in enumerate(parts):
        number[rows] = k
    up, gap = _views(scan, scan.rays, known)
    known, up, gap = known[gap > 0], up[gap > 0], gap[gap > 0]
    edges: list[tuple[int, int]] = []
    by_size = sorted(range(len(parts)), key=lambda k: len(parts[k]))
    own = {k: np.flatnonzero(number[known] == k) for k in by_size}
    points, rays = scan.cloud.points, scan.rays.direction[scan.cloud.ray[known]]
    low = np.array([points[rows].min(axis=0) for rows in parts])
    high = np.array([points[rows].max(axis=0) for rows in parts])
    for i, k in enumerate(by_size):
        reach = _reach(gap[own[k]], radius_m)
        for other in by_size[i + 1 :]:
            is_far = (np.maximum(low[k] - high[other], low[other] - high[k]) > reach).any()
            if not is_far and _are_adjacent(points[known[own[k]]], rays[own[k]], up[own[k]], gap[own[k]], points[parts[other]], radius_m):
                edges.append((k, other))
    if not edges:
        return list(parts), joined
    whole = tree_parts(np.array(edges, np.int64), len(parts))
    for rows, is_one_of_many in zip(parts, np.bincount(whole)[whole] > 1, strict=True):
        joined[rows] = is_one_of_many
    return [np.sort(np.concatenate([parts[k] for k in np.flatnonzero(whole == n).tolist()])) for n in range(int(whole.max()) + 1)], joined


def _views(scan: Scan, rays: Rays, known: IntArray) -> tuple[FloatArray, FloatArray]:
    """Of the points `known` (m,): the direction (m, 3) in which the next ring lies, and how far off it is, m; 0 where that is not told."""
    ring, frame = np.asarray(rays.ring)[scan.cloud.ray[known]], scan.cloud.frame[known]
    direction, depth = rays.direction[scan.cloud.ray[known]], rays.range_m[scan.cloud.ray[known]]
    axis, last = np.full((len(known), 3), np.nan), np.zeros(3)
    for f in np.unique(frame):
        mine = np.flatnonzero(frame == f)
        found = _spin_axis(direction[mine], ring[mine])
        axis[mine] = found if found @ last >= 0 or np.isnan(found).any() else -found  # a sensor is not turned over from frame to frame
        last = last if np.isnan(found).any() else axis[mine[0]]
    sine = np.einsum("nc,nc->n", direction, axis)
    rings, at = np.unique(ring, return_inverse=True)
    is_known = np.isfinite(sine)
    n_known = np.bincount(at, is_known, len(rings))
    mean = np.bincount(at, np.where(is_known, sine, 0.0), len(rings)) / np.maximum(n_known, 1)
    elevation = np.where(n_known >= _LEAST_OF_RING, np.arcsin(np.clip(mean, -1, 1)), np.nan)
    told = np.flatnonzero(np.isfinite(elevation))
    step = np.zeros(len(rings))
    if len(told) > 1:
        order = told[np.argsort(elevation[told])]
        apart = np.diff(elevation[order])
        step[order] = np.minimum(np.append(apart, apart[-1]), np.append(apart[0], apart))  # rings that hit nothing are no gap
    up = axis - sine[:, None] * direction
    up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-12)
    gap = np.where(is_known & np.isfinite(depth), depth * step[at], 0.0)
    return up, gap


def _spin_axis(direction: FloatArray, ring: IntArray) -> FloatArray:
    """The axis (3,) about which a sensor turns: rays (n, 3) of one ring keep their height along it. nan where too few rings tell."""
    _, at, counts = np.unique(ring, return_inverse=True, return_counts=True)
    keep = counts[at] >= _LEAST_OF_RING
    if (counts >= _LEAST_OF_RING).sum() < 2:
        return np.full(3, np.nan)
    mean = np.stack([np.bincount(at, direction[:, c]) for c in range(3)], 1) / counts[:, None]
    off = (direction - mean[at])[keep]
    axis: FloatArray = np.linalg.eigh(off.T @ off)[1][:, 0]
    return axis


def _reach(gap: FloatArray, radius_m: float) -> float:
    """How far a neighbour on the next ring may be; below every distance where no ring is told."""
    return _SLACK * float(gap.max()) + radius_m if len(gap) else -np.inf


def _are_adjacent(points: FloatArray, rays: FloatArray, up: FloatArray, gap: FloatArray, others: FloatArray, radius_m: float) -> bool:
    """Whether a tenth of the points (n, 3) has one of the others within a gap of rings, up or down, and a radius along and across the ring."""
    reach = _reach(gap, radius_m)
    near = others[((others >= points.min(axis=0) - reach) & (others <= points.max(axis=0) + reach)).all(axis=1)]
    if not len(near):
        return False
    offset = near[k_nearest(near, min(_NEAREST, len(near)), points)[1]] - points[:, None]
    high = np.abs(np.einsum("nkc,nc->nk", offset, up))
    deep = np.abs(np.einsum("nkc,nc->nk", offset, rays))
    wide = np.sqrt(np.maximum((offset**2).sum(axis=2) - high**2 - deep**2, 0.0))
    linked = ((high <= _SLACK * gap[:, None]) & (deep <= radius_m) & (wide <= radius_m)).any(axis=1)
    return bool(linked.mean() >= _SHARE)
