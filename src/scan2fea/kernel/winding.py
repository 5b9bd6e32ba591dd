"""Winding number of a cloud of oriented points and its gradient, summed through a tree.

Each point stands for a piece of surface of area a_j with outward normal n_j, a dipole. With r^2 = |p_j - x|^2 + s^2 (s: softening, so that
the sum is finite at the points themselves),

    w(x) = 1 / (4 pi) sum_j a_j n_j.(p_j - x) / r^3        (Barill et al. 2018, Fast winding numbers, eq 4)

is near 1 inside, 0 outside and 1/2 on the surface; -grad w points outward there. Far pieces are summed by cells (Barnes and Hut 1986):
the dipole at the centroid and its first moment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray, Value

_LEAF = 8  # points per leaf
OPENING = 0.5  # a cell is summed as one where its radius is below this share of its distance: w within 0.03
ROUGH_OPENING = 0.8  # half the work; directions of -grad w within 0.7 degrees
_MORTON_BITS = 20


@dataclass(frozen=True, eq=False, kw_only=True)
class Layout(Value):
    """Points in the order of a space-filling curve, and the cells of a complete binary tree over that order.

    order : (n,) rows of the points along the curve.   points : (n, 3) in that order.
    depth : the tree has 2**depth leaves; cell i has children 2 i and 2 i + 1, root 1; leaf l holds rows cuts[l] to cuts[l + 1].
    """

    order: IntArray
    points: FloatArray
    cuts: IntArray
    depth: int


def layout(points: FloatArray) -> Layout:
    """Sort points along a Morton curve and cut the curve into leaves. points : (n, 3), n >= 1."""
    require(len(points) > 0, InternalError, "winding.layout needs at least one point")
    xyz = np.ascontiguousarray(points, float)
    low = xyz.min(axis=0)
    step = max(float((xyz.max(axis=0) - low).max()), np.finfo(float).tiny) / (2**_MORTON_BITS - 1)
    grid = ((xyz - low) / step).astype(np.int64)
    code = np.zeros(len(xyz), np.int64)
    for bit in range(_MORTON_BITS):
        for axis in range(3):
            code |= ((grid[:, axis] >> bit) & 1) << (3 * bit + axis)
    order = np.argsort(code, kind="stable").astype(np.int64)
    depth = max(0, math.ceil(math.log2(len(xyz) / _LEAF)))
    cuts = (np.arange(2**depth + 1, dtype=np.int64) * len(xyz)) // 2**depth
    return Layout(order=order, points=xyz[order], cuts=cuts, depth=depth)


def winding(
    tree: Layout, normals: FloatArray, areas: FloatArray, softening: float, queries: FloatArray | None = None, opening: float = OPENING
) -> tuple[FloatArray, FloatArray]:
    """w and -grad w at the queries.

    normals : (n, 3) and areas : (n,), in the order of the points the layout was made from.   queries : (m, 3), or None for those points.
    softening : length, > 0 where a query can meet a point.   Returns w (m,) and -grad w (m, 3), 1/m.
    """
    require(len(normals) == len(tree.order) == len(areas), InternalError, f"{len(normals)} normals, {len(areas)} areas, {len(tree.order)} points")
    dipoles = (normals * areas[:, None])[tree.order]
    weight = np.maximum(areas[tree.order], np.finfo(float).tiny)
    centre, radius, total, moment = _gather(tree.points, dipoles, weight, tree.cuts, tree.depth)
    # a fresh copy of the queries in every case: one compiled variant for read-only and writable callers
    asked = np.array(tree.points if queries is None else queries, float, order="C")
    cells = (centre, radius, total, moment)
    value, outward = _evaluate(asked, tree.points, dipoles, tree.cuts, tree.depth, *cells, float(softening) ** 2, opening)
    if queries is not None:
        return value, outward
    back = np.argsort(tree.order, kind="stable")
    return value[back], outward[back]


@jit
def _gather(
    points: FloatArray, dipoles: FloatArray, weight: FloatArray, cuts: IntArray, depth: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Centroid, radius, sum and first moment (sum of d_a (p - c)_b) of the dipoles of each cell, leaves first."""
    n_leaves = 1 << depth
    centre = np.zeros((2 * n_leaves, 3))
    mass = np.zeros(2 * n_leaves)
    radius = np.zeros(2 * n_leaves)
    total = np.zeros((2 * n_leaves, 3))
    moment = np.zeros((2 * n_leaves, 9))
    off = np.zeros(3)
    for leaf in range(n_leaves):
        c = n_leaves + leaf
        for j in range(cuts[leaf], cuts[leaf + 1]):
            mass[c] += weight[j]
            centre[c] += weight[j] * points[j]
            total[c] += dipoles[j]
        centre[c] /= max(mass[c], 1e-300)
        for j in range(cuts[leaf], cuts[leaf + 1]):
            off[:] = points[j] - centre[c]
            _add_moment(moment[c], dipoles[j], off)
            radius[c] = max(radius[c], math.sqrt((off * off).sum()))
    for c in range(n_leaves - 1, 0, -1):
        mass[c] = mass[2 * c] + mass[2 * c + 1]
        centre[c] = (mass[2 * c] * centre[2 * c] + mass[2 * c + 1] * centre[2 * c + 1]) / max(mass[c], 1e-300)
        total[c] = total[2 * c] + total[2 * c + 1]
        moment[c] = moment[2 * c] + moment[2 * c + 1]
        for child in (2 * c, 2 * c + 1):
            off[:] = centre[child] - centre[c]
            _add_moment(moment[c], total[child], off)
            radius[c] = max(radius[c], math.sqrt((off * off).sum()) + radius[child])
    return centre, radius, total, moment


@jit
def _add_moment(moment: FloatArray, dipole: FloatArray, off: FloatArray) -> None:
    """Add dipole_a off_b to moment[3 a + b], in place."""
    for a in range(3):
        for b in range(3):
            moment[3 * a + b] += dipole[a] * off[b]


@jit
def _evaluate(
    queries: FloatArray,
    points: FloatArray,
    dipoles: FloatArray,
    cuts: IntArray,
    depth: int,
    centre: FloatArray,
    radius: FloatArray,
    total: FloatArray,
    moment: FloatArray,
    soft2: float,
    opening: float,
) -> tuple[FloatArray, FloatArray]:
    n_leaves = 1 << depth
    value = np.zeros(len(queries))
    outward = np.zeros((len(queries), 3))
    stack = np.zeros(2 * depth + 4, np.int64)
    for q in range(len(queries)):
        x, y, z = queries[q, 0], queries[q, 1], queries[q, 2]
        w = gx = gy = gz = 0.0
        stack[0] = 1
        height = 1
        while height > 0:
            height -= 1
            c = stack[height]
            dx, dy, dz = centre[c, 0] - x, centre[c, 1] - y, centre[c, 2] - z
            d2 = dx * dx + dy * dy + dz * dz
            if radius[c] * radius[c] < opening * opening * d2:
                i2 = 1.0 / (d2 + soft2)
                i3 = i2 * math.sqrt(i2)
                i5 = i3 * i2
                tx, ty, tz = total[c, 0], total[c, 1], total[c, 2]
                dot = tx * dx + ty * dy + tz * dz
                # Taylor series of D.d / r^3 about the centroid: D.d / r^3 + sum_ab M_ab (delta_ab / r^3 - 3 d_a d_b / r^5)
                mx = moment[c, 0] * dx + moment[c, 1] * dy + moment[c, 2] * dz
                my = moment[c, 3] * dx + moment[c, 4] * dy + moment[c, 5] * dz
                mz = moment[c, 6] * dx + moment[c, 7] * dy + moment[c, 8] * dz
                nx = moment[c, 0] * dx + moment[c, 3] * dy + moment[c, 6] * dz
                ny = moment[c, 1] * dx + moment[c, 4] * dy + moment[c, 7] * dz
                nz = moment[c, 2] * dx + moment[c, 5] * dy + moment[c, 8] * dz
                trace = moment[c, 0] + moment[c, 4] + moment[c, 8]
                dmd = mx * dx + my * dy + mz * dz
                w += dot * i3 + trace * i3 - 3.0 * dmd * i5
                # derivative by d of the above is -grad by x with the sign of d = p - x turned: d/dx = -d/dd
                along = -3.0 * (dot + trace) * i5 + 15.0 * dmd * i5 * i2
                gx += tx * i3 + along * dx - 3.0 * (mx + nx) * i5
                gy += ty * i3 + along * dy - 3.0 * (my + ny) * i5
                gz += tz * i3 + along * dz - 3.0 * (mz + nz) * i5
            elif c >= n_leaves:
                for j in range(cuts[c - n_leaves], cuts[c - n_leaves + 1]):
                    dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
                    i2 = dx * dx + dy * dy + dz * dz + soft2
                    if i2 == 0.0:
                        continue
                    i2 = 1.0 / i2
                    i3 = i2 * math.sqrt(i2)
                    dot = dipoles[j, 0] * dx + dipoles[j, 1] * dy + dipoles[j, 2] * dz
                    w += dot * i3
                    along = -3.0 * dot * i3 * i2
                    gx += dipoles[j, 0] * i3 + along * dx
                    gy += dipoles[j, 1] * i3 + along * dy
                    gz += dipoles[j, 2] * i3 + along * dz
            else:
                stack[height] = 2 * c + 1
                stack[height + 1] = 2 * c
                height += 2
        full = 1.0 / (4.0 * math.pi)
        value[q] = w * full
        outward[q, 0], outward[q, 1], outward[q, 2] = gx * full, gy * full, gz * full
    return value, outward
