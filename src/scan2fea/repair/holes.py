"""Holes filled as Liepa does (2003): triangulated with the smallest dihedral angles, refined to the density around them, faired; creases go on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from scan2fea.kernel.measures import area, face_normals
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import edge_table, half_edges
from scan2fea.repair.fair import faired
from scan2fea.repair.refine import refined
from scan2fea.repair.ridges import bridge, chords, crease_ends, parts_of
from scan2fea.repair.triangulate import ANY, EQUAL, triangulated
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

SMOOTH, PLAIN, LEAST = 0, 1, 2  # refined and faired; the corners alone; the corners alone with the least area


@dataclass(frozen=True, eq=False, kw_only=True)
class HolesFilled(Value):
    """mesh : the old faces first, then the fills.   hole : (m,) number of the hole each face fills, -1 for the old ones.

    n_holes : filled.   n_left : that could not be filled without repeating an edge.   n_creases : led on across holes.
    """

    mesh: TriangleMesh
    hole: IntArray
    n_holes: int
    n_left: int = 0
    n_creases: int = 0


def boundary_loops(faces: IntArray) -> list[IntArray]:
    """The borders as loops of vertices, each running as the half-edges of its faces do. Wants one fan per vertex."""
    directed = half_edges(faces)
    table = edge_table(faces)
    open_edges = directed[table.count[table.edge_of] == 1]
    after = {int(a): int(b) for a, b in open_edges}
    loops = []
    while after:
        start = min(after)
        loop, v = [], start
        while v in after:
            loop.append(v)
            v = after.pop(v)
        loops.append(np.array(loop, np.int64))
    return loops


class _Filling:
    """What the filling of several holes of one mesh shares: the mesh's edges, normals beyond its rims, densities, and the vertices made so far."""

    def __init__(self, mesh: TriangleMesh, loops: list[IntArray]) -> None:
        table = edge_table(mesh.faces)
        ends, normals = half_edges(mesh.faces), face_normals(mesh)
        on_rim = np.zeros(len(mesh.vertices), bool)
        on_rim[np.concatenate(loops)] = True
        self.edges = {(int(a), int(b)) for a, b in table.edges[on_rim[table.edges].all(axis=1)]}  # the only ones that a fill could repeat
        rim = np.flatnonzero(table.count[table.edge_of] == 1)
        self.beyond = {(int(b), int(a)): normals[h // 3] for h, (a, b) in zip(rim.tolist(), ends[rim].tolist(), strict=True)}
        length = np.linalg.norm(mesh.vertices[table.edges[:, 0]] - mesh.vertices[table.edges[:, 1]], axis=1)
        both = table.edges.T.ravel()
        count = np.bincount(both, minlength=len(mesh.vertices))
        self.scale = np.bincount(both, weights=np.tile(length, 2), minlength=len(mesh.vertices)) / np.maximum(count, 1)
        self.points = mesh.vertices
        self.creases = crease_ends(mesh.vertices, mesh.faces, table, normals, np.flatnonzero(on_rim))
        self.fixed: list[int] = []
        self.n_creases = 0

    def by(self, loop: IntArray, way: int) -> IntArray | None:
        """(k, 3) faces over the loop, SMOOTH, PLAIN or LEAST; None where an edge would be repeated."""
        return self.smooth(loop) if way == SMOOTH else self.plain(loop, EQUAL if way == PLAIN else ANY)

    def plain(self, loop: IntArray, equal: float = EQUAL) -> IntArray | None:
        """(k, 3) faces over the corners of the loop alone; None where an edge would be repeated."""
        ring = loop[::-1]  # the fill runs against the faces around it
        zero = np.zeros(3)
        pairs = zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True)
        beside = np.array([self.beyond.get(pair, zero) for pair in pairs])
        places = {int(v): k for k, v in enumerate(ring)}
        own = {(min(places[a], places[b]), max(places[a], places[b])) for a, b in self.edges_among(ring)}
        found = triangulated(self.points[ring], np.arange(len(ring)), beside, own, equal)
        return None if found is None else ring[found]

    def edges_among(self, ring: IntArray) -> list[tuple[int, int]]:
        """Edges of the mesh between vertices of the ring."""
        corners = sorted(int(v) for v in ring)
        if len(corners) ** 2 < len(self.edges):
            return [(a, b) for k, a in enumerate(corners) for b in corners[k + 1 :] if (a, b) in self.edges]
        known = set(corners)
        return [(a, b) for a, b in self.edges if a in known and b in known]

    def smooth(self, loop: IntArray) -> IntArray | None:
        """(k, 3) faces as dense as what is around, along the creases that the hole has cut; None where an edge would be repeated."""
        scale = float(self.scale[loop].mean())
        taken = chords(self.points, loop, self.creases) if self.creases else []
        chains = []
        for i, j in taken:
            v, w = int(loop[i]), int(loop[j])
            between = bridge(self.points[v], self.points[w], self.creases[v], self.creases[w], scale)
            chains.append(self._added(between, scale))
        fills = []
        for part in parts_of(loop.tolist(), taken, chains):
            plain = self.plain(np.array(part))
            if plain is None:
                return None
            fills.append(self._dense(plain))
            self.enter(fills[-1])
        self.fixed += [v for chain in chains for v in chain] + [int(loop[k]) for pair in taken for k in pair]
        self.n_creases += len(chains)
        return np.concatenate(fills)

    def _added(self, points: FloatArray, scale: float) -> list[int]:
        first = len(self.points)
        self.points = np.concatenate([self.points, points])
        self.scale = np.concatenate([self.scale, np.full(len(points), scale)])
        return list(range(first, len(self.points)))

    def _dense(self, plain: IntArray) -> IntArray:
        used, packed = np.unique(plain, return_inverse=True)
        places = {int(v): k for k, v in enumerate(used)}
        taken = np.array([(places[a], places[b]) for a, b in self.edges_among(used)], np.int64).reshape(-1, 2)
        points, faces = refined(self.points[used], packed.reshape(-1, 3), self.scale[used], taken)
        number = np.concatenate([used, np.array(self._added(points[len(used) :], 0.0), np.int64)])
        return number[faces]

    def enter(self, fill: IntArray) -> None:
        """Edges of the fill are edges of the mesh from now on."""
        self.edges |= {(int(min(a, b)), int(max(a, b))) for a, b in half_edges(fill)}


def fill_holes(mesh: TriangleMesh, *, smooth: bool = True, ways: Mapping[int, int] = MappingProxyType({})) -> HolesFilled:
    """Every hole filled that can be.

    smooth : refine and fair; else only the corners of the holes are used.   ways : SMOOTH, PLAIN or LEAST for holes that differ from that, by number.
    """
    loops = boundary_loops(mesh.faces)
    old = np.full(len(mesh.faces), -1, np.int64)
    if not loops:
        return HolesFilled(mesh=mesh, hole=old, n_holes=0)
    filling = _Filling(mesh, loops)
    faces, hole, n_left = [mesh.faces], [old], 0
    for number, loop in enumerate(loops):
        fill = filling.by(loop, ways.get(number, SMOOTH if smooth else PLAIN)) if len(loop) >= 3 else None
        if fill is None:
            n_left += 1
            continue
        filling.enter(fill)
        faces.append(fill)
        hole.append(np.full(len(fill), number))
    all_faces, n = np.concatenate(faces), len(mesh.vertices)
    used = np.zeros(len(filling.points), bool)
    used[:n] = True
    used[all_faces] = True  # vertices of a crease whose hole could not be filled go again
    points, all_faces = filling.points[used], (np.cumsum(used) - 1)[all_faces]
    crease = np.zeros(len(used), bool)
    crease[filling.fixed] = True
    crease = crease[used]
    moving = n + np.flatnonzero(~crease[n:])
    whole = TriangleMesh(vertices=faired(points, all_faces, moving, crease), faces=all_faces)
    return HolesFilled(mesh=whole, hole=np.concatenate(hole), n_holes=len(loops) - n_left, n_left=n_left, n_creases=filling.n_creases)


def least_area(mesh: TriangleMesh) -> float:
    """What closing all holes adds at least, over their corners alone, m2."""
    loops = [loop for loop in boundary_loops(mesh.faces) if len(loop) >= 3]
    if not loops:
        return 0.0
    filling = _Filling(mesh, loops)
    fills = [fill for loop in loops if (fill := filling.plain(loop, ANY)) is not None]
    return sum(area(TriangleMesh(vertices=mesh.vertices, faces=fill)) for fill in fills)


def filled_free(mesh: TriangleMesh) -> HolesFilled:
    """Every hole filled smoothly where that crosses nothing, else plainly, else with the least area."""
    ways: dict[int, int] = {}
    while True:
        found = fill_holes(mesh, ways=ways)
        crossing = found.hole[np.unique(self_intersections(found.mesh))]
        more = {k: ways.get(k, SMOOTH) + 1 for k in np.unique(crossing[crossing >= 0]).tolist() if ways.get(k, SMOOTH) < LEAST}
        if not more:
            return found
        ways |= more


def filled(mesh: TriangleMesh, *, smooth: bool = True) -> tuple[TriangleMesh, int]:
    """The mesh with every hole filled that can be, and how many were."""
    found = fill_holes(mesh, smooth=smooth)
    return found.mesh, found.n_holes


def without_faces(mesh: TriangleMesh, drop: BoolArray) -> TriangleMesh:
    """The mesh without some faces."""
    return replace(mesh, faces=mesh.faces[~drop], face_origin=None, face_region=None)
