"""Cavities: some tets round a vertex taken out and filled anew by a cone from it to their rim.

A cone whose tets are all positive fills its cavity exactly, since their volumes add up to it. The cavity grows tet by tet; the best of all stages
is kept, and only where its worst angle beats that of the tet it is meant to replace.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.tetmeshing.work import MOST, STAMP, Work, exchange, outward, shape_quality
from scan2fea.types import FloatArray, IntArray

SLIVERS, WORST = 0, 1  # what the cavity grows by: the least weight of the vertex at which the next tet falls, or the worst tet of the cone


@jit
def sphere_centre(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, out: FloatArray) -> float:
    """The centre of the sphere through four corners, from a, into `out`. Six times the volume is returned; not positive: there is no centre."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    sx, sy, sz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    u2, v2, s2 = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, sx * sx + sy * sy + sz * sz
    kx, ky, kz = vy * sz - vz * sy, vz * sx - vx * sz, vx * sy - vy * sx
    lx, ly, lz = sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux
    mx, my, mz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    six = ux * kx + uy * ky + uz * kz
    if six > 0:
        out[0] = (u2 * kx + v2 * lx + s2 * mx) / (2 * six)
        out[1] = (u2 * ky + v2 * ly + s2 * my) / (2 * six)
        out[2] = (u2 * kz + v2 * lz + s2 * mz) / (2 * six)
    return float(six)


@jit
def squared_radius(w: Work, t: int) -> float:
    """Of the sphere round t; inf for a tet that is not positive."""
    c = np.empty(3)
    p, v = w.points, w.tets[t]
    if sphere_centre(p[v[0]], p[v[1]], p[v[2]], p[v[3]], c) <= 0:
        return np.inf
    return float(c[0] ** 2 + c[1] ** 2 + c[2] ** 2)


@jit
def falls_at(w: Work, t: int, p: FloatArray) -> float:
    """The weight of a vertex at p from which on the sphere round t holds it: |p - c|^2 - R^2 (Cheng et al. 2000); inf for a flat tet."""
    c, v = np.empty(3), w.tets[t]
    a = w.points[v[0]]
    if sphere_centre(a, w.points[v[1]], w.points[v[2]], w.points[v[3]], c) <= 0:
        return np.inf
    x, y, z = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    return float(x * x + y * y + z * z - 2 * (x * c[0] + y * c[1] + z * c[2]))


@jit
def _rim(w: Work, apex: int, p: FloatArray, region: IntArray, n: int, rim: IntArray, quality: FloatArray) -> int:
    """Faces round the region without those at `apex`: corners outward, tet, face; and the quality of the cone over each."""
    w.tally[STAMP] += 1
    stamp = w.tally[STAMP]
    for k in range(n):
        w.mark[region[k]] = stamp
    m = 0
    face = np.empty(3, np.int64)
    for k in range(n):
        t = region[k]
        for i in range(4):
            u = w.beside[t, i]
            if u >= 0 and w.mark[u] == stamp:
                continue
            outward(w, t, i, face)
            if apex in (face[0], face[1], face[2]):
                continue
            if m == len(rim):
                return -1
            rim[m, 0], rim[m, 1], rim[m, 2], rim[m, 3], rim[m, 4] = face[0], face[1], face[2], t, i
            quality[m] = shape_quality(p, w.points[face[0]], w.points[face[1]], w.points[face[2]])
            m += 1
    return m


@jit
def _loses(w: Work, apex: int, region: IntArray, n: int, rim: IntArray, m: int) -> bool:
    """Would a vertex be left without a tet?"""
    for k in range(n):
        for i in range(4):
            v = w.tets[region[k], i]
            if v == apex:
                continue
            found = False
            for j in range(m):
                if v in (rim[j, 0], rim[j, 1], rim[j, 2]):
                    found = True
                    break
            if not found:
                return True
    return False


@jit
def _lightest(w: Work, p: FloatArray, rim: IntArray, m: int, most: float) -> int:
    """The face of the rim whose tet beyond falls first as the weight at p grows; -1 where none falls below `most`."""
    least, at = most, -1
    for k in range(m):
        u = w.beside[rim[k, 3], rim[k, 4]]
        if u >= 0:
            weight = falls_at(w, u, p)
            if weight < least:
                least, at = weight, k
    return at


@jit
def best_cone(
    w: Work, apex: int, p: FloatArray, region: IntArray, n: int, rule: int, most: float, must: float, cone: IntArray
) -> tuple[int, int, float]:
    """Grow `region` (n tets) and fill it from p, which is vertex `apex` (-1: a new one). most : the largest weight. must : the quality to beat.

    Returns how many tets of `region` the best stage takes out, how many faces its `cone` has (corners outward), and its quality; zeros where no
    stage beats `must`. Vertices are never lost.
    """
    rim, quality = np.empty((2 * MOST, 5), np.int64), np.empty(2 * MOST)
    best_n, best_m, best = 0, 0, must
    while True:
        m = _rim(w, apex, p, region, n, rim, quality)
        if m <= 0:
            break
        at = int(np.argmin(quality[:m]))
        worst = quality[at]
        if worst > best and m <= MOST and not _loses(w, apex, region, n, rim, m):
            best_n, best_m, best = n, m, worst
            for k in range(m):
                cone[k, 0], cone[k, 1], cone[k, 2] = rim[k, 0], rim[k, 1], rim[k, 2]
        if n == len(region):
            break
        if rule == SLIVERS:
            at = _lightest(w, p, rim, m, most)
        if at < 0 or w.beside[rim[at, 3], rim[at, 4]] < 0:
            break
        region[n] = w.beside[rim[at, 3], rim[at, 4]]
        n += 1
    return best_n, best_m, best


@jit
def fill_cone(w: Work, apex: int, region: IntArray, n: int, cone: IntArray, m: int, rows: IntArray) -> int:
    """Exchange the first n tets of `region` for the cone from `apex` over m faces. Returns m, 0 where the room is used up."""
    new = np.empty((m, 4), np.int64)
    for k in range(m):
        new[k, 0], new[k, 1], new[k, 2], new[k, 3] = apex, cone[k, 0], cone[k, 1], cone[k, 2]
    return m if exchange(w, region, n, new, m, rows) else 0
