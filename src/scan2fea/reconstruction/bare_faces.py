"""Faces of a flat solid on which too few points lie to say that they were seen: planes meet there because nothing said otherwise.

Planes that reach beyond their points close a solid wherever others cut them, and what a scan left out beyond such a face nobody knows. A face
that was seen holds as many points for its area as the others; noise carries some of its neighbours' points onto it, so few are as bad as none.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import pdtr

from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.kernel.primitives import Plane
from scan2fea.reconstruction.blurred_faces import from_outline
from scan2fea.reconstruction.budget import BARE_FACES
from scan2fea.reconstruction.evidence import around, at_most
from scan2fea.reconstruction.plane_growing import tolerance_m
from scan2fea.reconstruction.wall_ends import BEYOND, passed
from scan2fea.types import BoolArray, Check, FloatArray, TriangleMesh

LIMIT = 0.02  # of the volume: as behind ends of walls
CHANCE, CHANCE_HALF = 0.0025, 0.05  # of so few points at the density of the other faces, and at half of it
PLACES = 64  # of a face, where sight lines are asked for
LEAST_INNER = 12  # points that make a plane, away from the edges of a face: beyond what noise carries points of others
ASKED = 1000  # places of a face
PASSED = 0.5  # of them: the face was seen to end there


def bare_faces(mesh: TriangleMesh, points: FloatArray, sensors: FloatArray, spacing_m: float, sigma_m: float) -> Check:
    """How much may hide beyond faces that have too few points? points : (n, 3).   sensors : (n, 3) where each was seen from, nan: not known.

    A face of area A whose farthest corners are L apart hides A L / pi: a strip at the end of a wall as much as a half disc of it.
    """
    region = np.zeros(len(mesh.faces), np.int64) if mesh.face_region is None else np.unique(mesh.face_region, return_inverse=True)[1].ravel()
    areas = face_areas(mesh)
    area = np.asarray(np.bincount(region, areas), float)
    near = PointToMesh(mesh).nearest(points)
    held = np.bincount(region[near.face], minlength=len(area))
    typical = _typical(held / np.maximum(area, np.finfo(float).tiny), area)
    due = typical * area
    bare = np.flatnonzero((pdtr(held, due) <= CHANCE) & (pdtr(held, 0.5 * due) <= CHANCE_HALF))
    seen = [
        _seen_past(mesh, region == r, points, sensors, spacing_m)
        or _seen_in_part(mesh, region == r, near.closest[region[near.face] == r], typical, spacing_m, sigma_m)
        for r in bare
    ]
    bare = bare[~np.array(seen, bool)]
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


def _seen_in_part(mesh: TriangleMesh, own: BoolArray, places: FloatArray, typical: float, spacing_m: float, sigma_m: float) -> bool:
    """Is a face measured as densely as the others where it is, away from its edges? Then it was seen, and the rest of it is a gap (`flat_gaps`).

    places : (n, 3) of its points on it.   typical : points per area.
    """
    axes = Plane(normal=face_normals(mesh)[own][0], offset=0.0).axes()
    if not len(places):
        return False
    inner = -tolerance_m(spacing_m, sigma_m)
    within = places[from_outline(mesh, own, axes, places) < inner]
    if len(within) < LEAST_INNER:
        return False
    asked = sample_surface(TriangleMesh(vertices=mesh.vertices, faces=mesh.faces[own]), ASKED, seed=0)[0]
    near = np.asarray(cKDTree(within).query(asked)[0]) <= spacing_m
    covered = float(np.mean(near & (from_outline(mesh, own, axes, asked) < inner))) * float(face_areas(mesh)[own].sum())
    return bool(pdtr(len(within), 0.5 * typical * covered) > CHANCE_HALF)


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
