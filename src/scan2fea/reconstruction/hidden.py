"""Surface that nobody saw but that the sight lines enclose: what a thing covers that stands on another one."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import PointToMesh, sample_surface
from scan2fea.kernel.measures import area, face_normals
from scan2fea.kernel.neighbors import radius_components
from scan2fea.reconstruction.isosurface import spread
from scan2fea.types import FloatArray, TriangleMesh

DENSITY = 3.0  # samples per squared spacing, of which the evenly spread ones stay
APART, FAR, JOINED = 0.8, 2.5, 2.0  # spacings: between points put there, from any measured one, and between those of one patch
LEAST = 12  # points of a patch: smaller ones any answer closes


def hidden_points(mesh: TriangleMesh, points: FloatArray, spacing_m: float, seed: int = 0) -> FloatArray:
    """(k, 3) points a spacing apart on those patches of `mesh` that lie away from all measured
    `points` of their own side; none where there are only small ones.
    """
    n = int(np.ceil(DENSITY * area(mesh) / spacing_m**2))
    on, face = sample_surface(mesh, n, seed)
    normals, far = face_normals(mesh), FAR * spacing_m
    # in six dimensions, position and half the reach times the normal: points of the far side of a thin wall are out of reach
    own = np.concatenate([points, 0.5 * far * normals[PointToMesh(mesh).nearest(points).face]], axis=1)
    near = cKDTree(own).query(np.concatenate([on, 0.5 * far * normals[face]], axis=1), distance_upper_bound=far)[0]
    found = spread(on[~np.isfinite(np.asarray(near, float))], APART * spacing_m)
    if not len(found):
        return found
    patch = radius_components(found, JOINED * spacing_m)
    return np.asarray(found[np.bincount(patch)[patch] >= LEAST])
