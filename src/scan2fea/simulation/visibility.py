"""Which share of each solid's surface a sensor sees from where it stands: samples of the surface, a ray to each from each place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.rays import first_hits, ray_scene
from scan2fea.simulation.solids import Scene
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

SAMPLES = 2000  # per solid: the share is then known to 1.1 % (one standard deviation, at worst)
_ON_TARGET = 1e-9  # of the distance


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen(Value):
    """s samples on all solids. solid : (s,).   face : (s,) of the scene's mesh.   seen : (s, k) from each of k places."""

    solid: IntArray
    face: IntArray
    points: FloatArray
    seen: BoolArray

    def shares(self) -> FloatArray:
        """(n, k) share of each solid's surface that each place sees."""
        n = int(self.solid.max()) + 1
        counts = np.bincount(self.solid, minlength=n)
        return np.stack([np.bincount(self.solid, weights=column, minlength=n) / counts for column in self.seen.T], axis=1)

    def union(self) -> FloatArray:
        """(n,) share of each solid's surface that any place sees."""
        n = int(self.solid.max()) + 1
        counts = np.bincount(self.solid, minlength=n)
        return np.asarray(np.bincount(self.solid, weights=self.seen.any(axis=1).astype(float), minlength=n) / counts)


def seen_from(
    scene: Scene,
    positions: FloatArray,
    seed: int,
    *,
    max_incidence_deg: float = 90.0,
    reach_m: tuple[float, float] = (0.0, np.inf),
    n_samples: int = SAMPLES,
) -> Seen:
    """What (k, 3) places see of every solid, in all directions; hidden is what another surface, or the solid's own, stands before."""
    mesh = scene.mesh()
    target, normals = ray_scene(mesh.vertices, mesh.faces), face_normals(mesh)
    first = np.cumsum([0] + [len(s.mesh.faces) for s in scene.solids])
    drawn = [sample_surface(s.mesh, n_samples, seed + k) for k, s in enumerate(scene.solids)]
    points = np.concatenate([p for p, _ in drawn])
    face = np.concatenate([f + start for (_, f), start in zip(drawn, first, strict=False)])
    seen = np.zeros((len(points), len(positions)), bool)
    flattest = np.cos(np.radians(max_incidence_deg))
    for k, place in enumerate(positions):
        way = points - place
        distance = np.linalg.norm(way, axis=1)
        cosine = -np.einsum("ij,ij->i", way, normals[face]) / distance
        near = np.flatnonzero((cosine > max(flattest, 0.0)) & (distance >= reach_m[0]) & (distance <= reach_m[1]))
        t, _ = first_hits(target, np.broadcast_to(place, (len(near), 3)), way[near] / distance[near, None])
        seen[near, k] = t >= distance[near] * (1 - _ON_TARGET)
    solid = np.repeat(np.arange(len(scene.solids), dtype=np.int64), n_samples)
    return Seen(solid=solid, face=face.astype(np.int64), points=points, seen=seen)
