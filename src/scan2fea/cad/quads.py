"""Grids of points on a tiled surface: each tile with k corners becomes k four-sided patches with common borders, one to one on the surface.

Corners are those of the tile, the middles of its borders and its own middle. The grids lie between them in the flat disk of the tile (Coons 1967)
and slide on the surface until each point is the mean of its neighbours; a point is moved from triangle to triangle, so that it never jumps to what
is near in space but far along the surface, such as the other side of a wall.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array

from scan2fea.cad.charts import angles, flattened, located, loop_vertices
from scan2fea.cad.tiles import Tiles
from scan2fea.kernel.distances import nearest_on_triangle
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

SAMPLES = 13  # points along every border
ROUNDS = 40  # of sliding
NONE_HELD: Mapping[int, FloatArray] = {}


@dataclass(frozen=True, eq=False, kw_only=True)
class Quads(Value):
    """curves : (c, S, 3) points of each border.   sides : (q, 4) curves of each patch at v = 0, u = 1, v = 1, u = 0, along u or v.

    grids : (q, S, S, 3), u first; u x v points outward.   tile : (q,) of each patch.
    """

    curves: FloatArray
    sides: IntArray
    grids: FloatArray
    tile: IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class _Layout(Value):
    """Rows of nodes: curves (c, S), grids (q, S, S); face, weights : where each node starts."""

    curves: IntArray
    sides: IntArray
    grids: IntArray
    tile: IntArray
    face: IntArray
    weights: FloatArray


def quads_on(mesh: TriangleMesh, tiles: Tiles, held: Mapping[int, FloatArray] = NONE_HELD) -> Quads:
    """k patches per tile of k corners. held : (2 S - 1, 3) places of the points of borders that do not slide, from corner to corner."""
    layout = _laid(mesh, tiles)
    start = np.einsum("nk,nkx->nx", layout.weights, mesh.vertices[mesh.faces[layout.face]])
    slides = np.ones(len(start), bool)
    for arc, places in held.items():
        nodes = np.append(layout.curves[2 * arc], layout.curves[2 * arc + 1, -2::-1])
        start[nodes], slides[nodes] = places, False
    places = _slid(mesh, start, layout.face, _neighbours(layout.grids, len(start)), slides)
    return Quads(curves=places[layout.curves], sides=layout.sides, grids=places[layout.grids], tile=layout.tile)


def _laid(mesh: TriangleMesh, tiles: Tiles) -> _Layout:
    s = SAMPLES
    n_arcs = len(tiles.arcs)
    corners = np.unique(np.concatenate([arc.vertices[[0, -1]] for arc in tiles.arcs]))
    along = len(corners) + np.arange(n_arcs * (2 * s - 3)).reshape(n_arcs, -1)  # nodes inside each border
    ends = np.searchsorted(corners, np.array([arc.vertices[[0, -1]] for arc in tiles.arcs]))
    whole = np.concatenate([ends[:, :1], along, ends[:, 1:]], axis=1)
    halves = np.stack([whole[:, :s], whole[:, : s - 2 : -1]], axis=1).reshape(-1, s)  # from either end to the middle
    sizes = np.array([len(loop) for loop in tiles.loops])
    tile = np.repeat(np.arange(len(sizes)), sizes)
    n_quads, base = len(tile), len(corners) + along.size
    centre = base + np.arange(len(sizes))
    spoke = base + len(sizes) + np.arange(n_quads * (s - 2)).reshape(n_quads, -1)
    inner = base + len(sizes) + spoke.size + np.arange(n_quads * (s - 2) ** 2).reshape(n_quads, s - 2, s - 2)
    loop = np.concatenate([np.array(loop) for loop in tiles.loops])
    first_of = np.concatenate([[0], np.cumsum(sizes)])
    arc, back = np.where(loop >= 0, loop, ~loop), loop < 0
    before = first_of[tile] + (np.arange(n_quads) - first_of[tile] - 1) % sizes[tile]
    spokes = np.concatenate([whole[arc, s - 1][:, None], spoke, centre[tile][:, None]], axis=1)
    curves = np.concatenate([halves, spokes])
    sides = np.stack([2 * arc + back, 2 * n_arcs + np.arange(n_quads), 2 * n_arcs + before, 2 * arc[before] + ~back[before]], axis=1)
    grids = np.empty((n_quads, s, s), np.int64)
    grids[:, 1:-1, 1:-1] = inner
    grids[:, :, 0], grids[:, -1], grids[:, :, -1], grids[:, 0] = (curves[sides[:, k]] for k in range(4))
    face, weights = np.empty(int(inner.max()) + 1, np.int64), np.empty((int(inner.max()) + 1, 3))
    _place_borders(mesh, tiles, whole, face, weights)
    _place_insides(mesh, tiles, grids, first_of, face, weights)
    return _Layout(curves=curves, sides=sides.astype(np.int64), grids=grids, tile=tile, face=face, weights=weights)


def _place_borders(mesh: TriangleMesh, tiles: Tiles, whole: IntArray, face: IntArray, weights: FloatArray) -> None:
    """Nodes of every border, evenly along it, on the triangles to its left."""
    share = np.linspace(0, 1, whole.shape[1])
    for arc, nodes in zip(tiles.arcs, whole, strict=True):
        step = np.linalg.norm(np.diff(mesh.vertices[arc.vertices], axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(step)])
        at = share * along[-1]
        k = np.clip(np.searchsorted(along, at, side="right") - 1, 0, len(step) - 1)
        t = (at - along[k]) / step[k]
        h = arc.half_edges[k]
        face[nodes] = h // 3
        weights[nodes] = 0.0
        weights[nodes, h % 3], weights[nodes, (h + 1) % 3] = 1 - t, t


def _place_insides(mesh: TriangleMesh, tiles: Tiles, grids: IntArray, first_of: IntArray, face: IntArray, weights: FloatArray) -> None:
    """Nodes of spokes, middles and grids, found in the flat disks."""
    s = SAMPLES
    flat = np.empty((len(grids), s, s, 2))
    for tile in range(len(first_of) - 1):
        rim = _rim(mesh, tiles, tile)  # (k, 2 s - 1, 2)
        ahead, last = rim[:, :s], np.roll(rim, 1, axis=0)[:, : s - 2 : -1]
        t = np.linspace(1, 0, s)[:, None]
        out, back = ahead[:, -1:] * t, last[:, -1:] * t
        flat[first_of[tile] : first_of[tile + 1]] = _coons(ahead, out, back, last)
    nodes, where = np.unique(grids[:, 1:, 1:].reshape(len(grids), -1), return_index=True)
    quad = where // (s - 1) ** 2
    at = flat[:, 1:, 1:].reshape(-1, 2)[where]
    of = np.searchsorted(first_of, quad, side="right") - 1
    order = np.argsort(of, kind="stable")
    counts = np.bincount(of, minlength=len(first_of) - 1)
    by_tile = np.argsort(tiles.label, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(tiles.label, minlength=len(first_of) - 1))])
    found = located(at[order], np.concatenate([[0], np.cumsum(counts)]), flattened(mesh, tiles), by_tile, start)
    face[nodes[order]], weights[nodes[order]] = found


def _rim(mesh: TriangleMesh, tiles: Tiles, tile: int) -> FloatArray:
    """(k, 2 S - 1, 2) places on the circle of the nodes of each border of a tile."""
    at, turn = angles(mesh, tiles, tile)
    ring, starts = loop_vertices(tiles, tile)
    step = np.linalg.norm(mesh.vertices[np.roll(ring, -1)] - mesh.vertices[ring], axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    rim = np.concatenate([np.stack([np.cos(at), np.sin(at)], axis=1), [[np.cos(turn[-1]), np.sin(turn[-1])]]])
    places = np.linspace(along[starts[:-1]], along[starts[1:]], 2 * SAMPLES - 1, axis=1)
    return np.stack([np.interp(places, along, rim[:, x]) for x in range(2)], axis=2)


def _coons(low: FloatArray, right: FloatArray, top: FloatArray, left: FloatArray) -> FloatArray:
    """(q, S, S, d) between borders (q, S, d): low and top along u at v = 0 and 1, left and right along v at u = 0 and 1."""
    s = np.linspace(0, 1, low.shape[1])
    u, v = s[None, :, None, None], s[None, None, :, None]
    a, b, c, d = (x[:, None, None] for x in (low[:, 0], low[:, -1], top[:, -1], left[:, -1]))
    ruled = (1 - v) * low[:, :, None] + v * top[:, :, None] + (1 - u) * left[:, None] + u * right[:, None]
    return np.asarray(ruled - ((1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d))


def _neighbours(grids: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Start and neighbours of each of n nodes, by the lines of all grids."""
    ends = [grids[:, :-1], grids[:, 1:]], [grids[:, :, :-1], grids[:, :, 1:]]
    i, j = (np.concatenate([pair[k].ravel() for pair in ends]) for k in range(2))
    links = coo_array((np.ones(2 * len(i)), (np.concatenate([i, j]), np.concatenate([j, i]))), shape=(n, n)).tocsr()
    return links.indptr.astype(np.int64), links.indices.astype(np.int64)


def _slid(mesh: TriangleMesh, start: FloatArray, face: IntArray, links: tuple[IntArray, IntArray], slides: BoolArray) -> FloatArray:
    corner = np.argsort(mesh.faces.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(mesh.faces.ravel(), minlength=len(mesh.vertices)))])
    return _slide(start, face.copy(), slides, *links, mesh.vertices, mesh.faces, first, corner // 3, ROUNDS)


@jit
def _slide(
    start: FloatArray, face: IntArray, slides: BoolArray, first: IntArray, beside: IntArray, vertices: FloatArray, faces: IntArray, star: IntArray,
    fan: IntArray, rounds: int,
) -> FloatArray:  # fmt: skip
    """Every node that slides to the mean of its neighbours, then back to the surface, all at once; `face` is where each is and is kept up to date."""
    places, after = start.copy(), start.copy()
    goal, scratch = np.empty(3), np.empty((6, 3))
    for _ in range(rounds):
        for n in range(len(places)):
            if not slides[n]:
                continue
            goal[:] = 0.0
            for k in range(first[n], first[n + 1]):
                for x in range(3):
                    goal[x] += places[beside[k], x] / (first[n + 1] - first[n])
            face[n] = _onto(goal, face[n], vertices, faces, star, fan, after[n], scratch)
        places, after = after, places
    return places


@jit
def _onto(
    goal: FloatArray, f: int, vertices: FloatArray, faces: IntArray, star: IntArray, fan: IntArray, out: FloatArray, scratch: FloatArray
) -> int:
    """The triangle reached from `f` over triangles that share a vertex, each nearer to `goal` than the last; `out` takes the nearest point there."""
    best = _near(goal, f, vertices, faces, scratch)
    for x in range(3):
        out[x] = scratch[5, x]
    while not (scratch[3, 0] > 0 and scratch[3, 1] > 0 and scratch[3, 2] > 0):
        here = f
        for k in range(3):
            v = faces[here, k]
            for q in range(star[v], star[v + 1]):
                d = _near(goal, fan[q], vertices, faces, scratch)
                if d < best * (1 - 1e-12):
                    best, f = d, fan[q]
                    for x in range(3):
                        out[x] = scratch[5, x]
        if f == here:
            break
        _near(goal, f, vertices, faces, scratch)
    return f


@jit
def _near(goal: FloatArray, f: int, vertices: FloatArray, faces: IntArray, scratch: FloatArray) -> float:
    """Squared distance to triangle `f`. scratch : rows 0 to 2 its corners, 3 the weights, 5 the nearest point; 4 is used up."""
    for k in range(3):
        for x in range(3):
            scratch[k, x] = vertices[faces[f, k], x]
    d = nearest_on_triangle(goal, scratch[:3], scratch[3], scratch[4])
    for x in range(3):
        scratch[5, x] = scratch[3, 0] * scratch[0, x] + scratch[3, 1] * scratch[1, x] + scratch[3, 2] * scratch[2, x]
    return d
