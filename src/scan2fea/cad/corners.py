"""Corners and edges of a solid on its surfaces: the points of each chain of a network moved to where the surfaces beside it meet, or touch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from scan2fea.cad.extruded import Extruded
from scan2fea.cad.network import Network, smoothed
from scan2fea.cad.tangency import sharpest
from scan2fea.kernel.polylines import evenly, length_of
from scan2fea.kernel.surfaces import Surface
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

ROUNDS, ROUNDS_ON_EDGE = 40, 15
LEAST_SLOPE = 0.08  # of the steepest: flatter directions (two surfaces that touch) are left as they are
LONGEST_STEP = 2.0  # mm
SHORT = 3.0  # spacings: corners that a chain no longer than this joins may be one
MOVES = 1.5  # spacings, and no farther from the middle of that chain
EVENED = 4  # rounds
COLLAPSED = 0.2  # times as wide as its border: what edges enclose less of is nothing
LEAST_POINTS, MOST_POINTS = 6, 200  # along an edge

_Tie = tuple[Surface, Surface, FloatArray]  # two surfaces that touch, and the way across the line of touch
_Plane = tuple[FloatArray, FloatArray]  # a point and the normal of a plane


@dataclass(frozen=True, eq=False, kw_only=True)
class Corner(Value):
    """at : (3,).   off : how far it lies from the farthest of its surfaces."""

    at: FloatArray
    off: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Edge(Value):
    """chain : its number.   first, last : numbers of its corners.   points : (n, 3) from the one to the other."""

    chain: int
    first: int
    last: int
    points: FloatArray
    off: float


def met(start: FloatArray, surfaces: Sequence[Surface], ties: Iterable[_Tie], planes: Iterable[_Plane], rounds: int = ROUNDS) -> Corner:
    """The point next to `start` on all surfaces and planes, and at the lines of touch of the ties; of least squares where there is none."""
    at = np.array(start, float)
    ties, planes = list(ties), list(planes)
    for _ in range(rounds):
        here = at[None]
        slope = [s.normals(here)[0] for s in surfaces]
        off = [float(s.distance(here)[0]) for s in surfaces]
        for a, b, across in ties:
            scale = sharpest(a, b)
            places = at + 1e-4 * scale * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
            apart = scale * ((a.normals(places) - b.normals(places)) @ across)
            slope.append((apart[1:4] - apart[4:]) / (2e-4 * scale))
            off.append(float(apart[0]))
        for point, normal in planes:
            slope.append(normal)
            off.append(float((at - point) @ normal))
        if not slope:
            break
        step = np.linalg.pinv(np.array(slope), rcond=LEAST_SLOPE) @ np.array(off)
        length = float(np.linalg.norm(step))
        at = at - step * min(1.0, LONGEST_STEP / max(length, 1e-300))
        if length < 1e-10:
            break
    return Corner(at=at, off=max((abs(float(s.distance(at[None])[0])) for s in surfaces), default=0.0))


class Meeting:
    """The corners and edges of a network on its surfaces, millimetres.

    evened : borders between walls' facets and one face are smoothed first.
    corner_of : of each vertex of the mesh that is one, its number.   corners : by number.   gone : chains so short that they are corners.
    """

    def __init__(
        self, mesh: TriangleMesh, network: Network, surfaces: Sequence[Surface], touching: Iterable[int], tolerance: float, spacing: float,
        *, evened: bool = False,
    ):  # fmt: skip
        self.mesh, self.network, self.surfaces = mesh, network, surfaces
        self.touching = frozenset(touching)
        self.spacing = spacing
        self.corner_of: dict[int, int] = {}
        self.gone: set[int] = set()
        ends = [(int(c.vertices[0]), int(c.vertices[-1])) for c in network.chains]
        for vertex in sorted({v for pair in ends for v in pair}):
            self.corner_of[vertex] = vertex
        self._chains: dict[int, list[int]] = {v: [] for v in self.corner_of}
        self._regions: dict[int, set[int]] = {v: set() for v in self.corner_of}
        for number, (first, last) in enumerate(ends):
            for vertex in (first, last):
                self._chains[vertex].append(number)
                self._regions[vertex] |= {network.chains[number].left, network.chains[number].right}
        starts = self._evened() if evened else mesh.vertices
        self.corners: dict[int, Corner] = {v: self._solved(self._regions[v], self._chains[v], starts[v]) for v in self.corner_of}
        self._joined(tolerance)

    def _evened(self) -> dict[int, FloatArray]:
        """Where each corner is looked for: at its vertex; of the border between a wall's facets and one face, whose steps are shorter than its noise
        is wide, at the mean of its neighbours there, so that it does not cross itself on the face.
        """
        beside: dict[int, set[int]] = {}
        for found in self.network.chains:
            sides = self.network.surface[[found.left, found.right]]
            if sides.min() < 0 <= sides.max():
                a, b = int(found.vertices[0]), int(found.vertices[-1])
                beside.setdefault(a, set()).add(b)
                beside.setdefault(b, set()).add(a)
        at = {v: np.array(self.mesh.vertices[v]) for v in self.corner_of}
        free = [v for v, near in beside.items() if len(near) == 2 and sum(self.network.surface[k] >= 0 for k in self._regions[v]) == 1]
        for _ in range(EVENED):
            at |= {v: (2 * at[v] + sum(at[w] for w in beside[v])) / 4 for v in free}
        return at

    def _tie(self, number: int, at: FloatArray, along: FloatArray) -> _Tie | None:
        found = self.network.chains[number]
        a, b = (self.surfaces[self.network.surface[side]] for side in (found.left, found.right))
        across = np.cross(a.normals(at[None])[0] + b.normals(at[None])[0], along)
        length = float(np.linalg.norm(across))
        return (a, b, across / length) if length > 1e-9 else None

    def _solved(self, regions: Iterable[int], chains: Iterable[int], start: FloatArray) -> Corner:
        numbers = sorted({int(self.network.surface[k]) for k in regions if self.network.surface[k] >= 0})
        ties, planes = [], []
        for number in chains:
            border = self.network.chains[number]
            cut = self.network.cuts.get(frozenset((border.left, border.right)))
            if cut is not None:
                planes.append(cut)
            if number in self.touching:
                line = smoothed(self.mesh.vertices[border.vertices])
                step = min(3, len(line) - 1)
                is_first = np.linalg.norm(line[0] - start) <= np.linalg.norm(line[-1] - start)
                tie = self._tie(number, start, line[step] - line[0] if is_first else line[-1] - line[-1 - step])
                ties += [tie] if tie is not None else []
        return met(start, [self.surfaces[k] for k in numbers], ties, planes)

    def _joined(self, tolerance: float) -> None:
        """Corners at the ends of short chains made one, where all their surfaces pass one point as closely as they did each."""
        at = self.mesh.vertices
        length = [length_of(at[c.vertices]) for c in self.network.chains]
        for number in np.argsort(length, kind="stable").tolist():
            if length[number] > SHORT * self.spacing:
                break
            ends = self.network.chains[number].vertices[[0, -1]]
            i, j = (self.corner_of[int(v)] for v in ends)
            if i == j or self._is_facet(number):
                continue
            middle = at[ends].mean(0)
            chains = [k for k in self._chains[i] + self._chains[j] if k != number]
            regions = self._regions[i] | self._regions[j]
            found = self._solved(regions, chains, middle)
            limit = max(tolerance / 2, self.corners[i].off, self.corners[j].off)
            if found.off <= limit and np.linalg.norm(found.at - middle) <= MOVES * self.spacing:
                self.gone.add(number)
                self.corners[i], self._chains[i], self._regions[i] = found, chains, regions
                del self.corners[j]
                for vertex, corner in self.corner_of.items():
                    if corner == j:
                        self.corner_of[vertex] = i

    def _is_facet(self, number: int) -> bool:
        found = self.network.chains[number]
        return bool(min(self.network.surface[found.left], self.network.surface[found.right]) < 0)

    def missed(self, tolerance: float, edges: Mapping[int, Edge]) -> set[int]:
        """The surfaces at corners and edges that lie farther than half the tolerance off one of theirs: not the surfaces that are there."""
        off = [regions for v, regions in self._regions.items() if v in self.corners and self.corners[v].off > tolerance / 2]
        chains = [self.network.chains[k] for k, edge in edges.items() if edge.off > tolerance / 2]
        return {int(self.network.surface[k]) for k in chain(chain.from_iterable(off), *((c.left, c.right) for c in chains))}

    def unmet(self, tolerance: float, edges: Mapping[int, Edge]) -> list[tuple[set[int], IntArray]]:
        """The surfaces and the vertices of each corner that lies farther than half the tolerance off one of its surfaces, and of each edge that does
        between good corners.
        """
        own = self.network.surface
        bad = {v for v, corner in self.corners.items() if corner.off > tolerance / 2}
        out = [({int(own[k]) for k in self._regions[v]}, np.array([w for w, k in self.corner_of.items() if k == v])) for v in bad]
        for k, edge in edges.items():
            if edge.off > tolerance / 2 and not {edge.first, edge.last} & bad:
                border = self.network.chains[k]
                out.append(({int(own[border.left]), int(own[border.right])}, border.vertices))
        return [(names - {-1}, vertices) for names, vertices in out]

    def bridges(self, tolerance: float, edges: Mapping[int, Edge]) -> list[tuple[IntArray, int]]:
        """Short borders of two surfaces that do not meet there, both ends on one third: noise let them touch across it. Their vertices, the third."""
        out, own = [], self.network.surface
        for number, border in enumerate(self.network.chains):
            ends = [self.corner_of[int(border.vertices[k])] for k in (0, -1)]
            off = max([self.corners[k].off for k in ends] + ([edges[number].off] if number in edges else []))
            if off <= tolerance / 2 or length_of(self.mesh.vertices[border.vertices]) > SHORT * self.spacing:
                continue
            first, last = ({int(own[k]) for k in self._regions[corner]} for corner in ends)
            third = (first & last) - {int(own[border.left]), int(own[border.right])}
            if len(third) == 1 and min(third) >= 0 and not self._is_facet(number):
                out.append((border.vertices, min(third)))
        for corner, found in self.corners.items():  # where they touch in one point all borders there are the third's
            if found.off > tolerance / 2:
                sides = [{int(own[self.network.chains[k].left]), int(own[self.network.chains[k].right])} for k in self._chains[corner]]
                common = set.intersection(*sides)
                if len(common) == 1 and len(set.union(*sides)) == 3 and min(common) >= 0:
                    out.append((np.array([v for v, k in self.corner_of.items() if k == corner]), min(common)))
        return out

    def islands(self, edges: Mapping[int, Edge]) -> dict[int, int]:
        """Disks whose surfaces enclose nothing where they meet those beside: what noise left there. By the region, the surface that it has the
        longest border with.
        """
        own, out, at = self.network.surface, {}, self.mesh.vertices
        size = np.bincount(self.network.label, minlength=len(own))
        borders: dict[int, list[int]] = {}
        for number, found in enumerate(self.network.chains):
            for region in (found.left, found.right):
                borders.setdefault(region, []).append(number)
        for region, numbers in borders.items():
            chains = [self.network.chains[k] for k in numbers]
            beside = [c.right if c.left == region else c.left for c in chains]
            around = own[beside]
            if min(around) < 0 or own[region] < 0 or own[region] in around or size[region] >= size[np.unique(beside)].sum():
                continue
            used = np.unique(self.mesh.faces[self.network.label == region])
            is_disk = 2 * len(used) - size[region] - sum(len(c.vertices) - 1 for c in chains) == 2  # Euler
            way = [1 if c.left == region else -1 for c in chains]
            made = [(sign, edges[k].points) for sign, k in zip(way, numbers, strict=True) if k in edges]
            asked = [(sign, at[c.vertices]) for sign, c in zip(way, chains, strict=True)]
            if is_disk and _enclosed(made) < COLLAPSED**2 * _enclosed(asked):
                out[region] = int(np.bincount(around, weights=[length_of(line) for _, line in asked]).argmax())
        return out

    def edges(self) -> Mapping[int, Edge]:
        """By the number of their chain."""
        return {k: self._edge(k) for k in range(len(self.network.chains)) if k not in self.gone}

    def _edge(self, number: int) -> Edge:
        border = self.network.chains[number]
        first, last = (self.corner_of[int(border.vertices[k])] for k in (0, -1))
        ends = self.corners[first].at, self.corners[last].at
        if self._is_facet(number) and len(border.vertices) == 2:
            beside = [self.surfaces[k] for side in (border.left, border.right) if (k := int(self.network.surface[side])) >= 0]
            middle = (ends[0] + ends[1])[None] / 2
            off = max((float(np.abs(s.distance(middle))[0]) for s in beside), default=0.0)
            return Edge(chain=number, first=first, last=last, points=np.array(ends), off=off)
        line = smoothed(self.mesh.vertices[border.vertices])
        length = length_of(line)
        n = int(np.clip(np.ceil(length / self.spacing), LEAST_POINTS, MOST_POINTS))
        t = np.linspace(0.0, 1.0, n + 1)[:, None]
        line = evenly(line, n + 1)
        line = line + (1 - t) ** 4 * (ends[0] - line[0]) + t**4 * (ends[1] - line[-1])
        numbers = sorted({int(self.network.surface[k]) for k in (border.left, border.right) if self.network.surface[k] >= 0})
        surfaces = [self.surfaces[k] for k in numbers]
        line = next((s.along(line) for s in surfaces if isinstance(s, Extruded)), line)
        n = len(line) - 1
        cut = self.network.cuts.get(frozenset((border.left, border.right)))
        out = [Corner(at=ends[0], off=0.0)]
        for k in range(1, n):
            along = line[k + 1] - line[k - 1]
            along = along / max(float(np.linalg.norm(along)), 1e-300)
            tie = self._tie(number, line[k], along) if number in self.touching else None
            planes = [(line[k], along)] + ([cut] if cut is not None else [])
            out.append(met(line[k], surfaces, [tie] if tie is not None else [], planes, ROUNDS_ON_EDGE))
        out = _forward([*out, Corner(at=ends[1], off=0.0)])
        return Edge(chain=number, first=first, last=last, points=np.array([p.at for p in out]), off=max(p.off for p in out))


def _enclosed(loop: Sequence[tuple[int, FloatArray]]) -> float:
    """The area that lines, (n, 3) each, enclose, with 1 or -1 for the way that each is run: nothing where they run to and fro."""
    return float(np.linalg.norm(sum(sign * np.cross(line[:-1], line[1:]).sum(0) for sign, line in loop))) / 2


def _forward(places: Sequence[Corner]) -> list[Corner]:
    """Places along an edge without those from which it would turn back: where noise lets a border wind, its middle overtakes itself or a corner."""
    out = [places[0]]
    for place in places[1:]:
        while len(out) > 1 and (out[-1].at - out[-2].at) @ (place.at - out[-1].at) < 0:
            out.pop()
        out.append(place)
    return out
