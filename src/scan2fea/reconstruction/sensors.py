"""Where the points were seen from: which side that puts outside, and whether it can be true."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.jit import jit
from scan2fea.kernel.neighbors import _slot_of, _sorted_into_cells
from scan2fea.kernel.noise import sampled_rows
from scan2fea.types import BoolArray, FloatArray, IntArray

REJECTED = 0.05  # share of the rays that may pass through the surface of nearer points
N_RAYS = 4000
DISC = 0.75  # spacings: radius of the disc that stands for the surface at a point
SLANT = 0.3  # least cosine between a ray and the normal of a disc it is said to pass
OFF_PLANE = 0.5  # spacings a point must lie off the plane of a disc in its way
NEIGHBORS = 8


def outer_side(points: FloatArray, sensors: FloatArray, normals: FloatArray | None) -> FloatArray:
    """(n, 3) unit vectors on the outer side of the surface at each point: to its sensor, else its given normal, else as its neighbours' sensors.

    sensors : (n, 3), nan rows where not known, but not all.   normals : (n, 3) or None.
    """
    to = sensors - points
    known = np.isfinite(to).all(axis=1)
    unit = np.zeros_like(points)
    unit[known] = to[known] / np.maximum(np.linalg.norm(to[known], axis=1), np.finfo(float).tiny)[:, None]
    lost = ~known
    if normals is not None:
        given = lost & np.isfinite(normals).all(axis=1) & (np.linalg.norm(np.nan_to_num(normals), axis=1) > 0.5)
        unit[given] = normals[given]
        lost = lost & ~given
    if lost.any():
        near = cKDTree(points[known]).query(points[lost], k=[*range(1, min(NEIGHBORS, int(known.sum())) + 1)])[1]
        unit[lost] = unit[known][near].sum(axis=1)
    return unit


def blocked_share(points: FloatArray, normals: FloatArray, sensors: FloatArray, spacing_m: float, sigma_m: float, seed: int = 0) -> float:
    """Share of the rays that pass through the surface of nearer points on the way from their sensor; 0 if no sensor is known.

    points : (n, 3).   normals : (n, 3) unit, of any sign.   sensors : (n, 3), nan rows where not known. A seeded draw of N_RAYS is judged:
    a ray is blocked if it crosses, not too slantingly, a disc of 0.75 spacings at another point from whose plane its own point lies away
    by more than the noise.
    """
    known = np.flatnonzero(np.isfinite(sensors).all(axis=1))
    if not len(known):
        return 0.0
    rows = known[sampled_rows(len(known), N_RAYS, seed)]
    off = max(OFF_PLANE * spacing_m, 3.0 * sigma_m)
    xyz = np.ascontiguousarray(points, float)
    return float(_blocked(xyz, normals, rows, np.ascontiguousarray(sensors[rows]), xyz.min(axis=0), xyz.max(axis=0), DISC * spacing_m, off).mean())


@jit
def _blocked(
    points: FloatArray, normals: FloatArray, rows: IntArray, sensors: FloatArray, low: FloatArray, high: FloatArray, disc: float, off: float
) -> BoolArray:
    """March each ray through cells of two disc radii, a radius at a time, until it leaves the box of the points."""
    edge = 2.0 * disc
    _, cells, table, order, start = _sorted_into_cells(points, low, edge)
    out = np.zeros(len(rows), np.bool_)
    for r in range(len(rows)):
        p = points[rows[r]]
        way = sensors[r] - p
        length = math.sqrt((way**2).sum())
        if not length > 0.0:
            continue
        d = way / length
        s = 0.0
        while s < length and not out[r]:
            x = p + s * d
            if ((x < low - edge) | (x > high + edge)).any():
                break
            out[r] = _disc_near(points, normals, cells, table, order, start, low, edge, x, p, d, disc, off, length)
            s += disc
    return out


@jit
def _disc_near(
    points: FloatArray, normals: FloatArray, cells: IntArray, table: IntArray, order: IntArray, start: IntArray, low: FloatArray,
    edge: float, x: FloatArray, p: FloatArray, d: FloatArray, disc: float, off: float, length: float,
) -> bool:  # fmt: skip
    """True if the ray p + s d crosses a disc whose centre lies in the 27 cells round x."""
    i0 = np.int64(math.floor((x[0] - low[0]) / edge))
    j0 = np.int64(math.floor((x[1] - low[1]) / edge))
    k0 = np.int64(math.floor((x[2] - low[2]) / edge))
    for cell in range(27):
        c = table[_slot_of(i0 + cell // 9 - 1, j0 + (cell // 3) % 3 - 1, k0 + cell % 3 - 1, cells, table)]
        if c < 0:
            continue
        for o in range(start[c], start[c + 1]):
            q = order[o]
            height = along = 0.0
            for a in range(3):
                height += normals[q, a] * (points[q, a] - p[a])
                along += normals[q, a] * d[a]
            if abs(along) < SLANT or abs(height) < off:
                continue
            s = height / along
            if s <= 0.0 or s >= length:
                continue
            miss = 0.0
            for a in range(3):
                miss += (p[a] + s * d[a] - points[q, a]) ** 2
            if miss <= disc * disc:
                return True
    return False
