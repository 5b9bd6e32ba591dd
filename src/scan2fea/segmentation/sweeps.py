"""Directions along which surfaces run straight, and how far they do: what a prismatic member looks like from its points alone.

A member is a section swept along an axis: every normal is square to that axis, and each place of the section shows points all along it. So for one
direction, the points whose normal is square to it are put into narrow columns along it, and the length of the unbroken run that a point lies in says
how far the surface goes on there. Of several directions the one of the longest run is the point's own: the web of a beam that meets a column is as
parallel to the column's axis as the column is, but only as long as the web is deep.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.types import BoolArray, FloatArray, IntArray

SQUARE = 0.35  # sine of the tilt that a normal may have against square to the axis: noise and rounded edges
COLUMN = 2.0  # spacings: width of a column
GAP = 4.0  # spacings: a longer gap ends a run; a column holds two points a spacing
SHOWS = 0.75  # of its columns: less, and a section is not there
OF_SECTION = 0.3  # of the slices in which a column of the section holds points
SLICE = 2.0  # spacings: thickness of a slice across; with its column it holds four points
_PAIRS = 6  # normals compared with that of a point
_REACH = 8.0  # spacings: how far apart they lie
_NEAR = int(np.pi * _REACH**2)  # points of a sheet within that
_ANGLE = 0.5  # sine of the least angle between two normals whose product is a direction
_VOTERS = 1_500  # points asked for votes
_MOST_VOTES, _CANDIDATES = 4_000, 600  # votes that are counted, and those of them that stand for election
_SAME = 0.9962  # cosine of 5 degrees: votes for one direction
_OTHER = 0.9848  # cosine of 10 degrees: votes that are used up with it
_LEAST_VOTES = 0.005
_MOST_DIRECTIONS = 16
ONE_FACE = 0.1  # second moment of the normals square to their main direction: less, and all are alike
_SCALES = (96, 256)  # neighbours whose cloud may be a line
_LINE = 3.0  # length over width from which it is one
_TURN, _ASKED, _FEWER = 0.035, 3_000, 1.1  # two degrees; points that tell a straighter axis; how much more of them share a column then


def across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors square to the axis (3,) and to each other."""
    u = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    u /= np.linalg.norm(u)
    return u, np.cross(axis, u)


def directions(points: FloatArray, normals: FloatArray, h: float, seed: int) -> FloatArray:
    """(d, 3) unit directions in which the surfaces run, the most frequent first.

    Votes: the product of two normals near each other that differ by 30 degrees or more (an edge of a prism, or its curved face), and the long axis of
    neighbourhoods that are long (bars too thin to show two faces). Votes within 5 degrees make a direction.
    """
    rng = np.random.default_rng(seed)
    rows = rng.choice(len(points), min(len(points), _VOTERS), replace=False)
    distance, near = k_nearest(points, max(_NEAR, *_SCALES), points[rows])
    votes = np.concatenate([_products(normals, rows, distance[:, :_NEAR], near[:, :_NEAR], _REACH * h, rng), _lines(points, near)])
    votes = votes[rng.permutation(len(votes))[:_MOST_VOTES]]
    found: list[FloatArray] = []
    n_votes = len(votes)
    while len(votes) and len(found) < _MOST_DIRECTIONS:
        near = np.abs(votes[:_CANDIDATES] @ votes.T) >= _SAME
        best = near[int(near.sum(axis=1).argmax())]
        if best.sum() < max(3.0, _LEAST_VOTES * n_votes):
            break
        axis = _mean_direction(votes[best])
        for _ in range(2):  # to where the votes are densest
            axis = _mean_direction(votes[np.abs(votes @ axis) >= _SAME])
        found.append(axis)
        votes = votes[np.abs(votes @ axis) < _OTHER]
    return np.array(found).reshape(-1, 3)


def _mean_direction(votes: FloatArray) -> FloatArray:
    axis: FloatArray = np.linalg.eigh(votes.T @ votes)[1][:, 2]
    return axis


def _products(
    normals: FloatArray, rows: IntArray, distance: FloatArray, near: IntArray, reach: float, rng: np.random.Generator
) -> FloatArray:
    votes = []
    for _ in range(_PAIRS):
        pick = rng.integers(near.shape[1], size=len(rows))
        other = near[np.arange(len(rows)), pick]
        product = np.cross(normals[rows], normals[other])
        size = np.linalg.norm(product, axis=1)
        ok = (size > _ANGLE) & (distance[np.arange(len(rows)), pick] <= reach)
        votes.append(product[ok] / size[ok, None])
    return np.concatenate(votes)


def _lines(points: FloatArray, near: IntArray) -> FloatArray:
    votes = []
    for k in _SCALES:
        patch = points[near[:, :k]]
        patch = patch - patch.mean(axis=1, keepdims=True)
        values, axes = np.linalg.eigh(np.einsum("mki,mkj->mij", patch, patch))
        votes.append(axes[values[:, 2] > _LINE**2 * values[:, 1], :, 2])
    return np.concatenate(votes)


def run_lengths(points: FloatArray, normals: FloatArray, axis: FloatArray, h: float) -> FloatArray:
    """(n,) length of the unbroken run along the axis that each point lies in, m; 0 where its normal is not square to it.

    The longer of two, with columns shifted by half their width: a face along a border would alternate between two columns.
    """
    rows = np.flatnonzero(np.abs(normals @ axis) < SQUARE)
    length = np.zeros(len(points))
    u, v = across(axis)
    flat, z = np.stack([points[rows] @ u, points[rows] @ v], 1) / (COLUMN * h), points[rows] @ axis
    up = (z - z.min()) / (np.ptp(z) * (1.0 + 1e-6)) if len(z) and np.ptp(z) > 0 else np.zeros(len(z))  # 0 <= up < 1
    for shift in (0.0, 0.5):
        column = np.floor(flat + shift).astype(np.int64)
        column -= column.min(axis=0, initial=0)
        key = column[:, 0] * (int(column[:, 1].max(initial=0)) + 1) + column[:, 1]
        order = np.argsort(key + up)  # by column, then along the axis
        starts = (np.diff(key[order], prepend=-1) != 0) | (np.diff(z[order], prepend=0.0) > GAP * h)
        run = np.cumsum(starts) - 1
        first = np.flatnonzero(starts)
        last = np.append(first[1:], len(order)) - 1
        extent = z[order][last] - z[order][first] if len(order) else np.zeros(0)
        length[rows[order]] = np.maximum(length[rows[order]], extent[run])
    return length


def refined_axis(points: FloatArray, normals: FloatArray, axis: FloatArray) -> FloatArray:
    """The direction (3,) that the normals (n, 3) of one member are most nearly square to; of a single face its long axis, if near to `axis`."""
    values, vectors = np.linalg.eigh(normals.T @ normals / len(normals))
    found = vectors[:, 0]
    if values[1] < ONE_FACE:
        centred = points - points.mean(axis=0)
        found = np.linalg.eigh(centred.T @ centred)[1][:, 2]
    return found if abs(float(found @ axis)) >= _OTHER else axis


def straightened(points: FloatArray, axis: FloatArray, h: float) -> FloatArray:
    """The axis (3,) of a long piece (n, 3), turned by at most two degrees to where its points fill the fewest columns along it.

    What normals of neighbours tell is a degree off where walls are thinner than points lie apart: over a long beam that is wider than a column.
    """
    centred = points[:: max(1, len(points) // _ASKED)] - points.mean(axis=0)
    half = float(np.ptp(centred @ axis)) / 2
    n = int(_TURN * half / h)  # steps of a spacing at the ends; of shorter pieces a column holds both all the same
    found, before, after = axis, 0.0, 0.0
    for step, reach in ((h / half, n), (h / half / 2, 1), (h / half / 4, 1)) if n > 2 else ():
        u, v = across(found)
        flat, z = np.stack([centred @ u, centred @ v], 1), centred @ found
        crowds = {(i * step, j * step): 0.0 for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)}
        crowds = {turn: _crowding(flat - z[:, None] * turn, h) for turn in crowds}
        best = max(crowds, key=lambda turn: (crowds[turn], -abs(turn[0]) - abs(turn[1])))
        before, after = before or crowds[0.0, 0.0], crowds[best]
        found = found + best[0] * u + best[1] * v
        found = found / np.linalg.norm(found)
    return found if after > _FEWER * before else axis


def _crowding(flat: FloatArray, h: float) -> float:
    """Mean number of points (n, 2) that share a column with a point."""
    column = np.floor(flat / h).astype(np.int64)
    column -= column.min(axis=0)
    counts = np.bincount(column[:, 0] * (int(column[:, 1].max()) + 1) + column[:, 1])
    return float((counts.astype(float) ** 2).sum()) / len(flat)


def slice_profile(points: FloatArray, axis: FloatArray, h: float) -> tuple[FloatArray, IntArray]:
    """How much of the section shows in each slice along the axis: share (s,) of the section's columns, and the slice (n,) of each point.

    The section is the set of columns that hold points in 30 % of the slices.
    """
    u, v = across(axis)
    column = np.floor(np.stack([points @ u, points @ v], 1) / (COLUMN * h)).astype(np.int64)
    z = points @ axis
    at = np.floor((z - z.min()) / (SLICE * h)).astype(np.int64)
    column -= column.min(axis=0)
    number = np.unique(column[:, 0] * (int(column[:, 1].max()) + 1) + column[:, 1], return_inverse=True)[1].ravel()
    seen: BoolArray = np.zeros((int(number.max()) + 1, int(at.max()) + 1), bool)
    seen[number, at] = True
    of_section = seen.mean(axis=1) >= OF_SECTION
    if not of_section.any():
        of_section = np.ones(len(seen), bool)
    return seen[of_section].mean(axis=0), at
