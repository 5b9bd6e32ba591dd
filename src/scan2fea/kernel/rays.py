"""Casting rays at triangles: a bounding volume hierarchy built once, walked per ray.

Build: median of the triangle centres along the widest axis of their box (deterministic, no heuristics to tune). Walk: nearer child
first, boxes behind the nearest hit skipped. Triangle test: Moeller and Trumbore (1997), both sides count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

_LEAF = 4  # triangles per leaf at most
_DEPTH = 64  # stack of the walk; the median split halves the count, so 64 levels hold more triangles than any memory


@dataclass(frozen=True, eq=False, kw_only=True)
class RayScene(Value):
    """Triangles ready to be hit.

    corners : (m, 3, 3) in tree order.   face : (m,) the row each had before.
    boxes : (k, 6) low and high corner of each node.   child : (k, 2) the two nodes below, or (first, -count) of a leaf's triangles.
    """

    corners: FloatArray
    face: IntArray
    boxes: FloatArray
    child: IntArray


def ray_scene(vertices: FloatArray, faces: IntArray) -> RayScene:
    """The hierarchy over the triangles `vertices[faces]`. Raises InternalError for no triangle."""
    require(len(faces) > 0, InternalError, "a ray scene needs at least one triangle")
    corners = np.ascontiguousarray(vertices[faces], float)
    order, boxes, child = _built(corners.min(axis=1), corners.max(axis=1), corners.mean(axis=1))
    return RayScene(corners=corners[order], face=order, boxes=boxes, child=child)


def scene_of(mesh: TriangleMesh) -> RayScene:
    """The hierarchy over one mesh."""
    return ray_scene(mesh.vertices, mesh.faces)


def first_hits(scene: RayScene, origin: FloatArray, direction: FloatArray, t_min: float = 0.0) -> tuple[FloatArray, IntArray]:
    """Nearest hit of each ray origin + t direction with t > t_min.

    origin, direction : (n, 3); t is in units of the direction's length. Returns t (n,), inf for a miss, and the triangle hit (n,), -1 for a miss.
    """
    t = np.full(len(origin), np.inf)
    face = np.full(len(origin), -1, np.int64)
    o, d = np.ascontiguousarray(origin, float), np.ascontiguousarray(direction, float)
    _cast(o, d, t_min, scene.corners, scene.boxes, scene.child, scene.face, t, face)
    return t, face


def _built(low: FloatArray, high: FloatArray, centre: FloatArray) -> tuple[IntArray, FloatArray, IntArray]:
    """Order of the triangles, node boxes and node children; top down, an explicit stack instead of recursion."""
    n = len(low)
    order = np.arange(n, dtype=np.int64)
    boxes: list[FloatArray] = []
    child: list[tuple[int, int]] = []
    todo: list[tuple[int, int, int, int]] = [(0, n, -1, 0)]  # first, last, parent, side
    while todo:
        first, last, parent, side = todo.pop()
        node = len(boxes)
        rows = order[first:last]
        boxes.append(np.concatenate([low[rows].min(axis=0), high[rows].max(axis=0)]))
        child.append((first, first - last))
        if parent >= 0:
            child[parent] = (node, child[parent][1]) if side == 0 else (child[parent][0], node)
        if last - first > _LEAF:
            axis = int(np.argmax(np.ptp(centre[rows], axis=0)))
            order[first:last] = rows[np.argsort(centre[rows, axis], kind="stable")]
            middle = (first + last) // 2
            todo += [(middle, last, node, 1), (first, middle, node, 0)]
    return order, np.array(boxes), np.array(child, np.int64)


@jit
def _enters(boxes: FloatArray, node: int, o: FloatArray, inverse: FloatArray, t_far: float) -> float:
    """Where the ray enters the node's box, inf if it does not before t_far. A tiny margin keeps hits on the box's own faces."""
    near, far = 0.0, t_far
    for a in range(3):
        t0 = (boxes[node, a] - o[a]) * inverse[a]
        t1 = (boxes[node, a + 3] - o[a]) * inverse[a]
        if t0 > t1:
            t0, t1 = t1, t0
        if t0 > near:  # false for nan (ray in the face's plane): such a slab does not narrow the ray
            near = t0
        if t1 < far:
            far = t1
    return near if near <= far * (1.0 + 1e-12) + 1e-300 else math.inf


@jit
def _triangle(c: FloatArray, o: FloatArray, d: FloatArray) -> float:
    """Ray parameter of the hit, inf for none; edges count."""
    e1x, e1y, e1z = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    e2x, e2y, e2z = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    px, py, pz = d[1] * e2z - d[2] * e2y, d[2] * e2x - d[0] * e2z, d[0] * e2y - d[1] * e2x
    det = e1x * px + e1y * py + e1z * pz
    if det == 0.0:
        return math.inf
    sx, sy, sz = o[0] - c[0, 0], o[1] - c[0, 1], o[2] - c[0, 2]
    u = (sx * px + sy * py + sz * pz) / det
    if u < 0.0 or u > 1.0:
        return math.inf
    qx, qy, qz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
    v = (d[0] * qx + d[1] * qy + d[2] * qz) / det
    if v < 0.0 or u + v > 1.0:
        return math.inf
    return float((e2x * qx + e2y * qy + e2z * qz) / det)


@jit
def _on_plane(c: FloatArray, o: FloatArray, d: FloatArray) -> float:
    """Ray parameter on the triangle's plane. On needles it keeps the digits that the triangle test loses; the two shortest edges give the normal."""
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
    return float(above / (nx * d[0] + ny * d[1] + nz * d[2]))


@jit
def _cast(
    origin: FloatArray,
    direction: FloatArray,
    t_min: float,
    corners: FloatArray,
    boxes: FloatArray,
    child: IntArray,
    face: IntArray,
    t_out: FloatArray,
    face_out: IntArray,
) -> None:
    stack = np.zeros(_DEPTH, np.int64)
    inverse = np.zeros(3)
    for r in range(len(origin)):
        o, d = origin[r], direction[r]
        for a in range(3):
            inverse[a] = 1.0 / d[a] if d[a] != 0.0 else math.inf
        best, hit, row = math.inf, -1, -1
        stack[0], top = 0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if _enters(boxes, node, o, inverse, best) == math.inf:
                continue
            a, b = child[node, 0], child[node, 1]
            if b < 0:
                for i in range(a, a - b):
                    t = _triangle(corners[i], o, d)
                    if t > t_min and (t < best or (t == best and face[i] < hit)):
                        best, hit, row = t, face[i], i
                continue
            near_a, near_b = _enters(boxes, a, o, inverse, best), _enters(boxes, b, o, inverse, best)
            if near_a > near_b:
                a, b = b, a
                near_a, near_b = near_b, near_a
            if near_b < math.inf:
                stack[top] = b
                top += 1
            if near_a < math.inf:
                stack[top] = a
                top += 1
        t_out[r], face_out[r] = best if hit < 0 else _on_plane(corners[row], o, d), hit
