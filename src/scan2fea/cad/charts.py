"""Each tile of a surface laid flat, one to one: its border on a circle, each inner vertex a mean of its neighbours (Tutte 1963, Floater 2003).

The border is strictly convex and the weights are positive, so that no triangle turns over.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from scan2fea.cad.tiles import Tiles
from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray, TriangleMesh

EVEN = 0.5  # share of a circle that is given to the borders alike, the rest goes by their lengths


def loop_vertices(tiles: Tiles, tile: int) -> tuple[IntArray, IntArray]:
    """The vertices round a tile, counter-clockwise, and where among them each of its borders starts."""
    chains = [tiles.arcs[a].vertices if a >= 0 else tiles.arcs[~a].vertices[::-1] for a in tiles.loops[tile]]
    starts = np.cumsum([0] + [len(chain) - 1 for chain in chains])
    return np.concatenate([chain[:-1] for chain in chains]), starts


def angles(mesh: TriangleMesh, tiles: Tiles, tile: int) -> tuple[FloatArray, FloatArray]:
    """Angle on the circle of each vertex round a tile, and of the start of each border with the full turn at the end."""
    ring, starts = loop_vertices(tiles, tile)
    step = np.linalg.norm(mesh.vertices[np.roll(ring, -1)] - mesh.vertices[ring], axis=1)
    lengths = np.add.reduceat(step, starts[:-1])
    share = EVEN / len(lengths) + (1 - EVEN) * lengths / lengths.sum()
    turn = 2 * np.pi * np.concatenate([[0.0], np.cumsum(share)])
    along = np.concatenate([[0.0], np.cumsum(step)])
    at = np.interp(along[:-1], along[starts], turn)
    return at, turn


def flattened(mesh: TriangleMesh, tiles: Tiles) -> FloatArray:
    """(m, 3, 2) corners of every triangle in the disk of its tile."""
    faces, vertices = mesh.faces, mesh.vertices
    n_tiles = len(tiles.loops)
    corner_tile = np.repeat(tiles.label, 3)
    key = corner_tile * len(vertices) + faces.ravel()  # a vertex on a border is one in every tile
    names, row = np.unique(key, return_inverse=True)
    flat = np.zeros((len(names), 2))
    fixed = np.zeros(len(names), bool)
    for tile in range(n_tiles):
        at, _ = angles(mesh, tiles, tile)
        rows = np.searchsorted(names, tile * len(vertices) + loop_vertices(tiles, tile)[0])
        flat[rows], fixed[rows] = np.stack([np.cos(at), np.sin(at)], axis=1), True
    local = row.reshape(-1, 3)
    weight = _mean_value(vertices[faces])
    i = np.concatenate([local[:, k] for k in range(3) for _ in range(2)])
    j = np.concatenate([local[:, (k + s) % 3] for k in range(3) for s in (1, 2)])
    w = np.concatenate([weight[:, k, s] for k in range(3) for s in range(2)])
    free = np.cumsum(~fixed) - 1
    inner = ~fixed[i]
    i, j, w = i[inner], j[inner], w[inner]
    n = int((~fixed).sum())
    if n:
        total = np.bincount(free[i], w, n)
        w = w / total[free[i]]
        known = fixed[j]
        right = np.stack([np.bincount(free[i[known]], w[known] * flat[j[known], x], n) for x in range(2)], axis=1)
        rows, columns = np.concatenate([np.arange(n), free[i[~known]]]), np.concatenate([np.arange(n), free[j[~known]]])
        matrix = coo_array((np.concatenate([np.ones(n), -w[~known]]), (rows, columns)), shape=(n, n)).tocsc()
        flat[~fixed] = splu(matrix).solve(right)
    return np.asarray(flat[local])


def _mean_value(corners: FloatArray) -> FloatArray:
    """(m, 3, 2) tan(angle / 2) / length of the sides that leave each corner, ahead and back: summed over triangles they are Floater's weights."""
    weight = np.empty((len(corners), 3, 2))
    for k in range(3):
        ahead, back = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        a, b = np.linalg.norm(ahead, axis=1), np.linalg.norm(back, axis=1)
        half = np.tan(np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=1), (ahead * back).sum(1)) / 2)
        weight[:, k, 0], weight[:, k, 1] = half / np.maximum(a, 1e-300), half / np.maximum(b, 1e-300)
    return np.asarray(np.maximum(weight, 1e-12 * weight.max()))


@jit
def located(points: FloatArray, first: IntArray, flat: FloatArray, order: IntArray, start: IntArray) -> tuple[IntArray, FloatArray]:
    """The triangle under each point in the plane, and its barycentric coordinates there.

    points : (p, 2), those of tile t are first[t] .. first[t + 1].   flat : (m, 3, 2).   order, start : triangles by tile.
    A point outside all (beyond a chord of the circle) is given to the nearest and put on it.
    """
    face, weights = np.empty(len(points), np.int64), np.empty((len(points), 3))
    for tile in range(len(first) - 1):
        for p in range(first[tile], first[tile + 1]):
            best = -1e300
            for q in range(start[tile], start[tile + 1]):
                f = order[q]
                ax, ay = flat[f, 0, 0] - points[p, 0], flat[f, 0, 1] - points[p, 1]
                bx, by = flat[f, 1, 0] - points[p, 0], flat[f, 1, 1] - points[p, 1]
                cx, cy = flat[f, 2, 0] - points[p, 0], flat[f, 2, 1] - points[p, 1]
                a, b, c = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
                total = a + b + c
                if total <= 0:
                    continue
                least = min(a, b, c) / total
                if least > best:
                    best = least
                    face[p] = f
                    weights[p, 0], weights[p, 1], weights[p, 2] = max(a, 0.0) / total, max(b, 0.0) / total, max(c, 0.0) / total
                    if least >= 0:
                        break
        for p in range(first[tile], first[tile + 1]):
            total = weights[p, 0] + weights[p, 1] + weights[p, 2]
            for k in range(3):
                weights[p, k] /= total
    return face, weights
