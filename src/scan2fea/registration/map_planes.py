"""Planes of a map of many sweeps: grown over neighbours from the flattest places, each point then held against its plane as a whole."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.jit import jit
from scan2fea.kernel.normals import pca_normals
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.types import FloatArray, IntArray, Value

NEIGHBOURS = 24
_GROWN_OVER = 12
_LEAST_CELLS, _LEAST_POINTS = 12, 15
_TURNED = math.cos(math.radians(30.0))
_BAND = 2.0  # spreads: half the width in which a plane grows
_GATE = 3.5
_SPREAD = 1.3  # a plane may scatter so much more than it is allowed to grow with
_REFITS = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class MapPlanes(Value):
    """label : (n,) plane of each point, -1 none.   normal, centre : (p, 3).   axes : (p, 2, 3) unit, within the plane."""

    label: IntArray
    normal: FloatArray
    centre: FloatArray
    axes: FloatArray

    def __len__(self) -> int:
        return len(self.normal)


def map_planes(points: FloatArray, edge_m: float, spread_m: float) -> MapPlanes:
    """Planes of points (n, 3). edge_m : of the voxels they grow over.   spread_m : standard deviation that points across a plane may have."""
    cells = voxel_mean(points, edge_m)
    n = len(cells.mean)
    label = np.full(len(points), -1, np.int64)
    if n <= NEIGHBOURS:
        return _planes(label, [])
    tree = cKDTree(cells.mean)
    near = np.asarray(tree.query(cells.mean, k=[*range(1, NEIGHBOURS + 2)], workers=1)[1], np.int64)
    patch = cells.mean[near] - cells.mean[near].mean(axis=1, keepdims=True)
    thickness = np.linalg.eigvalsh(np.einsum("mki,mkj->mij", patch, patch))[:, 0]
    order = np.argsort(thickness, kind="stable")
    of_cell = np.full(n, -1, np.int64)
    grown = _grown(
        cells.mean, pca_normals(cells.mean, NEIGHBOURS), np.ascontiguousarray(near[:, 1 : _GROWN_OVER + 1]), order, _BAND * spread_m, _TURNED, of_cell
    )
    owner = of_cell[np.asarray(tree.query(points, k=1, workers=1)[1], np.int64)]
    fits: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    sorted_rows = np.argsort(owner, kind="stable")
    bounds = np.searchsorted(owner[sorted_rows], np.arange(grown + 1))
    for k in range(grown):
        rows = sorted_rows[bounds[k] : bounds[k + 1]]
        fit = _fitted(points[rows], spread_m) if len(rows) >= _LEAST_POINTS else None
        if fit is not None:
            label[rows[fit[0]]] = len(fits)
            fits.append(fit[1:])
    return _planes(label, fits)


def _planes(label: IntArray, fits: list[tuple[FloatArray, FloatArray, FloatArray]]) -> MapPlanes:
    normal, centre, axes = (np.array([fit[k] for fit in fits], float) for k in range(3))
    return MapPlanes(label=label, normal=normal.reshape(-1, 3), centre=centre.reshape(-1, 3), axes=axes.reshape(-1, 2, 3))


def _fitted(points: FloatArray, spread_m: float) -> tuple[IntArray, FloatArray, FloatArray, FloatArray] | None:
    """Rows within the plane, its normal, centre and axes; None where they scatter too much."""
    keep = np.arange(len(points))
    for _ in range(_REFITS):
        centre = points[keep].mean(axis=0)
        _, axes = np.linalg.eigh(np.cov((points[keep] - centre).T))
        across = (points - centre) @ axes[:, 0]
        scatter = 1.4826 * float(np.median(np.abs(across)))
        keep = np.flatnonzero(np.abs(across) < _GATE * max(scatter, 0.05 * spread_m))
        if len(keep) < _LEAST_POINTS:
            return None
    return (keep, axes[:, 0], centre, axes[:, 1:].T) if scatter <= _SPREAD * spread_m else None


@jit
def _grown(
    points: FloatArray, normals: FloatArray, near: IntArray, order: IntArray, band: float, turned: float, label: IntArray
) -> int:
    """Number the planes from 0 in `label`; cells of none get -2."""
    n, n_near = near.shape
    found = 0
    queue = np.empty(n, np.int64)
    for seed in order:
        if label[seed] != -1:
            continue
        normal, centre = normals[seed].copy(), points[seed].copy()
        total, square = points[seed].copy(), np.outer(points[seed], points[seed])
        label[seed] = found
        queue[0] = seed
        head, tail, refitted = 0, 1, 1
        while head < tail:
            at = queue[head]
            head += 1
            for k in range(n_near):
                other = near[at, k]
                if label[other] != -1 or abs(np.dot(normals[other], normal)) < turned or abs(np.dot(points[other] - centre, normal)) > band:
                    continue
                label[other] = found
                queue[tail] = other
                tail += 1
                total += points[other]
                square += np.outer(points[other], points[other])
                if tail >= _LEAST_CELLS and 2 * tail >= 3 * refitted:
                    refitted = tail
                    centre = total / tail
                    _, axes = np.linalg.eigh(square / tail - np.outer(centre, centre))
                    normal = axes[:, 0].copy()
        if tail < _LEAST_CELLS:
            for k in range(tail):
                label[queue[k]] = -2
        else:
            found += 1
    return found
