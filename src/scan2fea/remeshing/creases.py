"""Planes made exactly flat: borders between two planes become their line, corners the point of three, and each plane is filled anew.

The free form keeps its triangles; only its vertices on the border of a plane move, onto that plane. A plane that cannot be rebuilt (its
border crosses itself, a corner would move too far, faces would cross) becomes free form again, and the rest is rebuilt without it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import extent
from scan2fea.kernel.polygons import crossing_corners, triangulated
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.primitives import Plane, meeting_point
from scan2fea.kernel.topology import half_edges, surface_topology
from scan2fea.remeshing.borders import outgoing, unpinched
from scan2fea.remeshing.planes import Labelled, Neighbours, Scale
from scan2fea.remeshing.regions import one_piece_each, tidied
from scan2fea.remeshing.relax import near_faces, relaxed
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

EXACT = 1e-9  # of the size: farther than this off a plane is not on it
REACHES = 2.0  # of Scale.reach_m: a corner may move this far, the line of two planes may pass this far from their border
TUNNEL = 12.0  # spacings round the largest tunnel or speck that is filled across
FAIRING = 8  # rounds over the border between a plane and free form (Taubin 1995)
TAUBIN = (0.5, -0.53)
ATTEMPTS = 12
RETREAT = 2.0  # spacings round trouble that become free form, one more at each attempt
STRAYED = 0.05  # share of a plane
SAMPLES = 20_000  # of the new surface


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
        self.bad: set[int] = set()  # planes that have to be given up
        self.trouble: list[IntArray] = []  # old vertices round which planes cannot be joined
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
                self.trouble.append(np.array([v]))
                continue
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
        """Is the loop one between two planes without a corner? Their line cannot close: it is a tunnel or a speck, and both are filled across it."""
        beyond = int(self.beyond[loop[0]])
        if beyond < 0 or self.n_borders[self.ends[loop[0], 0]] > 2:
            return False
        length = float(np.linalg.norm(self.mesh.vertices[self.ends[loop, 0]] - self.mesh.vertices[self.ends[loop, 1]], axis=1).sum())
        if length > TUNNEL * self.scale.spacing_m:
            self.trouble.append(self.ends[loop, 0])
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
        trouble = self._off_line([*vertices, last])
        if len(trouble):
            self.trouble.append(trouble)
            self.lines[key] = [*vertices, last]
            return vertices
        p, q = self.points[vertices[0]], self.points[last]
        n = max(1, round(float(np.linalg.norm(q - p)) / self.edge_m))
        inner = [p + (q - p) * k / n for k in range(1, n)]
        first = len(self.points) + len(self.extra)
        self.extra += inner
        self.lines[key] = [vertices[0], *range(first, first + n - 1), last]
        return self.lines[key][:-1]

    def _off_line(self, chain: list[int]) -> IntArray:
        """Vertices of a border between two planes that is not where their line runs: all of it where the line runs the other way."""
        p, q = self.points[chain[0]], self.points[chain[-1]]
        old = self.mesh.vertices[chain]
        way, length = q - p, float(np.linalg.norm(q - p))
        if length < 1e-3 * self.scale.spacing_m or way @ (old[-1] - old[0]) <= 0:
            return np.array(chain if len(chain) < 12 else [chain[0], chain[-1]])
        off = np.linalg.norm(np.cross(old - p, way / length), axis=1)
        if np.percentile(off, 90) <= self.scale.reach_m:
            return np.zeros(0, np.int64)
        return np.asarray(np.array(chain, np.int64)[off > self.scale.reach_m])

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
        if self.trouble:
            return None
        points = np.concatenate([self.points, np.array(self.extra).reshape(-1, 3)])
        faces, regions = [self.mesh.faces[self.label < 0]], [np.full(int((self.label < 0).sum()), -1, np.int64)]
        for k, loops in rings.items():
            if not loops:
                continue
            xy = points @ self.labelled.plane(k).axes().T
            new = triangulated(loops, xy - xy[loops[0][0]])
            if new is None:
                self._tangled(k, loops, points, xy)
                continue
            faces.append(new)
            regions.append(np.full(len(new), k, np.int64))
        if self.bad or self.trouble:
            return None
        return _compact(*_without_repeated_edges(points, np.concatenate(faces), np.concatenate(regions)))


    def _tangled(self, number: int, loops: list[IntArray], points: FloatArray, xy: FloatArray) -> None:
        """Enter where the border of a plane crosses itself, or give the plane up."""
        where = crossing_corners(loops, xy)
        if not len(where):
            self.bad.add(number)
            return
        self.trouble.append(self.nearest_old(points[where]))

    def nearest_old(self, places: FloatArray) -> IntArray:
        """The old vertices nearest to places."""
        return np.unique(cKDTree(self.mesh.vertices).query(places)[1]).astype(np.int64)


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
        new_points: list[FloatArray] = []
        new_faces: list[tuple[int, int, int]] = []
        new_region: list[int] = []
        drop: list[int] = []
        edges: dict[tuple[int, int, int], list[int]] = {}
        for h in crowded.tolist():
            edges.setdefault((int(key[h, 0]), int(key[h, 1]), int(region[h // 3])), []).append(int(h))
        for (u, v, name), halves in sorted(edges.items()):
            if len(halves) != 2 or touched & {h // 3 for h in halves}:
                continue
            middle = len(points) + len(new_points)
            new_points.append((points[u] + points[v]) / 2)
            for half in halves:
                f = half // 3
                touched.add(f)
                drop.append(f)
                a, b, c = (int(faces[f, (half + k) % 3]) for k in range(3))
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


def _crossing_places(mesh: TriangleMesh, pairs: IntArray) -> FloatArray:
    """Where faces cross: the middle of the smaller face of each pair (planes are filled with long ones)."""
    tri = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    small = np.where(area[pairs[:, 0]] <= area[pairs[:, 1]], pairs[:, 0], pairs[:, 1])
    return np.asarray(tri[small].mean(1))


def _without_crossings(mesh: TriangleMesh) -> tuple[TriangleMesh, IntArray]:
    """The mesh, relaxed where free form crosses, and the pairs that cross all the same."""
    pairs = self_intersections(mesh)
    if not len(pairs):
        return mesh, pairs
    trial = relaxed(mesh, near_faces(mesh, np.unique(pairs)))
    left = self_intersections(trial)
    return (trial, left) if len(left) < len(pairs) else (mesh, pairs)


def _strayed(new: TriangleMesh, rebuild: _Rebuild) -> set[int]:
    """Planes that left their data: of their old vertices more than STRAYED lie farther than the reach from the new surface, or of samples of the
    new plane from the old surface.
    """
    reach, old, label = rebuild.scale.reach_m, rebuild.mesh, rebuild.label
    n = len(rebuild.areas)
    gap = PointToMesh(new).nearest(old.vertices).distance[old.faces].max(1) > reach
    share = np.bincount(label[gap & (label >= 0)], minlength=n) / np.maximum(np.bincount(label[label >= 0], minlength=n), 1)
    places, face = sample_surface(new, SAMPLES, 0)
    far = PointToMesh(old).nearest(places).distance > reach
    region = np.full(len(new.faces), -1) if new.face_region is None else new.face_region
    name = region[face]
    count = np.bincount(name[name >= 0], minlength=n)
    back = np.bincount(name[far & (name >= 0)], minlength=n) / np.maximum(count, 1)
    bad = np.flatnonzero((share > STRAYED) | ((back > STRAYED) & (count > 20)))
    return {int(min(bad, key=lambda k: (rebuild.areas[k], k)))} if len(bad) else set()


def flattened(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale, edge_m: float) -> Flattened:
    """The mesh with every plane of `labelled` that can be rebuilt made flat. edge_m : length of the pieces a crease is cut into.

    Where planes cannot be joined the faces round that place become free form, a wider place at each attempt.
    """
    current = one_piece_each(mesh, neighbours, labelled)
    wanted = len(current.offset)
    for attempt in range(ATTEMPTS):
        if not len(current.offset):
            break
        rebuild = _Rebuild(mesh, neighbours, current, scale, edge_m)
        new = rebuild.filled()
        if new is not None:
            new, pairs = _without_crossings(new)
            if len(pairs):
                rebuild.trouble.append(rebuild.nearest_old(_crossing_places(new, pairs)))
            else:
                rebuild.bad |= _strayed(new, rebuild)
            if not rebuild.trouble and not rebuild.bad:
                if surface_topology(new).is_clean:
                    left = len(current.offset)
                    return Flattened(mesh=new, planes=tuple(current.plane(k) for k in range(left)), n_undone=wanted - left)
                rebuild.bad.add(int(rebuild.areas.argmin()))
        current = _retreated(mesh, neighbours, rebuild, (RETREAT + attempt) * scale.spacing_m)
    region = np.full(len(mesh.faces), -1, np.int64)
    return Flattened(mesh=TriangleMesh(vertices=mesh.vertices, faces=mesh.faces, face_region=region), planes=(), n_undone=wanted)


def _retreated(mesh: TriangleMesh, neighbours: Neighbours, rebuild: _Rebuild, radius: float) -> Labelled:
    """The labels with free form round the trouble, and without the planes given up."""
    label = np.where(np.isin(rebuild.label, sorted(rebuild.bad)), -1, rebuild.label)
    if rebuild.trouble:
        places = mesh.vertices[np.unique(np.concatenate(rebuild.trouble))]
        near = np.asarray(np.asarray(cKDTree(places).query(mesh.vertices, distance_upper_bound=radius)[0]) <= radius)
        near[np.unique(np.concatenate(rebuild.trouble))] = True
        label = np.where(near[mesh.faces].any(1), -1, label)
    current = tidied(mesh, neighbours, replace(rebuild.labelled, label=label), rebuild.scale)
    current = unpinched(mesh, neighbours, current, rebuild.scale, may_join=False)
    return one_piece_each(mesh, neighbours, current)
