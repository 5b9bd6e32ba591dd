"""A closed surface cut into tiles: connected disks of triangles round seeds that lie evenly on it (Lloyd's relaxation of geodesic Voronoi tiles).

Eck and others (1995, Multiresolution analysis of arbitrary meshes, section 4) cut so and add seeds until every tile is a disk; here the tiles
themselves, not their dual triangles, carry the patches: a tile with k corners becomes k four-sided ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from scan2fea.errors import CadError, require
from scan2fea.kernel.face_tree import morton_order
from scan2fea.kernel.measures import face_areas
from scan2fea.kernel.topology import EdgeTable, edge_table
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

LLOYD = 8  # rounds
SMOOTHINGS = 6  # rounds in which a triangle goes to the tile of two of its neighbours
MENDINGS = 30  # rounds in which tiles that are no disks are parted


@dataclass(frozen=True, eq=False, kw_only=True)
class Arc(Value):
    """A border between two tiles. vertices : from corner to corner.   half_edges : along it, in the triangles on its left.   left, right : tiles."""

    vertices: IntArray
    half_edges: IntArray
    left: int
    right: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Tiles(Value):
    """label : (m,) tile of each triangle, 0 .. n - 1; n or more of those that are not tiled.   seeds : (n,) a triangle of each.

    arcs : all borders of tiles; on their right may lie what is not tiled.   loops : per tile its borders, counter-clockwise: arc, or ~arc where it
    runs backwards.
    """

    label: IntArray
    seeds: IntArray
    arcs: tuple[Arc, ...]
    loops: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Web(Value):
    """What tiles are cut from. graph : (m, m) ways from the middle of each triangle to those beside it.   centre : (m, 3).   area : (m,).

    part : (m,) region of each triangle, which no tile leaves.   is_tiled : (p,) regions that are cut.
    """

    faces: IntArray
    table: EdgeTable
    graph: Any
    centre: FloatArray
    area: FloatArray
    part: IntArray
    is_tiled: BoolArray


def web_of(mesh: TriangleMesh, part: IntArray | None = None, is_tiled: BoolArray | None = None) -> Web:
    """Of a closed manifold surface, cut all over unless its parts are given. Raises CadError where it has borders."""
    part = np.zeros(len(mesh.faces), np.int64) if part is None else part
    is_tiled = np.ones(int(part.max()) + 1, bool) if is_tiled is None else is_tiled
    table = edge_table(mesh.faces)
    require(bool((table.twin >= 0).all()), CadError, "tiles need a closed surface; repair it first")
    i, j = np.arange(len(table.twin)) // 3, table.twin // 3
    centre = mesh.vertices[mesh.faces].mean(1)
    way = np.linalg.norm(centre[i] - centre[j], axis=1)
    kept = (part[i] == part[j]) & is_tiled[part[i]]
    graph = coo_array((np.maximum(way, 1e-12 * way.max())[kept], (i[kept], j[kept])), shape=(len(centre),) * 2).tocsr()
    return Web(faces=mesh.faces, table=table, graph=graph, centre=centre, area=face_areas(mesh), part=part, is_tiled=is_tiled)


def spread(web: Web, n: int) -> IntArray:
    """About `n` triangles that lie evenly on the surface."""
    order = morton_order(web.centre)
    share = np.cumsum(web.area[order]) / web.area.sum()
    seeds = np.unique(order[np.searchsorted(share, (np.arange(n) + 0.5) / n).clip(0, len(order) - 1)])
    for _ in range(LLOYD):
        seeds = np.unique(_nearest_to_middles(web.centre, web.area, _nearest(web, seeds)[0]))
    return seeds


def parted(web: Web, tiles: Tiles, pieces: IntArray) -> IntArray:
    """Seeds with which each tile falls into so many pieces; the seeds of tiles that stay whole do not move."""
    kept = [tiles.seeds[pieces < 2]]
    for tile in np.flatnonzero(pieces >= 2).tolist():
        rows = np.flatnonzero(tiles.label == tile)
        inside = web.graph[rows][:, rows]
        own = np.flatnonzero(rows == tiles.seeds[tile])[:1]
        for _ in range(int(pieces[tile]) - 1):
            own = np.append(own, np.argmax(dijkstra(inside, indices=own, min_only=True))) if len(own) else np.zeros(1, np.int64)
        for _ in range(LLOYD):
            source = dijkstra(inside, indices=np.unique(own), min_only=True, return_predecessors=True)[2]
            own = _nearest_to_middles(web.centre[rows], web.area[rows], np.unique(source, return_inverse=True)[1])
        kept.append(rows[own])
    return np.unique(np.concatenate(kept))


def tiles_at(web: Web, seeds: IntArray) -> Tiles | None:
    """The tiles round these triangles, and round more where one is no disk with two corners at least; None where they cannot be parted."""
    for _ in range(MENDINGS):
        label, distance = _nearest(web, seeds)
        label = np.where(web.is_tiled[web.part], label, len(seeds) + web.part)
        label = _without_pinches(_smooth(label, web), len(seeds), web)
        kept, label = np.unique(label, return_inverse=True)  # a tile of few triangles may have gone to those beside it
        seeds = seeds[kept[kept < len(seeds)]]
        found = _traced(label, seeds, web.faces, web.table)
        if isinstance(found, Tiles):
            return found
        more = np.unique(np.append(seeds, [_farthest(label, distance, tile) for tile in found.tolist()]).astype(np.int64))
        if len(more) == len(seeds):
            return None
        seeds = more
    return None


def _nearest(web: Web, seeds: IntArray) -> tuple[IntArray, FloatArray]:
    """(m,) number of the seed that is nearest along the surface, and how far."""
    distance, _, source = dijkstra(web.graph, indices=seeds, min_only=True, return_predecessors=True)
    return np.searchsorted(seeds, source).astype(np.int64), np.asarray(distance)


def _nearest_to_middles(centre: FloatArray, area: FloatArray, label: IntArray) -> IntArray:
    """The triangle of each label that is nearest to the middle of all that bear it."""
    n = int(label.max()) + 1
    total = np.bincount(label, area, n)
    middle = np.stack([np.bincount(label, area * centre[:, x], n) / np.maximum(total, 1e-300) for x in range(3)], axis=1)
    off = np.linalg.norm(centre - middle[label], axis=1)
    order = np.lexsort((off, label))
    return np.asarray(order[np.unique(label[order], return_index=True)[1]])


def _farthest(label: IntArray, distance: FloatArray, tile: int) -> int:
    rows = np.flatnonzero(label == tile)
    return int(rows[np.argmax(distance[rows])])


def _smooth(label: IntArray, web: Web) -> IntArray:
    """Triangles with two neighbours in one other tile go to it: borders without spikes. Every second triangle at a time, so that two never swap."""
    beside = (web.table.twin // 3).reshape(-1, 3)
    part = _part_of(label, web)
    for turn in range(2 * SMOOTHINGS):
        near = label[beside]
        other = np.where(near[:, 0] == near[:, 1], near[:, 0], np.where((near[:, 2] == near[:, 0]) | (near[:, 2] == near[:, 1]), near[:, 2], label))
        change = (other != label) & ((near == label[:, None]).sum(1) < 2) & (np.arange(len(label)) % 2 == turn % 2) & (part[other] == web.part)
        label = np.where(change, other, label)
    return label


def _part_of(label: IntArray, web: Web) -> IntArray:
    """The region of each tile."""
    out = np.full(int(label.max()) + 1, -1)
    out[label] = web.part
    return out


def _without_pinches(label: IntArray, n: int, web: Web) -> IntArray:
    """Where one of `n` tiles touches itself at a vertex the smaller of its two fans there goes to the tile beside it."""
    label, part, faces, table = label.copy(), _part_of(label, web), web.faces, web.table
    for _ in range(SMOOTHINGS):
        pinched = np.flatnonzero(_pinched(label, n, faces, table))
        if not len(pinched):
            break
        first = np.full(int(faces.max()) + 1, -1)
        first[faces.ravel()] = np.arange(faces.size)
        for vertex in pinched.tolist():
            fan = _fan(int(first[vertex]), table.twin)
            runs = _runs(label[fan])
            names = [label[fan[run[0]]] for run in runs]
            doubled = [k for k, name in enumerate(names) if names.count(name) > 1 and part[names[(k + 1) % len(names)]] == part[name]]
            if doubled:
                k = min(doubled, key=lambda k: (len(runs[k]), fan[runs[k][0]]))
                label[fan[runs[k]]] = names[(k + 1) % len(names)]
    return label


def _fan(half_edge: int, twin: IntArray) -> IntArray:
    """Triangles round the vertex at which `half_edge` starts, in order."""
    fan, at = [], half_edge
    while True:
        fan.append(at // 3)
        at = int(twin[at - at % 3 + (at + 2) % 3])
        if at == half_edge:
            return np.array(fan)


def _runs(names: IntArray) -> list[list[int]]:
    """Places of equal neighbours in a ring."""
    starts = np.flatnonzero(names != np.roll(names, 1))
    if not len(starts):
        return [list(range(len(names)))]
    ends = np.append(starts[1:], starts[0] + len(names))
    return [[k % len(names) for k in range(a, b)] for a, b in zip(starts.tolist(), ends.tolist(), strict=True)]


def _border(label: IntArray, table: EdgeTable) -> BoolArray:
    """(3 m,) half-edges between two tiles."""
    return np.asarray(label[np.arange(len(table.twin)) // 3] != label[table.twin // 3])


def _pinched(label: IntArray, n: int, faces: IntArray, table: EdgeTable) -> BoolArray:
    """(v,) vertices round which one of `n` tiles comes twice: as often as its borders leave them."""
    leaves = _border(label, table) & (np.repeat(label, 3) < n)
    at, times = np.unique(np.stack([faces.ravel(), np.repeat(label, 3)], axis=1)[leaves], axis=0, return_counts=True)
    out = np.zeros(int(faces.max()) + 1, bool)
    out[at[times > 1, 0]] = True
    return out


def _traced(label: IntArray, seeds: IntArray, faces: IntArray, table: EdgeTable) -> Tiles | IntArray:
    """The tiles with their borders, or the numbers of those that are no disks with two corners."""
    n = len(seeds)
    border = _border(label, table)
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    near = np.unique(label[(_pinched(label, n, faces, table)[faces]).any(1)])
    bad = set(near[near < n].tolist())
    inner = ~border & (table.twin >= 0)
    same = coo_array((np.ones(int(inner.sum())), (np.flatnonzero(inner) // 3, table.twin[inner] // 3)), shape=(len(faces),) * 2)
    pieces = connected_components(same, directed=False)[1]
    whole = np.unique(np.stack([label, pieces], axis=1), axis=0)[:, 0]
    bad |= set(np.flatnonzero(np.bincount(whole, minlength=n)[:n] != 1).tolist())
    if bad:
        return np.array(sorted(bad), np.int64)
    is_corner = np.bincount(tail[border], minlength=int(faces.max()) + 1) >= 3
    follow: list[dict[int, int]] = [{} for _ in range(n)]
    for h in np.flatnonzero(border & (np.repeat(label, 3) < n)).tolist():
        follow[label[h // 3]][int(tail[h])] = h
    arcs: list[Arc] = []
    number: dict[int, int] = {}  # of the arc whose first half-edge, on its left, this is
    loops = []
    for tile in range(n):
        loop: list[int] = []
        left = dict(follow[tile])
        first = at = next((v for v in left if is_corner[v]), -1)
        while left and at >= 0:
            chain, run = [at], list[int]()
            while at in left and (not run or not is_corner[at]):
                run.append(left.pop(at))
                at = int(head[run[-1]])
                chain.append(at)
            back = int(table.twin[run[-1]])
            if back in number:
                loop.append(~number[back])
            else:
                number[run[0]] = len(arcs)
                loop.append(len(arcs))
                arcs.append(Arc(vertices=np.array(chain), half_edges=np.array(run), left=tile, right=int(label[back // 3])))
            if at == first:
                break
        if left or len(loop) < 2:
            bad.add(tile)
        loops.append(tuple(loop))
    if bad:
        return np.array(sorted(bad), np.int64)
    return Tiles(label=label, seeds=seeds, arcs=tuple(arcs), loops=tuple(loops))
