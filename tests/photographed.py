"""Simulated scans by a range camera: points in the order of its images, noise along the rays only, no sensor positions."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.types import TriangleMesh

COLUMNS, ROWS, PITCH = 176, 144, 0.0044  # a small time-of-flight camera, tangent of a pixel


def turned(mesh: TriangleMesh, rng: np.random.Generator) -> TriangleMesh:
    """The mesh about its middle, turned at random, its longest side 1."""
    axes, upper = np.linalg.qr(rng.normal(size=(3, 3)))
    axes = axes * np.sign(np.diag(upper))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    vertices = (mesh.vertices - 0.5 * (mesh.vertices.max(axis=0) + mesh.vertices.min(axis=0))) @ axes.T
    return TriangleMesh(vertices=vertices / np.ptp(vertices, axis=0).max(), faces=mesh.faces)


def photographed(mesh: TriangleMesh, n_images: int, sigma: float, seed: int, pitch: float = PITCH, aspect: float = 1.05):
    """The turned mesh of size 1, and its points (float32 in value) as images from 3 to 5 sizes away give them; the cameras' places."""
    rng = np.random.default_rng(seed)
    mesh = turned(mesh, rng)
    scene = scene_of(mesh)
    points, places = [], []
    j, i = np.meshgrid(np.arange(ROWS) - ROWS // 2, np.arange(COLUMNS) - COLUMNS // 2, indexing="ij")
    for _ in range(n_images):
        eye = rng.normal(size=3)
        eye *= rng.uniform(3, 5) / np.linalg.norm(eye)
        z = -eye / np.linalg.norm(eye) + 0.03 * rng.normal(size=3)
        z /= np.linalg.norm(z)
        x = np.cross(z, rng.normal(size=3))
        x /= np.linalg.norm(x)
        way = z + i.reshape(-1, 1) * pitch * x + j.reshape(-1, 1) * aspect * pitch * np.cross(z, x)
        way /= np.linalg.norm(way, axis=1)[:, None]
        length, face = first_hits(scene, np.tile(eye, (len(way), 1)), way)
        hit = face >= 0
        noise = sigma * rng.normal(size=hit.sum())
        points.append(eye + (length[hit] + noise)[:, None] * way[hit])
        places.append(np.tile(eye, (hit.sum(), 1)))
    return mesh, np.concatenate(points).astype(np.float32).astype(float), np.concatenate(places)
