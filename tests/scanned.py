"""Simulated scans of exact solids with a free line of sight from every point, for tests and benchmarks of the reconstruction."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.types import PointCloud, Rays, Scan

DENSITY = 0.85  # points per square spacing of a random sample whose mean distance to 6 neighbours is the spacing


def scanned(mesh, spacing, sigma=0.0, seed=0, away=None, tries=40):
    """Scan of a mesh: random points, normal noise of all coordinates, sensors `away` metres off in a random free direction.

    Points for which no free direction is found have no sensor. Returns the scan, the exact points and their exact normals.
    """
    rng = np.random.default_rng(seed)
    places, face = sample_surface(mesh, int(DENSITY * area(mesh) / spacing**2), seed)
    normals = face_normals(mesh)[face]
    away = 10 * float(np.ptp(mesh.vertices, axis=0).max()) if away is None else away
    scene = scene_of(mesh)
    sensors = np.full_like(places, np.nan)
    left = np.arange(len(places))
    for _ in range(tries):
        way = rng.normal(size=(len(left), 3))
        way /= np.linalg.norm(way, axis=1)[:, None]
        way *= np.where(np.einsum("ij,ij->i", way, normals[left]) < 0, -1, 1)[:, None]
        steep = np.einsum("ij,ij->i", way, normals[left]) > 0.2
        hit = first_hits(scene, places[left] + 1e-6 * spacing * normals[left], way)[1]
        free = steep & (hit < 0)
        sensors[left[free]] = places[left[free]] + away * way[free]
        left = left[~free]
    points = places + sigma * rng.normal(size=places.shape)
    return scan_of(points, sensors), places, normals


def scan_of(points, sensors=None, **columns):
    """The scan of points whose sensors stand at `sensors` (nan: not known)."""
    if sensors is None:
        return Scan(cloud=PointCloud.of(points, **columns))
    known = np.isfinite(sensors).all(axis=1)
    way = points[known] - sensors[known]
    length = np.linalg.norm(way, axis=1)
    ray = np.full(len(points), -1, np.int64)
    ray[known] = np.arange(known.sum())
    rays = Rays(origin=sensors[known], direction=way / length[:, None], range_m=length)
    return Scan(cloud=PointCloud.of(points, ray=ray, **columns), rays=rays)
