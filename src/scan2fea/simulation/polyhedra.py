"""Closed solids from plane faces given as loops of vertices, and from a profile turned about an axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InternalError, require
from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray, TriangleMesh

Loop = tuple[int, ...]
_ROUNDING = 1e-13  # of the square of a face's size: three corners that turn by less lie on one line


@dataclass(frozen=True, eq=False, kw_only=True)
class Polyhedron:
    """vertices : (n, 3).   faces : per plane face its loops; the outer one counter-clockwise seen from outside, holes clockwise."""

    vertices: FloatArray
    faces: tuple[tuple[Loop, ...], ...]


def prism(outer: npt.ArrayLike, length: float, holes: Sequence[npt.ArrayLike] = ()) -> Polyhedron:
    """The polygon `outer` (k, 2), counter-clockwise, with `holes` clockwise, swept along z from 0 to `length`.

    Faces: bottom, top, then one per edge in the order of the loops.
    """
    loops = [np.asarray(loop, float) for loop in (outer, *holes)]
    plane = np.concatenate(loops)
    n = len(plane)
    vertices = np.concatenate([np.c_[plane, np.zeros(n)], np.c_[plane, np.full(n, length)]])
    starts = np.cumsum([0] + [len(loop) for loop in loops])
    rings = [tuple(range(a, b)) for a, b in pairwise(starts.tolist())]
    bottom = tuple(ring[::-1] for ring in rings)
    top = tuple(tuple(i + n for i in ring) for ring in rings)
    sides = [((a, b, b + n, a + n),) for ring in rings for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]
    return Polyhedron(vertices=vertices, faces=(bottom, top, *sides))


def drilled(solid: Polyhedron, face_in: int, face_out: int, centre: npt.ArrayLike, through: npt.ArrayLike, outline: FloatArray) -> Polyhedron:
    """The solid with a straight hole from one plane face to the parallel one.

    centre : (3,) on `face_in`.   through : (3,) from there to `face_out`, normal to both.
    outline : (k, 2) convex, counter-clockwise, about the centre.
    """
    d = np.asarray(through, float)
    axis = d / np.linalg.norm(d)
    u = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    u /= np.linalg.norm(u)
    ring = np.asarray(centre, float) + outline[:, :1] * u + outline[:, 1:] * np.cross(axis, u)
    n, k = len(solid.vertices), len(outline)
    near, far = tuple(range(n, n + k)), tuple(range(n + k, n + 2 * k))
    faces = list(solid.faces)
    faces[face_in] = (*faces[face_in], near)  # counter-clockwise about `through` is clockwise seen from outside
    faces[face_out] = (*faces[face_out], far[::-1])
    walls = [((near[(i + 1) % k], near[i], far[i], far[(i + 1) % k]),) for i in range(k)]
    return replace(solid, vertices=np.concatenate([solid.vertices, ring, ring + d]), faces=(*faces, *walls))


def raised(solid: Polyhedron, face: int, outline: FloatArray, height: float) -> Polyhedron:
    """The solid with a column standing on the inside of one plane face (a leg under a table top).

    outline : (k, 3) on the face, counter-clockwise seen from outside.   height : how far the column reaches out.
    """
    normal = np.cross(outline[1] - outline[0], outline[2] - outline[1])
    normal /= np.linalg.norm(normal)
    n, k = len(solid.vertices), len(outline)
    foot, tip = tuple(range(n, n + k)), tuple(range(n + k, n + 2 * k))
    faces = list(solid.faces)
    faces[face] = (*faces[face], foot[::-1])
    walls = [((foot[i], foot[(i + 1) % k], tip[(i + 1) % k], tip[i]),) for i in range(k)]
    return replace(solid, vertices=np.concatenate([solid.vertices, outline, outline + height * normal]), faces=(*faces, *walls, (tip,)))


def meshed(solid: Polyhedron) -> TriangleMesh:
    """The solid's faces cut into triangles without new vertices."""
    triangles = [_face_triangles(solid.vertices, face) for face in solid.faces]
    return TriangleMesh(vertices=solid.vertices, faces=np.concatenate(triangles))


def revolved(profile: npt.ArrayLike, n_segments: int) -> TriangleMesh:
    """A profile (k, 2) of (radius, z) turned about the z axis in `n_segments` steps.

    It runs from a point on the axis to another one with the material on its left; only its first and last radius are zero.
    """
    p = np.asarray(profile, float)
    require(p[0, 0] == 0 == p[-1, 0] and (p[1:-1, 0] > 0).all(), InternalError, "a profile must start and end on the axis and keep off it between")
    angle = 2 * np.pi * np.arange(n_segments) / n_segments
    inner = p[1:-1]
    rings = np.stack([inner[:, :1] * np.cos(angle), inner[:, :1] * np.sin(angle), np.broadcast_to(inner[:, 1:], (len(inner), n_segments))], -1)
    vertices = np.concatenate([rings.reshape(-1, 3), [[0, 0, p[0, 1]], [0, 0, p[-1, 1]]]])
    j = np.arange(n_segments)
    k = (j + 1) % n_segments
    faces = [np.stack([np.full_like(j, len(vertices) - 2), k, j], 1)]
    for row in range(len(inner) - 1):
        a, b = row * n_segments, (row + 1) * n_segments
        faces += [np.stack([a + j, a + k, b + k], 1), np.stack([a + j, b + k, b + j], 1)]
    last = (len(inner) - 1) * n_segments
    faces.append(np.stack([last + j, last + k, np.full_like(j, len(vertices) - 1)], 1))
    return TriangleMesh(vertices=vertices, faces=np.concatenate(faces))


def _face_triangles(vertices: FloatArray, loops: tuple[Loop, ...]) -> IntArray:
    """(k, 3) triangles of one plane face with holes."""
    outer = vertices[list(loops[0])]
    normal = np.cross(outer, np.roll(outer, -1, axis=0)).sum(axis=0)  # Newell
    normal /= np.linalg.norm(normal)
    u = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    flat = {i: np.array([vertices[i] @ u, vertices[i] @ v]) for loop in loops for i in loop}
    return np.array(triangulated(flat, [list(loop) for loop in loops]), np.int64)


def triangulated(flat: dict[int, FloatArray], loops: list[list[int]]) -> list[tuple[int, int, int]]:
    """Triangles of a plane polygon with holes, by bridges and ear clipping (Eberly, Triangulation by Ear Clipping).

    flat : vertex -> (2,).   loops : outer counter-clockwise, holes clockwise. Raises InternalError where the loops cross.
    """
    every = np.array([flat[i] for loop in loops for i in loop])
    slack = _ROUNDING * float(np.ptp(every, axis=0).max()) ** 2
    ring = list(loops[0])
    for hole in sorted(loops[1:], key=lambda loop: -max(flat[i][0] for i in loop)):
        ring = _bridged(flat, ring, hole)
    places = _clipped(np.array(ring, np.int64), np.array([flat[i] for i in ring]), slack)
    require(len(places) == len(ring) - 2, InternalError, "the loops of a face cross: it has no triangulation")
    return [(ring[a], ring[b], ring[c]) for a, b, c in places.tolist()]


@jit
def _clipped(vertex: IntArray, at: FloatArray, slack: float) -> IntArray:
    """(n - 2, 3) places in the ring of the triangles, the first ear of it cut off each time; fewer where no ear is left.

    vertex : (n,) a bridge walks its ends twice.   at : (n, 2).
    """
    n = len(vertex)
    left = np.arange(n)
    out = np.zeros((n - 2, 3), np.int64)
    for count in range(n - 2):
        k = n - count
        i = 1 if k == 3 else 0
        while k > 3 and i < k and not _is_ear(vertex, at, left[:k], i, slack):
            i += 1
        if i == k:
            return out[:count]
        out[count, 0], out[count, 1], out[count, 2] = left[i - 1 if i else k - 1], left[i], left[(i + 1) % k]
        for j in range(i, k - 1):
            left[j] = left[j + 1]
    return out


@jit
def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


@jit
def _holds(a: FloatArray, b: FloatArray, c: FloatArray, p: FloatArray, slack: float = 0.0) -> bool:
    """True where p lies in the counter-clockwise triangle or on its border; `slack` (m2) is what rounding may take from a turn."""
    return _turn(a, b, p) >= -slack and _turn(b, c, p) >= -slack and _turn(c, a, p) >= -slack


@jit
def _is_ear(vertex: IntArray, at: FloatArray, left: IntArray, i: int, slack: float) -> bool:
    k = len(left)
    before, tip, after = left[i - 1 if i else k - 1], left[i], left[(i + 1) % k]
    if _turn(at[before], at[tip], at[after]) <= slack:
        return False
    for j in left:
        is_corner = vertex[j] == vertex[before] or vertex[j] == vertex[tip] or vertex[j] == vertex[after]
        if not is_corner and _holds(at[before], at[tip], at[after], at[j], slack):
            return False
    return True


def _bridged(flat: dict[int, FloatArray], ring: list[int], hole: list[int]) -> list[int]:
    """The ring with the hole joined to it by a bridge walked both ways: from the hole's rightmost vertex to one of the ring that it can see."""
    start = max(range(len(hole)), key=lambda i: flat[hole[i]][0])
    m = flat[hole[start]]
    best, seen = np.inf, -1
    for i in range(len(ring)):  # nearest edge to the right that the ray m -> +x crosses from below to above: the ring's inside is to its left
        a, b = flat[ring[i]], flat[ring[(i + 1) % len(ring)]]
        if a[1] <= m[1] <= b[1] and a[1] < b[1]:
            x = a[0] + (m[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            if m[0] <= x < best:
                best, seen = x, i if a[0] > b[0] else (i + 1) % len(ring)
    require(seen >= 0, InternalError, "a hole lies outside its face")
    hit = np.array([best, m[1]])
    p = flat[ring[seen]]
    b, c = (hit, p) if p[1] > m[1] else (p, hit)
    inside = [i for i in range(len(ring)) if ring[i] != ring[seen] and _turn(m, b, c) > 0 and _holds(m, b, c, flat[ring[i]])]
    if inside:  # a vertex in the way: take the one at the smallest angle to the ray, the nearer of equals
        seen = min(inside, key=lambda i: (abs(float(np.arctan2(flat[ring[i]][1] - m[1], flat[ring[i]][0] - m[0]))), float(flat[ring[i]][0])))
    around = hole[start:] + hole[:start]
    return [*ring[: seen + 1], *around, around[0], *ring[seen:]]
