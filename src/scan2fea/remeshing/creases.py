"""Planes made exactly flat: borders between two planes become their line, corners the point of three, and each plane is filled anew.

The free form keeps its triangles; only its vertices on the border of a plane move, onto that plane. A plane that cannot be rebuilt (its
border crosses itself, a corner would move too far, faces would cross) becomes free form again, and the rest is rebuilt without it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel.measures import extent
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.primitives import Plane, meeting_point
from scan2fea.kernel.topology import half_edges, neighbour_vertices, surface_topology
from scan2fea.remeshing.borders import outgoing, unpinched
from scan2fea.remeshing.planes import Labelled, Neighbours, Scale, one_piece_each
from scan2fea.remeshing.polygons import triangulated
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

EXACT = 1e-9  # of the size: farther than this off a plane is not on it
REACHES = 2.0  # of Scale.reach_m: a corner may move this far, the line of two planes may pass this far from their border
TUNNEL = 12.0  # spacings round the largest tunnel or speck that is filled across
FAIRING = 8  # rounds over the border between a plane and free form (Taubin 1995)
TAUBIN = (0.5, -0.53)
RINGS = 2  # of faces round a crossing that are relaxed


@dataclass(frozen=True, eq=False, kw_only=True)
class Flattened(Value):
    """mesh : with face_region.   planes : of each region.   n_undone : planes that had to be given up."""

    mesh: TriangleMesh
    planes: tuple[Plane, ...]
    n_undone: int


class _Rebuild:
    """One attempt to rebuild all planes; `bad` collects those that cannot be."""

    def __init__(self, mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale, edge_m: float) -> None:
        self.mesh, self.neighbours, self.labelled, self.scale, self.edge_m = mesh, neighbours, labelled, scale, edge_m
        self.label = labelled.label
        self.areas = np.bincount(self.label[self.label >= 0], weights=neighbours.areas[self.label >= 0], minlength=len(labelled.offset))
        self.twin = neighbours.table.twin
        self.ends = half_edges(mesh.faces)
        self.beyond = self.label[self.twin // 3]
        self.is_border = np.repeat(self.label, 3) != self.beyond
        self.n_borders = np.bincount(self.ends[self.is_border, 0], minlength=len(mesh.vertices))
        self.points = mesh.vertices.copy()
        self.extra: list[FloatArray] = []
        self.bad: set[int] = set()
        self.lines: dict[int, list[int]] = {}
        self.size = extent(mesh.vertices)

    def smallest(self, names: set[int]) -> int:
        """The plane to give up among `names`."""
        return min((name for name in names if name >= 0), key=lambda name: (self.areas[name], name))

    def corners(self) -> None:
        """Vertices where three borders or more meet moved onto all planes there."""
        out = outgoing(self.mesh)
        for v in np.flatnonzero(self.n_borders > 2):
            names, h = set(), int(out[v])
            while True:
                names.add(int(self.label[h // 3]))
                h = int(self.twin[h // 3 * 3 + (h + 2) % 3])
                if h == out[v]:
                    break
            planes = [self.labelled.plane(name) for name in sorted(names) if name >= 0]
            place = meeting_point(planes, self.mesh.vertices[v])
            off = max(abs(float(plane.distance(place))) for plane in planes)
            if off > EXACT * self.size or np.linalg.norm(place - self.mesh.vertices[v]) > REACHES * self.scale.reach_m:
                self.bad.add(self.smallest(names))
            self.points[v] = place

    def loops(self, number: int) -> list[list[int]]:
        """The borders of a plane as loops of half-edges, its faces on the left, each starting at a corner where it has one."""
        own = np.flatnonzero(self.is_border & (np.repeat(self.label, 3) == number))
        at = {int(self.ends[h, 0]): int(h) for h in own}
        loops = []
        while at:
            start = min(at)
            loop, v = [], start
            while v in at:
                h = at.pop(v)
                loop.append(h)
                v = int(self.ends[h, 1])
            corner = next((k for k, h in enumerate(loop) if self.n_borders[self.ends[h, 0]] > 2), 0)
            loops.append(loop[corner:] + loop[:corner])
        return loops

    def chains(self, loop: list[int]) -> list[list[int]]:
        """A loop cut at its corners."""
        cuts = [k for k, h in enumerate(loop) if self.n_borders[self.ends[h, 0]] > 2] or [0]
        return [loop[a:b] for a, b in zip(cuts, [*cuts[1:], len(loop)], strict=True)]

    def is_tunnel(self, number: int, loop: list[int]) -> bool:
        """Is the loop one between two planes without a corner? Their line cannot close, so it is a tunnel or a speck: both planes are filled across it."""
        beyond = int(self.beyond[loop[0]])
        if beyond < 0 or self.n_borders[self.ends[loop[0], 0]] > 2:
            return False
        length = float(np.linalg.norm(self.mesh.vertices[self.ends[loop, 0]] - self.mesh.vertices[self.ends[loop, 1]], axis=1).sum())
        if length > TUNNEL * self.scale.spacing_m:
            self.bad.add(self.smallest({number, beyond}))
        return True

    def ring(self, number: int, loop: list[int]) -> IntArray:
        """The new vertices along a loop."""
        return np.array([v for chain in self.chains(loop) for v in self.polyline(number, chain)], np.int64)

    def polyline(self, number: int, chain: list[int]) -> list[int]:
        """The new vertices along a chain, its end left out."""
        beyond = int(self.beyond[chain[0]])
        vertices = [int(self.ends[h, 0]) for h in chain]
        if beyond < 0:
            return vertices
        key = int(self.neighbours.table.edge_of[chain].min())
        if key in self.lines:
            line = self.lines[key]
            return line[::-1][:-1]
        last = int(self.ends[chain[-1], 1])
        if not self._is_straight(number, beyond, vertices, last):
            self.bad.add(self.smallest({number, beyond}))
            self.lines[key] = [*vertices, last]
            return vertices
        p, q = self.points[vertices[0]], self.points[last]
        n = max(1, round(float(np.linalg.norm(q - p)) / self.edge_m))
        inner = [p + (q - p) * k / n for k in range(1, n)]
        first = len(self.points) + len(self.extra)
        self.extra += inner
        self.lines[key] = [vertices[0], *range(first, first + n - 1), last]
        return self.lines[key][:-1]

    def _is_straight(self, number: int, beyond: int, vertices: list[int], last: int) -> bool:
        """Does the line of the two planes run along the old border, the same way?"""
        p, q = self.points[vertices[0]], self.points[last]
        old = self.mesh.vertices[[*vertices, last]]
        way, length = q - p, float(np.linalg.norm(q - p))
        if length < 1e-3 * self.scale.spacing_m or way @ (old[-1] - old[0]) <= 0:
            return False
        off = np.linalg.norm(np.cross(old - p, way / length), axis=1)
        return bool(off.max() <= REACHES * self.scale.reach_m)

    def fair_free_borders(self) -> None:
        """Border vertices between a plane and free form put onto the plane and smoothed in it, corners held."""
        half = np.flatnonzero(self.is_border & (np.repeat(self.label, 3) >= 0) & (self.beyond < 0))
        a, b = self.ends[half].T
        inner = self.n_borders == 2
        move = np.zeros(len(self.points), bool)
        move[a[inner[a]]] = True
        plane_of = np.zeros(len(self.points), np.int64)
        plane_of[a] = self.label[half // 3]
        rows = np.flatnonzero(move)
        normal, offset = self.labelled.normal[plane_of[rows]], self.labelled.offset[plane_of[rows]]
        self.points[rows] -= (np.einsum("ij,ij->i", self.points[rows], normal) - offset)[:, None] * normal
        start = self.points.copy()
        after = np.zeros(len(self.points), np.int64)
        before = np.zeros(len(self.points), np.int64)
        after[a], before[b] = b, a
        for _ in range(FAIRING):
            for share in TAUBIN:
                middle = (self.points[after[rows]] + self.points[before[rows]]) / 2
                step = share * (middle - self.points[rows])
                step -= np.einsum("ij,ij->i", step, normal)[:, None] * normal
                self.points[rows] = self.points[rows] + step
        moved = self.points[rows] - start[rows]
        limit = 0.5 * self.scale.spacing_m + 3 * self.scale.residual_m
        length = np.linalg.norm(moved, axis=1)
        self.points[rows] = start[rows] + moved * np.minimum(1.0, limit / np.maximum(length, 1e-300))[:, None]

    def filled(self) -> TriangleMesh | None:
        """The rebuilt mesh, or None with `bad` set."""
        self.corners()
        self.fair_free_borders()
        rings = {k: [self.ring(k, loop) for loop in self.loops(k) if not self.is_tunnel(k, loop)] for k in range(len(self.areas))}
        if self.bad:
            return None
        points = np.concatenate([self.points, np.array(self.extra).reshape(-1, 3)])
        faces, regions = [self.mesh.faces[self.label < 0]], [np.full(int((self.label < 0).sum()), -1, np.int64)]
        for k, loops in rings.items():
            if not loops:
                continue
            xy = points @ self.labelled.plane(k).axes().T
            new = triangulated(loops, xy - xy[loops[0][0]])
            if new is None:
                self.bad.add(k)
                continue
            faces.append(new)
            regions.append(np.full(len(new), k, np.int64))
        if self.bad:
            return None
        return _compact(*_without_repeated_edges(points, np.concatenate(faces), np.concatenate(regions)))


def _compact(points: FloatArray, faces: IntArray, region: IntArray) -> TriangleMesh:
    used, packed = np.unique(faces, return_inverse=True)
    return TriangleMesh(vertices=points[used], faces=packed.reshape(-1, 3).astype(np.int64), face_region=region)


def _without_repeated_edges(points: FloatArray, faces: IntArray, region: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """A diagonal of a plane that joins two vertices which an edge elsewhere joins too is cut in two: an edge has two faces only."""
    for _ in range(10):
        key = np.sort(half_edges(faces), axis=1)
        _, inverse, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
        crowded = np.flatnonzero(count[inverse.ravel()] > 2)
        crowded = crowded[region[crowded // 3] >= 0]
        if not len(crowded):
            break
        touched: set[int] = set()
        new_points, new_faces, new_region, drop = [], [], [], []
        edges: dict[tuple[int, int, int], list[int]] = {}
        for h in crowded:
            edges.setdefault((int(key[h, 0]), int(key[h, 1]), int(region[h // 3])), []).append(int(h))
        for (u, v, name), halves in sorted(edges.items()):
            if len(halves) != 2 or touched & {h // 3 for h in halves}:
                continue
            middle = len(points) + len(new_points)
            new_points.append((points[u] + points[v]) / 2)
            for h in halves:
                f = h // 3
                touched.add(f)
                drop.append(f)
                a, b, c = (int(faces[f, (h + k) % 3]) for k in range(3))
                new_faces += [(a, middle, c), (middle, b, c)]
                new_region += [name, name]
        if not drop:
            break
        keep = np.ones(len(faces), bool)
        keep[drop] = False
        points = np.concatenate([points, np.array(new_points)])
        faces = np.concatenate([faces[keep], np.array(new_faces, np.int64)])
        region = np.concatenate([region[keep], np.array(new_region, np.int64)])
    return points, faces, region


def _crossing_plane(mesh: TriangleMesh, pairs: IntArray, rebuild: _Rebuild) -> int:
    """The plane to give up because faces cross: the smallest of those in the pairs; where only free form crosses, the smallest near it."""
    region = np.full(len(mesh.faces), -1) if mesh.face_region is None else mesh.face_region
    rows = np.unique(pairs)
    for _ in range(20):
        names = set(region[rows].tolist())
        if max(names) >= 0:
            return rebuild.smallest(names)
        rows = np.flatnonzero(np.isin(mesh.faces, mesh.faces[rows]).any(1))
    return int(rebuild.areas.argmin())


def _relaxed(mesh: TriangleMesh, pairs: IntArray) -> TriangleMesh:
    """Free-form vertices at and near crossing faces drawn to the middle of their neighbours: the border beside them has moved, they follow."""
    if mesh.face_region is None:
        return mesh
    rows = np.unique(pairs)
    for _ in range(RINGS):
        rows = np.flatnonzero(np.isin(mesh.faces, mesh.faces[rows]).any(1))
    held = np.ones(len(mesh.vertices), bool)
    held[mesh.faces[rows]] = False
    held[mesh.faces[mesh.face_region >= 0]] = True
    move = np.flatnonzero(~held)
    start, other = neighbour_vertices(mesh.faces, len(mesh.vertices))
    points = mesh.vertices.copy()
    for _ in range(10):
        for v in move:
            points[v] = 0.5 * points[v] + 0.5 * points[other[start[v] : start[v + 1]]].mean(0)
    return replace(mesh, vertices=points)


def _without_crossings(mesh: TriangleMesh) -> tuple[TriangleMesh, IntArray]:
    """The mesh, relaxed where free form crosses, and the pairs that cross all the same."""
    pairs = self_intersections(mesh)
    for _ in range(3):
        if not len(pairs):
            break
        trial = _relaxed(mesh, pairs)
        left = self_intersections(trial)
        if len(left) >= len(pairs):
            break
        mesh, pairs = trial, left
    return mesh, pairs


def flattened(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale, edge_m: float) -> Flattened:
    """The mesh with every plane of `labelled` that can be rebuilt made flat. edge_m : length of the pieces a crease is cut into."""
    current = one_piece_each(mesh, neighbours, labelled)
    undone = 0
    while len(current.offset):
        rebuild = _Rebuild(mesh, neighbours, current, scale, edge_m)
        new = rebuild.filled()
        bad = rebuild.bad
        if new is not None:
            new, pairs = _without_crossings(new)
            if not len(pairs) and surface_topology(new).is_clean:
                return Flattened(mesh=new, planes=tuple(current.plane(k) for k in range(len(current.offset))), n_undone=undone)
            bad = {_crossing_plane(new, pairs, rebuild)} if len(pairs) else {int(rebuild.areas.argmin())}
        undone += len(bad)
        label = np.where(np.isin(current.label, sorted(bad)), -1, current.label)
        current = unpinched(mesh, neighbours, replace(current, label=label), scale)
        current = one_piece_each(mesh, neighbours, current)
    region = np.full(len(mesh.faces), -1, np.int64)
    return Flattened(mesh=TriangleMesh(vertices=mesh.vertices, faces=mesh.faces, face_region=region), planes=(), n_undone=undone)
