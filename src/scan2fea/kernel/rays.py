"""Casting rays at triangles: a bounding volume hierarchy built once, walked per ray.

Build: the split of least expected cost (surface area heuristic, MacDonald and Booth 1990) among 16 bins of the triangle centres on each
axis (Wald 2007). Walk: nearer child first, boxes behind the nearest hit skipped. Triangle test: Moeller and Trumbore (1997), both sides
count. The hits do not depend on the tree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.kernel.threads import in_threads
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

_LEAF = 6  # triangles per leaf at most
_BINS = 16
_DEEPEST = 64  # below, the count is halved, so that no scene makes the walk's stack overflow
_DEPTH = 128
_WIDER, _TINY = 1.0 + 1e-12, 1e-300  # keep what rounding would push out of a box
_AT_ONCE = 1 << 15  # rays per piece of work of a thread


@dataclass(frozen=True, eq=False, kw_only=True)
class RayScene(Value):
    """Triangles ready to be hit.

    corners : (m, 3, 3) in tree order.   face : (m,) the row each had before.
    child : (k, 2) the two nodes below, or (first, -count) of a leaf's triangles.   pair : (k, 12) low and high corner of the box of either child.
    """

    corners: FloatArray
    face: IntArray
    child: IntArray
    pair: FloatArray


def ray_scene(vertices: FloatArray, faces: IntArray) -> RayScene:
    """The hierarchy over the triangles `vertices[faces]`. Raises InternalError for no triangle."""
    require(len(faces) > 0, InternalError, "a ray scene needs at least one triangle")
    corners = np.ascontiguousarray(vertices[faces], float)
    order, boxes, child = _built(corners.min(axis=1), corners.max(axis=1), corners.mean(axis=1))
    inner = child[:, 1] >= 0
    pair = np.zeros((len(boxes), 12))
    pair[inner] = boxes[child[inner]].reshape(-1, 12)
    return RayScene(corners=corners[order], face=order, child=child, pair=pair)


def scene_of(mesh: TriangleMesh) -> RayScene:
    """The hierarchy over one mesh."""
    return ray_scene(mesh.vertices, mesh.faces)


def first_hits(scene: RayScene, origin: FloatArray, direction: FloatArray, t_min: float = 0.0, threads: int = 1) -> tuple[FloatArray, IntArray]:
    """Nearest hit of each ray origin + t direction with t > t_min.

    origin, direction : (n, 3); t is in units of the direction's length. Returns t (n,), inf for a miss, and the triangle hit (n,), -1 for a miss.
    Rays are independent: the number of threads changes the time only.
    """
    t = np.full(len(origin), np.inf)
    face = np.full(len(origin), -1, np.int64)
    o, d = np.ascontiguousarray(origin, float), np.ascontiguousarray(direction, float)

    def cast(rows: slice) -> None:
        _cast(o[rows], d[rows], t_min, scene.corners, scene.pair, scene.child, scene.face, t[rows], face[rows])

    in_threads(cast, [slice(k, k + _AT_ONCE) for k in range(0, len(t), _AT_ONCE)], at_most=threads)
    return t, face


@jit
def _built(low: FloatArray, high: FloatArray, centre: FloatArray) -> tuple[IntArray, FloatArray, IntArray]:
    """Order of the triangles, node boxes and node children; top down, an explicit stack instead of recursion."""
    n = len(low)
    order = np.arange(n)
    boxes, child = np.zeros((2 * n, 6)), np.zeros((2 * n, 2), np.int64)
    todo = np.zeros((_DEPTH, 5), np.int64)  # first, last, parent, side, depth
    todo[0, 1], todo[0, 2] = n, -1
    top, nodes = 1, 0
    scratch = np.zeros(n, np.int64)
    counts, bins, right = np.zeros(_BINS, np.int64), np.zeros((_BINS, 6)), np.zeros(_BINS)
    while top > 0:
        top -= 1
        first, last, parent, side, depth = todo[top, 0], todo[top, 1], todo[top, 2], todo[top, 3], todo[top, 4]
        node = nodes
        nodes += 1
        _cover(low, high, order[first:last], boxes[node])
        child[node, 0], child[node, 1] = first, first - last
        if parent >= 0:
            child[parent, side] = node
        if last - first > _LEAF:
            rows = order[first:last]
            count = 0
            if depth < _DEEPEST:
                count = _parted(low, high, centre, rows, scratch[: last - first], counts, bins, right)
            if count == 0:  # all centres in one place, or too deep
                count = (last - first) // 2
            for k in range(2):
                todo[top, 2], todo[top, 3], todo[top, 4] = node, 1 - k, depth + 1
                todo[top, 0], todo[top, 1] = (first + count, last) if k == 0 else (first, first + count)
                top += 1
    return order, boxes[:nodes].copy(), child[:nodes].copy()


@jit
def _cover(low: FloatArray, high: FloatArray, rows: IntArray, box: FloatArray) -> None:
    """`box` becomes the box around the boxes of `rows`."""
    box[:3], box[3:] = math.inf, -math.inf
    for i in rows:
        for a in range(3):
            box[a] = min(box[a], low[i, a])
            box[a + 3] = max(box[a + 3], high[i, a])


@jit
def _half_area(box: FloatArray) -> float:
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return float(x * y + y * z + z * x)


@jit
def _join(box: FloatArray, other: FloatArray) -> None:
    for a in range(3):
        box[a] = min(box[a], other[a])
        box[a + 3] = max(box[a + 3], other[a + 3])


@jit
def _bin(value: float, low: float, scale: float) -> int:
    return min(int((value - low) * scale), _BINS - 1)


@jit
def _fill_bins(
    low: FloatArray, high: FloatArray, centre: FloatArray, rows: IntArray, axis: int, start: float, scale: float, counts: IntArray, bins: FloatArray
) -> None:
    """Number and box of the triangles whose centre falls in each bin."""
    counts[:] = 0
    bins[:, :3], bins[:, 3:] = math.inf, -math.inf
    for i in rows:
        k = _bin(centre[i, axis], start, scale)
        counts[k] += 1
        for a in range(3):
            bins[k, a] = min(bins[k, a], low[i, a])
            bins[k, a + 3] = max(bins[k, a + 3], high[i, a])


@jit
def _cheapest(counts: IntArray, bins: FloatArray, right: FloatArray) -> tuple[float, int]:
    """Least cost (half area times count, both sides) and the last bin of the left side."""
    box = np.zeros(6)
    box[:3], box[3:] = math.inf, -math.inf
    total = 0
    for k in range(_BINS - 1, 0, -1):
        _join(box, bins[k])
        total += counts[k]
        right[k] = _half_area(box) * total if total else 0.0
    box[:3], box[3:] = math.inf, -math.inf
    n, total, best, cut = total + counts[0], 0, math.inf, 0
    for k in range(_BINS - 1):
        _join(box, bins[k])
        total += counts[k]
        if 0 < total < n and _half_area(box) * total + right[k + 1] < best:
            best, cut = _half_area(box) * total + right[k + 1], k
    return best, cut


@jit
def _parted(
    low: FloatArray,
    high: FloatArray,
    centre: FloatArray,
    rows: IntArray,
    scratch: IntArray,
    counts: IntArray,
    bins: FloatArray,
    right: FloatArray,
) -> int:
    """Reorder `rows` (stable) so that the left side of the cheapest split comes first; how many those are, 0 where no split parts them."""
    best, axis, cut, start, scale = math.inf, -1, 0, 0.0, 0.0
    for a in range(3):
        first, last = math.inf, -math.inf
        for i in rows:
            first, last = min(first, centre[i, a]), max(last, centre[i, a])
        if not last > first:
            continue
        step = _BINS / (last - first)
        if not step < math.inf:
            continue
        _fill_bins(low, high, centre, rows, a, first, step, counts, bins)
        cost, k = _cheapest(counts, bins, right)
        if cost < best:
            best, axis, cut, start, scale = cost, a, k, first, step
    if axis < 0:
        return 0
    left, behind = 0, 0
    for i in rows:
        if _bin(centre[i, axis], start, scale) <= cut:
            rows[left] = i
            left += 1
        else:
            scratch[behind] = i
            behind += 1
    for k in range(behind):
        rows[left + k] = scratch[k]
    return left


@jit
def _enters(pair: FloatArray, node: int, k: int, ox: float, oy: float, oz: float, ix: float, iy: float, iz: float, t_far: float) -> float:
    """Where the ray enters the box of child k, inf if it does not before t_far. A tiny margin keeps hits on the box's own faces.

    Comparisons with nan (ray in a face's plane) are false: such a slab does not narrow the ray.
    """
    near, far = 0.0, t_far
    t0, t1 = (pair[node, k] - ox) * ix, (pair[node, k + 3] - ox) * ix
    low, high = (t0, t1) if t0 < t1 else (t1, t0)
    near, far = low if low > near else near, high if high < far else far
    t0, t1 = (pair[node, k + 1] - oy) * iy, (pair[node, k + 4] - oy) * iy
    low, high = (t0, t1) if t0 < t1 else (t1, t0)
    near, far = low if low > near else near, high if high < far else far
    t0, t1 = (pair[node, k + 2] - oz) * iz, (pair[node, k + 5] - oz) * iz
    low, high = (t0, t1) if t0 < t1 else (t1, t0)
    near, far = low if low > near else near, high if high < far else far
    return near if near <= far * _WIDER + _TINY else math.inf


@jit
def _triangle(corners: FloatArray, i: int, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """Ray parameter of the hit with triangle i, inf for none; edges count. All is computed before anything is decided: cheaper than to branch."""
    ax, ay, az = corners[i, 0, 0], corners[i, 0, 1], corners[i, 0, 2]
    e1x, e1y, e1z = corners[i, 1, 0] - ax, corners[i, 1, 1] - ay, corners[i, 1, 2] - az
    e2x, e2y, e2z = corners[i, 2, 0] - ax, corners[i, 2, 1] - ay, corners[i, 2, 2] - az
    px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
    det = e1x * px + e1y * py + e1z * pz
    sx, sy, sz = ox - ax, oy - ay, oz - az
    qx, qy, qz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
    if det == 0.0:
        return math.inf
    u, v = (sx * px + sy * py + sz * pz) / det, (dx * qx + dy * qy + dz * qz) / det
    if u < 0.0 or v < 0.0 or u + v > 1.0:
        return math.inf
    return float((e2x * qx + e2y * qy + e2z * qz) / det)


@jit
def _on_plane(c: FloatArray, o: FloatArray, d: FloatArray, tested: float) -> float:
    """Ray parameter on the triangle's plane. On needles it keeps the digits that the triangle test loses; the two shortest edges give the normal.

    tested : what that test gave; it stands where rounding leaves the ray in the plane.
    """
    a, b = 0, 0.0
    for i in range(3):  # the corner opposite the longest edge
        j, k = (i + 1) % 3, (i + 2) % 3
        size = (c[j, 0] - c[k, 0]) ** 2 + (c[j, 1] - c[k, 1]) ** 2 + (c[j, 2] - c[k, 2]) ** 2
        if size > b:
            a, b = i, size
    j, k = (a + 1) % 3, (a + 2) % 3
    ux, uy, uz = c[j, 0] - c[a, 0], c[j, 1] - c[a, 1], c[j, 2] - c[a, 2]
    vx, vy, vz = c[k, 0] - c[a, 0], c[k, 1] - c[a, 1], c[k, 2] - c[a, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    above = nx * (c[a, 0] - o[0]) + ny * (c[a, 1] - o[1]) + nz * (c[a, 2] - o[2])
    across = nx * d[0] + ny * d[1] + nz * d[2]
    return float(above / across) if across != 0.0 else tested


@jit
def _cast(
    origin: FloatArray,
    direction: FloatArray,
    t_min: float,
    corners: FloatArray,
    pair: FloatArray,
    child: IntArray,
    face: IntArray,
    t_out: FloatArray,
    face_out: IntArray,
) -> None:
    stack, entry = np.zeros(_DEPTH, np.int64), np.zeros(_DEPTH)
    for r in range(len(origin)):
        ox, oy, oz = origin[r, 0], origin[r, 1], origin[r, 2]
        dx, dy, dz = direction[r, 0], direction[r, 1], direction[r, 2]
        ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
        best, hit, row = math.inf, -1, -1
        node, top = 0, 0
        while node >= 0:
            a, b = child[node, 0], child[node, 1]
            limit = best * _WIDER + _TINY
            if b < 0:
                for i in range(a, a - b):
                    t = _triangle(corners, i, ox, oy, oz, dx, dy, dz)
                    if t > t_min and (t < best or (t == best and face[i] < hit)):
                        best, hit, row = t, face[i], i
                node = -1
            else:
                near_a = _enters(pair, node, 0, ox, oy, oz, ix, iy, iz, limit)
                near_b = _enters(pair, node, 6, ox, oy, oz, ix, iy, iz, limit)
                if near_b < near_a:
                    a, b, near_a, near_b = b, a, near_b, near_a
                node = a if near_a < math.inf else -1
                if near_b < math.inf:
                    stack[top], entry[top] = b, near_b
                    top += 1
            while node < 0 and top > 0:
                top -= 1
                if entry[top] <= best * _WIDER + _TINY:
                    node = stack[top]
        t_out[r], face_out[r] = best if hit < 0 else _on_plane(corners[row], origin[r], direction[r], best), hit


@jit
def _inverse(x: float) -> float:
    return 1.0 / x if x != 0.0 else math.inf
