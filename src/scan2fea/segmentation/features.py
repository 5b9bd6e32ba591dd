"""What a point's surroundings look like at four scales: eigenvalue features (Demantke et al. 2011; Weinmann et al. 2015), direction and height.

The neighbours of a point at one scale are the points in its voxel and the 26 around it (a pyramid of voxels as in Hackel et al. 2016): sums per voxel
make that linear in the points at every scale. z is up.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from scan2fea.errors import SegmentationError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.neighbors import slot_of, sorted_into_cells
from scan2fea.types import FloatArray, IntArray

EDGES = (1.5, 3.0, 6.0, 12.0)  # of the voxels, in spacings
PER_SCALE = ("linearity", "planarity", "scatter", "curvature", "verticality", "rise")
FEATURES = (*(f"{name}_{edge:g}h" for edge in EDGES for name in PER_SCALE), "height_m", "height_share")
_TAIL = 0.01


def point_features(points: FloatArray, spacing_m: float) -> npt.NDArray[np.float32]:
    """(n, 26) float32 features of points (n, 3), in the order of FEATURES.

    linearity (l1 - l2) / l1, planarity (l2 - l3) / l1, scatter l3 / l1, curvature l3 / (l1 + l2 + l3), l1 >= l2 >= l3 of the neighbours' covariance;
    verticality 1 - |n_z| of their normal; rise |e_z| of their long axis; height above the lowest 1 % of the points, and as a share of all heights.
    Raises SegmentationError for points that are not finite, or all at one place.
    """
    require(np.isfinite(points).all(), SegmentationError, "the cloud has coordinates that are not finite: features need numbers; drop those points")
    require(spacing_m > 0 and math.isfinite(spacing_m), SegmentationError, "the points lie at one place: features need points that spread")
    xyz = np.ascontiguousarray(points, float)
    out = np.zeros((len(xyz), len(FEATURES)), np.float32)
    for s, edge in enumerate(EDGES):
        covariance = _covariances(xyz, xyz.min(axis=0), edge * spacing_m)
        for first in range(0, len(xyz), 50_000):  # eigenvectors of all at once would fill the memory
            rows = slice(first, first + 50_000)
            out[rows, s * len(PER_SCALE) : (s + 1) * len(PER_SCALE)] = _of_covariance(covariance[rows])
    low, high = np.quantile(xyz[:, 2], [_TAIL, 1 - _TAIL])
    out[:, -2] = xyz[:, 2] - low
    out[:, -1] = np.clip((xyz[:, 2] - low) / max(high - low, 1e-12), 0, 1)
    return out


def _of_covariance(covariance: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(covariance)
    l3, l2, l1 = (np.maximum(values[:, k], 0.0) for k in range(3))
    top, total = np.maximum(l1, 1e-30), np.maximum(l1 + l2 + l3, 1e-30)
    columns = [(l1 - l2) / top, (l2 - l3) / top, l3 / top, l3 / total, 1 - np.abs(vectors[:, 2, 0]), np.abs(vectors[:, 2, 2])]
    return np.stack(columns, axis=1)


@jit
def _covariances(points: FloatArray, low: FloatArray, edge: float) -> FloatArray:
    """(n, 3, 3) of the points in the 27 voxels around each point's own; equal for the points of one voxel."""
    cell_of, cells, table, order, start = sorted_into_cells(points, low, edge)
    n_cells = len(cells)
    sums = np.zeros((n_cells, 10))
    for c in range(n_cells):
        for at in range(start[c], start[c + 1]):
            p = order[at]
            x, y, z = points[p, 0] - low[0], points[p, 1] - low[1], points[p, 2] - low[2]
            sums[c, 0] += 1.0
            sums[c, 1] += x
            sums[c, 2] += y
            sums[c, 3] += z
            sums[c, 4] += x * x
            sums[c, 5] += x * y
            sums[c, 6] += x * z
            sums[c, 7] += y * y
            sums[c, 8] += y * z
            sums[c, 9] += z * z
    by_cell = np.zeros((n_cells, 3, 3))
    total = np.zeros(10)
    for c in range(n_cells):
        total[:] = 0.0
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    other = table[slot_of(cells[c, 0] + dx, cells[c, 1] + dy, cells[c, 2] + dz, cells, table)]
                    if other >= 0:
                        total += sums[other]
        n = total[0]
        mx, my, mz = total[1] / n, total[2] / n, total[3] / n
        xx, xy, xz = total[4] / n - mx * mx, total[5] / n - mx * my, total[6] / n - mx * mz
        yy, yz, zz = total[7] / n - my * my, total[8] / n - my * mz, total[9] / n - mz * mz
        by_cell[c, 0, 0], by_cell[c, 0, 1], by_cell[c, 0, 2] = xx, xy, xz
        by_cell[c, 1, 0], by_cell[c, 1, 1], by_cell[c, 1, 2] = xy, yy, yz
        by_cell[c, 2, 0], by_cell[c, 2, 1], by_cell[c, 2, 2] = xz, yz, zz
    out = np.zeros((len(points), 3, 3))
    for p in range(len(points)):
        for a in range(3):
            for b in range(3):
                out[p, a, b] = by_cell[cell_of[p], a, b]
    return out


def most_frequent(labels: IntArray, near: IntArray, n_classes: int) -> IntArray:
    """(m,) the class that most of some neighbours (m, k), rows of `labels`, have; of equal ones the lowest."""
    votes = np.zeros((len(near), n_classes), np.int64)
    for column in near.T:
        votes[np.arange(len(near)), labels[column]] += 1
    return np.asarray(votes.argmax(axis=1))
