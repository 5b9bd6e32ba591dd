"""Borders of the patches of a surface as a network: every face on a patch, corners where three or more meet, chains of edges between corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.cad.extruded import EXTRUDED
from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.surfaces import PLANE, SPHERE, Surface
from scan2fea.kernel.topology import EdgeTable, edge_table, face_components
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

LEAST_FACES = 8  # fewer are strays of the patch around them: no patch begins with so few
TIDIED = 6  # times at most
OPEN_TURN = np.pi / 2  # a patch that leaves less of a turn open is cut in two: faces without seams
NEARLY_HALF_BALL = 0.6  # of its area, the sum of the normals of a ball's patch: less (a cap of 78 degrees) leaves no room for both poles
DIRECTIONS = 36  # tried for a cut


@dataclass(frozen=True, eq=False, kw_only=True)
class Chain(Value):
    """left, right : regions on its sides.   vertices : of the mesh, from corner to corner; the first is the last where it closes on itself."""

    left: int
    right: int
    vertices: IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Network(Value):
    """label : (m,) region of each face.   surface : (n,) number of the surface of each region, -1 a facet of a wall of free form.

    cuts : of pairs of regions that are halves of one, a point and the normal of the plane between them.
    """

    label: IntArray
    surface: IntArray
    chains: tuple[Chain, ...]
    cuts: dict[frozenset[int], tuple[FloatArray, FloatArray]]

    def halved_through(self, surfaces: Sequence[Surface]) -> Network:
        """The same with its cuts through the axes, or centres, of these surfaces: the seam of what is joined again is straight."""
        cuts = {}
        for halves, (_, normal) in self.cuts.items():
            surface = surfaces[int(self.surface[min(halves)])]
            square = normal if surface.kind == SPHERE else normal - (normal @ surface.axis) * surface.axis
            cuts[halves] = surface.point, square / np.linalg.norm(square)
        return replace(self, cuts=cuts)

    def tiled(self, mesh: TriangleMesh, tiles: IntArray, n: int) -> Network:
        """The same with `n` tiles, the first of them number len(surface), for the regions cut. tiles : (m,) of each face, n or more elsewhere."""
        label = np.where(tiles < n, len(self.surface) + tiles, self.label)
        chains = _chains(mesh, label, edge_table(mesh.faces), np.zeros(0, np.int64))
        return replace(self, label=label, surface=np.append(self.surface, np.full(n, -1)), chains=chains)


def network_of(
    mesh: TriangleMesh, label: IntArray, surfaces: Sequence[Surface], wall: BoolArray | None = None, free: IntArray | None = None
) -> Network:
    """The network of a closed manifold mesh. label : (m,) surface of each face, -1 where the nearest beside it is to be taken.

    wall : (m,) faces of walls of free form: regions each.   free : (m,) number of the piece of free form that each is of, a region; -1 of none.
    """
    table = edge_table(mesh.faces)
    beside = table.twin.reshape(-1, 3) // 3
    label = label.copy() if wall is None else np.where(wall, len(surfaces), label)
    label = label if free is None else np.where(free >= 0, len(surfaces) + free, label)
    label = _tidy(mesh, _filled(mesh, label, surfaces, beside), surfaces, table)
    facets = np.flatnonzero(label == len(surfaces)) if free is None else np.zeros(0, np.int64)
    label[facets] += np.arange(len(facets))
    part = _parts(mesh, label, table)
    region = np.zeros(int(part.max()) + 1, np.int64)
    region[part] = np.where(label < len(surfaces), label, -1)
    halved, cuts = part.copy(), {}  # type: tuple[IntArray, dict[int, tuple[FloatArray, FloatArray]]]
    for k in np.flatnonzero(region >= 0).tolist():
        rows = np.flatnonzero(part == k)
        cut = _cut(mesh, rows, halved, surfaces[region[k]], table)  # corners of the cuts before too
        if cut is not None:
            centres = mesh.vertices[mesh.faces[rows]].mean(1)
            beyond = (centres - cut[0]) @ cut[1] > 0
            halved[rows[_whole(mesh.faces[rows], beyond)]] = len(region) + k
            cuts[k] = cut
    out = _parts(mesh, halved, table)
    origin = np.zeros(int(out.max()) + 1, np.int64)
    origin[out] = part
    chains = _chains(mesh, out, table, facets)
    halves = {frozenset((c.left, c.right)): cuts[int(origin[c.left])] for c in chains if origin[c.left] == origin[c.right]}
    return Network(label=out, surface=region[origin], chains=chains, cuts=halves)


def _filled(mesh: TriangleMesh, label: IntArray, surfaces: Sequence[Surface], beside: IntArray) -> IntArray:
    """Labels with no face left over: each goes to the surface beside it whose farthest corner is nearest, from the borders inward."""
    label = label.copy()
    while True:
        front = np.flatnonzero((label < 0) & (label[beside] >= 0).any(1))
        if not len(front):
            return label
        best, new = np.full(len(front), np.inf), np.full(len(front), -1)
        for side in range(3):
            k = label[beside[front, side]]
            for j in np.unique(k[k >= 0]).tolist():
                rows = np.flatnonzero(k == j)
                corners = mesh.vertices[mesh.faces[front[rows]]].reshape(-1, 3)
                off = np.abs(surfaces[j].distance(corners)).reshape(-1, 3).max(1) if j < len(surfaces) else np.full(len(rows), 1e300)
                better = off < best[rows]
                best[rows[better]], new[rows[better]] = off[better], j
        label[front] = new


def _tidy(mesh: TriangleMesh, label: IntArray, surfaces: Sequence[Surface], table: EdgeTable) -> IntArray:
    """Labels without faces that have two neighbours of another patch and none of their own, nor pieces of less than LEAST_FACES."""
    beside = table.twin.reshape(-1, 3) // 3
    for _ in range(TIDIED):
        before = label
        near = label[beside]
        twice = np.where((near[:, 0] == near[:, 1]) | (near[:, 0] == near[:, 2]), near[:, 0], near[:, 1])
        lone = (near != label[:, None]).all(1) & ((near == twice[:, None]).sum(1) >= 2)
        label = np.where(lone, twice, label)
        part = _parts(mesh, label, table)
        small = np.bincount(part)[part] < LEAST_FACES
        if small.any() and not small.all():
            label = _filled(mesh, np.where(small, -1, label), surfaces, beside)
        if (label == before).all():
            break
    return label


def _parts(mesh: TriangleMesh, label: IntArray, table: EdgeTable) -> IntArray:
    """(m,) number of the piece of one label that each face is of."""
    same = label[table.twin // 3] == np.repeat(label, 3)
    joined = np.zeros(len(table.edges), bool)
    joined[table.edge_of[same]] = True
    return face_components(mesh.faces, joined)[1]


def _whole(faces: IntArray, beyond: BoolArray) -> BoolArray:
    """Sides of some faces of which each is one piece: crumbs that a border along the cut leaves go to the other side."""
    out = beyond.copy()
    for side in (False, True):
        rows = np.flatnonzero(beyond == side)
        if len(rows):
            part = face_components(faces[rows])[1]
            size = np.bincount(part)
            out[rows[(size < LEAST_FACES)[part] & (part != size.argmax())]] = not side
    return out


def _cut(mesh: TriangleMesh, rows: IntArray, label: IntArray, surface: Surface, table: EdgeTable) -> tuple[FloatArray, FloatArray] | None:
    """A plane through the axis that halves a region which goes (nearly) all the way round, far from its corners; None where it does not."""
    if surface.kind in (PLANE, EXTRUDED):
        return None
    if surface.kind == SPHERE:
        area = face_areas(mesh)[rows]
        middle = area @ face_normals(mesh)[rows]
        length = float(np.linalg.norm(middle))
        if length > NEARLY_HALF_BALL * float(area.sum()):
            return None
        surface = surface if length < 1e-6 * float(area.sum()) else replace(surface, axis=middle / length)
    e = surface.frame()

    def turn(points: FloatArray) -> FloatArray:
        flat = (points - surface.point) @ e.T
        return np.arctan2(flat[:, 1], flat[:, 0])

    own = np.sort(turn(mesh.vertices[mesh.faces[rows]].mean(1)))
    if float(np.diff(np.append(own, own[0] + 2 * np.pi)).max()) > OPEN_TURN:
        return None
    inside = np.zeros(len(label), bool)
    inside[rows] = True
    half = (3 * rows[:, None] + np.arange(3)).ravel()
    half = half[~inside[table.twin[half] // 3]]
    ends = table.edges[table.edge_of[half]]
    several = np.unique(np.stack([ends.ravel(), np.repeat(label[table.twin[half] // 3], 2)], axis=1), axis=0)[:, 0]
    corners = several[:-1][several[1:] == several[:-1]]
    grid = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    apart = np.abs((turn(mesh.vertices[corners])[:, None] - grid + np.pi / 2) % np.pi - np.pi / 2)
    best = grid[int(apart.min(0).argmax())] if len(corners) else 0.0
    return surface.point, np.asarray(-np.sin(best) * e[0] + np.cos(best) * e[1])


def _chains(mesh: TriangleMesh, label: IntArray, table: EdgeTable, facets: IntArray) -> tuple[Chain, ...]:
    """The borders from corner to corner, each once, its left side the lower region. All corners of facets are some."""
    own, other = np.repeat(label, 3), label[table.twin // 3]
    half = np.flatnonzero(own != other)
    tail, head = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    degree = np.bincount(table.edges[np.unique(table.edge_of[half])].ravel(), minlength=len(mesh.vertices))
    is_corner: BoolArray = (degree > 0) & (degree != 2)
    is_corner[mesh.faces[facets]] = True
    follow = {(int(tail[h]), int(own[h])): h for h in half.tolist() if not is_corner[tail[h]]}
    start = [h for h in half.tolist() if is_corner[tail[h]] and own[h] < other[h]]
    loop = [h for h in half.tolist() if not is_corner[tail[h]] and own[h] < other[h]]
    done: set[int] = set()
    out = []
    for h in start + loop:
        if h in done:
            continue
        path = [h]
        while (int(head[path[-1]]), int(own[h])) in follow:
            step = follow[int(head[path[-1]]), int(own[h])]
            if step == h:
                break
            path.append(step)
        done.update(path)
        out.append(Chain(left=int(own[h]), right=int(other[h]), vertices=np.append(tail[path[0]], head[path])))
    return tuple(out)


def smoothed(line: FloatArray, rounds: int = 4) -> FloatArray:
    """A polyline of which each inner point has gone half way to the middle of its neighbours, some times; a closed one all round."""
    line = line.copy()
    closed = bool((line[0] == line[-1]).all())
    for _ in range(rounds):
        if closed:
            ring = line[:-1]
            ring = (np.roll(ring, 1, axis=0) + 2 * ring + np.roll(ring, -1, axis=0)) / 4
            line = np.concatenate([ring, ring[:1]])
        elif len(line) > 2:
            line[1:-1] = (line[:-2] + 2 * line[1:-1] + line[2:]) / 4
    return line
