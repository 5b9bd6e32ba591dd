"""Space cut by planes into convex cells, face to face: what a solid with flat faces is put together from.

A plane need not cut every cell: only those it is asked to. The facets between a cut cell and one that stays whole are cut all the same, so every
facet lies between exactly two cells and the boundary of any set of cells is closed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.kernel.primitives import Plane
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

ON_PLANE = 1e-9  # of the box: nearer than this a vertex lies on the plane
SAME_PLACE = 1e-8  # of the box: vertices nearer than this are one


@dataclass(frozen=True, eq=False, kw_only=True)
class Cells(Value):
    """vertices : (n, 3).   loops : corners of each facet, counter-clockwise seen from the side its plane's normal points to.

    plane : (f,) row of its plane; the six planes of the box are numbered after the given ones.   cell : (f, 2) the cells on the side of the normal
    and on the other, -1 beyond the box.   n_cells : how many there are.
    """

    vertices: FloatArray
    loops: tuple[IntArray, ...]
    plane: IntArray
    cell: IntArray
    n_cells: int


class _Sides(dict[int, int]):
    """On which side of a plane that cuts vertices lie: 1 before it, -1 behind it, 0 on it, as do those that the cut makes."""

    def __init__(self, space: Arrangement, plane: int, vertices: set[int]) -> None:
        super().__init__()
        self.space, self.plane, self.before = space, plane, len(space.vertices)
        rows = sorted(vertices)
        if rows:
            height = np.array([space.vertices[v] for v in rows]) @ space.normals[plane] - space.offsets[plane]
            self.update(zip(rows, np.where(np.abs(height) <= ON_PLANE * space.size, 0, np.sign(height)).astype(int).tolist(), strict=True))

    def __missing__(self, v: int) -> int:
        height = self.height(v)
        self[v] = 0 if v >= self.before or abs(height) <= ON_PLANE * self.space.size else 1 if height > 0 else -1
        return self[v]

    def height(self, v: int) -> float:
        return float(self.space.vertices[v] @ self.space.normals[self.plane] - self.space.offsets[self.plane])


class Arrangement:
    """Cells of a box, cut by one plane after the other. normals : (p, 3) unit, offsets : (p,) of all planes that may come."""

    def __init__(self, normals: FloatArray, offsets: FloatArray, low: FloatArray, high: FloatArray) -> None:
        axes = np.vstack([np.eye(3), -np.eye(3)])
        self.normals, self.offsets = np.vstack([normals, axes]), np.append(offsets, np.append(high, -low))
        self.size = float(np.linalg.norm(high - low))
        self.low = low
        self.vertices: list[FloatArray] = []
        self.places: dict[tuple[int, ...], int] = {}
        self.loops: list[list[int]] = []
        self.plane: list[int] = []
        self.cell: list[list[int]] = []
        self.facets: list[set[int]] = [set()]
        self.tree: list[tuple[int, int, int]] = [(-1, 0, 0)]  # plane, node in front, node behind; a leaf is (-1, cell, 0)
        self.leaf = [0]  # node of each cell
        self._nodes = np.zeros((0, 3), np.int64)
        self._box(len(normals), low, high)

    def _box(self, first: int, low: FloatArray, high: FloatArray) -> None:
        corner = [self._vertex(np.where([k & 4, k & 2, k & 1], high, low)) for k in range(8)]
        sides = ([4, 6, 7, 5], [2, 3, 7, 6], [1, 5, 7, 3], [0, 1, 3, 2], [0, 4, 5, 1], [0, 2, 6, 4])
        for k, side in enumerate(sides):
            self._facet(first + k, [corner[v] for v in side], [-1, 0])

    def _vertex(self, place: FloatArray) -> int:
        """The number of the vertex at a place; a new one where there is none."""
        at = ((place - self.low) / (SAME_PLACE * self.size)).tolist()
        i, j, k = (math.floor(x) for x in at)
        u, v, w = (1 if x - math.floor(x) > 0.5 else -1 for x in at)
        for key in ((a, b, c) for a in (i, i + u) for b in (j, j + v) for c in (k, k + w)):
            if key in self.places:
                return self.places[key]
        self.places[i, j, k] = len(self.vertices)
        self.vertices.append(np.asarray(place, float))
        return len(self.vertices) - 1

    def _facet(self, plane: int, loop: list[int], cell: list[int]) -> None:
        number = len(self.loops)
        self.loops.append(loop)
        self.plane.append(plane)
        self.cell.append(cell)
        for c in cell:
            if c >= 0:
                self.facets[c].add(number)

    @property
    def n_cells(self) -> int:
        return len(self.facets)

    def located(self, points: FloatArray) -> IntArray:
        """(n,) the cell each point lies in; points on a plane count as behind it."""
        if len(self._nodes) != len(self.tree):  # every cut of a cell makes two nodes more
            self._nodes = np.array(self.tree, np.int64)
        return _located(np.ascontiguousarray(points, float), self._nodes, self.normals, self.offsets)

    def holding(self, points: FloatArray) -> list[int]:
        """The cells that any of the points lies in."""
        return [int(c) for c in np.unique(self.located(points))]

    def cut(self, plane: int, cells: Sequence[int]) -> tuple[list[int], list[int]]:
        """Cut the given cells by a plane, where it passes through them. Returns what of them lies in front of it, and what behind."""
        corners = [{v for f in self.facets[c] for v in self.loops[f]} for c in cells]
        over = _Sides(self, plane, set().union(*corners))
        front, behind = list[int](), list[int]()
        for c, own in zip(cells, corners, strict=True):
            sides = {over[v] for v in own}  # what cuts of the cells beside it add lies on the plane
            if 1 in sides and -1 in sides:
                front.append(c)
                behind.append(self.n_cells)
                self._split(c, plane, over)
            else:
                (front if 1 in sides else behind).append(c)
        return front, behind

    def _split(self, c: int, plane: int, over: _Sides) -> None:
        new = len(self.facets)
        self.facets.append(set())
        self.tree += [(-1, c, 0), (-1, new, 0)]
        self.tree[self.leaf[c]] = (plane, len(self.tree) - 2, len(self.tree) - 1)
        self.leaf[c] = len(self.tree) - 2
        self.leaf.append(len(self.tree) - 1)
        on: set[int] = set()
        for f in sorted(self.facets[c]):
            front, behind = self._halves(f, over, on)
            if not front:
                self._hand_over(f, c, new)
            elif behind:
                self.loops[f] = front
                cell = [new if x == c else x for x in self.cell[f]]
                self._facet(self.plane[f], behind, cell)
        on |= {v for f in self.facets[c] | self.facets[new] for v in self.loops[f] if not over[v]}
        places = np.array([self.vertices[v] for v in sorted(on)])
        first, second = Plane(normal=self.normals[plane], offset=float(self.offsets[plane])).axes()
        middle = places - places.mean(axis=0)
        order = np.argsort(np.arctan2(middle @ second, middle @ first), kind="stable")
        self._facet(plane, [sorted(on)[k] for k in order], [c, new])

    def _hand_over(self, f: int, old: int, new: int) -> None:
        self.facets[old].discard(f)
        self.facets[new].add(f)
        self.cell[f] = [new if x == old else x for x in self.cell[f]]

    def _halves(self, f: int, over: _Sides, on: set[int]) -> tuple[list[int], list[int]]:
        """The parts of a facet in front of the plane and behind it; a part without area is empty. Vertices on the plane are added to `on`."""
        loop = self.loops[f]
        sides = [over[v] for v in loop]
        if -1 not in sides:
            return loop, []
        if 1 not in sides:
            return [], loop
        front: list[int] = []
        behind: list[int] = []
        for k, v in enumerate(loop):
            w, after = loop[(k + 1) % len(loop)], sides[(k + 1) % len(loop)]
            if sides[k] >= 0:
                front.append(v)
            if sides[k] <= 0:
                behind.append(v)
            if sides[k] * after < 0:
                share = over.height(v) / (over.height(v) - over.height(w))
                middle = self._vertex(self.vertices[v] + share * (self.vertices[w] - self.vertices[v]))
                on.add(middle)
                front.append(middle)
                behind.append(middle)
        return front, behind

    def cells(self) -> Cells:
        """What has come of it."""
        return Cells(
            vertices=np.array(self.vertices),
            loops=tuple(np.array(loop, np.int64) for loop in self.loops),
            plane=np.array(self.plane, np.int64),
            cell=np.array(self.cell, np.int64),
            n_cells=len(self.facets),
        )


def boundary_facets(cells: Cells, inside: BoolArray) -> tuple[IntArray, BoolArray]:
    """The facets between inside and outside, and whether each looks along its plane's normal. inside : (n_cells,)."""
    label = np.append(inside, False)[cells.cell]  # row -1, beyond the box, is outside
    wanted = np.flatnonzero(label[:, 0] != label[:, 1])
    return wanted, label[wanted, 1]


@jit
def _located(points: FloatArray, nodes: IntArray, normals: FloatArray, offsets: FloatArray) -> IntArray:
    """(n,) down from node 0: nodes (k, 3) are plane, node in front, node behind; a leaf is -1 and its cell."""
    out = np.zeros(len(points), np.int64)
    for i in range(len(points)):
        node = 0
        while nodes[node, 0] >= 0:
            plane = nodes[node, 0]
            height = points[i, 0] * normals[plane, 0] + points[i, 1] * normals[plane, 1] + points[i, 2] * normals[plane, 2]
            node = nodes[node, 1] if height > offsets[plane] else nodes[node, 2]
        out[i] = nodes[node, 1]
    return out
