"""Volume that may hide behind surface that nothing was measured on: what a closed surface, however neat, cannot know.

A gap in a face hides about as much depth as it is wide. Behind the end of what was seen of an opening (the mouth of a tube, into which sight lines
led a little way: points round it look at it) anything may lie, up to the other side.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import Nearest
from scan2fea.kernel.measures import extent, face_areas, face_normals, volume
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.kernel.topology import edge_table
from scan2fea.reconstruction.budget import HIDDEN_VOLUME
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, TriangleMesh

LIMIT = 0.05  # of the volume: the error that is tolerated of a volume without noise
REACH = 3.0  # spacings: a place farther from any point of its own side is not measured
REACH_UNSEEN = 1.75  # the same where no sight line tells a hole from a gap: random points leave exp(-0.85 pi 1.75^2) = 0.03 % of a surface so bare
LOOKS_IN = 0.7  # cosine between the normal of a point beside a patch and its way to the middle of that: a wall round the patch
SECTORS, ROUND = 8, 4  # about the middle, and of these with such points: a wall beside a patch is in fewer, and what it hides as wide as that
RIGHT_BEHIND = 1e-3  # of the reach: where rays begin
ONE_WAY = 0.1  # of its area, what a patch looks one way with: less closes upon itself, and ends nothing
LEAST_BEHIND = 1e-3  # of the volume, in a patch times the size of the part: less is not asked


def hidden_volume(mesh: TriangleMesh, near: Nearest, spacing_m: float, reach: float = REACH, border: float = REACH_UNSEEN) -> Check:
    """Does what no point has seen stay under LIMIT of the volume?

    near : the places under points, measured, or inferred from a support that was seen.   reach : in spacings, REACH or REACH_UNSEEN.
    border : spacings from the points to which a gap goes that has places beyond the reach. A pocket nine spacings wide (a lipped Z, 1.07) had passed,
    taken for three.
    """
    return hidden_check(*unseen_volume(mesh, near.closest, face_normals(mesh)[near.face], reach * spacing_m, border * spacing_m))


def hidden_check(share: float, where: FloatArray) -> Check:
    """The check of a share of the volume that may hide. where : (k, 3) places of the gaps."""
    says = (
        f"{share:.0%} of the volume may hide behind surface that was not measured (limit {LIMIT:.0%}){around(where)}: scan there too, "
        "or fit the member"
    )
    return at_most(HIDDEN_VOLUME, share, LIMIT, says)


def unseen_volume(
    mesh: TriangleMesh, places: FloatArray, normals: FloatArray, reach_m: float, border_m: float = math.inf
) -> tuple[float, FloatArray]:
    """Share of the volume that may hide behind patches that no ray has met, and the middles of their faces.

    A patch of area A and perimeter P spans a gap about 2 A / P wide; what it hides is taken as that deep: A^2 / P on either side. With points round
    it that look at its middle it is the end of an opening, which may go on to the other side of the part.
    """
    bare = bare_faces_of(mesh, places, normals, reach_m)
    if not bare.any():
        return 0.0, np.zeros((0, 3))
    far, bare = bare, bare | bare_faces_of(mesh, places, normals, min(border_m, reach_m))
    twin = edge_table(mesh.faces).twin.reshape(-1, 3) // 3
    areas, corners = face_areas(mesh), mesh.vertices[mesh.faces]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    face, side = np.nonzero(bare[:, None] & bare[twin])
    graph = coo_array((np.ones(len(face), np.int8), (face, twin[face, side])), shape=(len(bare), len(bare)))
    patch = connected_components(graph, directed=False)[1]
    bare &= np.isin(patch, patch[far])
    size = np.bincount(patch[bare], areas[bare])
    perimeter = np.bincount(patch[bare], (lengths * ~bare[twin]).sum(axis=1)[bare], len(size))
    hidden = size**2 / np.maximum(perimeter, np.sqrt(np.maximum(size, np.finfo(float).tiny)))
    whole = abs(volume(mesh))
    tree = cKDTree(places)
    for k in np.flatnonzero(size * extent(mesh.vertices) > LEAST_BEHIND * whole):
        hidden[k] = max(hidden[k], _beyond_mouth_m3(mesh, np.flatnonzero(bare & (patch == k)), tree, normals, reach_m))
    return min(1.0, float(hidden.sum() / whole)), corners[bare].mean(axis=1)


def _beyond_mouth_m3(mesh: TriangleMesh, own: IntArray, tree: cKDTree, normals: FloatArray, reach_m: float) -> float:
    """Volume between a patch and the other side of the part, where places beside it look at its middle from most sides; else 0.

    own : rows of its faces.   tree, normals : of the places, (n, 3).
    """
    piece = TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[own])
    areas, corners, ways = face_areas(piece), mesh.vertices[piece.faces], face_normals(piece)
    way = areas @ ways / areas.sum()
    if np.linalg.norm(way) < ONE_WAY:
        return 0.0
    way /= np.linalg.norm(way)
    near = tree.query_ball_point(np.unique(corners.reshape(-1, 3), axis=0), reach_m)
    rows = np.unique(np.concatenate([np.asarray(some, np.int64) for some in near]))
    axes = Plane(normal=way, offset=0.0).axes()
    to = (areas @ corners.mean(axis=1) / areas.sum() - tree.data[rows]) @ axes.T
    looks = np.einsum("ij,ij->i", normals[rows] @ axes.T, to) > LOOKS_IN * np.linalg.norm(to, axis=1)
    angle = np.arctan2(to[looks, 1], to[looks, 0])
    if len(np.unique(np.floor(angle / (2.0 * np.pi) * SECTORS))) < ROUND:
        return 0.0
    deep, _ = first_hits(scene_of(mesh), corners.mean(axis=1) - RIGHT_BEHIND * reach_m * ways, np.repeat(-way[None], len(own), axis=0))
    return float(areas @ np.where(np.isfinite(deep), deep, 0.0))


def bare_faces_of(mesh: TriangleMesh, places: FloatArray, normals: FloatArray, reach_m: float) -> BoolArray:
    """(m,) faces with no place of their own side within reach, by a search in six dimensions: position, and half the reach times the normal."""
    scale = reach_m / 2.0
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    asked = np.concatenate([middle, scale * face_normals(mesh)], axis=1)
    if not len(places):
        return np.ones(len(middle), bool)
    found = cKDTree(np.concatenate([places, scale * normals], axis=1)).query(asked, distance_upper_bound=reach_m)[0]
    return np.asarray(~np.isfinite(np.asarray(found, float)))
