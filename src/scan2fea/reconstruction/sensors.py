"""Where the points were seen from: which side that puts outside, and whether it can be true."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.kernel.neighbors import k_nearest, slot_of, sorted_into_cells
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.small_matrices import cross
from scan2fea.types import BoolArray, FloatArray, IntArray

REJECTED = 0.05  # share of the rays that may pass through the surface of nearer points
N_RAYS = 4000
DISC = 1.5  # spacings: the points this near to where the ray crosses their planes must surround it; a rim beside the ray does not block it
SLANT = 0.3  # least cosine between a ray and the normals at both ends of its crossing: noise alone lifts a grazing ray in and out
OFF_PLANE = 0.5  # spacings a point must lie off the plane of a disc in its way
NEIGHBORS = 8
PAIR_NEIGHBORS = 32  # wide against the noise: the nearest few are near in height too, by selection
PAIR_QUANTILE, PAIR_HEIGHT = 0.3, 0.545  # 30 % of |N(0, 2)| lie below 0.545


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
        near = k_nearest(points[known], NEIGHBORS, points[lost])[1]
        unit[lost] = unit[known][near].sum(axis=1)
    return unit


def blocked_share(points: FloatArray, normals: FloatArray, sensors: FloatArray, spacing_m: float, sigma_m: float, seed: int = 0) -> float:
    """Share of the rays that pass through the surface of nearer points on the way from their sensor; 0 if no sensor is known.

    points : (n, 3).   normals : (n, 3) unit, of any sign.   sensors : (n, 3), nan rows where not known. A seeded draw of N_RAYS is judged,
    grazing ones left out. A ray is blocked where it crosses the planes of points that surround the crossing within 1.5 spacings and
    from whose planes its own point lies away by more than the noise.
    """
    to = sensors - points
    steep = np.abs(np.einsum("ij,ij->i", to, normals)) >= SLANT * np.linalg.norm(to, axis=1)  # False where the sensor is nan
    known = np.flatnonzero(steep)
    if not len(known):
        return 0.0
    rows = known[sampled_rows(len(known), N_RAYS, seed)]
    off = max(OFF_PLANE * spacing_m, 3.0 * min(sigma_m, _pair_sigma(points, normals, seed)))
    xyz = np.ascontiguousarray(points, float)
    return float(_blocked(xyz, normals, rows, np.ascontiguousarray(sensors[rows]), xyz.min(axis=0), xyz.max(axis=0), DISC * spacing_m, off).mean())


def _pair_sigma(points: FloatArray, normals: FloatArray, seed: int) -> float:
    """Noise from the heights of neighbours over each other's planes, m.

    False sensors give both sheets of a thin wall the same side, and the fit over both takes the wall for noise. Here a low quantile is
    judged, which pairs of the same sheet fill: right for one sheet, and at most 2.2 times too high for two.
    """
    rows = sampled_rows(len(points), N_RAYS, seed)
    _, near = k_nearest(points, PAIR_NEIGHBORS, points[rows])
    height = np.abs(np.einsum("kc,kjc->kj", normals[rows], points[near[:, 1:]] - points[rows][:, None]))
    return float(np.quantile(height, PAIR_QUANTILE) / PAIR_HEIGHT)


@jit
def _blocked(
    points: FloatArray, normals: FloatArray, rows: IntArray, sensors: FloatArray, low: FloatArray, high: FloatArray, disc: float, off: float
) -> BoolArray:
    """March each ray through cells of two disc radii, a radius at a time, until it leaves the box of the points."""
    edge = 2.0 * disc
    _, cells, table, order, start = sorted_into_cells(points, low, edge)
    out = np.zeros(len(rows), np.bool_)
    angles = np.zeros(256)
    ray = np.zeros((4, 3))  # origin, direction, and two axes across
    for r in range(len(rows)):
        for a in range(3):
            ray[0, a] = points[rows[r], a]
        length = math.sqrt(((sensors[r] - ray[0]) ** 2).sum())
        if not length > 0.0:
            continue
        for a in range(3):
            ray[1, a] = (sensors[r, a] - ray[0, a]) / length
        ray[2] = 0.0
        ray[2, np.argmin(np.abs(ray[1]))] = 1.0
        for axis in (2, 3):
            across = cross(ray[1], ray[2])
            for a in range(3):
                ray[axis, a] = across[a]
        s = 0.0
        while s < length and not out[r]:
            x = ray[0] + s * ray[1]
            if ((x < low - edge) | (x > high + edge)).any():
                break
            n = _crossings(points, normals, cells, table, order, start, low, disc, ray, s, min(s + disc, length), off, angles)
            out[r] = n >= 3 and _surrounded(angles[:n])
            s += disc
    return out


@jit
def _surrounded(angles: FloatArray) -> bool:
    """True if no gap between the directions reaches half a turn."""
    ordered = np.sort(angles)
    gap = ordered[0] + 2.0 * math.pi - ordered[-1]
    for k in range(1, len(ordered)):
        gap = max(gap, ordered[k] - ordered[k - 1])
    return bool(gap < math.pi)


@jit
def _crossings(
    points: FloatArray, normals: FloatArray, cells: IntArray, table: IntArray, order: IntArray, start: IntArray, low: FloatArray,
    disc: float, ray: FloatArray, near: float, far: float, off: float, angles: FloatArray,
) -> int:  # fmt: skip
    """How many discs the ray crosses between `near` - disc and `far`, and in which direction across the ray each centre lies."""
    edge = 2.0 * disc
    i0 = np.int64(math.floor((ray[0, 0] + near * ray[1, 0] - low[0]) / edge))
    j0 = np.int64(math.floor((ray[0, 1] + near * ray[1, 1] - low[1]) / edge))
    k0 = np.int64(math.floor((ray[0, 2] + near * ray[1, 2] - low[2]) / edge))
    found = 0
    for cell in range(27):
        c = table[slot_of(i0 + cell // 9 - 1, j0 + (cell // 3) % 3 - 1, k0 + cell % 3 - 1, cells, table)]
        if c < 0:
            continue
        for o in range(start[c], start[c + 1]):
            q = order[o]
            height = along = 0.0
            for a in range(3):
                height += normals[q, a] * (points[q, a] - ray[0, a])
                along += normals[q, a] * ray[1, a]
            if abs(along) < SLANT or abs(height) < off:
                continue
            s = height / along
            if s <= 0.0 or s < near - disc or s > far:
                continue
            miss = u = v = 0.0
            for a in range(3):
                w = points[q, a] - ray[0, a] - s * ray[1, a]
                miss += w * w
                u += w * ray[2, a]
                v += w * ray[3, a]
            if miss <= disc * disc and found < len(angles):
                angles[found] = math.atan2(v, u)
                found += 1
    return found
