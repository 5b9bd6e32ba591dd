"""Normals fitted on one side of a wall only, and how far it is to the other side.

Two sheets nearer to each other than their points are spaced cannot be told apart by distance; they can by where their points were seen
from. Every fit here uses only neighbours whose normals agree (n_i.n_j > SAME_SIDE).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit, jit_ieee
from scan2fea.kernel.neighbors import slot_of, sorted_into_cells
from scan2fea.kernel.small_matrices import eigh_3
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

SAME_SIDE = 0.3  # least cosine between the normals of one side
SAME_FACE = 0.8  # least cosine between the normals of one face, once they are known
FLAT_SIGMAS, FLAT_SPACINGS = 1.3, 0.05  # a patch is flat if its residual is below their sum
SIGN_ROUNDS = 8  # each carries the evidence one radius on
GLIMPSE = -0.1  # least cosine at which a sensor is believed to see a surface: below, it would look at it from behind
OPPOSITE = -0.7  # largest cosine between the normals of the two faces of a wall
LINE = 1e-9  # of the variance along it: what two points leave across the line through them
AXIS_RADIUS = 1.6  # spacings round the axis in which the other side is looked for


@dataclass(frozen=True, eq=False, kw_only=True)
class Near(Value):
    """points : (n, 3). Those within `radius_m` of point i, itself among them, are index[first[i]:first[i + 1]]."""

    points: FloatArray
    radius_m: float
    first: IntArray
    index: IntArray


def near_lists(points: FloatArray, radius_m: float) -> Near:
    """The neighbours of every point within a radius."""
    xyz = np.array(points, float)
    first, index = _lists(xyz, xyz.min(axis=0), float(radius_m))
    return Near(points=xyz, radius_m=float(radius_m), first=first, index=index)


def side_normals(near: Near, toward: FloatArray, refits: int = 2) -> FloatArray:
    """Unit normals (n, 3) by least squares on neighbours of the same side within the radius, weight exp(-2 r^2 / R^2).

    toward : (n, 3) any vector on the outer side of each point's surface (to the sensor, or a normal); it gives the sign.
    """
    normals = _signed(_fit(near, np.zeros_like(near.points), -1.0)[0], toward)
    for _ in range(refits):
        normals = _signed(_fit(near, normals, SAME_SIDE)[0], normals)
    return normals


def spread_evidence(near: Near, normals: FloatArray, evidence: FloatArray, sure: BoolArray, thickness_m: float) -> FloatArray:
    """(n,) the evidence for the sign of each normal, averaged along its sheet: the points within `thickness_m` of each other's tangent planes.

    evidence : (n,) for each point alone, such as the cosine n.U at which it was seen; negative where the normal should be turned.
    sure : (n,) points that keep their own.
    """
    axes, out = np.array(normals, float), np.array(evidence, float)
    share = _shares(near.points, axes, sure, near.first, near.index, near.radius_m, thickness_m)
    for _ in range(SIGN_ROUNDS):
        out = _spread_evidence(out, sure, near.first, near.index, share)
    return out


def opposed_evidence(points: FloatArray, normals: FloatArray, sure: BoolArray, spacing_m: float, reach_m: float, thickness_m: float) -> FloatArray:
    """(n,) evidence for the sign of each unsure normal from the sheets before and behind it, in [-2, 2]; 0 where there are none, or where sure.

    Along a line through a solid its faces alternate: whichever way one looks from a face, out through the air or in through the wall, the next
    face met has the opposite normal. The first sheet within `reach_m`, beyond `thickness_m`, counts by the share of its points that are sure.
    """
    xyz, axes = np.ascontiguousarray(points, float), np.ascontiguousarray(normals, float)
    return _opposed(xyz, axes, sure, xyz.min(axis=0), AXIS_RADIUS * spacing_m, reach_m, thickness_m)


def is_flat(near: Near, normals: FloatArray, sigma_m: float, spacing_m: float) -> BoolArray:
    """(n,) True where the neighbours of the same side lie on one plane within the noise."""
    _, rms = _fit(near, np.array(normals, float), SAME_SIDE)
    return np.asarray(rms <= FLAT_SIGMAS * sigma_m + FLAT_SPACINGS * spacing_m)


def crease_normals(near: Near, normals: FloatArray, toward: FloatArray, flat: BoolArray, thickness_m: float) -> FloatArray:
    """The normals (n, 3) with those at creases replaced: the plane through points of two faces is neither of them.

    Where the patch is not flat, the point takes the normal of the flat neighbour whose plane it lies on best, within `thickness_m`,
    among those that can be seen from `toward`; then all are fitted again, each on its own face.
    """
    chosen = _of_best_plane(near.points, np.array(normals, float), np.array(toward, float), flat, near.first, near.index, near.radius_m, thickness_m)
    return _signed(_fit(near, chosen, SAME_FACE)[0], chosen)


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
    return np.where(flip[:, None], -axes, axes)


def _fit(near: Near, normals: FloatArray, least: float) -> tuple[FloatArray, FloatArray]:
    """Axis of least variance (n, 3) of the neighbours with n_i.n_j > least, of either sign, and the residual (n,) across it.

    Points on one line have no such axis. They take LAPACK's choice: with it 6 of 72 beams (twelve scans, three noises, two positions) had a narrow
    face too many, with the one of Jacobi's rotations 9, where the normal before was kept or they were no flat patch 11.
    """
    moments = _covariances(near.points, normals, near.first, near.index, near.radius_m, least)
    axis, rms, on_line = _least_axes(moments)
    axis[on_line] = np.linalg.eigh(moments[on_line][:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3))[1][:, :, 0]
    return axis, rms


@jit_ieee
def _least_axes(moments: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Axis of least variance (n, 3), the deviation (n,) along it, and (n,) True where there is variance along one axis at most.

    moments : rows of `_covariances`.
    """
    axis, rms, on_line = np.zeros((len(moments), 3)), np.zeros(len(moments)), np.zeros(len(moments), np.bool_)
    matrix, values, axes = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
    for p in range(len(moments)):
        matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2], matrix[2, 2], weight = moments[p]
        matrix[1, 0], matrix[2, 0], matrix[2, 1] = matrix[0, 1], matrix[0, 2], matrix[1, 2]
        eigh_3(matrix, values, axes)
        axis[p], on_line[p] = axes[:, 0], values[1] <= LINE * values[2]
        rms[p] = math.sqrt(max(values[0], 0.0) / weight) if weight > 0.0 else 0.0
    return axis, rms, on_line


@jit
def _lists(points: FloatArray, low: FloatArray, radius: float) -> tuple[IntArray, IntArray]:
    n = len(points)
    cell_of, cells, table, order, start = sorted_into_cells(points, low, radius)
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
        other = table[slot_of(i, j, k, cells, table)]
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
def _shares(
    points: FloatArray, normals: FloatArray, sure: BoolArray, first: IntArray, index: IntArray, radius: float, thickness: float
) -> FloatArray:
    """What the evidence of each neighbour counts, in the rows of `index`: on the tangent plane most, carried over with n_i.n_j; 0 for sure points."""
    out = np.zeros(len(index))
    for p in range(len(points)):
        weights = 0.0
        for o in range(first[p], first[p + 1]):
            if sure[p]:
                break
            q = index[o]
            r2 = height = cosine = 0.0
            for a in range(3):
                d = points[q, a] - points[p, a]
                r2 += d * d
                height += d * normals[p, a]
                cosine += normals[q, a] * normals[p, a]
            out[o] = math.exp(-2.0 * r2 / (radius * radius) - 0.5 * (height / thickness) ** 2) * cosine
            weights += abs(out[o])
        if weights > 0.0:
            for o in range(first[p], first[p + 1]):
                out[o] /= weights
    return out


@jit
def _spread_evidence(evidence: FloatArray, sure: BoolArray, first: IntArray, index: IntArray, share: FloatArray) -> FloatArray:
    """(n,) mean of the evidence for the sign of each normal over its neighbours; sure points keep theirs."""
    out = evidence.copy()
    for p in range(len(evidence)):
        if not sure[p]:
            out[p] = 0.0
            for o in range(first[p], first[p + 1]):
                out[p] += share[o] * evidence[index[o]]
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
                for a in range(3):
                    out[p, a] = normals[q, a]
    return out


@jit
def _first_layer(
    points: FloatArray, normals: FloatArray, counted: BoolArray, p: int, sign: float,
    cells: IntArray, table: IntArray, order: IntArray, start: IntArray, low: FloatArray,
    radius: float, least: float, reach: float, largest_cosine: float, depths: FloatArray,
) -> tuple[int, float]:  # fmt: skip
    """Points met along sign * normal of p: how many (their depths in `depths`), and the sum of n.n_p of the `counted` ones.

    Layers as thick as the radius are searched until one, and the one after it, have given all points with n.n_p < largest_cosine; cells of
    1.2 radii are large enough (sqrt(1 + 0.5^2) < 1.2) that a layer needs only its 27.
    """
    edge = 1.2 * radius
    ax, ay, az = sign * normals[p, 0], sign * normals[p, 1], sign * normals[p, 2]
    found, last, layer, total = 0, -1, 0, 0.0
    while layer * radius < reach and (last < 0 or layer == last + 1):
        middle = (layer + 0.5) * radius
        i0 = np.int64(math.floor((points[p, 0] + middle * ax - low[0]) / edge))
        j0 = np.int64(math.floor((points[p, 1] + middle * ay - low[1]) / edge))
        k0 = np.int64(math.floor((points[p, 2] + middle * az - low[2]) / edge))
        for cell in range(27):
            other = table[slot_of(i0 + cell // 9 - 1, j0 + (cell // 3) % 3 - 1, k0 + cell % 3 - 1, cells, table)]
            if other < 0:
                continue
            for o in range(start[other], start[other + 1]):
                q = order[o]
                cosine = normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2]
                if cosine >= largest_cosine:
                    continue
                x, y, z = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2]
                depth = x * ax + y * ay + z * az
                across = x * x + y * y + z * z - depth * depth
                inside = depth > max(layer * radius, least) and depth <= min((layer + 1) * radius, reach) and across <= radius * radius
                if inside and found < len(depths):
                    depths[found] = depth
                    found += 1
                    if counted[q]:
                        total += cosine
        if found > 0 and last < 0:
            last = layer
        layer += 1
    return found, total


@jit
def _depths(points: FloatArray, normals: FloatArray, low: FloatArray, radius: float, reach: float, sign: float) -> FloatArray:
    _, cells, table, order, start = sorted_into_cells(points, low, 1.2 * radius)
    out, depths, counted = np.full(len(points), np.nan), np.zeros(4096), np.ones(len(points), np.bool_)
    for p in range(len(points)):
        found, _ = _first_layer(points, normals, counted, p, sign, cells, table, order, start, low, radius, 0.0, reach, OPPOSITE, depths)
        if found > 0:
            out[p] = np.median(depths[:found])
    return out


@jit
def _opposed(points: FloatArray, normals: FloatArray, sure: BoolArray, low: FloatArray, radius: float, reach: float, thickness: float) -> FloatArray:
    _, cells, table, order, start = sorted_into_cells(points, low, 1.2 * radius)
    out, depths = np.zeros(len(points)), np.zeros(4096)
    for p in range(len(points)):
        if sure[p]:
            continue
        for way in range(2):
            sign = 1.0 - 2.0 * way
            found, total = _first_layer(points, normals, sure, p, sign, cells, table, order, start, low, radius, thickness, reach, 2.0, depths)
            if found > 0:
                out[p] -= total / found
    return out
