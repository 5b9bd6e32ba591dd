"""Tets between copies of a triangulated section: the volume mesh of a swept solid, without a mesher."""

from __future__ import annotations

import numpy as np

from scan2fea.errors import MeshingError, require
from scan2fea.kernel.measures import tet_volumes
from scan2fea.tetmeshing.tets import boundary_of, tagged, tet_mesh
from scan2fea.types import FloatArray, IntArray, TetMesh


def layered(points: FloatArray, triangles: IntArray, rim: IntArray, rim_tag: IntArray, face_names: tuple[str, ...], order: int = 2) -> TetMesh:
    """The tets between m copies of a section of n places.

    points : (m, n, 3) the places of each copy, metres, in the order of the way.   triangles : (k, 3), counter-clockwise seen from ahead.
    rim : (r, 2) border edges of the section, any direction.   rim_tag : (r,) index into `face_names` of the face that each of them sweeps; the first
    and the last copy are the faces named last but one and last. Every prism becomes three tets, cut from the lower number at the near copy to the
    higher at the far one, so that neighbours agree. Raises MeshingError where a tet is turned over (the axis bends too much for the section).
    """
    m, n, _ = points.shape
    require(m >= 2, MeshingError, f"a swept solid needs two copies of its section at least, not {m}")
    corner = np.sort(triangles, axis=1)
    a, b, c = triangles.T
    is_even = ((a > b).astype(np.int64) + (b > c) + (a > c)) % 2 == 0
    p, q, r = corner.T
    P, Q, R = (corner + n).T
    three = np.stack([np.stack([p, q, r, R], 1), np.stack([p, q, R, Q], 1), np.stack([p, P, Q, R], 1)], axis=1)
    three[~is_even] = three[~is_even][:, :, [1, 0, 2, 3]]
    tets = (three.reshape(1, -1, 4) + n * np.arange(m - 1)[:, None, None]).reshape(-1, 4)
    nodes = points.reshape(-1, 3)
    turned = int((tet_volumes(nodes, tets) <= 0).sum())
    require(turned == 0, MeshingError, f"{turned} of {len(tets)} tets of the swept section are turned over: its axis bends too much for its size")

    low, high = np.sort(rim, axis=1).T
    side = np.stack([np.stack([low, high, high + n], 1), np.stack([low, high + n, low + n], 1)], axis=1)  # the diagonal as above
    sides = (side.reshape(1, -1, 3) + n * np.arange(m - 1)[:, None, None]).reshape(-1, 3)
    surface = np.concatenate([sides, triangles, triangles + n * (m - 1)])
    last = len(face_names) - 1
    ends = np.repeat([last - 1, last], len(triangles))
    tag = np.concatenate([np.tile(np.repeat(rim_tag, 2), m - 1), ends]).astype(np.int64)
    boundary = boundary_of(tets)
    return tet_mesh(nodes, tets, boundary, tagged(boundary, surface, tag), face_names, order)
