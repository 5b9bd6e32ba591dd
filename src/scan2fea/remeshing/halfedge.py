"""Split, collapse and flip on a closed triangle mesh, compiled. Guards live here; what to aim for lives in `isotropic`.

Half-edge h = 3 f + k starts at origin[h], corner k of face f; a dead face has origin -1. twin[h] is the opposite half-edge,
out[v] one half-edge that starts at v. sharp[h] is 1 on creases, on both halves. kind[v]: FREE, CREASE (slides along its crease only),
CORNER (stays), FROZEN (nothing near it changes). goal[v] is the edge length wanted at v.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.kernel.small_matrices import cross
from scan2fea.remeshing.sizing import GROWTH
from scan2fea.types import ByteArray, FloatArray, IntArray

FREE, CREASE, CORNER, FROZEN = 0, 1, 2, 3
LONG, SHORT = 4 / 3, 4 / 5  # of the goal: a split or a collapse brings the edge nearer to it (Botsch and Kobbelt 2004)
GOOD = 0.45  # shape (1 is equilateral) from which on a change need not improve; about 25 degrees
SLIVER = 0.1  # shape under which a face's own normal says little


@jit
def _area_vector(a: FloatArray, b: FloatArray, c: FloatArray, out: FloatArray) -> float:
    """Unit normal into `out`; the shape 4 sqrt(3) area / sum of squared edges, 1 for equilateral, is returned."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    doubled = np.sqrt(nx * nx + ny * ny + nz * nz)
    wx, wy, wz = ux - vx, uy - vy, uz - vz
    squares = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
    if doubled <= 1e-300 or squares <= 0:
        out[0] = out[1] = out[2] = 0.0
        return 0.0
    out[0] = nx / doubled
    out[1] = ny / doubled
    out[2] = nz / doubled
    return float(2 * np.sqrt(3.0) * doubled / squares)


@jit
def _fan_accepts(
    v: int, at: FloatArray, skip: int, origin: IntArray, twin: IntArray, out: IntArray, points: FloatArray, turn: float, floor: float
) -> float:
    """Worst shape of the faces around v with v moved to `at`, leaving out those that hold vertex `skip`; -1 where one would turn over.

    A face turns over if its normal leaves the old one by more than acos(turn); that of a sliver is compared with the mean of the fan.
    Shapes under `floor` are accepted only if no worse than the worst there was.
    """
    before, after, mean = np.zeros(3), np.zeros(3), np.zeros(3)
    worst_old, worst = 2.0, 2.0
    first = out[v]
    h = first
    while True:
        b, c = origin[h // 3 * 3 + (h + 1) % 3], origin[h // 3 * 3 + (h + 2) % 3]
        q = _area_vector(points[v], points[b], points[c], before)
        worst_old = min(worst_old, q)
        size = 0.0
        for k in range(3):
            size += (points[b, k] - points[c, k]) ** 2
        for k in range(3):
            mean[k] += before[k] * q * size
        h = twin[h // 3 * 3 + (h + 2) % 3]
        if h == first:
            break
    length = np.sqrt(mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2)
    h = first
    while True:
        b, c = origin[h // 3 * 3 + (h + 1) % 3], origin[h // 3 * 3 + (h + 2) % 3]
        if skip not in (b, c):
            q_old = _area_vector(points[v], points[b], points[c], before)
            q = _area_vector(at, points[b], points[c], after)
            worst = min(worst, q)
            if q_old >= SLIVER:
                if before[0] * after[0] + before[1] * after[1] + before[2] * after[2] < turn:
                    return -1.0
            elif mean[0] * after[0] + mean[1] * after[1] + mean[2] * after[2] < 0.3 * length:
                return -1.0
        h = twin[h // 3 * 3 + (h + 2) % 3]
        if h == first:
            break
    if worst < floor and worst < worst_old:
        return -1.0
    return float(worst)


@jit
def _valence(v: int, twin: IntArray, out: IntArray) -> int:
    n, h = 0, out[v]
    while True:
        n += 1
        h = twin[h // 3 * 3 + (h + 2) % 3]
        if h == out[v]:
            return n


@jit
def _are_joined(a: int, b: int, origin: IntArray, twin: IntArray, out: IntArray) -> bool:
    h = out[a]
    while True:
        if origin[h // 3 * 3 + (h + 1) % 3] == b:
            return True
        h = twin[h // 3 * 3 + (h + 2) % 3]
        if h == out[a]:
            return False


@jit
def split_edges(
    queue: IntArray, n_vertices: int, n_faces: int, origin: IntArray, twin: IntArray, out: IntArray, sharp: ByteArray, kind: ByteArray,
    goal: FloatArray, region: IntArray, points: FloatArray, largest: float,
) -> tuple[int, int]:  # fmt: skip
    """Halve each queued half-edge that is longer than LONG times its goal; arrays have room behind n_vertices and n_faces. Returns the new counts.

    largest : what the goal may grow to in the middle of long edges.
    """
    for h in queue:
        t = twin[h]
        f, g = h // 3, t // 3
        h1, h2, t2 = f * 3 + (h + 1) % 3, f * 3 + (h + 2) % 3, g * 3 + (t + 2) % 3
        a, b, c, d = origin[h], origin[h1], origin[h2], origin[t2]
        if kind[a] == FROZEN or kind[b] == FROZEN or kind[c] == FROZEN or kind[d] == FROZEN:
            continue
        length = 0.0
        for k in range(3):
            length += (points[a, k] - points[b, k]) ** 2
        if np.sqrt(length) <= LONG * 0.5 * (goal[a] + goal[b]):
            continue
        m = n_vertices
        n_vertices += 1
        for k in range(3):
            points[m, k] = 0.5 * (points[a, k] + points[b, k])
        # between two holes of a plate the goal is not that of their rims
        grown = min(goal[a], goal[b]) + GROWTH * (0.5 * np.sqrt(length) - max(goal[a], goal[b]))
        goal[m] = max(0.5 * (goal[a] + goal[b]), min(grown, largest))
        kind[m] = CREASE if sharp[h] else FREE
        e, i = 3 * n_faces, 3 * n_faces + 3
        n_faces += 2
        region[e // 3], region[i // 3] = region[f], region[g]
        bc, db = twin[h1], twin[t2]
        origin[h1] = m
        origin[t] = m
        origin[e], origin[e + 1], origin[e + 2] = m, b, c
        origin[i], origin[i + 1], origin[i + 2] = b, m, d
        twin[e], twin[i] = i, e
        twin[e + 1], twin[bc] = bc, e + 1
        twin[e + 2], twin[h1] = h1, e + 2
        twin[i + 1], twin[t2] = t2, i + 1
        twin[i + 2], twin[db] = db, i + 2
        sharp[e] = sharp[i] = sharp[h]
        sharp[e + 1], sharp[i + 2] = sharp[h1], sharp[t2]
        sharp[h1] = sharp[e + 2] = sharp[t2] = sharp[i + 1] = 0
        out[m], out[b] = e, i
        # out of a, c and d still start there: h, h2 and t2 kept their origins
    return n_vertices, n_faces


@jit
def _may_collapse(h: int, origin: IntArray, twin: IntArray, out: IntArray, sharp: ByteArray, kind: ByteArray) -> bool:
    """Is taking the start of h into its end allowed by topology and creases? (link condition, Dey et al. 1999)"""
    t = twin[h]
    h1, h2, t1, t2 = h // 3 * 3 + (h + 1) % 3, h // 3 * 3 + (h + 2) % 3, t // 3 * 3 + (t + 1) % 3, t // 3 * 3 + (t + 2) % 3
    a, b, c, d = origin[h], origin[h1], origin[h2], origin[t2]
    if kind[a] >= CORNER or kind[b] == FROZEN or (kind[a] == CREASE and not sharp[h]) or c == d:
        return False
    if sharp[h2] or sharp[t1]:  # a crease of a would fall onto another edge
        return False
    if _valence(c, twin, out) <= 3 or _valence(d, twin, out) <= 3:
        return False
    i = out[a]
    while True:
        w = origin[i // 3 * 3 + (i + 1) % 3]
        if kind[w] == FROZEN or (w not in (b, c, d) and _are_joined(b, w, origin, twin, out)):
            return False
        i = twin[i // 3 * 3 + (i + 2) % 3]
        if i == out[a]:
            return True


@jit
def _segment_gap(p: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray, n: FloatArray) -> float:
    """Height of p over the plane of a face with unit normal n; inf where p does not lie over the face."""
    height = (p[0] - a[0]) * n[0] + (p[1] - a[1]) * n[1] + (p[2] - a[2]) * n[2]
    corner = (a, b, c)
    for k in range(3):
        s, e = corner[k], corner[(k + 1) % 3]
        ex, ey, ez = e[0] - s[0], e[1] - s[1], e[2] - s[2]
        rx, ry, rz = p[0] - s[0], p[1] - s[1], p[2] - s[2]
        side = (ey * rz - ez * ry) * n[0] + (ez * rx - ex * rz) * n[1] + (ex * ry - ey * rx) * n[2]
        if side < -1e-9 * (ex * ex + ey * ey + ez * ez):
            return np.inf
    return float(abs(height))


@jit
def _fits_after_collapse(
    h: int, origin: IntArray, twin: IntArray, out: IntArray, goal: FloatArray, points: FloatArray, turn: float, drift: float, stretch: float
) -> bool:
    """Do edges stay under the long limit and does the surface under the vertex move by less than `drift`?"""
    a, b = origin[h], origin[h // 3 * 3 + (h + 1) % 3]
    normal = np.zeros(3)
    gap = np.inf
    i = out[a]
    while True:
        w, x = origin[i // 3 * 3 + (i + 1) % 3], origin[i // 3 * 3 + (i + 2) % 3]
        if w != b:
            length = 0.0
            for k in range(3):
                length += (points[b, k] - points[w, k]) ** 2
            if np.sqrt(length) > stretch * 0.5 * (goal[b] + goal[w]):
                return False
            if x != b:
                _area_vector(points[b], points[w], points[x], normal)
                gap = min(gap, _segment_gap(points[a], points[b], points[w], points[x], normal))
        i = twin[i // 3 * 3 + (i + 2) % 3]
        if i == out[a]:
            break
    if gap == np.inf:  # over no face: the distance to the end bounds it
        gap = 0.0
        for k in range(3):
            gap += (points[a, k] - points[b, k]) ** 2
        gap = np.sqrt(gap)
    return bool(gap <= drift and _fan_accepts(a, points[b], b, origin, twin, out, points, turn, GOOD) >= 0)


@jit
def collapse_edges(
    queue: IntArray, origin: IntArray, twin: IntArray, out: IntArray, sharp: ByteArray, kind: ByteArray, goal: FloatArray,
    points: FloatArray, turn: float, drift: float, short: float,
) -> int:  # fmt: skip
    """Take one end of each queued half-edge shorter than `short` times its goal into the other where the guards allow it. Returns how many."""
    count = 0
    for queued in queue:
        if origin[queued] < 0:
            continue
        a, b = origin[queued], origin[queued // 3 * 3 + (queued + 1) % 3]
        length = 0.0
        for k in range(3):
            length += (points[a, k] - points[b, k]) ** 2
        if np.sqrt(length) >= short * 0.5 * (goal[a] + goal[b]):
            continue
        for h in (queued, twin[queued]):
            if not _may_collapse(h, origin, twin, out, sharp, kind):
                continue
            if not _fits_after_collapse(h, origin, twin, out, goal, points, turn, drift, LONG):
                continue
            t = twin[h]
            h1, h2, t1, t2 = h // 3 * 3 + (h + 1) % 3, h // 3 * 3 + (h + 2) % 3, t // 3 * 3 + (t + 1) % 3, t // 3 * 3 + (t + 2) % 3
            a, b, c, d = origin[h], origin[h1], origin[h2], origin[t2]
            i = out[a]
            while True:
                origin[i] = b
                i = twin[i // 3 * 3 + (i + 2) % 3]
                if i == out[a]:
                    break
            x, y, u, w = twin[h1], twin[h2], twin[t1], twin[t2]  # c-b, b-c (was a-c), d-b (was d-a), b-d
            twin[x], twin[y], twin[u], twin[w] = y, x, w, u
            sharp[y] = sharp[x]
            sharp[u] = sharp[w]
            out[b], out[c], out[d], out[a] = y, x, u, -1
            for k in range(3):
                origin[h // 3 * 3 + k] = -1
                origin[t // 3 * 3 + k] = -1
            count += 1
            break
    return count


@jit
def flip_edges(
    queue: IntArray, origin: IntArray, twin: IntArray, out: IntArray, sharp: ByteArray, kind: ByteArray, points: FloatArray, turn: float, drift: float
) -> int:
    """Turn each queued edge where that raises the worse shape of its two faces and moves the surface by less than `drift`. Returns how many."""
    n1, n2, m1, m2 = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    count = 0
    for h in queue:
        t = twin[h]
        h1, h2, t1, t2 = h // 3 * 3 + (h + 1) % 3, h // 3 * 3 + (h + 2) % 3, t // 3 * 3 + (t + 1) % 3, t // 3 * 3 + (t + 2) % 3
        a, b, c, d = origin[h], origin[h1], origin[h2], origin[t2]
        if sharp[h] or c == d or kind[a] == FROZEN or kind[b] == FROZEN or kind[c] == FROZEN or kind[d] == FROZEN:
            continue
        q1, q2 = _area_vector(points[a], points[b], points[c], n1), _area_vector(points[b], points[a], points[d], n2)
        r1, r2 = _area_vector(points[a], points[d], points[c], m1), _area_vector(points[d], points[b], points[c], m2)
        if min(r1, r2) <= min(q1, q2) + 1e-3:
            continue
        mean = n1 * q1 + n2 * q2 if min(q1, q2) < SLIVER else n1 + n2
        size = np.sqrt((mean * mean).sum())
        if (m1 * m2).sum() < turn or (m1 * mean).sum() < turn * size or (m2 * mean).sum() < turn * size:
            continue
        ab, cd = points[b] - points[a], points[d] - points[c]
        across = cross(ab, cd)
        gap = abs((across * (points[c] - points[a])).sum()) / max(np.sqrt((across * across).sum()), 1e-300)
        if gap > drift or _valence(a, twin, out) <= 3 or _valence(b, twin, out) <= 3 or _are_joined(c, d, origin, twin, out):
            continue
        ad, ca, db, bc = twin[t1], twin[h2], twin[t2], twin[h1]
        s_ad, s_ca, s_db, s_bc = sharp[t1], sharp[h2], sharp[t2], sharp[h1]
        e, i = h // 3 * 3, t // 3 * 3
        origin[e], origin[e + 1], origin[e + 2] = a, d, c
        origin[i], origin[i + 1], origin[i + 2] = d, b, c
        twin[e], twin[ad], twin[e + 1], twin[i + 2], twin[e + 2], twin[ca] = ad, e, i + 2, e + 1, ca, e + 2
        twin[i], twin[db], twin[i + 1], twin[bc] = db, i, bc, i + 1
        sharp[e], sharp[e + 1], sharp[e + 2] = s_ad, 0, s_ca
        sharp[i], sharp[i + 1], sharp[i + 2] = s_db, s_bc, 0
        out[a], out[b], out[c], out[d] = e, i + 1, e + 2, i
        count += 1
    return count


@jit
def move_vertices(
    queue: IntArray, wanted: FloatArray, origin: IntArray, twin: IntArray, out: IntArray, points: FloatArray, turn: float, floor: float
) -> int:
    """Move each queued vertex to its wanted place, or half the way, where no face around it turns over or falls under `floor`. Returns how many."""
    count = 0
    for i in range(len(queue)):
        v = queue[i]
        step = wanted[i] - points[v]
        for share in (1.0, 0.5, 0.2):
            at = points[v] + share * step
            if _fan_accepts(v, at, -1, origin, twin, out, points, turn, floor) >= 0:
                for x in range(3):
                    points[v, x] = at[x]
                count += 1
                break
    return count
