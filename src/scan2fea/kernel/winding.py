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
from scan2fea.kernel.face_tree import morton_order
from scan2fea.kernel.jit import jit, jit_ieee
from scan2fea.types import FloatArray, IntArray, Value

_LEAF = 8  # points per leaf
OPENING = 0.5  # a cell is summed as one where its radius is below this share of its distance: w within 0.03
ROUGH_OPENING = 0.8  # half the work; directions of -grad w within 0.7 degrees
_GROUP = 32  # queries


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
    order = morton_order(xyz)
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
    asked, order = (tree.points, tree.order) if queries is None else _along_curve(queries)
    # a fresh copy of the queries in every case: one compiled variant for read-only and writable callers
    asked = np.array(asked, float, order="C")
    cells = (centre, radius, total, moment)
    value, outward = _evaluate(asked, tree.points, dipoles, tree.cuts, tree.depth, *cells, float(softening) ** 2, opening)
    back = np.argsort(order, kind="stable")
    return value[back], outward[back]


def _along_curve(queries: FloatArray) -> tuple[FloatArray, IntArray]:
    order = morton_order(queries) if len(queries) else np.zeros(0, np.int64)
    return queries[order], order


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
            for a in range(3):
                centre[c, a] += weight[j] * points[j, a]
                total[c, a] += dipoles[j, a]
        for a in range(3):
            centre[c, a] /= max(mass[c], 1e-300)
        for j in range(cuts[leaf], cuts[leaf + 1]):
            for a in range(3):
                off[a] = points[j, a] - centre[c, a]
            _add_moment(moment[c], dipoles[j], off)
            radius[c] = max(radius[c], math.sqrt((off * off).sum()))
    for c in range(n_leaves - 1, 0, -1):
        mass[c] = mass[2 * c] + mass[2 * c + 1]
        for a in range(3):
            centre[c, a] = (mass[2 * c] * centre[2 * c, a] + mass[2 * c + 1] * centre[2 * c + 1, a]) / max(mass[c], 1e-300)
            total[c, a] = total[2 * c, a] + total[2 * c + 1, a]
        for a in range(9):
            moment[c, a] = moment[2 * c, a] + moment[2 * c + 1, a]
        for child in (2 * c, 2 * c + 1):
            for a in range(3):
                off[a] = centre[child, a] - centre[c, a]
            _add_moment(moment[c], total[child], off)
            radius[c] = max(radius[c], math.sqrt((off * off).sum()) + radius[child])
    return centre, radius, total, moment


@jit
def _add_moment(moment: FloatArray, dipole: FloatArray, off: FloatArray) -> None:
    """Add dipole_a off_b to moment[3 a + b], in place."""
    for a in range(3):
        for b in range(3):
            moment[3 * a + b] += dipole[a] * off[b]


@jit_ieee
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
    """queries : (m, 3), neighbours one after the other: _GROUP of them go down the tree together, each term summed for all of these at once."""
    n_leaves = 1 << depth
    value = np.zeros(len(queries))
    outward = np.zeros((len(queries), 3))
    stack = np.zeros(2 * depth + 4, np.int64)
    at, sums = np.zeros((3, _GROUP)), np.zeros((4, _GROUP))
    full = 1.0 / (4.0 * math.pi)
    for start in range(0, len(queries), _GROUP):
        n = min(_GROUP, len(queries) - start)
        x = y = z = reach2 = 0.0
        for i in range(n):
            at[0, i], at[1, i], at[2, i] = queries[start + i, 0], queries[start + i, 1], queries[start + i, 2]
            x, y, z = x + at[0, i] / n, y + at[1, i] / n, z + at[2, i] / n
        for i in range(n):
            reach2 = max(reach2, (at[0, i] - x) ** 2 + (at[1, i] - y) ** 2 + (at[2, i] - z) ** 2)
        reach = math.sqrt(reach2)
        sums[:] = 0.0
        stack[0] = 1
        height = 1
        while height > 0:
            height -= 1
            c = stack[height]
            apart = math.sqrt((centre[c, 0] - x) ** 2 + (centre[c, 1] - y) ** 2 + (centre[c, 2] - z) ** 2)
            if radius[c] < opening * (apart - reach):
                _add_cell(sums, at, n, centre[c], total[c], moment[c], soft2)
            elif c >= n_leaves:
                for j in range(cuts[c - n_leaves], cuts[c - n_leaves + 1]):
                    _add_point(sums, at, n, points[j], dipoles[j], soft2)
            else:
                stack[height] = 2 * c + 1
                stack[height + 1] = 2 * c
                height += 2
        for i in range(n):
            value[start + i] = sums[0, i] * full
            outward[start + i, 0], outward[start + i, 1], outward[start + i, 2] = sums[1, i] * full, sums[2, i] * full, sums[3, i] * full
    return value, outward


@jit_ieee
def _add_cell(sums: FloatArray, at: FloatArray, n: int, centre: FloatArray, total: FloatArray, moment: FloatArray, soft2: float) -> None:
    """Add to sums (4, n), in place, w and its gradient at the places `at` (3, n) of a cell's dipoles.

    Taylor series of D.d / r^3 about the centroid: D.d / r^3 + sum_ab M_ab (delta_ab / r^3 - 3 d_a d_b / r^5). Its derivative by d = p - x is that
    by x with the sign turned. Of M only M + M^T counts.
    """
    cx, cy, cz = centre[0], centre[1], centre[2]
    tx, ty, tz = total[0], total[1], total[2]
    xx, yy, zz = 2.0 * moment[0], 2.0 * moment[4], 2.0 * moment[8]
    xy, xz, yz = moment[1] + moment[3], moment[2] + moment[6], moment[5] + moment[7]
    trace = 0.5 * (xx + yy + zz)
    for i in range(n):
        dx, dy, dz = cx - at[0, i], cy - at[1, i], cz - at[2, i]
        i2 = 1.0 / (dx * dx + dy * dy + dz * dz + soft2)
        i3 = i2 * math.sqrt(i2)
        i5 = i3 * i2
        dot = tx * dx + ty * dy + tz * dz + trace
        mx, my, mz = xx * dx + xy * dy + xz * dz, xy * dx + yy * dy + yz * dz, xz * dx + yz * dy + zz * dz
        dmd = 0.5 * (mx * dx + my * dy + mz * dz)
        along = (15.0 * dmd * i2 - 3.0 * dot) * i5
        sums[0, i] += dot * i3 - 3.0 * dmd * i5
        sums[1, i] += tx * i3 + along * dx - 3.0 * mx * i5
        sums[2, i] += ty * i3 + along * dy - 3.0 * my * i5
        sums[3, i] += tz * i3 + along * dz - 3.0 * mz * i5


@jit_ieee
def _add_point(sums: FloatArray, at: FloatArray, n: int, point: FloatArray, dipole: FloatArray, soft2: float) -> None:
    """The same of one dipole; nothing where it lies at the place itself and there is no softening."""
    px, py, pz = point[0], point[1], point[2]
    ax, ay, az = dipole[0], dipole[1], dipole[2]
    for i in range(n):
        dx, dy, dz = px - at[0, i], py - at[1, i], pz - at[2, i]
        r2 = dx * dx + dy * dy + dz * dz + soft2
        i2 = 1.0 / r2 if r2 > 0.0 else 0.0
        i3 = i2 * math.sqrt(i2)
        dot = ax * dx + ay * dy + az * dz
        along = -3.0 * dot * i3 * i2
        sums[0, i] += dot * i3
        sums[1, i] += ax * i3 + along * dx
        sums[2, i] += ay * i3 + along * dy
        sums[3, i] += az * i3 + along * dz
