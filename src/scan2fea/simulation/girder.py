"""The plate girder as one polyhedron: two flanges and, between them, the web with its stiffeners as one column of constant height."""

from __future__ import annotations

from typing import Any

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.simulation.polyhedra import Loop, Polyhedron, meshed
from scan2fea.types import FloatArray, TriangleMesh


def girder_mesh(h: float, b: float, tw: float, tf: float, length: float, ts: float, bs: float, n_stiffeners: int) -> TriangleMesh:
    """A welded I along z, centred in x and y; stiffeners stand on both sides of the web from flange to flange, at equal distances along z.

    Raises InputError where they do not fit: bs must leave a rim of flange, and there must be web between neighbours.
    """
    require(tw < b and 2 * tf < h, InputError, f"girder: web {tw} m or flange {tf} m does not fit a section of {h} x {b} m")
    require(n_stiffeners >= 0, InputError, f"girder: n_stiffeners is {n_stiffeners}; it must not be negative")
    require(bs < (b - tw) / 2, InputError, f"girder: bs is {bs} m; it must be less than {(b - tw) / 2:.6g} m, the flange beside the web")
    require(ts < length / (n_stiffeners + 1), InputError, f"girder: ts is {ts} m; {n_stiffeners} of them do not fit a length of {length} m")
    inner = h / 2 - tf
    side = _outline(tw / 2, ts, bs, length, n_stiffeners)  # of the right side of the column, (x, z), z from 0 to the length
    n = len(side)
    right, left = side, side * [-1, 1]
    levels = (-h / 2, -inner, inner, h / 2)
    corners = np.array([[b / 2, 0], [b / 2, length], [-b / 2, length], [-b / 2, 0]])
    blocks = [corners, np.concatenate([corners, right, left]), np.concatenate([corners, right, left]), corners]
    vertices = np.concatenate([np.insert(plane, 1, y, axis=1) for plane, y in zip(blocks, levels, strict=True)])
    lower, upper, top = 4, 8 + 2 * n, 12 + 4 * n  # first vertex of levels 1, 2, 3; level 0 begins at 0
    faces = [_loop([0, 1, 2, 3]), _loop([top, top + 1, top + 2, top + 3])]
    for flange, level in ((0, lower), (top, upper)):
        faces.append(_loop([flange, flange + 1, level + 1, level]))
        faces.append(_loop([flange + 2, flange + 3, level + 3, level + 2]))
        r, le = level + 4, level + 4 + n
        faces.append(_loop([level, level + 1, *range(r + n - 1, r - 1, -1)]))
        faces.append(_loop([level + 3, level + 2, *range(le + n - 1, le - 1, -1)]))
    for first in (4, 4 + n):
        for k in range(n - 1):
            faces.append(_loop([lower + first + k, lower + first + k + 1, upper + first + k + 1, upper + first + k]))
    for end, web in ((0, 0), (1, n - 1)):
        far = 3 - end
        r, le = 4 + web, 4 + n + web
        right_side = [end, lower + end, lower + r, upper + r, upper + end, top + end]
        left_side = [top + far, upper + far, upper + le, lower + le, lower + far, far]
        faces.append(_loop(right_side + left_side))
    return meshed(_outward(Polyhedron(vertices=vertices, faces=tuple(faces)), _normals(n, side)))


def _outline(x0: float, ts: float, bs: float, length: float, n_stiffeners: int) -> FloatArray:
    corners = [[x0, 0.0]]
    for k in range(1, n_stiffeners + 1):
        z = length * k / (n_stiffeners + 1)
        corners += [[x0, z - ts / 2], [x0 + bs, z - ts / 2], [x0 + bs, z + ts / 2], [x0, z + ts / 2]]
    return np.array([*corners, [x0, length]])


def _loop(vertices: Any) -> tuple[Loop, ...]:
    return (tuple(vertices),)


def _normals(n: int, side: FloatArray) -> FloatArray:
    """Outward normals of the faces in the order in which they were made."""
    x, y, z = np.eye(3)
    flanges = [-y, y, x, -x, y, y, x, -x, -y, -y]
    step = np.diff(side, axis=0)
    right = [np.array([dz, 0.0, -dx]) for dx, dz in step]
    left = [normal * [-1, 1, 1] for normal in right]
    return np.array([*flanges, *right, *left, -z, z])


def _outward(solid: Polyhedron, normals: FloatArray) -> Polyhedron:
    """Each loop walked so that its area vector points along the given normal."""
    faces = []
    for (loop,), normal in zip(solid.faces, normals, strict=True):
        p = solid.vertices[list(loop)]
        around = np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0)
        faces.append((loop,) if around @ normal > 0 else (loop[::-1],))
    return Polyhedron(vertices=solid.vertices, faces=tuple(faces))
