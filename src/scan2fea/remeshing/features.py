"""What creases say of the size of details: how tightly they bend, and how far the next one runs beside them.

The bend of faces says little of a drawn wall, whose facets are as tall as the wall: a rim tells its radius. And a step or the top of a rib may be
narrower than an edge though nothing bends and nothing is thin.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.measures import extent, face_normals
from scan2fea.kernel.rays import first_hits, ray_scene
from scan2fea.kernel.topology import edge_table
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

SMOOTHING = 3  # rounds over the tangents before the bend is read from them: rims of a scan are jagged
ALONG = 0.866  # cosine: the far crease runs beside the near one, within 30 degrees; a corner's two sides are no strip
RIBBON = 1e-6  # of the size: how far the ribbons that stand on creases reach beyond them


def crease_bend(mesh: TriangleMesh, is_sharp: BoolArray) -> FloatArray:
    """(n,) 1/m, how a crease bends at each vertex on it: the angle between its edges over their mean length. 0 off creases and where three meet."""
    edges = edge_table(mesh.faces).edges[is_sharp]
    out = np.zeros(len(mesh.vertices))
    inner, pair = _paired(edges, len(mesh.vertices))
    if not len(inner):
        return out
    along = mesh.vertices[edges[:, 1]] - mesh.vertices[edges[:, 0]]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
    tangent = along / length[:, None]
    first, second = pair.T
    turned = np.where(edges[first, 1] == inner, 1, -1) * np.where(edges[second, 0] == inner, 1, -1)  # 1: one edge ends where the other begins
    for _ in range(SMOOTHING):
        total = 2 * tangent * length[:, None]
        np.add.at(total, first, tangent[second] * (turned * length[second])[:, None])
        np.add.at(total, second, tangent[first] * (turned * length[first])[:, None])
        tangent = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
    cosine = turned * (tangent[first] * tangent[second]).sum(1)
    angle = np.arctan2(np.linalg.norm(np.cross(tangent[first], tangent[second]), axis=1), cosine)
    out[inner] = angle / (0.5 * (length[first] + length[second]))
    return out


def _paired(edges: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Vertices with exactly two of the edges, and the (k, 2) rows of these."""
    ends = edges.ravel()
    order = np.argsort(ends, kind="stable")
    count = np.bincount(ends, minlength=n)
    inner = np.flatnonzero(count == 2)
    start = np.searchsorted(ends[order], inner)
    return inner, np.stack([order[start], order[start + 1]], axis=1) // 2 if len(inner) else np.zeros((0, 2), np.int64)


def strip_width(mesh: TriangleMesh, is_sharp: BoolArray) -> FloatArray:
    """(n,) metres across the narrowest face beside a crease, from each vertex on it to the crease that runs along on the other side; inf elsewhere.

    A ray in the plane of the face beside each sharp edge, square to it, against small ribbons that stand on all sharp edges.
    """
    table = edge_table(mesh.faces)
    half = np.flatnonzero(is_sharp[table.edge_of])
    out = np.full(len(mesh.vertices), np.inf)
    if not len(half):
        return out
    a, b = mesh.faces.ravel()[half], mesh.faces.ravel()[half // 3 * 3 + (half + 1) % 3]
    normal = face_normals(mesh)[half // 3]
    along = mesh.vertices[b] - mesh.vertices[a]
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    inward = np.cross(normal, along)
    size = extent(mesh.vertices)
    up, more = RIBBON * size * normal, RIBBON * size * along  # they overlap at their ends, and no ray meets them halfway along their diagonals
    start, end = mesh.vertices[a] - more, mesh.vertices[b] + more
    corner = np.concatenate([start - up, end - up, end + 2 * up, start + 2 * up])
    k, m = np.arange(len(half)), len(half)
    ribbon = np.concatenate([np.stack([k, k + m, k + 2 * m], axis=1), np.stack([k, k + 2 * m, k + 3 * m], axis=1)])
    middle = 0.5 * (mesh.vertices[a] + mesh.vertices[b])
    t, hit = first_hits(ray_scene(corner, ribbon), middle, inward, t_min=RIBBON * size)
    far = np.flatnonzero(hit >= 0)
    far = far[(inward[far] * inward[hit[far] % m]).sum(1) < -ALONG]
    for v in (a, b):
        np.minimum.at(out, v[far], t[far])
    return out
