"""Local wall thickness of a closed surface, measured inward from its faces."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import extent, face_normals
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.types import FloatArray, TriangleMesh

SAMPLES = 4000


def wall_thickness(mesh: TriangleMesh, seed: int = 0, n: int = SAMPLES) -> FloatArray:
    """(k,) distances from seeded places on the surface straight inward to the other side; k <= n, rays that leave through an edge are dropped."""
    if not len(mesh.faces):
        return np.zeros(0)
    places, face = sample_surface(mesh, n, seed)
    inward = -face_normals(mesh)[face]
    step = 1e-7 * extent(mesh.vertices)  # off the face the ray starts on
    t, hit = first_hits(scene_of(mesh), places + step * inward, inward)
    through = (hit >= 0) & np.isfinite(t)
    return np.asarray(t[through] + step)


def median_thickness(mesh: TriangleMesh, seed: int = 0) -> float:
    """Median of `wall_thickness`; nan where there is no surface."""
    found = wall_thickness(mesh, seed)
    return float(np.median(found)) if len(found) else float("nan")
