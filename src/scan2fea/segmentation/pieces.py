"""Pieces of a cloud of touching members: neighbours whose surface runs farthest in one direction (`sweeps`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.near_tree import near_tree
from scan2fea.kernel.neighbors import radius_components
from scan2fea.kernel.noise import noise_sigma, spacing
from scan2fea.kernel.normals import pca_normals
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.segmentation.sweeps import GAP, directions, refined_axis, run_lengths, straightened
from scan2fea.types import FloatArray, IntArray, Value

_MOST = 40_000  # points that are looked at
_LEAST = 300
NORMAL_NEIGHBOURS = 16
_DISTINCT = 0.9994  # cosine of 2 degrees
_NEARLY = 0.8  # of the longest run: of such directions the one of most points is taken
LEAST_PIECE = 3 * NORMAL_NEIGHBOURS
LINK = 3.5  # spacings: neighbours on one surface (radius.link_radius)


@dataclass(frozen=True, eq=False, kw_only=True)
class Thin(Value):
    """Points (n, 3) of even density h, their normals, the point (m,) that stands for each given one, and the spacing and noise of these, m."""

    points: FloatArray
    normals: FloatArray
    h: float
    of_point: IntArray
    spacing: float
    sigma: float


def thinned(points: FloatArray, seed: int) -> Thin | None:
    """Means of voxels as wide as the points lie apart, or twice their noise; wider where that leaves too many."""
    tree = near_tree(points)
    h, sigma = spacing(points, seed, tree), noise_sigma(points, seed=seed, tree=tree)
    if not h > 0:
        return None
    edge = max(h, 2.0 * sigma) if np.isfinite(sigma) else h
    cells = voxel_mean(points - points.min(axis=0), edge)
    for _ in range(6):
        if len(cells.mean) <= _MOST:
            break
        edge *= 1.05 * float(np.sqrt(len(cells.mean) / _MOST))
        cells = voxel_mean(points - points.min(axis=0), edge)
    if len(cells.mean) < _LEAST:
        return None
    xyz, of_point = cells.mean, cells.cell_of_point
    normals = pca_normals(xyz, NORMAL_NEIGHBOURS)
    return Thin(points=xyz, normals=normals, h=spacing(xyz, seed), of_point=of_point, spacing=h, sigma=sigma)


def pieces(thin: Thin, seed: int) -> tuple[IntArray, FloatArray]:
    """Piece (n,) of each point, -1 none, and the axis (p, 3) of each. Twice: the axes of the first pieces are better directions than votes."""
    axes = directions(thin.points, thin.normals, thin.h, seed)
    piece, which = np.full(len(thin.points), -1, np.int64), axes
    for _ in range(2):
        if not len(axes):
            break
        runs = np.stack([run_lengths(thin.points, thin.normals, axis, thin.h) for axis in axes])
        longest = runs.max(axis=0)
        own = np.where(longest >= 2.0 * GAP * thin.h, (runs >= _NEARLY * longest).argmax(axis=0), -1)  # of axes that do as well the first
        piece, which = _connected(thin, own, axes)
        axes = distinct(which, np.bincount(piece[piece >= 0], minlength=len(which)))
    return piece, which


def _connected(thin: Thin, own: IntArray, axes: FloatArray) -> tuple[IntArray, FloatArray]:
    piece = np.full(len(thin.points), -1, np.int64)
    which: list[FloatArray] = []
    for d in range(len(axes)):
        rows = np.flatnonzero(own == d)
        if not len(rows):
            continue
        part = radius_components(thin.points[rows], LINK * thin.h)
        for label in np.flatnonzero(np.bincount(part) >= LEAST_PIECE):
            mine = rows[part == label]
            piece[mine] = len(which)
            axis = refined_axis(thin.points[mine], thin.normals[mine], axes[d])
            which.append(straightened(thin.points[mine], axis, thin.h))
    return piece, np.array(which).reshape(-1, 3)


def distinct(axes: FloatArray, weight: IntArray) -> FloatArray:
    """The axes that differ by two degrees or more, those of most points first; at most 48."""
    kept: list[FloatArray] = []
    for i in np.argsort(-weight, kind="stable"):
        if all(abs(float(axes[i] @ other)) < _DISTINCT for other in kept):
            kept.append(axes[i])
        if len(kept) == 48:
            break
    return np.array(kept).reshape(-1, 3)
