"""Short members that meet: what a welded node is made of, where neither one member nor a free form explains it.

Faces of members that meet are often in one plane, and a stub is hardly longer there than it is wide: the direction in which its surface runs farthest
is that of its neighbour. So each place may first be of several members, one per direction in which it runs nearly as far as it does at all; a member
is what runs at least half as far as its longest places. Where members share places they go to the one whose ends are farther: who runs through has
them, and of two that end there, at a corner, each has its half, as of a mitre.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.neighbors import k_nearest, radius_components
from scan2fea.segmentation.extents import Extent, extent_on_faces
from scan2fea.segmentation.pieces import LEAST_PIECE, LINK, Thin, distinct, pieces, thinned
from scan2fea.segmentation.sweeps import GAP, directions, run_lengths
from scan2fea.types import BoolArray, FloatArray, IntArray

STUB = 2.0  # length over width of a member that may meet others: below it nobody can tell along from across
_NEARLY = 0.8  # of the longest run of a place: it may be of that direction's member too
_OF_LONGEST = 0.5  # of the runs of a member
_LONGEST = 0.9  # quantile of them: a run that noise or a neighbour in line made longer is no measure
_SIGMAS, _CLOSE = 2.0, 0.25  # noise and spacings that its places may lie outside its box
_NEW = 0.05  # of the places that no longer member has


def joined_members(points: FloatArray, seed: int = 0, min_points: int = 100) -> IntArray | None:
    """(n,) label from 0 of the member that each of the points (n, 3) of one object is of, -1 of none; None where they are not two or more."""
    thin = thinned(points, seed)
    if thin is None:
        return None
    groups = _groups(thin, seed)
    if len(groups) < 2:
        return None
    labels = _apart(thin, _shared_out(thin, groups), groups)[thin.of_point]
    counts = np.bincount(labels[labels >= 0], minlength=1)
    large = np.flatnonzero(counts >= min_points)
    if len(large) < 2:
        return None
    number = np.full(len(counts) + 1, -1, np.int64)
    number[large[np.argsort(-counts[large], kind="stable")]] = np.arange(len(large))
    return number[labels]


def _groups(thin: Thin, seed: int) -> list[tuple[BoolArray, Extent]]:
    """Places (n,) and box of each member, those of most places first; a place may be of several."""
    piece, which = pieces(thin, seed)
    first = directions(thin.points, thin.normals, thin.h, seed)
    weight = np.r_[np.bincount(piece[piece >= 0], minlength=len(which)), np.zeros(len(first), np.int64)]
    axes = distinct(np.concatenate([which, first]), weight)
    runs = np.stack([run_lengths(thin.points, thin.normals, axis, thin.h) for axis in axes]) if len(axes) else np.zeros((0, len(thin.points)))
    longest = runs.max(axis=0, initial=2.0 * GAP * thin.h)
    found: list[tuple[BoolArray, BoolArray, Extent]] = []
    for axis, run in zip(axes, runs, strict=True):
        for seen in _connected(thin, run >= _NEARLY * longest):
            is_long = run >= _OF_LONGEST * float(np.quantile(run[seen], _LONGEST))
            for own in _connected(thin, seen & is_long):
                extent = extent_on_faces(thin.points[own], thin.normals[own], axis)
                if extent.length >= STUB * extent.width:
                    found.append((own, is_long, extent))
    found.sort(key=lambda one: -int(one[0].sum()))
    taken = np.zeros(len(thin.points), bool)
    groups = []
    for own, is_long, extent in found:
        if (own & ~taken).sum() >= max(LEAST_PIECE, _NEW * len(taken)):
            groups.append((own, extent))
            taken |= is_long & extent.holds(thin.points, LINK * thin.h)  # in the plane of a face slanting runs may be longer still
    return groups


def _connected(thin: Thin, rows: BoolArray) -> list[BoolArray]:
    """The connected parts of some places (n,), large enough for a member."""
    at = np.flatnonzero(rows)
    if not len(at):
        return []
    part = radius_components(thin.points[at], LINK * thin.h)
    parts = []
    for label in np.flatnonzero(np.bincount(part) >= LEAST_PIECE):
        own = np.zeros(len(rows), bool)
        own[at[part == label]] = True
        parts.append(own)
    return parts


def _shared_out(thin: Thin, groups: list[tuple[BoolArray, Extent]]) -> IntArray:
    """Member (n,) of each place: of those that have it the one whose ends are farther; else the nearest, where it lies in that one's box; -1."""
    out, best = np.full(len(thin.points), -1, np.int64), np.full(len(thin.points), -np.inf)
    margin = max(_SIGMAS * thin.sigma if np.isfinite(thin.sigma) else 0.0, _CLOSE * thin.h)
    for k, (own, extent) in enumerate(groups):
        z = (thin.points - extent.middle) @ extent.axis
        inside = np.minimum(z - extent.low[2], extent.high[2] - z)
        better = own & (inside > best) & extent.holds(thin.points, margin, to_ends=True)  # a column of its places may reach beyond its side
        out[better], best[better] = k, inside[better]
    on, left = np.flatnonzero(out >= 0), np.flatnonzero(out < 0)
    if len(left):
        near = out[on[k_nearest(thin.points[on], 1, thin.points[left])[1][:, 0]]]
        for k, (_, extent) in enumerate(groups):
            mine = left[near == k]
            out[mine[extent.holds(thin.points[mine], LINK * thin.h, to_ends=True)]] = k
    return out


def _apart(thin: Thin, member: IntArray, groups: list[tuple[BoolArray, Extent]]) -> IntArray:
    """Labels (n,) where a member that another passes through is one on either side of it, as two beams in line on a column are; -1 of none.

    What is not connected to a member but lies beside it is its own: inner faces seen through its open end.
    """
    labels, n = np.full(len(member), -1, np.int64), 0
    for k, (_, extent) in enumerate(groups):
        own = np.flatnonzero(member == k)
        z = (thin.points[own] - extent.middle) @ extent.axis
        reach = np.array([[z[part[own]].min(), z[part[own]].max()] for part in _connected(thin, member == k)]).reshape(-1, 2)
        reach = reach[np.argsort(reach[:, 0])]
        starts = reach[1:, 0] > np.maximum.accumulate(reach[:, 1])[:-1]
        borders = 0.5 * (reach[1:, 0] + np.maximum.accumulate(reach[:, 1])[:-1])[starts]
        labels[own] = n + np.searchsorted(borders, z)
        n += len(borders) + 1
    return labels
