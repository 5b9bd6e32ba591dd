"""Compiled pieces of Lloyd and ODT on a surface: cells and energies of triangles, sliding on a reference, Delaunay flips.

Edge k of face f runs from corner k to corner k + 1; beside[f, k] is the face across it, sharp[f, k] is 1 on creases (on both sides).
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.distances import nearest_on_triangle
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, ByteArray, FloatArray, IntArray

ODT, LLOYD = 0, 1


@jit
def dot(a: FloatArray, b: FloatArray, o: FloatArray) -> float:
    """(a - o) . (b - o)."""
    return float((a[0] - o[0]) * (b[0] - o[0]) + (a[1] - o[1]) * (b[1] - o[1]) + (a[2] - o[2]) * (b[2] - o[2]))


@jit
def area_normal(a: FloatArray, b: FloatArray, c: FloatArray, out: FloatArray) -> float:
    """Unit normal into `out` (zero for no area); the area."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    out[0], out[1], out[2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    doubled = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    for k in range(3):
        out[k] = out[k] / doubled if doubled > 0 else 0.0
    return float(doubled / 2)


@jit
def _enter(v: int, area: float, a: FloatArray, b: FloatArray, c: FloatArray, total: FloatArray, weight: FloatArray) -> None:
    weight[v] += area
    for x in range(3):
        total[v, x] += area * (a[x] + b[x] + c[x]) / 3


@jit
def lloyd_cells(p: FloatArray, faces: IntArray) -> tuple[FloatArray, float]:
    """Centroids of the Voronoi cells, each triangle shared out among its own corners; and the integral of |x - corner|^2.

    A right-angled piece with legs a (along the edge) and h gives a^3 h / 4 + a h^3 / 12.
    """
    total, weight, energy = np.zeros(p.shape), np.zeros(len(p)), 0.0
    middle, foot, other, n = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for f in range(len(faces)):
        area = area_normal(p[faces[f, 0]], p[faces[f, 1]], p[faces[f, 2]], n)
        if area <= 0:
            continue
        obtuse = -1
        for k in range(3):
            if dot(p[faces[f, (k + 1) % 3]], p[faces[f, (k + 2) % 3]], p[faces[f, k]]) < 0:
                obtuse = k
        if obtuse < 0:
            for k in range(3):  # edge a b, whose bisector ends in the centre of the circle
                a, b, c = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
                half = np.sqrt(dot(p[b], p[b], p[a])) / 2
                cot = dot(p[a], p[b], p[c]) / (2 * area)
                _right_pieces(p, a, b, half, half * cot, n, total, weight, middle, foot)
                energy += 2 * (half**3 * half * cot / 4 + half * (half * cot) ** 3 / 12)
        else:
            c, a, b = faces[f, obtuse], faces[f, (obtuse + 1) % 3], faces[f, (obtuse + 2) % 3]
            energy += _obtuse(p, a, b, c, area, total, weight, middle, foot, other)
    for v in range(len(p)):
        for x in range(3):
            total[v, x] = total[v, x] / weight[v] if weight[v] > 0 else p[v, x]
    return total, energy


@jit
def lloyd_of(a: FloatArray, b: FloatArray, c: FloatArray, n: FloatArray) -> float:
    """The energy of one triangle alone; as in `lloyd_cells`."""
    area = area_normal(a, b, c, n)
    if area <= 0:
        return 0.0
    corner = (a, b, c)
    energy = 0.0
    for k in range(3):
        p, q, r = corner[k], corner[(k + 1) % 3], corner[(k + 2) % 3]
        if dot(q, r, p) < 0:  # obtuse at p
            left = area
            long2 = dot(r, r, q)
            shares = np.zeros(2)
            energy = 0.0
            for side in range(2):
                v, w = (q, r) if side == 0 else (r, q)
                short2 = dot(p, p, v)
                along = short2 / (2 * dot(w, p, v))
                h, half = np.sqrt(max(along * along * long2 - short2 / 4, 0.0)), np.sqrt(short2) / 2
                energy += 2 * (half**3 * h / 4 + half * h**3 / 12)
                left -= half * h
                shares[side] = along
            foot, other = np.zeros(3), np.zeros(3)
            for x in range(3):
                foot[x] = q[x] + shares[0] * (r[x] - q[x])
                other[x] = r[x] + shares[1] * (q[x] - r[x])
            return energy + left / 6 * (dot(foot, foot, p) + dot(other, other, p) + dot(foot, other, p))
        half = np.sqrt(dot(q, q, p)) / 2
        h = half * dot(p, q, r) / (2 * area)
        energy += 2 * (half**3 * h / 4 + half * h**3 / 12)
    return energy


@jit
def _energy_of(kind: int, a: FloatArray, b: FloatArray, c: FloatArray, n: FloatArray) -> float:
    return odt_of(a, b, c, n) if kind == ODT else lloyd_of(a, b, c, n)


@jit
def _right_pieces(
    p: FloatArray, a: int, b: int, half: float, h: float, n: FloatArray, total: FloatArray, weight: FloatArray, middle: FloatArray, foot: FloatArray
) -> None:
    """The two pieces at the middle of the edge a b, h high on its left side."""
    for x in range(3):
        middle[x] = (p[a, x] + p[b, x]) / 2
    ex, ey, ez = (p[b, 0] - p[a, 0]) / (2 * half), (p[b, 1] - p[a, 1]) / (2 * half), (p[b, 2] - p[a, 2]) / (2 * half)
    foot[0] = middle[0] + h * (n[1] * ez - n[2] * ey)
    foot[1] = middle[1] + h * (n[2] * ex - n[0] * ez)
    foot[2] = middle[2] + h * (n[0] * ey - n[1] * ex)
    _enter(a, half * h / 2, p[a], middle, foot, total, weight)
    _enter(b, half * h / 2, p[b], middle, foot, total, weight)


@jit
def _obtuse(
    p: FloatArray, a: int, b: int, c: int, area: float, total: FloatArray, weight: FloatArray, middle: FloatArray, foot: FloatArray, other: FloatArray
) -> float:
    """The obtuse corner is c: a and b get what the bisectors of c a and c b cut off, c the same mirrored and the triangle between."""
    energy = 0.0
    long2 = dot(p[b], p[b], p[a])
    for side in range(2):
        v, w = (a, b) if side == 0 else (b, a)
        short2 = dot(p[c], p[c], p[v])
        along = short2 / (2 * dot(p[w], p[c], p[v]))  # share of v w at which the bisector of v c meets it
        h = np.sqrt(max(along * along * long2 - short2 / 4, 0.0))
        half = np.sqrt(short2) / 2
        end = foot if side == 0 else other
        for x in range(3):
            middle[x] = (p[v, x] + p[c, x]) / 2
            end[x] = p[v, x] + along * (p[w, x] - p[v, x])
        _enter(v, half * h / 2, p[v], middle, end, total, weight)
        _enter(c, half * h / 2, p[c], middle, end, total, weight)
        energy += 2 * (half**3 * h / 4 + half * h**3 / 12)
        area -= half * h
    _enter(c, area, p[c], foot, other, total, weight)
    return energy + area / 6 * (dot(foot, foot, p[c]) + dot(other, other, p[c]) + dot(foot, other, p[c]))


@jit
def odt_targets(p: FloatArray, faces: IntArray) -> FloatArray:
    """sum A c / sum A over each star, c the centres of the circles."""
    total, weight, n = np.zeros(p.shape), np.zeros(len(p)), np.zeros(3)
    for f in range(len(faces)):
        a, b, c = p[faces[f, 0]], p[faces[f, 1]], p[faces[f, 2]]
        area = area_normal(a, b, c, n)
        if area <= 0:
            continue
        # barycentric weights of the centre: a^2 (b^2 + c^2 - a^2), ...
        a2, b2, c2 = dot(b, b, c), dot(c, c, a), dot(a, a, b)
        s, t, u = a2 * (b2 + c2 - a2), b2 * (c2 + a2 - b2), c2 * (a2 + b2 - c2)
        whole = s + t + u
        if whole <= 0:  # 16 area^2 but for rounding: a needle without a centre
            continue
        for k in range(3):
            v = faces[f, k]
            weight[v] += area
            for x in range(3):
                total[v, x] += area * (s * a[x] + t * b[x] + u * c[x]) / whole
    for v in range(len(p)):
        for x in range(3):
            total[v, x] = total[v, x] / weight[v] if weight[v] > 0 else p[v, x]
    return total


@jit
def odt_of(a: FloatArray, b: FloatArray, c: FloatArray, n: FloatArray) -> float:
    """The error of the interpolant of |x|^2 over a triangle: area / 12 x the sum of the squared edges."""
    return area_normal(a, b, c, n) / 12 * (dot(b, b, a) + dot(c, c, b) + dot(a, a, c))


@jit
def odt_energy(p: FloatArray, faces: IntArray) -> float:
    total, n = 0.0, np.zeros(3)
    for f in range(len(faces)):
        total += odt_of(p[faces[f, 0]], p[faces[f, 1]], p[faces[f, 2]], n)
    return total


@jit
def half_shortest_edges(p: FloatArray, faces: IntArray, held: BoolArray) -> FloatArray:
    out = np.full(len(p), np.inf)
    for f in range(len(faces)):
        for k in range(3):
            a, b = faces[f, k], faces[f, (k + 1) % 3]
            away = np.sqrt(dot(p[b], p[b], p[a])) / 2
            out[a] = min(out[a], away)
            out[b] = min(out[b], away)
    for v in range(len(p)):
        if held[v] or out[v] == np.inf:
            out[v] = 0.0
    return out


@jit
def turned(p: FloatArray, trial: FloatArray, faces: IntArray, floor: float, turn: float) -> BoolArray:
    """Vertices that moved of faces that turn by more than acos(turn), or fall under the shape `floor` and under what they were."""
    out = np.zeros(len(p), np.bool_)
    before, after = np.zeros(3), np.zeros(3)
    for f in range(len(faces)):
        a, b, c = faces[f]
        area = area_normal(p[a], p[b], p[c], before)
        area_now = area_normal(trial[a], trial[b], trial[c], after)
        cosine = before[0] * after[0] + before[1] * after[1] + before[2] * after[2]
        squares = dot(p[b], p[b], p[a]) + dot(p[c], p[c], p[b]) + dot(p[a], p[a], p[c])
        squares_now = dot(trial[b], trial[b], trial[a]) + dot(trial[c], trial[c], trial[b]) + dot(trial[a], trial[a], trial[c])
        shape = 4 * 3**0.5 * area / max(squares, 1e-300)  # a face may be a point
        now = 4 * 3**0.5 * area_now / max(squares_now, 1e-300)
        if cosine < turn or (now < floor and now < shape):
            for v in (a, b, c):
                if p[v, 0] != trial[v, 0] or p[v, 1] != trial[v, 1] or p[v, 2] != trial[v, 2]:
                    out[v] = True
    return out


@jit
def slide(
    trial: FloatArray, which: IntArray, at: IntArray, vertices: FloatArray, faces: IntArray, first: IntArray, around: IntArray, label: IntArray
) -> None:
    """Put the vertices `which` of `trial` onto the reference: downhill from face to face of the same label, from at[v] on, which follows.

    The nearest point of a face that is inside it ends the walk; one on its edge or corner goes on over the faces there.
    first, around : the reference faces at each reference vertex.
    """
    corner, weights, scratch = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    now, then = np.zeros(3), np.zeros(3)
    for v in which:
        here = at[v]
        best = _nearest_on_face(trial[v], vertices, faces[here], corner, now, scratch)
        while now[0] <= 0 or now[1] <= 0 or now[2] <= 0:
            came = here
            for i in range(3):
                if now[i] <= 0:
                    continue
                for k in range(first[faces[came, i]], first[faces[came, i] + 1]):
                    f = around[k]
                    if f == came or label[f] != label[came]:
                        continue
                    away = _nearest_on_face(trial[v], vertices, faces[f], corner, weights, scratch)
                    if away < best:
                        best, here = away, f
                        for x in range(3):
                            then[x] = weights[x]
            if here == came:
                break
            for x in range(3):
                now[x] = then[x]
        at[v] = here
        for x in range(3):
            trial[v, x] = now[0] * vertices[faces[here, 0], x] + now[1] * vertices[faces[here, 1], x] + now[2] * vertices[faces[here, 2], x]


@jit
def _nearest_on_face(
    point: FloatArray, vertices: FloatArray, face: IntArray, corner: FloatArray, weights: FloatArray, scratch: FloatArray
) -> float:
    for j in range(3):
        for x in range(3):
            corner[j, x] = vertices[face[j], x]
    return float(nearest_on_triangle(point, corner, weights, scratch))


@jit
def slide_along(trial: FloatArray, which: IntArray, at: IntArray, vertices: FloatArray, edges: IntArray, beside: IntArray) -> None:
    """Put the vertices `which` onto the reference creases: from edge at[v] to the neighbouring ones, beside[e] (-1: the crease ends there)."""
    for v in which:
        here, best = at[v], np.inf
        fx, fy, fz = 0.0, 0.0, 0.0
        while True:
            came = here
            for which_edge in range(3):
                e = came if which_edge == 0 else beside[came, which_edge - 1]
                if e < 0:
                    continue
                a, b = vertices[edges[e, 0]], vertices[edges[e, 1]]
                length2 = dot(b, b, a)
                s = min(max(dot(trial[v], b, a) / length2, 0.0), 1.0) if length2 > 0 else 0.0
                x, y, z = a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2])
                away = (trial[v, 0] - x) ** 2 + (trial[v, 1] - y) ** 2 + (trial[v, 2] - z) ** 2
                if away < best:
                    best, here, fx, fy, fz = away, e, x, y, z
            if here == came:
                break
        at[v] = here
        trial[v, 0], trial[v, 1], trial[v, 2] = fx, fy, fz


@jit
def _corner(faces: IntArray, f: int, v: int) -> int:
    for k in range(3):
        if faces[f, k] == v:
            return k
    return -1


@jit
def _joined(c: int, d: int, f: int, faces: IntArray, beside: IntArray) -> bool:
    """Is there an edge from c to d? Walks round c from face f; True where the walk meets a border (then nothing may change)."""
    g = f
    while True:
        k = _corner(faces, g, c)
        if d in (faces[g, (k + 1) % 3], faces[g, (k + 2) % 3]):
            return True
        g = beside[g, k]
        if g < 0:
            return True
        if g == f:
            return False


@jit
def flip_to_delaunay(p: FloatArray, faces: IntArray, beside: IntArray, sharp: ByteArray, kind: int, drift: float, turn: float) -> int:
    """Edges across which the circle of one face holds the corner of the other are turned where that lowers the energy of the method `kind`.

    Not on creases, nor where the surface would move by more than `drift` or a face turn by more than acos(turn). Returns how many.
    """
    flips = 0
    n, m = np.zeros(3), np.zeros(3)
    for f in range(len(faces)):
        for k in range(3):
            g = beside[f, k]
            if g < 0 or sharp[f, k]:
                continue
            a, b, c = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            j = _corner(faces, g, b)
            d = faces[g, (j + 2) % 3]
            area_f, area_g = area_normal(p[a], p[b], p[c], n), area_normal(p[b], p[a], p[d], m)
            if area_f <= 0 or area_g <= 0:
                continue
            if dot(p[a], p[b], p[c]) / area_f + dot(p[a], p[b], p[d]) / area_g >= -1e-9:
                continue
            before = _energy_of(kind, p[a], p[b], p[c], n) + _energy_of(kind, p[b], p[a], p[d], m)
            sx, sy, sz = area_f * n[0] + area_g * m[0], area_f * n[1] + area_g * m[1], area_f * n[2] + area_g * m[2]
            size = np.sqrt(sx * sx + sy * sy + sz * sz)
            after = _energy_of(kind, p[a], p[d], p[c], n) + _energy_of(kind, p[d], p[b], p[c], m)
            if after >= before or n[0] * sx + n[1] * sy + n[2] * sz < turn * size or m[0] * sx + m[1] * sy + m[2] * sz < turn * size:
                continue
            if _gap(p[a], p[b], p[c], p[d]) > drift or _joined(c, d, f, faces, beside):
                continue
            _turn_edge(f, k, g, j, faces, beside, sharp)
            flips += 1
            break
    return flips


@jit
def _gap(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> float:
    """Distance between the lines a b and c d."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = d[0] - c[0], d[1] - c[1], d[2] - c[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size = np.sqrt(nx * nx + ny * ny + nz * nz)
    if size <= 0:
        return np.inf
    return float(abs(nx * (c[0] - a[0]) + ny * (c[1] - a[1]) + nz * (c[2] - a[2])) / size)


@jit
def _turn_edge(f: int, k: int, g: int, j: int, faces: IntArray, beside: IntArray, sharp: ByteArray) -> None:
    """f = a b c and g = b a d become a d c and d b c."""
    a, b, c, d = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3], faces[g, (j + 2) % 3]
    bc, ca, ad, db = beside[f, (k + 1) % 3], beside[f, (k + 2) % 3], beside[g, (j + 1) % 3], beside[g, (j + 2) % 3]
    s_bc, s_ca, s_ad, s_db = sharp[f, (k + 1) % 3], sharp[f, (k + 2) % 3], sharp[g, (j + 1) % 3], sharp[g, (j + 2) % 3]
    faces[f, 0], faces[f, 1], faces[f, 2] = a, d, c
    faces[g, 0], faces[g, 1], faces[g, 2] = d, b, c
    beside[f, 0], beside[f, 1], beside[f, 2] = ad, g, ca
    beside[g, 0], beside[g, 1], beside[g, 2] = db, bc, f
    sharp[f, 0], sharp[f, 1], sharp[f, 2] = s_ad, 0, s_ca
    sharp[g, 0], sharp[g, 1], sharp[g, 2] = s_db, s_bc, 0
    if ad >= 0:
        beside[ad, _corner(faces, ad, d)] = f  # there the edge runs d a
    if bc >= 0:
        beside[bc, _corner(faces, bc, c)] = g  # there it runs c b
