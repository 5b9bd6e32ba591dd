"""Which faces of a mesh cross one another.

Two faces cross where an edge of one meets the other, or where both lie in one plane and share area. Faces that meet at a shared vertex or
edge (the same place, whatever its number) do not cross there; faces that share nothing must not even touch.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.face_tree import face_tree
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

EPS = 1e-8  # of barycentric coordinates, where faces share a vertex and rounding alone would make them meet
PARALLEL = 1e-11  # sine under which an edge is parallel to a face
FLAT_COSINE, FLAT_GAP = 1 - 2e-9, 2e-8  # faces within these lie in one plane (the cosine of their normals; the gap over their size)
CLEAR = 1e-9  # of the products that a height over a plane is summed from: more is no rounding
FLAT_TOUCH = 5e-10  # overlap in one plane under this share of the size is a touch


@jit
def _edge_passes(p: FloatArray, q: FloatArray, t: FloatArray, eps: float) -> bool:
    """Does the segment pq meet triangle t (3, 3)? eps : of barycentric coordinates, left out at both rims. (Moeller and Trumbore 1997)"""
    e1x, e1y, e1z = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    e2x, e2y, e2z = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    hx, hy, hz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
    det = e1x * hx + e1y * hy + e1z * hz
    size = (e1x * e1x + e1y * e1y + e1z * e1z) * (e2x * e2x + e2y * e2y + e2z * e2z) * (dx * dx + dy * dy + dz * dz)
    if det * det <= PARALLEL * PARALLEL * size:
        return False
    sx, sy, sz = p[0] - t[0, 0], p[1] - t[0, 1], p[2] - t[0, 2]
    u = (sx * hx + sy * hy + sz * hz) / det
    if u < eps or u > 1 - eps:
        return False
    kx, ky, kz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
    w = (dx * kx + dy * ky + dz * kz) / det
    if w < eps or u + w > 1 - eps:
        return False
    along = (e2x * kx + e2y * ky + e2z * kz) / det
    return bool(along >= eps and along <= 1 - eps)


@jit
def _apart_in_plane(a: FloatArray, b: FloatArray, x: int, y: int) -> bool:
    """Does an edge of triangle `a` part it from `b`, both seen along the axis that is not x or y?"""
    turn = (a[1, x] - a[0, x]) * (a[2, y] - a[0, y]) - (a[1, y] - a[0, y]) * (a[2, x] - a[0, x])
    size = max(
        max(b[0, x], b[1, x], b[2, x]) - min(b[0, x], b[1, x], b[2, x]),
        max(b[0, y], b[1, y], b[2, y]) - min(b[0, y], b[1, y], b[2, y]),
    )
    for k in range(3):
        m = (k + 1) % 3
        ex, ey = a[m, x] - a[k, x], a[m, y] - a[k, y]
        if turn < 0:
            ex, ey = -ex, -ey
        most = -np.inf
        for j in range(3):
            most = max(most, ex * (b[j, y] - a[k, y]) - ey * (b[j, x] - a[k, x]))
        if most <= FLAT_TOUCH * np.sqrt(ex * ex + ey * ey) * size:
            return True
    return False


@jit
def _overlap_in_plane(a: FloatArray, b: FloatArray, na: FloatArray, gap: float) -> bool:
    """Do two triangles of parallel planes lie in one and share area? na : normal of a.   gap : heights under this are none, in lengths of na."""
    for j in range(3):
        if abs((b[j, 0] - a[0, 0]) * na[0] + (b[j, 1] - a[0, 1]) * na[1] + (b[j, 2] - a[0, 2]) * na[2]) >= gap:
            return False
    drop = int(np.argmax(np.abs(na)))
    x, y = (drop + 1) % 3, (drop + 2) % 3
    return not (_apart_in_plane(a, b, x, y) or _apart_in_plane(b, a, x, y))


@jit
def _on_one_side(a: FloatArray, na: FloatArray, b: FloatArray, shared: int, gap: float) -> bool:
    """Do the corners of b that a does not have lie on one side of the plane of a, beyond doubt? shared : bits of those that it has."""
    above = below = asked = 0
    for k in range(3):
        if not (shared >> k) & 1:
            x, y, z = b[k, 0] - a[0, 0], b[k, 1] - a[0, 1], b[k, 2] - a[0, 2]
            doubt = CLEAR * (abs(x) + abs(y) + abs(z)) * (abs(na[0]) + abs(na[1]) + abs(na[2])) + gap
            height = x * na[0] + y * na[1] + z * na[2]
            asked += 1
            above += height > doubt
            below += height < -doubt
    return above == asked or below == asked


@jit
def _faces_cross(tri: FloatArray, faces: IntArray, normal: FloatArray, size: FloatArray, i: int, j: int) -> bool:
    """normal, size : of each face, across it and twice its area."""
    mine = theirs = n_shared = 0  # bits of the shared corners
    for k in range(3):
        for m in range(3):
            if faces[i, k] == faces[j, m]:
                mine |= 1 << k
                theirs |= 1 << m
                n_shared += 1
    if n_shared >= 3:
        return True
    a, b, na, nb = tri[i], tri[j], normal[i], normal[j]
    gap = FLAT_GAP * np.sqrt(max(size[i], size[j]))
    if _on_one_side(a, na, b, theirs, gap * size[i]) or _on_one_side(b, nb, a, mine, gap * size[j]):
        return False
    if n_shared < 2:
        eps = 0.0 if n_shared == 0 else EPS
        # an edge that ends in a shared vertex meets the other face there; that it crosses farther on shows in the edges across
        for k in range(3):
            edge = 1 << k | 1 << (k + 1) % 3
            if not mine & edge and _edge_passes(a[k], a[(k + 1) % 3], b, eps):
                return True
            if not theirs & edge and _edge_passes(b[k], b[(k + 1) % 3], a, eps):
                return True
    along = na[0] * nb[0] + na[1] * nb[1] + na[2] * nb[2]
    return abs(along) > FLAT_COSINE * size[i] * size[j] and _overlap_in_plane(a, b, na, gap * size[i])


@jit
def _spans(tri: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Box (low and high corner), normal and twice the area of each triangle."""
    n = len(tri)
    low, high, normal, size = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    for i in range(n):
        for k in range(3):
            c, d = (k + 1) % 3, (k + 2) % 3
            low[i, k], high[i, k] = min(tri[i, 0, k], tri[i, 1, k], tri[i, 2, k]), max(tri[i, 0, k], tri[i, 1, k], tri[i, 2, k])
            ec, ed, fc, fd = tri[i, 1, c] - tri[i, 0, c], tri[i, 1, d] - tri[i, 0, d], tri[i, 2, c] - tri[i, 0, c], tri[i, 2, d] - tri[i, 0, d]
            normal[i, k] = ec * fd - ed * fc
        size[i] = np.sqrt(normal[i, 0] ** 2 + normal[i, 1] ** 2 + normal[i, 2] ** 2)
    return low, high, normal, size


@jit
def _crossing_pairs(tri: FloatArray, faces: IntArray, boxes: FloatArray, start: IntArray) -> IntArray:
    """Rows (i, j), i < j, in tree order, of the faces that cross; walks the tree once per leaf."""
    first_leaf = len(boxes) // 2
    low, high, normal, size = _spans(tri)
    found = np.zeros((64, 2), np.int64)
    n_found = 0
    stack = np.zeros(128, np.int64)
    for leaf in range(len(start) - 1):
        own = first_leaf + leaf
        top, stack[0] = 1, 0
        while top:
            top -= 1
            node = stack[top]
            if _boxes_apart(boxes[node], boxes[own]):
                continue
            if node < first_leaf:
                stack[top], stack[top + 1] = 2 * node + 1, 2 * node + 2
                top += 2
                continue
            if node < own:  # those pairs are done
                continue
            for i in range(start[leaf], start[leaf + 1]):
                for j in range(max(start[node - first_leaf], i + 1), start[node - first_leaf + 1]):
                    apart = False
                    for k in range(3):
                        apart |= low[j, k] > high[i, k] or high[j, k] < low[i, k]
                    if not apart and _faces_cross(tri, faces, normal, size, i, j):
                        if n_found == len(found):
                            more = np.zeros((2 * n_found, 2), np.int64)
                            for k in range(n_found):
                                more[k, 0], more[k, 1] = found[k, 0], found[k, 1]
                            found = more
                        found[n_found, 0], found[n_found, 1] = i, j
                        n_found += 1
    return found[:n_found].copy()


@jit
def _boxes_apart(a: FloatArray, b: FloatArray) -> bool:
    return bool(a[0] > b[3] or a[1] > b[4] or a[2] > b[5] or a[3] < b[0] or a[4] < b[1] or a[5] < b[2])


def _places(vertices: FloatArray) -> IntArray:
    """(n,) the same number for vertices at exactly the same place."""
    order = np.lexsort((vertices[:, 2], vertices[:, 1], vertices[:, 0]))
    new = np.concatenate([[True], (vertices[order[1:]] != vertices[order[:-1]]).any(1)])
    place = np.zeros(len(vertices), np.int64)
    place[order] = np.cumsum(new) - 1
    return place


def self_intersections(mesh: TriangleMesh) -> IntArray:
    """(k, 2) pairs of faces of `mesh` that cross or overlap, each pair once, smaller face first, in order."""
    return _crossing(mesh.vertices, mesh.faces)


def intersections_of(mesh: TriangleMesh, rows: IntArray) -> IntArray:
    """As `self_intersections`, of the pairs with a face among `rows` (k,), ascending; more only where both are near these."""
    if len(rows) == len(mesh.faces) or not len(rows):
        return _crossing(mesh.vertices, mesh.faces[rows])
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    tree = face_tree(np.stack([low[rows], high[rows], high[rows]], axis=1))
    near = np.flatnonzero(_boxes_met(low, high, tree.corners, tree.boxes, tree.start))
    return near[_crossing(mesh.vertices, mesh.faces[near])]


def _crossing(vertices: FloatArray, faces: IntArray) -> IntArray:
    """As `self_intersections`, of some faces of a mesh."""
    if len(faces) < 2:
        return np.zeros((0, 2), np.int64)
    middle = vertices.mean(0)  # keeps the products small for a part far from the origin
    is_used = np.zeros(len(vertices), bool)
    is_used[faces] = True
    place = np.zeros(len(vertices), np.int64)
    place[is_used] = _places(vertices[is_used])
    tree = face_tree((vertices - middle)[faces])
    pairs = tree.face[_crossing_pairs(tree.corners, np.ascontiguousarray(place[faces[tree.face]]), tree.boxes, tree.start)]
    pairs = np.sort(pairs.reshape(-1, 2), axis=1)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


@jit
def _boxes_met(low: FloatArray, high: FloatArray, own: FloatArray, boxes: FloatArray, start: IntArray) -> BoolArray:
    """(n,) boxes from `low` to `high` (n, 3) that meet one of those in the leaves of a tree, from own[:, 0] to own[:, 1]."""
    out, first_leaf = np.zeros(len(low), np.bool_), len(boxes) // 2
    stack = np.zeros(128, np.int64)
    for i in range(len(low)):
        top, stack[0] = 1, 0
        while top and not out[i]:
            top -= 1
            node = stack[top]
            apart = False
            for k in range(3):
                apart |= low[i, k] > boxes[node, k + 3] or high[i, k] < boxes[node, k]
            if apart:
                continue
            if node < first_leaf:
                stack[top], stack[top + 1] = 2 * node + 1, 2 * node + 2
                top += 2
                continue
            for j in range(start[node - first_leaf], start[node - first_leaf + 1]):
                apart = False
                for k in range(3):
                    apart |= low[i, k] > own[j, 1, k] or high[i, k] < own[j, 0, k]
                out[i] |= not apart
    return out
