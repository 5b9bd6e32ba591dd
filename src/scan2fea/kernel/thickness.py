"""Local wall thickness of a closed surface, measured inward from its faces."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import extent, face_normals
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.types import FloatArray, TriangleMesh

SAMPLES = 4000


def places_on(mesh: TriangleMesh, seed: int = 0, n: int = SAMPLES) -> FloatArray:
    """(n, 3) seeded places on the surface, uniform in area."""
    return sample_surface(mesh, n, seed)[0]


def thickness_at(mesh: TriangleMesh, places: FloatArray) -> FloatArray:
    """(n,) thickness of a closed surface at the points of it nearest to `places` (n, 3): straight inward to the other side, nan where nothing is met.

    The same places on two surfaces tell what happened to each wall; medians of their own samples would mix walls of different thickness.
    """
    nearest = PointToMesh(mesh).nearest(places)
    inward = -face_normals(mesh)[nearest.face]
    step = 1e-7 * extent(mesh.vertices)  # off the face the ray starts on
    t, hit = first_hits(scene_of(mesh), nearest.closest + step * inward, inward)
    return np.where((hit >= 0) & np.isfinite(t), t + step, np.nan)


def face_thickness(mesh: TriangleMesh) -> FloatArray:
    """(m,) way through the material from the middle of each face along its inward normal; nan where no other face is met."""
    if not len(mesh.faces):
        return np.zeros(0)
    inward = -face_normals(mesh)
    step = 1e-7 * extent(mesh.vertices)
    t, hit = first_hits(scene_of(mesh), mesh.vertices[mesh.faces].mean(axis=1) + step * inward, inward)
    return np.where((hit >= 0) & np.isfinite(t), t + step, np.nan)


def wall_thickness(mesh: TriangleMesh, seed: int = 0, n: int = SAMPLES) -> FloatArray:
    """(k,) thickness at seeded places; k <= n, rays that leave through an edge are dropped."""
    if not len(mesh.faces):
        return np.zeros(0)
    found = thickness_at(mesh, places_on(mesh, seed, n))
    return found[np.isfinite(found)]


def median_thickness(mesh: TriangleMesh, seed: int = 0) -> float:
    """Median of `wall_thickness`; nan where there is no surface."""
    found = wall_thickness(mesh, seed)
    return float(np.median(found)) if len(found) else float("nan")
