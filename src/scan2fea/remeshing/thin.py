"""Thin triangles taken out one by one, the thinnest first: an edge is turned, or drawn together to an end or, in free form, to its middle.

A thin triangle of the surface is a side of a tet that is about as flat, whatever is done inside: only here can it be mended. The best change is taken
that leaves every angle round it larger than the thin one was, and moves the surface by no more than it may.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.quality import triangle_angles
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

THIN_DEG = 15.0
GAIN_DEG = 1.0  # a change has to be worth its while
SAME_SIDE = 0.5  # cosine a face may turn by
MAX_TRIES = 600


@dataclass(frozen=True, eq=False, kw_only=True)
class _Change(Value):
    """old : rows of faces that go.   new : (k, 3) corners of those that come.   kept : (k,) rows of the faces that these stand for.

    vertex, place : one that moves, -1 for none.   gone : the vertex that is no longer used, -1 for none.
    """

    old: IntArray
    new: IntArray
    kept: IntArray
    vertex: int = -1
    place: FloatArray
    gone: int = -1


def without_thin(mesh: TriangleMesh, give_m: float) -> TriangleMesh:
    """`mesh` with as few angles under THIN_DEG as its shape allows; regions keep their planes, and no place moves farther than `give_m`."""
    if len(self_intersections(mesh)):
        return mesh  # no step could prove itself harmless
    given = PointToMesh(mesh)
    refused: set[tuple[float, ...]] = set()
    for _ in range(MAX_TRIES):
        angle = np.degrees(triangle_angles(mesh.vertices, mesh.faces)).min(axis=1)
        thin = [k for k in np.argsort(angle, kind="stable")[: len(refused) + 1].tolist() if _name(mesh, k) not in refused]
        if not thin or angle[thin[0]] >= THIN_DEG:
            break
        made = _mended(mesh, thin[0], given, give_m)
        if made is None:
            refused.add(_name(mesh, thin[0]))
        else:
            mesh = made
    return mesh


def _name(mesh: TriangleMesh, face: int) -> tuple[float, ...]:
    """A face by its place: its number changes with every edge drawn together."""
    return tuple(mesh.vertices[mesh.faces[face]].ravel().tolist())


def _mended(mesh: TriangleMesh, face: int, given: PointToMesh, give_m: float) -> TriangleMesh | None:
    """The mesh after the best change at an edge of the face, or None where there is none."""
    before = np.degrees(triangle_angles(mesh.vertices, mesh.faces[face : face + 1])).min()
    options: list[tuple[float, int, _Change]] = []
    for change in _changes(mesh, face):
        angle = float(np.degrees(triangle_angles(_places(mesh, change), change.new)).min())
        if angle >= before + GAIN_DEG:
            options.append((-angle, len(options), change))
    for _, _, change in sorted(options, key=lambda option: option[:2]):
        if _stays(mesh, change, given, give_m):
            return _made(mesh, change)
    return None


def _changes(mesh: TriangleMesh, face: int) -> Iterator[_Change]:
    """What can be done to the edges of a face without pinching the surface or leaving a plane."""
    for side in range(3):
        a, b, c = (int(mesh.faces[face, (side + k) % 3]) for k in range(3))
        at_a, at_b = ((mesh.faces == v).any(axis=1) for v in (a, b))
        both = np.flatnonzero(at_a & at_b)
        if len(both) != 2:
            continue
        other = int(both[both != face][0])
        d = int(next(v for v in mesh.faces[other].tolist() if v not in (a, b)))
        is_one = mesh.face_region is None or mesh.face_region[face] == mesh.face_region[other]
        if is_one and not ((mesh.faces == c).any(axis=1) & (mesh.faces == d).any(axis=1)).any():
            old = np.array([face, other])
            yield _Change(old=old, new=np.array([[a, d, c], [d, b, c]]), kept=old, place=np.zeros(3))
        if len(np.intersect1d(mesh.faces[at_a], mesh.faces[at_b])) != 4:
            continue  # besides the two ends others than the two tips of the edge's faces
        on_a, on_b = _planes_at(mesh, at_a), _planes_at(mesh, at_b)
        middle = (mesh.vertices[a] + mesh.vertices[b]) / 2
        ends = [(a, b, mesh.vertices[b], on_a <= on_b), (b, a, mesh.vertices[a], on_b <= on_a), (a, b, middle, not (on_a | on_b))]
        for gone, stays, place, may in ends:
            if may:
                old = np.flatnonzero(at_a | at_b)
                kept = old[~np.isin(old, both)]
                new = np.where(mesh.faces[kept] == gone, stays, mesh.faces[kept])
                yield _Change(old=old, new=new, kept=kept, vertex=stays, place=place, gone=gone)


def _planes_at(mesh: TriangleMesh, around: IntArray) -> set[int]:
    if mesh.face_region is None:
        return set()
    return {int(r) for r in mesh.face_region[around] if r >= 0}


def _places(mesh: TriangleMesh, change: _Change) -> FloatArray:
    if change.vertex < 0:
        return mesh.vertices
    places = mesh.vertices.copy()
    places[change.vertex] = change.place
    return places


def _stays(mesh: TriangleMesh, change: _Change, given: PointToMesh, give_m: float) -> bool:
    """Whether old and new faces lie within `give_m` of each other and of the surface given, look the same way, and cross nothing."""
    vertices = _places(mesh, change)
    old, new = TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[change.old]), TriangleMesh(vertices=vertices, faces=change.new)
    ahead, back = PointToMesh(old).nearest(_probes(new)), PointToMesh(new).nearest(_probes(old))
    strayed = given.nearest(_probes(new)).distance.max()
    if max(ahead.distance.max(), back.distance.max(), strayed) > give_m:
        return False
    turned = np.einsum("ij,ij->i", face_normals(old)[ahead.face[: len(new.faces)]], face_normals(new))
    if (turned <= SAME_SIDE).any():
        return False
    rest = np.ones(len(mesh.faces), bool)
    rest[change.old] = False
    corners, changed = mesh.vertices[mesh.faces], vertices[change.new]
    low, high = changed.min(axis=(0, 1)), changed.max(axis=(0, 1))
    near = rest & (corners.max(axis=1) >= low).all(axis=1) & (corners.min(axis=1) <= high).all(axis=1)
    return not len(self_intersections(TriangleMesh(vertices=vertices, faces=np.concatenate([change.new, mesh.faces[near]]))))


def _probes(mesh: TriangleMesh) -> FloatArray:
    """Middles of the faces, corners, and middles of the edges."""
    corners = mesh.vertices[mesh.faces]
    halfway = (corners + np.roll(corners, -1, axis=1)) / 2
    return np.concatenate([corners.mean(axis=1), corners.reshape(-1, 3), halfway.reshape(-1, 3)])


def _made(mesh: TriangleMesh, change: _Change) -> TriangleMesh:
    faces = mesh.faces.copy()
    faces[change.kept] = change.new
    row = np.setdiff1d(np.arange(len(faces)), np.setdiff1d(change.old, change.kept))
    region = None if mesh.face_region is None else mesh.face_region[row]
    vertices, faces = _places(mesh, change), faces[row]
    if change.gone >= 0:
        vertices, faces = np.delete(vertices, change.gone, axis=0), faces - (faces > change.gone)
    return replace(mesh, vertices=vertices, faces=faces, face_region=region, face_origin=None, deviation_m=None)
