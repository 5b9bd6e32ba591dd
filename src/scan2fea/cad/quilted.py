"""A solid of true faces with NURBS patches for the rest: what lies on no surface, or where the surfaces meet in no edge, is cut into tiles.

The network of the patches is as for tracing. Regions of free form are cut into tiles that do not leave them, each of these into four-sided patches;
the borders to true faces, and the creases between two regions of free form, stand where the edges of the network are, and the patches end there.
Faces share their edges by construction.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from scan2fea.cad.corners import Corner, Edge, Meeting
from scan2fea.cad.freeform import DEGREE, KNOTS, PIECES, RATE, SPANS, Patched, patches_of
from scan2fea.cad.live import is_valid, pnt, solid_of_faces
from scan2fea.cad.network import Network, network_of
from scan2fea.cad.occ import bspline_curve, bspline_surface
from scan2fea.cad.quads import SAMPLES, Quads, quads_on
from scan2fea.cad.roundings import MEETS
from scan2fea.cad.sheets import SMOOTH_SHARE
from scan2fea.cad.tangency import made_to_touch, touches_of
from scan2fea.cad.tiles import Arc, Tiles, Web, parted, tiles_at, web_of
from scan2fea.cad.traced import EXACT, RESOLUTION, SMALL, face_on, joined_loops, joined_whole, shared_edges
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.nurbs import basis
from scan2fea.kernel.polylines import evenly, length_of
from scan2fea.kernel.surfaces import Surface
from scan2fea.kernel.topology import edge_table
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

GIVEN_UP = 8  # rounds in which surfaces that meet in no edge become free form
ROUNDS = 8  # in which tiles are parted
ROUNDED = 2.5  # times as far as an edge was moved the surface beside it is rounded
MOST_PATCHES = 1_000
MOST_FOLDED = 0.03  # of a patch: at a corner where borders meet at next to no angle, or a straight one, it has no normal
TRIANGLES_A_PART = 6  # a tile of fewer for each of its patches is not parted
ALONG = np.linspace(0, 1, 33)  # places along an edge where its distance from the faces beside it is looked at


@dataclass(frozen=True, eq=False, kw_only=True)
class Quilt(Value):
    """solid : None where there is none, and why.   free : (m,) faces on patches.   n_patches : of these.

    within : how far an edge may lie from a face beside it: each has its own place for it.
    """

    solid: Any | None
    reason: str
    free: BoolArray
    n_patches: int = 0
    within: float = 0.0


def quilted_solid(
    mesh_mm: TriangleMesh, label: IntArray, surfaces: Sequence[Surface], covariances: Sequence[FloatArray], tolerance: float, spacing: float,
    free: BoolArray, limit: float, closely: float, reach: float,
) -> Quilt:  # fmt: skip
    """The solid, in millimetres. label : (m,) number of the surface of each face, -1 of none.   free : (m,) faces of free form.

    limit, closely : how far patches may lie off the surface, at most and in the mean (rms), where there are triangles enough.
    reach : how far from a place where two large surfaces do not meet the surface is free form.
    """
    for _ in range(GIVEN_UP):
        label, more, made, network, pairs = _met(mesh_mm, label, free, surfaces, covariances, tolerance, spacing, reach)
        if (more & ~free).any():
            free = free | more
            continue
        if not free.any():
            return Quilt(solid=None, reason="all surfaces meet in edges", free=free)
        solid, n_patches, invalid, within = _patched(mesh_mm, network, made, pairs, tolerance, spacing, limit, closely)
        if not invalid:
            reason = "" if solid is not None else "no tiles hold the free form"
            return Quilt(solid=solid, reason=reason, free=free, n_patches=n_patches, within=within)
        free = free | np.isin(network.surface[network.label], sorted(invalid))
    return Quilt(solid=None, reason="surfaces meet in no edges", free=free)


def _met(
    mesh: TriangleMesh, label: IntArray, free: BoolArray, surfaces: Sequence[Surface], covariances: Sequence[FloatArray], tolerance: float,
    spacing: float, reach: float,
) -> tuple[IntArray, BoolArray, list[Surface], Network, set[frozenset[int]]]:  # fmt: skip
    """Labels without islands, what is free form because surfaces do not meet there, the surfaces made to touch, their network, and pairs that do."""
    area = face_areas(mesh)
    while True:
        network = network_of(mesh, label, surfaces, free=_pieces(mesh, label, free))
        made, kept = made_to_touch(surfaces, covariances, touches_of(mesh, network, surfaces, covariances, tolerance, spacing), tolerance)
        network = network.halved_through(made)
        meeting = Meeting(mesh, network, made, [touch.chain for touch in kept], tolerance, spacing)
        edges = meeting.edges()
        islands = meeting.islands(edges)
        if not islands:
            break
        for region, around in islands.items():
            label = np.where(network.label == region, around, label)
    own = network.surface[network.label]
    size = np.asarray(np.bincount(own[own >= 0], weights=area[own >= 0], minlength=len(made)), float)
    given_up = _loose(mesh, network, made, {touch.chain for touch in kept}, size)
    spots = np.zeros(len(mesh.vertices), bool)
    for names, vertices in meeting.unmet(tolerance, edges):
        smallest = min(names, key=lambda k: size[k])
        if size[smallest] <= SMALL * area.sum():
            given_up.add(smallest)
        else:
            spots[vertices] = True
    more = free | np.isin(own, sorted(given_up))
    if spots.any():
        near = np.asarray(cKDTree(mesh.vertices[spots]).query(mesh.vertices, distance_upper_bound=reach)[0]) < np.inf
        more |= near[mesh.faces].any(1)
    return label, np.asarray(more, bool), made, network, {frozenset((touch.first, touch.second)) for touch in kept}


def _patched(
    mesh: TriangleMesh, network: Network, surfaces: Sequence[Surface], touching: Collection[frozenset[int]], tolerance: float, spacing: float,
    limit: float, closely: float,
) -> tuple[Any | None, int, set[int], float]:  # fmt: skip
    """The solid with tiles whose patches hold, the number of these, the surfaces of true faces that are not valid, and how far edges may lie off."""
    web = web_of(mesh, network.label, network.surface < 0)
    seeds = np.sort(np.unique(web.part, return_index=True)[1][web.is_tiled[np.unique(web.part)]])  # a triangle of each region
    for _ in range(ROUNDS):
        tiles = tiles_at(web, seeds)
        if tiles is None:
            return None, 0, set(), 0.0
        tiled = network.tiled(mesh, tiles.label, len(tiles.seeds))
        touches = [k for k, c in enumerate(tiled.chains) if frozenset(tiled.surface[[c.left, c.right]].tolist()) in touching]
        meeting = Meeting(mesh, tiled, surfaces, touches, tolerance, spacing)
        border = _Border.of(mesh, web, tiles, tiled, meeting)
        if any(length_of(line) < RESOLUTION for line in border.held.values()):
            return None, 0, set(), 0.0
        quads = quads_on(border.mesh, border.tiles, border.held)
        found = patches_of(quads, border.mesh)
        n = len(found.controls)
        if n > MOST_PATCHES:
            return None, n, set(), 0.0
        worst = np.zeros(len(tiles.loops))
        off = _offs(_borders_of(found, quads), border, tiled, surfaces, len(border.tiles.arcs))
        is_off = (found.folded > MOST_FOLDED) | (found.rms_m > closely) | (off[quads.sides].max(1) > tolerance / 10)
        np.maximum.at(worst, quads.tile, np.where(is_off, np.maximum(found.off_m, 1.01 * limit), found.off_m))
        parts = np.where(worst > limit, np.clip(np.ceil((worst / limit) ** RATE), 2, PIECES), 1).astype(np.int64)
        size = np.bincount(tiles.label, minlength=len(worst))[: len(worst)]
        parts[size < TRIANGLES_A_PART * np.bincount(quads.tile)] = 1  # noise, or a crease, that no patch follows
        if (parts < 2).all():
            break
        seeds = parted(web, tiles, parts)
    solid, invalid = _sewn(mesh, tiled, surfaces, meeting, border, quads, found, off)
    return solid, n, invalid, 3.0 * float(off.max())


def _pieces(mesh: TriangleMesh, label: IntArray, free: BoolArray) -> IntArray:
    """(m,) number of the piece of free form that each face is of, -1 of none: labels that pass into each other without an angle are of one piece."""
    twin = edge_table(mesh.faces).twin
    own, other = np.repeat(label, 3), label[twin // 3]
    inner = np.repeat(free, 3) & free[twin // 3] & (own < other)
    normal = face_normals(mesh)
    n = int(label.max()) + 2
    pair = (own[inner] + 1) * n + other[inner] + 1
    side, beyond = np.flatnonzero(inner) // 3, twin[inner] // 3
    joined = [[], []]  # type: list[list[int]]
    for code in np.unique(pair).tolist():
        rows = pair == code
        # across the noise of single faces: the mean of each side within some faces of the border would say more, the median of many says enough
        if np.median(np.einsum("ij,ij->i", normal[side[rows]], normal[beyond[rows]])) > MEETS or -1 in (code // n - 1, code % n - 1):
            joined[0].append(code // n)
            joined[1].append(code % n)
    group = connected_components(coo_array((np.ones(len(joined[0])), (joined[0], joined[1])), shape=(n, n)), directed=False)[1]
    return np.asarray(np.where(free, group[label + 1], -1), np.int64)


def _loose(mesh: TriangleMesh, network: Network, surfaces: Sequence[Surface], touching: Collection[int], size: FloatArray) -> set[int]:
    """Of two surfaces that pass into each other without an angle along most of their border, and do not touch, the smaller: a piece of free form."""
    length: dict[tuple[int, int], list[float]] = {}
    for number, found in enumerate(network.chains):
        first, second = sorted(int(network.surface[side]) for side in (found.left, found.right))
        if first < 0 or first == second:
            continue
        at = mesh.vertices[found.vertices]
        turn = float(np.median(np.einsum("ij,ij->i", surfaces[first].normals(at), surfaces[second].normals(at))))
        total = length.setdefault((first, second), [0.0, 0.0])
        total[0] += length_of(at)
        total[1] += length_of(at) if turn > MEETS and number not in touching else 0.0
    return {min(pair, key=lambda k: size[k]) for pair, (total, loose) in length.items() if loose > SMOOTH_SHARE * total}


@dataclass(frozen=True, eq=False, kw_only=True)
class _Border(Value):
    """mesh, tiles : the tiled regions alone, their borders where the edges are.   held : places along the borders that are given.

    chain : (a,) of each border of tiles, and whether it runs the same way.
    """

    mesh: TriangleMesh
    tiles: Tiles
    held: Mapping[int, FloatArray]
    chain: Sequence[tuple[int, bool]]
    edges: Mapping[int, Edge]

    @staticmethod
    def of(mesh: TriangleMesh, web: Web, tiles: Tiles, network: Network, meeting: Meeting) -> _Border:
        edges = meeting.edges()
        rows = np.flatnonzero(tiles.label < len(tiles.seeds))
        row_of = np.full(len(tiles.label), -1, np.int64)
        row_of[rows] = np.arange(len(rows))
        used, packed = np.unique(mesh.faces[rows], return_inverse=True)
        at = mesh.vertices[used].copy()
        vertex_of = np.full(len(mesh.vertices), -1, np.int64)
        vertex_of[used] = np.arange(len(used))
        ways: dict[tuple[int, int], tuple[int, bool]] = {}
        for number, found in enumerate(network.chains):
            ways[int(found.vertices[0]), int(found.vertices[1])] = number, True
            ways[int(found.vertices[-1]), int(found.vertices[-2])] = number, False
        arcs, chain, held = [], [], {}
        for number, arc in enumerate(tiles.arcs):
            chain.append(ways[int(arc.vertices[0]), int(arc.vertices[1])])
            arcs.append(
                Arc(vertices=vertex_of[arc.vertices], half_edges=3 * row_of[arc.half_edges // 3] + arc.half_edges % 3, left=arc.left, right=arc.right)
            )
            sides = web.part[[arc.half_edges[0] // 3, web.table.twin[arc.half_edges[0]] // 3]]
            if sides[0] == sides[1]:
                continue
            edge, forward = edges[chain[-1][0]], chain[-1][1]
            line = edge.points if forward else edge.points[::-1]
            held[number] = evenly(line, 2 * SAMPLES - 1)
            at[arcs[-1].vertices] = _beside(mesh.vertices[arc.vertices], line)
        on_border = np.zeros(len(at), bool)
        for number in held:
            on_border[arcs[number].vertices] = True
        local = packed.reshape(-1, 3).astype(np.int64)
        at = _relaxed(mesh.vertices[used], at, local, on_border)
        cut = Tiles(label=tiles.label[rows], seeds=row_of[tiles.seeds], arcs=tuple(arcs), loops=tiles.loops)
        return _Border(mesh=TriangleMesh(vertices=at, faces=local), tiles=cut, held=held, chain=chain, edges=edges)


def _relaxed(before: FloatArray, at: FloatArray, faces: IntArray, is_given: BoolArray) -> FloatArray:
    """Vertices beside a border that was moved on a membrane between it and the rest: there the noise has rounded a crease.

    Of a crease that is rounded with a radius r the edge lies 0.41 r off the surface, which leaves the faces r before it.
    """
    border, rest = np.flatnonzero(is_given), np.flatnonzero(~is_given)
    if not len(border) or not len(rest):
        return at
    step = np.linalg.norm(at - before, axis=1)
    far, near = k_nearest(before[border], min(8, len(border)), before[rest])
    loose = rest[(far < ROUNDED * step[border[near]]).any(1)]
    if not len(loose):
        return at
    i, j = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    links = coo_array((np.ones(2 * len(i)), (np.concatenate([i, j]), np.concatenate([j, i]))), shape=(len(at),) * 2).tocsr()
    links.data[:] = 1.0
    inner = links[loose]
    known = np.ones(len(at), bool)
    known[loose] = False
    matrix = diags_array(inner.sum(1)).tocsc() - inner[:, loose].tocsc()
    out = at.copy()
    out[loose] = splu(matrix.tocsc()).solve(inner[:, np.flatnonzero(known)] @ at[known])
    return out


def _beside(line: FloatArray, onto: FloatArray) -> FloatArray:
    """Points of one line at the same shares of the length of another."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    there = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(onto, axis=0), axis=1)))
    return np.column_stack([np.interp(along / along[-1] * there[-1], there, x) for x in onto.T])


def _sewn(
    mesh: TriangleMesh, network: Network, surfaces: Sequence[Surface], meeting: Meeting, border: _Border, quads: Quads, found: Patched,
    off: FloatArray,
) -> tuple[Any | None, set[int]]:  # fmt: skip
    """The solid of the true faces and the patches, which share their edges; and the surfaces of faces that are not valid."""
    of_arcs = {number for number, _ in border.chain}
    plain = {k: e for k, e in border.edges.items() if k not in of_arcs}
    curves = _borders_of(found, quads)
    corner = _corner_numbers(border, meeting, quads)
    free = {v: curves[c, -k] for c, ends in enumerate(corner) for k, v in enumerate(ends)}  # where those are that slid
    given = {v for e in plain.values() for v in (e.first, e.last)} | {v for arc in border.held for v in (corner[2 * arc][0], corner[2 * arc + 1][0])}
    placed = {v: c if v in given else Corner(at=free[v], off=0.0) for v, c in meeting.corners.items()}
    at = free | {v: c.at for v, c in placed.items()}
    try:
        drawn, ends = shared_edges(plain, placed, EXACT)
        drawn |= _curved_edges(curves, corner, at, ends, off)
        uses: dict[int, list[tuple[int, bool, int, int]]] = {k: [] for k in np.flatnonzero(network.surface >= 0).tolist()}
        for number, edge in plain.items():
            found_chain = network.chains[number]
            uses[found_chain.left].append((number, True, edge.first, edge.last))
            uses[found_chain.right].append((number, False, edge.last, edge.first))
        for arc, one in enumerate(border.tiles.arcs):
            if one.right < len(border.tiles.seeds):
                continue
            number, forward = border.chain[arc]
            side = network.chains[number].right if forward else network.chains[number].left
            (first, middle), (last, _) = corner[2 * arc], corner[2 * arc + 1]
            uses[side] += [(_key(2 * arc + 1), True, last, middle), (_key(2 * arc), False, middle, first)]
        faces, invalid = [], set()
        for region, own in uses.items():
            if not own:
                continue
            loops = joined_loops(own)
            if not loops:
                return None, set()
            used = np.unique(mesh.faces[network.label == region])
            k = int(network.surface[region])
            faces.append(face_on(surfaces[k], mesh.vertices[used], loops, drawn))
            invalid |= set() if is_valid(faces[-1]) else {k}
        faces += [_patch(control, [drawn[_key(int(c))] for c in sides]) for control, sides in zip(found.controls, quads.sides, strict=True)]
    except Exception:  # noqa: BLE001 - Open Cascade raises types of its own for what it cannot draw: no solid then
        return None, set()
    solid = solid_of_faces(faces)
    return None if solid is None else joined_whole(solid), invalid


def _key(curve: int) -> int:
    return -1 - curve


def _borders_of(found: Patched, quads: Quads) -> FloatArray:
    """(c, n, 3) control points of each border."""
    out = np.empty((len(quads.curves), found.controls.shape[1], 3))
    sides = found.controls[:, :, 0], found.controls[:, -1], found.controls[:, :, -1], found.controls[:, 0]
    for k, control in enumerate(sides):
        out[quads.sides[:, k]] = control
    return out


def _corner_numbers(border: _Border, meeting: Meeting, quads: Quads) -> list[tuple[int, int]]:
    """The numbers of the vertices at both ends of each border of patches: of the meeting's corners, below 0 of those inside."""
    out: list[tuple[int, int]] = []
    n_arcs = len(border.tiles.arcs)
    for arc, (number, forward) in enumerate(border.chain):
        edge = border.edges[number]
        first, last = (edge.first, edge.last) if forward else (edge.last, edge.first)
        out += [(first, -1 - arc), (last, -1 - arc)]
    for tile, loop in enumerate(border.tiles.loops):
        out += [(-1 - (arc if arc >= 0 else ~arc), -1 - n_arcs - tile) for arc in loop]
    return out


def _offs(curves: FloatArray, border: _Border, network: Network, surfaces: Sequence[Surface], n_arcs: int) -> FloatArray:
    """(c,) how far each border of patches lies from the true face beside it."""
    value = basis(KNOTS, DEGREE, ALONG)
    out = np.zeros(len(curves))
    for arc in range(n_arcs):
        chain = network.chains[border.chain[arc][0]]
        for k in (int(network.surface[side]) for side in (chain.left, chain.right)):
            if k >= 0:
                for half in (2 * arc, 2 * arc + 1):
                    out[half] = max(out[half], float(np.abs(surfaces[k].distance(value @ curves[half])).max()))
    return out


def _curved_edges(
    curves: FloatArray, corner: Sequence[tuple[int, int]], at: Mapping[int, FloatArray], ends: Mapping[int, Any], off: FloatArray
) -> dict[int, Any]:
    """Edges of Open Cascade along the borders of patches."""
    from OCP.BRep import BRep_Builder
    from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
    from OCP.TopoDS import TopoDS, TopoDS_Edge, TopoDS_Vertex

    builder, places, out = BRep_Builder(), dict(ends), {}
    for control, numbers, far, number in zip(curves, corner, off, range(len(curves)), strict=True):
        shape = TopoDS_Edge()
        builder.MakeEdge(shape, bspline_curve(control, SPANS, DEGREE), max(RESOLUTION, 2 * float(far)))
        for name, way, place in zip(numbers, (TopAbs_FORWARD, TopAbs_REVERSED), control[[0, -1]], strict=True):
            if name not in places:
                places[name] = TopoDS_Vertex()
                builder.MakeVertex(places[name], pnt(at[name]), RESOLUTION)
            miss = float(np.linalg.norm(at[name] - place))
            builder.UpdateVertex(places[name], max(RESOLUTION, 2 * miss, 2 * float(far)))
            builder.Add(shape, TopoDS.Vertex(places[name].Oriented(way)))
        builder.Range(shape, 0.0, 1.0)
        out[_key(number)] = shape
    return out


def _patch(control: FloatArray, sides: Sequence[Any]) -> Any:
    """The face of a patch between its edges: at v = 0, u = 1, v = 1, u = 0, each along u or v."""
    from OCP.BRep import BRep_Builder
    from OCP.Geom2d import Geom2d_Line
    from OCP.gp import gp_Dir2d, gp_Pnt2d
    from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS_Face, TopoDS_Wire

    builder, face, wire = BRep_Builder(), TopoDS_Face(), TopoDS_Wire()
    surface = bspline_surface(control, SPANS, DEGREE)
    builder.MakeFace(face, surface, RESOLUTION)
    builder.MakeWire(wire)
    lines = ((0.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (0.0, 1.0)), ((0.0, 1.0), (1.0, 0.0)), ((0.0, 0.0), (0.0, 1.0))
    for edge, (start, along), way in zip(sides, lines, (TopAbs_FORWARD, TopAbs_FORWARD, TopAbs_REVERSED, TopAbs_REVERSED), strict=True):
        builder.UpdateEdge(edge, Geom2d_Line(gp_Pnt2d(*start), gp_Dir2d(*along)), surface, TopLoc_Location(), RESOLUTION)
        builder.Add(wire, edge.Oriented(way))
    wire.Closed(True)
    builder.Add(face, wire)
    return face
