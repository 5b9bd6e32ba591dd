"""What is known of a place from points and their sight lines alone: empty, full, or nothing.

A first surface closes over what is hidden and may be wrong there by as much as the hidden places are wide. Planes need no surface to label their
cells: each is large, and a part of it was seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.reconstruction.evidence import at_most
from scan2fea.reconstruction.visibility import Reconstruction
from scan2fea.reconstruction.wall_ends import passed
from scan2fea.types import BoolArray, Check, FloatArray, Scan, TriangleMesh, Value

NEAR = 3.0  # spacings from a measured point within which it tells the side
BELOW = 0.5  # of the wall under a point: so deep it is full
BESIDE = 0.25  # spacings from a sight line: empty
BLOCKED = 0.005  # of the lines may end, or run, deeper in a solid than noise lets them: a normal one leaves 0.0013 beyond 3 sigma
SIGMAS = 3.0  # of the noise: how far a line may be off
LINES = 20_000  # sight lines that are asked
UNDER, OVER = 1.0, 0.25  # spacings aside of the nearest point, below and above it: in a corner the nearest one may be of another face


@dataclass(frozen=True, eq=False, kw_only=True)
class Sight(Value):
    """points, normals : (n, 3) denoised, outward.   wall_m : (n,) under each.   origin, target : (k, 3) of sight lines.   spacing_m.

    skin_m : how deep below a face a line that only grazes it may seem to pass.
    """

    points: FloatArray
    normals: FloatArray
    wall_m: FloatArray
    origin: FloatArray
    target: FloatArray
    spacing_m: float
    skin_m: float

    @classmethod
    def of(cls, scan: Scan, first: Reconstruction, seed: int = 0, lines: int = LINES) -> Sight:
        """The points of a first surface and the lines of the scan they come from; a wall is at least a spacing where none is known."""
        sensors = scan.sensors()
        known = np.flatnonzero(np.isfinite(sensors).all(axis=1))
        known = known[sampled_rows(len(known), lines, seed)]
        return cls(
            points=first.points,
            normals=first.normals,
            wall_m=np.where(np.isfinite(first.thickness_m), first.thickness_m, first.spacing_m),
            origin=np.ascontiguousarray(sensors[known]),
            target=np.ascontiguousarray(scan.cloud.points[known]),
            spacing_m=first.spacing_m,
            skin_m=BESIDE * first.spacing_m + SIGMAS * first.sigma_m,
        )

    def told(self, places: FloatArray) -> tuple[BoolArray, BoolArray]:
        """(k,) which of (k, 3) places are full, and which are empty; those of which nothing is known are neither."""
        distance, near = k_nearest(self.points, 1, places)
        row, close = near[:, 0], distance[:, 0] <= NEAR * self.spacing_m
        height = np.einsum("ij,ij->i", places - self.points[row], self.normals[row])
        aside = np.sqrt(np.maximum(distance[:, 0] ** 2 - height**2, 0.0))
        full = close & (aside <= UNDER * self.spacing_m) & (height < 0) & (-height <= BELOW * self.wall_m[row])
        empty = close & (aside <= OVER * self.spacing_m) & (height > 0)
        left = np.flatnonzero(~full & ~empty)
        empty[left] = self.passes(places[left])
        return np.asarray(full), np.asarray(empty)

    def crossings(self, plane: Plane, beyond_m: float) -> FloatArray:
        """(k, 3) where lines cross a plane, those that begin and end farther from it than `beyond_m`."""
        start, end = plane.distance(self.origin), plane.distance(self.target)
        rows = np.flatnonzero((start * end < 0.0) & (np.minimum(np.abs(start), np.abs(end)) > beyond_m))
        share = (start[rows] / (start[rows] - end[rows]))[:, None]
        return np.asarray(self.origin[rows] + share * (self.target[rows] - self.origin[rows]))

    def passes(self, places: FloatArray) -> BoolArray:
        """(k,) places (k, 3) that a sight line passes."""
        return np.asarray(passed(np.ascontiguousarray(places), self.origin, self.target, BESIDE * self.spacing_m))


def blocked_lines(scan: Scan, mesh: TriangleMesh, spacing_m: float, sigma_m: float) -> Check:
    """How many sight lines run through the solid before they end? Those of the wall of a bore do where planes have closed it.

    Told by the depth below the face that a line meets first: the skin of `Sight` is left to noise and to faces that it grazes.
    """
    sensors = scan.sensors()
    known = np.flatnonzero(np.isfinite(sensors).all(axis=1))
    way = scan.cloud.points[known] - sensors[known]
    length = np.linalg.norm(way, axis=1)
    way = way / length[:, None]
    scene, normals, hair = scene_of(mesh), face_normals(mesh), 1e-6 * spacing_m
    near, face = first_hits(scene, sensors[known], way)
    met = np.flatnonzero((face >= 0) & (near < length))
    chord = first_hits(scene, sensors[known][met] + (near[met] + hair)[:, None] * way[met], way[met])[0]
    chord = np.minimum(chord, length[met] - near[met])
    depth = chord * np.abs(np.einsum("ij,ij->i", way[met], normals[face[met]]))
    share = float(np.sum(depth > BESIDE * spacing_m + SIGMAS * sigma_m)) / max(1, len(known))
    says = f"{share:.1%} of the sight lines run through the flat solid (limit {BLOCKED:.1%}): planes have closed what is open"
    return at_most("sight lines blocked", share, BLOCKED, says)
