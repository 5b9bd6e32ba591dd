"""A closed mesh cut by planes: sliced where it stays whole, or with the part inside a convex wedge taken out and the wound closed.

Everything is keyed by the edges that a plane crosses, so that neighbours stay joined and nothing is merged by distance.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InputError, InternalError, require
from scan2fea.simulation.polyhedra import triangulated
from scan2fea.types import FloatArray, IntArray, TriangleMesh

ON_PLANE = 1e-12  # of the size of the mesh: a vertex so near lies on the plane, or a needle would be cut off


@dataclass
class _Vertices:
    """The vertices of all cells, and where each edge was cut."""

    points: list[FloatArray]
    size: float
    cut: dict[tuple[int, int], int] = field(default_factory=dict)

    def above(self, normal: FloatArray, offset: float) -> FloatArray:
        """Signed distances from the plane, 0 where a vertex lies on it."""
        s = np.array(self.points) @ normal - offset
        return np.where(np.abs(s) <= ON_PLANE * self.size, 0.0, s)

    def crossing(self, i: int, j: int, s: FloatArray) -> int:
        """The vertex where the plane crosses edge ij; the same for both of its faces."""
        low, high = min(i, j), max(i, j)
        if (low, high) not in self.cut:
            share = s[low] / (s[low] - s[high])
            self.cut[low, high] = len(self.points)
            self.points.append(self.points[low] + share * (self.points[high] - self.points[low]))
        return self.cut[low, high]


def sliced(mesh: TriangleMesh, normal: npt.ArrayLike, offsets: Sequence[float]) -> TriangleMesh:
    """The same surface, its faces cut where the planes normal . x = offset cross it."""
    n = np.asarray(normal, float)
    faces = mesh.faces.tolist()
    vertices = _Vertices(points=list(mesh.vertices), size=float(np.ptp(mesh.vertices, axis=0).max()))
    done: list[list[int]] = []
    todo = [(faces, sorted(offsets))]
    while todo:  # the middle plane first: each triangle then meets few planes more than it crosses
        part, planes = todo.pop()
        if not planes or not part:
            done += part
            continue
        half = len(planes) // 2
        vertices.cut.clear()
        below, above = _split(vertices, part, n, planes[half])
        todo += [(above, planes[half + 1 :]), (below, planes[:half])]
    return TriangleMesh(vertices=np.array(vertices.points), faces=np.array(done, np.int64))


def carved(mesh: TriangleMesh, planes: Sequence[tuple[npt.ArrayLike, float]]) -> TriangleMesh:
    """The solid less the wedge where normal . x > offset for ALL of the planes (a corner: one plane; a slot: three).

    Raises InputError where nothing is left, where nothing is taken away, or where the wound is no set of plain polygons.
    """
    vertices = _Vertices(points=list(mesh.vertices), size=float(np.ptp(mesh.vertices, axis=0).max()))
    wedge: list[list[list[int]]] = [mesh.faces.tolist()]  # cells still inside every plane so far
    kept: list[list[list[int]]] = []
    for normal, offset in planes:
        n = np.asarray(normal, float)
        vertices.cut.clear()
        # what was kept is split along too, so that faces shared with the wedge stay the same triangles
        kept = [part for cell in kept for part in _parted(vertices, cell, n, offset)]
        inside: list[list[list[int]]] = []
        for cell in wedge:
            below, above = _parted(vertices, cell, n, offset)
            kept += [below] if below else []
            inside += [above] if above else []
        wedge = inside
    require(any(wedge), InputError, "nothing is cut away: the cut lies beside the object")
    faces = _without_inner(np.array([face for cell in kept for face in cell], np.int64).reshape(-1, 3))
    require(len(faces) > 0, InputError, "nothing is left: the cut takes the whole object")
    used, packed = np.unique(faces, return_inverse=True)
    return TriangleMesh(vertices=np.array(vertices.points)[used], faces=packed.reshape(-1, 3).astype(np.int64))


def _parted(vertices: _Vertices, cell: list[list[int]], normal: FloatArray, offset: float) -> tuple[list[list[int]], list[list[int]]]:
    """A closed cell as the two closed cells below and above the plane; one is empty where the plane misses it."""
    below, above = _split(vertices, cell, normal, offset)
    if not below or not above:
        return below, above
    lid = _lid(vertices, below, normal)
    if lid:
        return below + lid, above + [face[::-1] for face in lid]
    return below, above


def _split(vertices: _Vertices, faces: list[list[int]], normal: FloatArray, offset: float) -> tuple[list[list[int]], list[list[int]]]:
    """Triangles below and above; those in the plane go with the side their normal points away from."""
    s = vertices.above(normal, offset)
    below: list[list[int]] = []
    above: list[list[int]] = []
    corners = s[np.array(faces, np.int64).reshape(-1, 3)]
    low, high = corners.min(axis=1).tolist(), corners.max(axis=1).tolist()
    for face, least, most in zip(faces, low, high, strict=True):
        if most <= 0 and least < 0:
            below.append(face)
        elif least >= 0 and most > 0:
            above.append(face)
        elif least == most:
            a, b, c = (vertices.points[i] for i in face)
            (below if np.cross(b - a, c - a) @ normal > 0 else above).append(face)
        else:
            _cut(vertices, face, s, below, above)
    return below, above


def _cut(vertices: _Vertices, face: list[int], s: FloatArray, below: list[list[int]], above: list[list[int]]) -> None:
    """One triangle that the plane passes through."""
    around = [*face, face[0]]
    sides: dict[int, list[int]] = {-1: [], 1: []}
    for i, j in itertools.pairwise(around):
        for sign in (-1, 1):
            if s[i] * sign >= 0:
                sides[sign].append(i)
        if s[i] * s[j] < 0:
            middle = vertices.crossing(i, j, s)
            sides[-1].append(middle)
            sides[1].append(middle)
    for sign, out in ((-1, below), (1, above)):
        first = sides[sign].index(min(sides[sign]))  # the same diagonal from either side of the face
        ring = sides[sign][first:] + sides[sign][:first]
        out += [[ring[0], ring[k], ring[k + 1]] for k in range(1, len(ring) - 1)]


def _lid(vertices: _Vertices, below: list[list[int]], normal: FloatArray) -> list[list[int]]:
    """Triangles in the plane that close the part below it, facing up."""
    edges = {(f[k], f[(k + 1) % 3]) for f in below for k in range(3)}
    after: dict[int, int] = {}
    for a, b in edges:
        if (b, a) not in edges:
            require(b not in after, InputError, "the cut touches the object in a point: move it a little")
            after[b] = a
    if not after:
        return []
    u = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    u /= np.linalg.norm(u)
    v = np.cross(normal / np.linalg.norm(normal), u)
    flat = {i: np.array([vertices.points[i] @ u, vertices.points[i] @ v]) for i in after}
    loops = _loops(after)
    outer = [loop for loop in loops if _area(flat, loop) > 0]
    holes = [loop for loop in loops if _area(flat, loop) < 0]
    faces: list[list[int]] = []
    for loop in outer:
        inside = [hole for hole in holes if _holds(flat, loop, hole[0]) and not any(o is not loop and _within(flat, o, loop, hole) for o in outer)]
        try:
            faces += [list(t) for t in triangulated(flat, [loop, *inside])]
        except InternalError as error:
            raise InputError("the cut runs along an edge of the bent object, so that its wound crosses itself: move it a little") from error
    return faces


def _loops(after: dict[int, int]) -> list[list[int]]:
    left, loops = dict(after), []
    while left:
        start = min(left)
        loop = [start]
        while (following := left.pop(loop[-1])) != start:
            require(following in left, InputError, "the cut leaves an open wound: the object is not closed")
            loop.append(following)
        loops.append(loop)
    return loops


def _within(flat: dict[int, FloatArray], inner: list[int], outer: list[int], hole: list[int]) -> bool:
    """Does `inner` lie in `outer` and hold the hole?"""
    return _holds(flat, outer, inner[0]) and _holds(flat, inner, hole[0])


def _area(flat: dict[int, FloatArray], loop: list[int]) -> float:
    p = np.array([flat[i] for i in loop])
    q = np.roll(p, -1, axis=0)
    return float((p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]).sum() / 2)


def _holds(flat: dict[int, FloatArray], loop: list[int], vertex: int) -> bool:
    p = np.array([flat[i] for i in loop])
    q = np.roll(p, -1, axis=0)
    x, y = flat[vertex]
    crosses = (p[:, 1] > y) != (q[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = p[:, 0] + (y - p[:, 1]) * (q[:, 0] - p[:, 0]) / (q[:, 1] - p[:, 1])
    return bool((crosses & (x < at)).sum() % 2)


def _without_inner(faces: IntArray) -> IntArray:
    """The faces without the pairs that two kept cells share, back to back."""
    order = np.argmin(faces, axis=1)
    start = np.take_along_axis(faces, (order[:, None] + np.arange(3)) % 3, axis=1)
    seen: dict[tuple[int, ...], int] = {}
    keep = np.ones(len(faces), bool)
    for row, (a, b, c) in enumerate(start.tolist()):
        twin = seen.pop((a, c, b), None)
        if twin is None:
            seen[a, b, c] = row
        else:
            keep[[row, twin]] = False
    return faces[keep]
