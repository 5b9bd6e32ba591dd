"""The open sheet through the points of an object of which no solid can be made: what was measured, with the borders it has."""

from __future__ import annotations

import numpy as np

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.coverage import HOLE_SPACINGS
from scan2fea.kernel.delaunay import tetrahedralise
from scan2fea.kernel.noise import spacing
from scan2fea.reconstruction.advancing_front import front
from scan2fea.reconstruction.denoise import denoise, first_normals
from scan2fea.reconstruction.sensors import outer_side
from scan2fea.reconstruction.thin import distinct, thinned
from scan2fea.reconstruction.visibility import KNOWN_SHARE, LEAST_POINTS
from scan2fea.types import FloatArray, Scan, TriangleMesh


def open_sheet(scan: Scan, max_points: int = 150_000, seed: int = 0) -> TriangleMesh:
    """The triangles of the advancing front through the denoised points: manifold with borders, each piece turned one way; gaps wider
    than HOLE_SPACINGS stay open.

    Sensors tell the outer side where half of the points have one; else the plain front does, piece by piece, and its triangles lend the points their
    normals. Inferred points are left out. Raises ReconstructionError for fewer than LEAST_POINTS points or points that coincide.
    """
    cloud = scan.cloud
    seen = scan if cloud.is_inferred is None else Scan(cloud=cloud.take(np.flatnonzero(~cloud.is_inferred)), rays=scan.rays)
    seen = thinned(distinct(seen), max_points)
    points = seen.cloud.points
    require(len(points) >= LEAST_POINTS, ReconstructionError, f"{len(points)} points are too few for a sheet (limit {LEAST_POINTS})")
    h = spacing(points, seed)
    require(h > 0, ReconstructionError, "all points coincide: there is no sheet to find")
    sensors = seen.sensors()
    known = np.isfinite(sensors).all(axis=1).mean() >= KNOWN_SHARE
    toward = outer_side(points, sensors, seen.cloud.normals) if known else _by_front(points, h, seed)
    normals, sigma, _ = first_normals(points, toward, h)
    clean = denoise(points, normals, h, sigma)
    faces = front(tetrahedralise(clean.points, h, seed), clean.normals).faces
    corners = clean.points[faces]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    used, packed = np.unique(faces[longest <= HOLE_SPACINGS * h], return_inverse=True)  # what is wider was not measured
    return TriangleMesh(vertices=clean.points[used], faces=packed.reshape(-1, 3).astype(np.int64))


def _by_front(points: FloatArray, spacing_m: float, seed: int) -> FloatArray:
    """(n, 3) unit normals of the triangles that the plain front takes at each point; zero at points it leaves out."""
    faces = front(tetrahedralise(points, spacing_m, seed)).faces
    a, b, c = (points[faces[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    total = np.stack([np.bincount(faces.ravel(), weights=np.repeat(weighted[:, k], 3), minlength=len(points)) for k in range(3)], axis=1)
    unit: FloatArray = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.finfo(float).tiny)
    return unit
