"""Tets that change: which tet lies across each face, the star of a vertex, the ring of an edge, and one way to exchange some tets for others.

Everything that reconnects (flips, cavities) goes through `exchange`, so neighbours are kept right in one place. Corner order is that of
`kernel.quality`: positive volume, face i across from corner i.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.kernel.quality import TET_FACES
from scan2fea.types import ByteArray, FloatArray, IntArray

PER_JACOBIAN = 0.47  # a scaled Jacobian of 0.2, twice what solvers like to see, counts as much as an angle of 25 degrees
ROOM = 1.6  # times the tets and nodes given; what would not fit is not done
MOST = 96  # tets that one exchange may take out
POINTS, TETS, FREE, STAMP = 0, 1, 2, 3  # of `tally`


class Work(NamedTuple):
    """Arrays with room, written to by the kernels.

    points : (p, 3).   held : (p,) 1 for vertices that must not move (the boundary).   tets : (t, 4), a dead row starts with -1.
    beside : (t, 4) the tet across face i, -1 outside.   tet_of : (p,) one tet of each vertex, -1 where it is no longer used.
    free : (t,) stack of dead rows.   mark : (t,) stamps of the searches.   tally : (4,) points, rows of tets, dead rows, last stamp.
    """

    points: FloatArray
    held: ByteArray
    tets: IntArray
    beside: IntArray
    tet_of: IntArray
    free: IntArray
    mark: IntArray
    tally: IntArray


def opened(nodes: FloatArray, tets: IntArray) -> Work:
    """Work arrays of positive, conforming tets; the vertices of their boundary are held. The input is copied."""
    n, m = len(nodes), len(tets)
    rows, room = int(ROOM * m) + 400, int(ROOM * n) + 100
    beside = _neighbours(tets)
    points = np.zeros((room, 3))
    points[:n] = nodes
    held = np.zeros(room, np.uint8)
    outside = np.nonzero(beside < 0)
    held[tets[:, TET_FACES][outside]] = 1
    wide = np.full((rows, 4), -1, np.int64)
    wide[:m] = tets
    across = np.full((rows, 4), -1, np.int64)
    across[:m] = beside
    tet_of = np.full(room, -1, np.int64)
    tet_of[tets[::-1].ravel()] = np.repeat(np.arange(m)[::-1], 4)
    free = np.zeros(rows, np.int64)
    free[: rows - m] = np.arange(m, rows)[::-1]
    tally = np.array([n, rows, rows - m, 0], np.int64)
    return Work(points=points, held=held, tets=wide, beside=across, tet_of=tet_of, free=free, mark=np.zeros(rows, np.int64), tally=tally)


def closed(work: Work) -> tuple[FloatArray, IntArray, IntArray]:
    """Nodes, tets, and the row each node had in the work; nodes that no tet uses are left out. The order of the nodes stays."""
    alive = work.tets[work.tets[:, 0] >= 0]
    used, packed = np.unique(alive, return_inverse=True)
    return work.points[used], packed.reshape(-1, 4).astype(np.int64), used


def _neighbours(tets: IntArray) -> IntArray:
    """(m, 4) the tet across each face, -1 outside."""
    faces = np.sort(tets[:, TET_FACES].reshape(-1, 3), axis=1)
    order = np.lexsort(faces.T[::-1])
    same = (faces[order[1:]] == faces[order[:-1]]).all(1)
    beside = np.full(len(faces), -1, np.int64)
    first, second = order[:-1][same], order[1:][same]
    beside[first], beside[second] = second // 4, first // 4
    return beside.reshape(-1, 4)


@jit
def shape_quality(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> float:
    """1 - cos of the smallest dihedral angle or, where that is less, PER_JACOBIAN x the scaled Jacobian; -1 for a tet that is not positive.

    The angle alone lets needles through: their dihedral angles are fine, their Jacobian is not.
    """
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    # normals of the faces across b, c, d; that across a is minus their sum (all scaled by twice the area)
    bx, by, bz = wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx
    cx, cy, cz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    dx, dy, dz = vy * uz - vz * uy, vz * ux - vx * uz, vx * uy - vy * ux
    volume = -(ux * bx + uy * by + uz * bz)
    if volume <= 0.0:
        return -1.0
    ax, ay, az = -bx - cx - dx, -by - cy - dy, -bz - cz - dz
    na = 1.0 / max(np.sqrt(ax * ax + ay * ay + az * az), 1e-300)
    nb = 1.0 / max(np.sqrt(bx * bx + by * by + bz * bz), 1e-300)
    nc = 1.0 / max(np.sqrt(cx * cx + cy * cy + cz * cz), 1e-300)
    nd = 1.0 / max(np.sqrt(dx * dx + dy * dy + dz * dz), 1e-300)
    cosine = -(ax * bx + ay * by + az * bz) * na * nb
    cosine = max(cosine, -(ax * cx + ay * cy + az * cz) * na * nc)
    cosine = max(cosine, -(ax * dx + ay * dy + az * dz) * na * nd)
    cosine = max(cosine, -(bx * cx + by * cy + bz * cz) * nb * nc)
    cosine = max(cosine, -(bx * dx + by * dy + bz * dz) * nb * nd)
    cosine = max(cosine, -(cx * dx + cy * dy + cz * dz) * nc * nd)
    u2, v2, w2 = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
    r2 = (ux - vx) ** 2 + (uy - vy) ** 2 + (uz - vz) ** 2
    s2 = (ux - wx) ** 2 + (uy - wy) ** 2 + (uz - wz) ** 2
    t2 = (vx - wx) ** 2 + (vy - wy) ** 2 + (vz - wz) ** 2
    product = np.sqrt(max(u2 * v2 * w2, u2 * r2 * s2, v2 * r2 * t2, w2 * s2 * t2))
    return float(min(1.0 - cosine, PER_JACOBIAN * 2**0.5 * volume / product))


@jit
def quality_of(w: Work, t: int) -> float:
    p, v = w.points, w.tets[t]
    return shape_quality(p[v[0]], p[v[1]], p[v[2]], p[v[3]])


@jit
def all_qualities(w: Work) -> FloatArray:
    """(t,) of every row; 2 for dead ones."""
    out = np.full(len(w.tets), 2.0)
    for t in range(len(w.tets)):
        if w.tets[t, 0] >= 0:
            out[t] = quality_of(w, t)
    return out


@jit
def star_of(w: Work, v: int, out: IntArray) -> int:
    """The tets round vertex v into `out`; how many, or -1 where they are more than `out` holds."""
    start = w.tet_of[v]
    if start < 0:
        return 0
    w.tally[STAMP] += 1
    stamp = w.tally[STAMP]
    out[0] = start
    w.mark[start] = stamp
    n, k = 1, 0
    while k < n:
        t = out[k]
        k += 1
        for i in range(4):
            u = w.beside[t, i]
            if w.tets[t, i] == v or u < 0 or w.mark[u] == stamp:
                continue
            if n == len(out):
                return -1
            w.mark[u] = stamp
            out[n] = u
            n += 1
    return n


@jit
def corner_of(w: Work, t: int, v: int) -> int:
    for i in range(4):
        if w.tets[t, i] == v:
            return i
    return -1


@jit
def outward(w: Work, t: int, i: int, face: IntArray) -> None:
    """The corners of face i of t, outward."""
    v = w.tets[t]
    if i == 0:
        face[0], face[1], face[2] = v[1], v[2], v[3]
    elif i == 1:
        face[0], face[1], face[2] = v[0], v[3], v[2]
    elif i == 2:
        face[0], face[1], face[2] = v[0], v[1], v[3]
    else:
        face[0], face[1], face[2] = v[0], v[2], v[1]


@jit
def ring_of(w: Work, t: int, a: int, b: int, around: IntArray, tets: IntArray) -> int:
    """Vertices and tets round the edge a b from tet t on: (a, b, around[i], around[i + 1]) is positive.

    How many; 0 where the edge lies on the boundary or has more than fit.
    """
    i, j = corner_of(w, t, a), corner_of(w, t, b)
    c, d = -1, -1
    for k in range(4):
        if k not in (i, j):
            if c < 0:
                c = k
            else:
                d = k
    swaps = (i > j) + (i > c) + (i > d) + (j > c) + (j > d) + (c > d)
    if swaps % 2 == 1:
        c, d = d, c
    at = t
    first, second = w.tets[t, c], w.tets[t, d]
    n = 0
    while True:
        if n == len(around):
            return 0
        around[n], tets[n] = first, at
        n += 1
        beyond = w.beside[at, corner_of(w, at, first)]
        if beyond < 0:
            return 0
        at = beyond
        first = second
        for k in range(4):
            x = w.tets[at, k]
            if x not in (a, b, first):
                second = x
        if at == t:
            return n


@jit
def _same(a0: int, a1: int, a2: int, b0: int, b1: int, b2: int) -> bool:
    return (a0 in (b0, b1, b2)) and (a1 in (b0, b1, b2)) and (a2 in (b0, b1, b2))


@jit
def exchange(w: Work, old: IntArray, n_old: int, new: IntArray, n_new: int, rows: IntArray) -> bool:
    """Take the tets `old` out and put the corners `new` (n_new, 4) in, which fill the same place; their rows go into `rows`.

    Changes nothing and says False where the room is used up.
    """
    if n_new > n_old + w.tally[FREE]:
        return False
    rim = np.empty((4 * n_old, 5), np.int64)
    n_rim = _rim_of(w, old, n_old, rim)
    for k in range(n_old):
        for i in range(4):
            w.tet_of[w.tets[old[k], i]] = -1
        w.tets[old[k], 0] = -1
        w.free[w.tally[FREE]] = old[k]
        w.tally[FREE] += 1
    for k in range(n_new):
        w.tally[FREE] -= 1
        t = w.free[w.tally[FREE]]
        rows[k] = t
        for i in range(4):
            w.tets[t, i] = new[k, i]
            w.beside[t, i] = -2
            w.tet_of[new[k, i]] = t
    for k in range(n_new):
        for i in range(4):
            if w.beside[rows[k], i] == -2:
                _join(w, rows[k], i, rows, k, n_new, rim, n_rim)
    return True


@jit
def _rim_of(w: Work, old: IntArray, n_old: int, rim: IntArray) -> int:
    """The faces round the tets `old`: three corners, the tet beyond (-1 outside) and its face there. How many."""
    w.tally[STAMP] += 1
    stamp = w.tally[STAMP]
    for k in range(n_old):
        w.mark[old[k]] = stamp
    n = 0
    for k in range(n_old):
        t = old[k]
        for i in range(4):
            u = w.beside[t, i]
            if u >= 0 and w.mark[u] == stamp:
                continue
            x, y, z = w.tets[t, (i + 1) % 4], w.tets[t, (i + 2) % 4], w.tets[t, (i + 3) % 4]
            face = -1
            if u >= 0:
                for j in range(4):
                    if w.tets[u, j] not in (x, y, z):
                        face = j
            rim[n, 0], rim[n, 1], rim[n, 2], rim[n, 3], rim[n, 4] = x, y, z, u, face
            n += 1
    return n


@jit
def _join(w: Work, t: int, i: int, rows: IntArray, k: int, n_new: int, rim: IntArray, n_rim: int) -> None:
    """Find what lies across face i of the new tet t: another new tet, or what lay beyond the old ones."""
    x, y, z = w.tets[t, (i + 1) % 4], w.tets[t, (i + 2) % 4], w.tets[t, (i + 3) % 4]
    for m in range(k + 1, n_new):
        u = rows[m]
        for j in range(4):
            if w.beside[u, j] == -2 and _same(x, y, z, w.tets[u, (j + 1) % 4], w.tets[u, (j + 2) % 4], w.tets[u, (j + 3) % 4]):
                w.beside[t, i], w.beside[u, j] = u, t
                return
    for m in range(n_rim):
        if _same(x, y, z, rim[m, 0], rim[m, 1], rim[m, 2]):
            u = rim[m, 3]
            w.beside[t, i] = u
            if u >= 0:
                w.beside[u, rim[m, 4]] = t
            return
    w.beside[t, i] = -1
