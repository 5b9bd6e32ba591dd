"""Faces of a flat solid on which too few points lie to say that they were seen: planes meet there because nothing said otherwise.

Planes that reach beyond their points close a solid wherever others cut them, and what a scan left out beyond such a face nobody knows. A face
that was seen holds as many points for its area as the others; noise carries some of its neighbours' points onto it, so few are as bad as none.
"""

from __future__ import annotations

import numpy as np
from scipy.special import pdtr

from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.reconstruction.budget import BARE_FACES
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.wall_ends import BEYOND, passed
from scan2fea.types import BoolArray, Check, FloatArray, TriangleMesh

LIMIT = 0.02  # of the volume: as behind ends of walls
CHANCE, CHANCE_HALF = 0.0025, 0.05  # of so few points at the density of the other faces, and at half of it
PLACES = 64  # of a face, where sight lines are asked for
PASSED = 0.5  # of them: the face was seen to end there


def bare_faces(mesh: TriangleMesh, points: FloatArray, sensors: FloatArray, spacing_m: float) -> Check:
    """How much may hide beyond faces that have too few points? points : (n, 3).   sensors : (n, 3) where each was seen from, nan: not known.

    A face of area A whose farthest corners are L apart hides A L / pi: a strip at the end of a wall as much as a half disc of it.
    """
    region = np.zeros(len(mesh.faces), np.int64) if mesh.face_region is None else np.unique(mesh.face_region, return_inverse=True)[1].ravel()
    areas = face_areas(mesh)
    area = np.asarray(np.bincount(region, areas), float)
    held = np.bincount(region[PointToMesh(mesh).nearest(points).face], minlength=len(area))
    due = area * _typical(held / np.maximum(area, np.finfo(float).tiny), area)
    bare = np.flatnonzero((pdtr(held, due) <= CHANCE) & (pdtr(held, 0.5 * due) <= CHANCE_HALF))
    bare = bare[[not _seen_past(mesh, region == r, points, sensors, spacing_m) for r in bare]] if len(bare) else bare
    corners = [mesh.vertices[np.unique(mesh.faces[region == r])] for r in bare]
    hidden = sum(area[r] * _extent(own) / np.pi for r, own in zip(bare, corners, strict=True))
    share = min(1.0, float(hidden) / abs(volume(mesh)))
    where = around(np.concatenate(corners)) if corners else ""
    says = f"{share:.1%} of the volume may hide beyond flat faces with too few points (limit {LIMIT:.0%}){where}: scan them too, or fit the member"
    return at_most(BARE_FACES, share, LIMIT, says)


def _typical(density: FloatArray, area: FloatArray) -> float:
    """Points per area: that of the face in whose middle half of the area, ordered by density, has been passed."""
    order = np.argsort(density, kind="stable")
    return float(density[order][np.searchsorted(np.cumsum(area[order]), 0.5 * area.sum())])


def _extent(corners: FloatArray) -> float:
    return float(np.linalg.norm(corners[:, None] - corners[None], axis=2).max())


def _seen_past(mesh: TriangleMesh, own: BoolArray, points: FloatArray, sensors: FloatArray, spacing_m: float) -> bool:
    """Do sight lines pass before most of a face?"""
    known = np.isfinite(sensors).all(axis=1)
    if not known.any():
        return False
    piece = TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[own])
    places, face = sample_surface(piece, PLACES, seed=0)
    out = places + BEYOND * spacing_m * face_normals(piece)[face]
    return float(passed(out, np.ascontiguousarray(sensors[known]), np.ascontiguousarray(points[known]), 0.5 * spacing_m).mean()) >= PASSED
