"""Volume that may hide behind surface that nothing was measured on: what a closed surface, however neat, cannot know."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import Nearest
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.kernel.topology import edge_table
from scan2fea.reconstruction.budget import HIDDEN_VOLUME
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.types import BoolArray, Check, FloatArray, TriangleMesh

LIMIT = 0.05  # of the volume: the error that is tolerated of a volume without noise
REACH = 3.0  # spacings: a place farther from any point of its own side is not measured
REACH_UNSEEN = 1.75  # the same where no sight line tells a hole from a gap: random points leave exp(-0.85 pi 1.75^2) = 0.03 % of a surface so bare


def hidden_volume(mesh: TriangleMesh, near: Nearest, spacing_m: float, reach: float = REACH) -> Check:
    """Does what no point has seen stay under LIMIT of the volume?

    near : the places under points, measured, or inferred from a support that was seen.   reach : in spacings, REACH or REACH_UNSEEN.
    """
    return hidden_check(*unseen_volume(mesh, near.closest, face_normals(mesh)[near.face], reach * spacing_m))


def hidden_check(share: float, where: FloatArray) -> Check:
    """The check of a share of the volume that may hide. where : (k, 3) places of the gaps."""
    says = (
        f"{share:.0%} of the volume may hide behind surface that was not measured (limit {LIMIT:.0%}){around(where)}: scan there too, "
        "or fit the member"
    )
    return at_most(HIDDEN_VOLUME, share, LIMIT, says)


def unseen_volume(mesh: TriangleMesh, places: FloatArray, normals: FloatArray, reach_m: float) -> tuple[float, FloatArray]:
    """Share of the volume that may hide behind patches that no ray has met, and the middles of their faces.

    A patch of area A and perimeter P spans a gap about 2 A / P wide; what it hides is taken as that deep: A^2 / P on either side.
    """
    bare = bare_faces_of(mesh, places, normals, reach_m)
    if not bare.any():
        return 0.0, np.zeros((0, 3))
    twin = edge_table(mesh.faces).twin.reshape(-1, 3) // 3
    areas, corners = face_areas(mesh), mesh.vertices[mesh.faces]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    face, side = np.nonzero(bare[:, None] & bare[twin])
    graph = coo_array((np.ones(len(face), np.int8), (face, twin[face, side])), shape=(len(bare), len(bare)))
    patch = connected_components(graph, directed=False)[1]
    size = np.bincount(patch[bare], areas[bare])
    perimeter = np.bincount(patch[bare], (lengths * ~bare[twin]).sum(axis=1)[bare], len(size))
    hidden = size**2 / np.maximum(perimeter, np.sqrt(np.maximum(size, np.finfo(float).tiny)))
    return float(hidden.sum() / abs(volume(mesh))), corners[bare].mean(axis=1)


def bare_faces_of(mesh: TriangleMesh, places: FloatArray, normals: FloatArray, reach_m: float) -> BoolArray:
    """(m,) faces with no place of their own side within reach, by a search in six dimensions: position, and half the reach times the normal."""
    scale = reach_m / 2.0
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    asked = np.concatenate([middle, scale * face_normals(mesh)], axis=1)
    if not len(places):
        return np.ones(len(middle), bool)
    found = cKDTree(np.concatenate([places, scale * normals], axis=1)).query(asked, distance_upper_bound=reach_m)[0]
    return np.asarray(~np.isfinite(np.asarray(found, float)))
