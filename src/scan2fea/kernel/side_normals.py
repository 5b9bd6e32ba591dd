"""Normals fitted on one side of a wall only, and how far it is to the other side.

Two sheets nearer to each other than their points are spaced cannot be told apart by distance; they can by where their points were seen
from. Every fit here uses only neighbours whose normals agree (n_i.n_j > SAME_SIDE).
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.kernel.neighbors import _slot_of, _sorted_into_cells
from scan2fea.types import BoolArray, FloatArray, IntArray

SAME_SIDE = 0.3  # least cosine between the normals of one side
SAME_FACE = 0.8  # least cosine between the normals of one face, once they are known
FLAT_SIGMAS, FLAT_SPACINGS = 1.3, 0.05  # a patch is flat if its residual is below their sum
GLIMPSE = -0.1  # least cosine at which a sensor is believed to see a surface: below, it would look at it from behind
OPPOSITE = -0.7  # largest cosine between the normals of the two faces of a wall
AXIS_RADIUS = 1.6  # spacings round the axis in which the other side is looked for


def radius_lists(points: FloatArray, radius_m: float) -> tuple[IntArray, IntArray]:
    """(first (n + 1,), index): the points within `radius_m` of point i, itself among them, are index[first[i]:first[i + 1]]."""
    xyz = np.ascontiguousarray(points, float)
    return _lists(xyz, xyz.min(axis=0), float(radius_m))


def side_normals(points: FloatArray, toward: FloatArray, radius_m: float, refits: int = 2) -> FloatArray:
    """Unit normals (n, 3) by least squares on neighbours of the same side within `radius_m`, weight exp(-2 r^2 / R^2).

    toward : (n, 3) any vector on the outer side of each point's surface (to the sensor, or a normal); it gives the sign.
    """
    first, index = radius_lists(points, radius_m)
    xyz = np.ascontiguousarray(points, float)
    normals = _signed(_fit(xyz, np.zeros_like(xyz), first, index, radius_m, -1.0)[0], toward)
    for _ in range(refits):
        normals = _signed(_fit(xyz, normals, first, index, radius_m, SAME_SIDE)[0], normals)
    return normals


def settled_normals(points: FloatArray, normals: FloatArray, toward: FloatArray, radius_m: float, sigma_m: float, spacing_m: float) -> FloatArray:
    """The normals (n, 3) made sure of where a single point cannot be: at grazing incidence and at creases.

    Signs: a point seen at grazing incidence does not know its side, noise decides. Each point takes the sum of what its neighbours see,
    |n.U| strong, counting those that lie on its own tangent plane within the noise, and those on flat patches most.
    Creases: the plane through points of two faces is neither, and a sensor may see one face from behind the other. Where the patch is
    not flat, the point takes the normal of the flat neighbour whose plane it lies on best, among those its own sensor can see.
    toward : (n, 3) unit vectors U on the outer side.
    """
    first, index = radius_lists(points, radius_m)
    xyz, seen = np.ascontiguousarray(points, float), np.ascontiguousarray(toward, float)
    _, rms = _fit(xyz, normals, first, index, radius_m, SAME_SIDE)
    flat = rms <= FLAT_SIGMAS * sigma_m + FLAT_SPACINGS * spacing_m
    thickness = 1.5 * sigma_m + FLAT_SPACINGS * spacing_m
    signed = normals * _agreed(xyz, normals, seen, flat, first, index, radius_m, thickness)[:, None]
    settled = _of_best_plane(xyz, signed, seen, flat, first, index, radius_m, thickness)
    return _signed(_fit(xyz, settled, first, index, radius_m, SAME_FACE)[0], settled)


def wall_depth(points: FloatArray, normals: FloatArray, spacing_m: float, reach_m: float, outward: bool = False) -> FloatArray:
    """(n,) metres to the opposite face along the inward axis, nan where there is none within `reach_m`.

    The median depth of the points with opposite normal within 1.6 spacings of the axis, in the first layer that holds any.
    `outward`: the width of the gap in front of the point instead.
    """
    xyz = np.ascontiguousarray(points, float)
    radius = AXIS_RADIUS * spacing_m
    return _depths(xyz, np.ascontiguousarray(normals), xyz.min(axis=0), radius, reach_m, 1.0 if outward else -1.0)


def _signed(axes: FloatArray, toward: FloatArray) -> FloatArray:
    flip = np.einsum("ij,ij->i", axes, toward) < 0
    return np.ascontiguousarray(np.where(flip[:, None], -axes, axes))


def _fit(points: FloatArray, normals: FloatArray, first: IntArray, index: IntArray, radius: float, least: float) -> tuple[FloatArray, FloatArray]:
    """Axis of least variance (n, 3) of the neighbours with n_i.n_j > least, of either sign, and the residual (n,) across it."""
    moments = _covariances(points, normals, first, index, radius, least)
    values, axes = np.linalg.eigh(moments[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3))
    return np.asarray(axes[:, :, 0]), np.sqrt(np.maximum(values[:, 0], 0.0) / np.maximum(moments[:, 6], np.finfo(float).tiny))


@jit
def _lists(points: FloatArray, low: FloatArray, radius: float) -> tuple[IntArray, IntArray]:
    n = len(points)
    cell_of, cells, table, order, start = _sorted_into_cells(points, low, radius)
    first = np.zeros(n + 1, np.int64)
    index = np.zeros(0, np.int64)
    for p in range(n):
        first[p + 1] = first[p] + _within(points, p, radius, cells, table, order, start, cell_of[p], index, 0)
    index = np.zeros(first[n], np.int64)
    for p in range(n):
        _within(points, p, radius, cells, table, order, start, cell_of[p], index, first[p])
    return first, index


@jit
def _within(
    points: FloatArray, p: int, radius: float,
    cells: IntArray, table: IntArray, order: IntArray, start: IntArray, home: int, index: IntArray, at: int,
) -> int:  # fmt: skip
    """Number of points within `radius` of p, written to index[at:] if there is room."""
    found = 0
    for cell in range(27):
        i, j, k = cells[home, 0] + cell // 9 - 1, cells[home, 1] + (cell // 3) % 3 - 1, cells[home, 2] + cell % 3 - 1
        other = table[_slot_of(i, j, k, cells, table)]
        if other < 0:
            continue
        for o in range(start[other], start[other + 1]):
            q = order[o]
            d = (points[p, 0] - points[q, 0]) ** 2 + (points[p, 1] - points[q, 1]) ** 2 + (points[p, 2] - points[q, 2]) ** 2
            if d <= radius * radius:
                if at + found < len(index):
                    index[at + found] = q
                found += 1
    return found


@jit
def _covariances(points: FloatArray, normals: FloatArray, first: IntArray, index: IntArray, radius: float, least: float) -> FloatArray:
    """(n, 7) weighted moments xx, xy, xz, yy, yz, zz of each point's neighbours with n_i.n_j > least, and the sum of their weights."""
    out = np.zeros((len(points), 7))
    for p in range(len(points)):
        w = sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
        for o in range(first[p], first[p + 1]):
            q = index[o]
            cosine = normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2]
            if cosine <= least:
                continue
            x, y, z = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2]
            a = math.exp(-2.0 * (x * x + y * y + z * z) / (radius * radius))
            w += a
            sx, sy, sz = sx + a * x, sy + a * y, sz + a * z
            xx, xy, xz = xx + a * x * x, xy + a * x * y, xz + a * x * z
            yy, yz, zz = yy + a * y * y, yz + a * y * z, zz + a * z * z
        if w > 0.0:
            out[p, 0], out[p, 1], out[p, 2] = xx - sx * sx / w, xy - sx * sy / w, xz - sx * sz / w
            out[p, 3], out[p, 4], out[p, 5] = yy - sy * sy / w, yz - sy * sz / w, zz - sz * sz / w
            out[p, 6] = w
    return out


@jit
def _agreed(
    points: FloatArray, normals: FloatArray, toward: FloatArray, flat: BoolArray,
    first: IntArray, index: IntArray, radius: float, thickness: float,
) -> FloatArray:  # fmt: skip
    """(n,) 1 where the neighbours agree with the sign of the normal, else -1."""
    out = np.ones(len(points))
    for p in range(len(points)):
        total = 0.0
        for o in range(first[p], first[p + 1]):
            q = index[o]
            r2 = height = cosine = seen = 0.0
            for a in range(3):
                d = points[q, a] - points[p, a]
                r2 += d * d
                height += d * normals[p, a]
                cosine += normals[q, a] * normals[p, a]
                seen += normals[q, a] * toward[q, a]
            trust = 1.0 if flat[q] else 0.1
            total += trust * cosine * seen * math.exp(-2.0 * r2 / (radius * radius) - 0.5 * (height / thickness) ** 2)
        if total < 0.0:
            out[p] = -1.0
    return out


@jit
def _of_best_plane(
    points: FloatArray, normals: FloatArray, toward: FloatArray, flat: BoolArray,
    first: IntArray, index: IntArray, radius: float, thickness: float,
) -> FloatArray:  # fmt: skip
    """(n, 3) the normal of the flat neighbour whose plane holds the point best, for points whose own patch is not flat."""
    out = normals.copy()
    for p in range(len(points)):
        if flat[p]:
            continue
        best = np.inf
        for o in range(first[p], first[p + 1]):
            q = index[o]
            if not flat[q]:
                continue
            r2 = height = seen = 0.0
            for a in range(3):
                d = points[q, a] - points[p, a]
                r2 += d * d
                height += d * normals[q, a]
                seen += normals[q, a] * toward[p, a]
            cost = abs(height) / thickness + 0.5 * math.sqrt(r2) / radius
            if seen > GLIMPSE and cost < best:
                best = cost
                out[p] = normals[q]
    return out


@jit
def _depths(points: FloatArray, normals: FloatArray, low: FloatArray, radius: float, reach: float, sign: float) -> FloatArray:
    """Layer by layer along the axis, one layer as thick as the radius; cells large enough that a layer needs only its 27 cells."""
    n = len(points)
    _, cells, table, order, start = _sorted_into_cells(points, low, 1.2 * radius)  # sqrt(1 + 0.5^2) radius < 1.2 radius
    out = np.full(n, np.nan)
    depths = np.zeros(4096)
    for p in range(n):
        ax, ay, az = sign * normals[p, 0], sign * normals[p, 1], sign * normals[p, 2]
        found = 0
        layer = 0
        last = -1
        while layer * radius < reach and (last < 0 or layer == last + 1):
            middle = (layer + 0.5) * radius
            i0 = np.int64(math.floor((points[p, 0] + middle * ax - low[0]) / (1.2 * radius)))
            j0 = np.int64(math.floor((points[p, 1] + middle * ay - low[1]) / (1.2 * radius)))
            k0 = np.int64(math.floor((points[p, 2] + middle * az - low[2]) / (1.2 * radius)))
            for cell in range(27):
                other = table[_slot_of(i0 + cell // 9 - 1, j0 + (cell // 3) % 3 - 1, k0 + cell % 3 - 1, cells, table)]
                if other < 0:
                    continue
                for o in range(start[other], start[other + 1]):
                    q = order[o]
                    cosine = normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2]
                    if cosine >= OPPOSITE:
                        continue
                    x, y, z = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2]
                    depth = x * ax + y * ay + z * az
                    across = x * x + y * y + z * z - depth * depth
                    if depth > layer * radius and depth <= min((layer + 1) * radius, reach) and across <= radius * radius and found < 4096:
                        depths[found] = depth
                        found += 1
            if found > 0 and last < 0:
                last = layer
            layer += 1
        if found > 0:
            out[p] = np.median(depths[:found])
    return out
