"""The fill of a hole made as dense as the mesh around it: centroids put in where a triangle is too large, edges turned (Liepa 2003; compiled)."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.kernel.small_matrices import cross
from scan2fea.kernel.topology import edge_table
from scan2fea.types import FloatArray, IntArray

CONTROL = math.sqrt(2.0)  # of Liepa: a corner farther than its scale / CONTROL from the centroid makes room for a vertex there
MOST_NEW = 20_000  # vertices put into one hole at most
SWEEPS, ROUNDS = 50, 40


@jit
def _corner(faces: IntArray, f: int, v: int) -> int:
    return 0 if faces[f, 0] == v else (1 if faces[f, 1] == v else 2)


@jit
def _angle(p: FloatArray, at: int, a: int, b: int) -> float:
    ux, uy, uz = p[a, 0] - p[at, 0], p[a, 1] - p[at, 1], p[a, 2] - p[at, 2]
    vx, vy, vz = p[b, 0] - p[at, 0], p[b, 1] - p[at, 1], p[b, 2] - p[at, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return math.atan2(math.sqrt(x * x + y * y + z * z), ux * vx + uy * vy + uz * vz)


@jit
def _joined(faces: IntArray, beside: IntArray, f: int, c: int, d: int) -> bool:
    """Does an edge of the fill join c, a corner of face f, and d?"""
    for way in range(2):
        g = f
        for _ in range(len(faces)):
            k = _corner(faces, g, c)
            if faces[g, (k + 1) % 3] == d or faces[g, (k + 2) % 3] == d:
                return True
            g = beside[g, k] if way == 0 else beside[g, (k + 2) % 3]
            if g < 0 or g == f:
                break
    return False


@jit
def _link(beside: IntArray, f: int, old: int, new: int) -> None:
    if f >= 0:
        for k in range(3):
            if beside[f, k] == old:
                beside[f, k] = new
                return


@jit
def _may_turn(p: FloatArray, a: int, b: int, c: int, d: int) -> bool:
    """Would faces (a, d, c) and (d, b, c) look where (a, b, c) and (b, a, d) do?"""
    ab, ac, ad = p[b] - p[a], p[c] - p[a], p[d] - p[a]
    old = cross(ab, ac) + cross(ad, ab)
    one, two = cross(ad, ac), cross(p[b] - p[d], p[c] - p[d])
    return bool((one * old).sum() > 0.0 and (two * old).sum() > 0.0)


@jit
def _relax(p: FloatArray, faces: IntArray, beside: IntArray, n_faces: int, n_old: int, taken: IntArray, n: int) -> None:
    """Inner edges turned while the angles across them exceed 180 degrees together; arrays changed in place. taken : keys of edges elsewhere."""
    for _ in range(SWEEPS):
        turned = 0
        for f in range(n_faces):
            for k in range(3):
                g = beside[f, k]
                if g < f:
                    continue
                a, b, c = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
                m = _corner(faces, g, b)
                d = faces[g, (m + 2) % 3]
                if c == d or _angle(p, c, a, b) + _angle(p, d, a, b) <= math.pi + 1e-9:
                    continue
                if c < n_old and d < n_old:
                    key = min(c, d) * n + max(c, d)
                    row = np.searchsorted(taken, key)
                    if row < len(taken) and taken[row] == key:
                        continue
                if not _may_turn(p, a, b, c, d) or _joined(faces, beside, f, c, d):
                    continue
                bc, ca = beside[f, (k + 1) % 3], beside[f, (k + 2) % 3]
                ad, db = beside[g, (m + 1) % 3], beside[g, (m + 2) % 3]
                faces[f, 0], faces[f, 1], faces[f, 2] = a, d, c
                beside[f, 0], beside[f, 1], beside[f, 2] = ad, g, ca
                faces[g, 0], faces[g, 1], faces[g, 2] = d, b, c
                beside[g, 0], beside[g, 1], beside[g, 2] = db, bc, f
                _link(beside, ad, g, f)
                _link(beside, bc, f, g)
                turned += 1
                break
        if turned == 0:
            break


@jit
def _split(p: FloatArray, scale: FloatArray, faces: IntArray, beside: IntArray, n_faces: int, n_points: int, most: int) -> tuple[int, int]:
    """A vertex in the middle of every face that is too large; the new counts of faces and points."""
    for f in range(n_faces):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if n_points >= most:
            break
        middle = (p[a] + p[b] + p[c]) / 3.0
        size = (scale[a] + scale[b] + scale[c]) / 3.0
        large = True
        for v in (a, b, c):
            away = CONTROL * math.sqrt(((middle - p[v]) ** 2).sum())
            large = large and away > size and away > scale[v]
        if not large:
            continue
        w, g, h = n_points, n_faces, n_faces + 1
        p[w], scale[w] = middle, size
        bc, ca = beside[f, 1], beside[f, 2]
        faces[f, 2] = w
        faces[g, 0], faces[g, 1], faces[g, 2] = b, c, w
        faces[h, 0], faces[h, 1], faces[h, 2] = c, a, w
        beside[f, 1], beside[f, 2] = g, h
        beside[g, 0], beside[g, 1], beside[g, 2] = bc, h, f
        beside[h, 0], beside[h, 1], beside[h, 2] = ca, f, g
        _link(beside, bc, f, g)
        _link(beside, ca, f, h)
        n_points += 1
        n_faces += 2
    return n_faces, n_points


@jit
def _refine(
    p: FloatArray, scale: FloatArray, faces: IntArray, beside: IntArray, n_faces: int, n_old: int, taken: IntArray, n: int
) -> tuple[int, int]:  # fmt: skip
    n_points = n_old
    _relax(p, faces, beside, n_faces, n_old, taken, n)
    for _ in range(ROUNDS):
        before = n_points
        n_faces, n_points = _split(p, scale, faces, beside, n_faces, n_points, len(p))
        if n_points == before:
            break
        _relax(p, faces, beside, n_faces, n_old, taken, n)
    return n_faces, n_points


def refined(points: FloatArray, faces: IntArray, scale: FloatArray, taken: IntArray) -> tuple[FloatArray, IntArray]:
    """The fill with as many vertices as the scales of its border ask for; the new ones come last.

    points : (n, 3) of the border.   faces : (m, 3) over them.   scale : (n,) mean edge length around each, m.   taken : (k, 2) edges between
    points that the mesh has already.
    """
    n, m = len(points), len(faces)
    length = np.linalg.norm(points[faces] - points[np.roll(faces, -1, axis=1)], axis=2)
    area = float(np.prod(length, axis=1).sum()) / max(float(length.mean()), 1e-300)  # generous: only sets the room that is kept
    room = min(MOST_NEW, 64 + int(8.0 * area / max(float(scale.min()) ** 2, 1e-300)))
    p, s = np.zeros((n + room, 3)), np.zeros(n + room)
    p[:n], s[:n] = points, scale
    f, beside = np.zeros((m + 2 * room, 3), np.int64), np.full((m + 2 * room, 3), -1, np.int64)
    twin = edge_table(faces).twin
    f[:m], beside[:m] = faces, np.where(twin >= 0, twin // 3, -1).reshape(-1, 3)
    keys = np.unique(taken.min(1) * n + taken.max(1)) if len(taken) else np.zeros(0, np.int64)
    n_faces, n_points = _refine(p, s, f, beside, m, n, keys, n)
    return p[:n_points], f[:n_faces]
