"""Faces of a solid as pictures, flat ones as they lie, round ones unrolled: a face is far larger than the gaps in it, which are sets of pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, label
from scipy.spatial import ConvexHull

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.primitives import Plane
from scan2fea.kernel.surfaces import Surface
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

PIXEL = 0.5  # spacings
MOST_PIXELS = 4e6  # of one face: a larger one is looked at more coarsely
SEAMS = 16  # places round a cylinder at which it may be opened


@dataclass(frozen=True, eq=False, kw_only=True)
class Flat(Value):
    """A plane as a sheet."""

    plane: Plane

    def laid(self, points: FloatArray) -> FloatArray:
        """(..., 2) places of points (..., 3) on the sheet."""
        return np.asarray(points @ self.plane.axes().T)

    def triangles(self, corners: FloatArray) -> FloatArray:
        """(k, 3, 2) of triangles (k, 3, 3)."""
        return self.laid(corners)

    def places(self, on: FloatArray) -> FloatArray:
        """(k, 3) of places (k, 2) on the sheet."""
        return np.asarray(on @ self.plane.axes() + self.plane.offset * self.plane.normal)

    def normals(self, on: FloatArray) -> FloatArray:
        return np.tile(self.plane.normal, (len(on), 1))


@dataclass(frozen=True, eq=False, kw_only=True)
class Rolled(Value):
    """A cylinder as a sheet, opened at an angle: arc from there, and height."""

    surface: Surface
    seam: float

    def laid(self, points: FloatArray) -> FloatArray:
        across = (points - self.surface.point) @ self.surface.frame().T
        angle = np.mod(np.arctan2(across[..., 1], across[..., 0]) - self.seam, 2 * np.pi)
        return np.stack([self.surface.radius * angle, (points - self.surface.point) @ self.surface.axis], axis=-1)

    def triangles(self, corners: FloatArray) -> FloatArray:
        laid, round_m = self.laid(corners), 2 * np.pi * self.surface.radius
        middle = self.laid(corners.mean(axis=1))[:, None, 0]
        laid[..., 0] -= round_m * np.round((laid[..., 0] - middle) / round_m)
        return laid

    def places(self, on: FloatArray) -> FloatArray:
        s = self.surface
        return np.asarray(s.point + s.radius * self._out(on) + on[:, 1:] * s.axis)

    def normals(self, on: FloatArray) -> FloatArray:
        return np.asarray(self.surface.sense * self._out(on))

    def _out(self, on: FloatArray) -> FloatArray:
        angle = on[:, 0] / self.surface.radius + self.seam
        return np.asarray(np.column_stack([np.cos(angle), np.sin(angle)]) @ self.surface.frame())


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture(Value):
    """A face in pixels.   inside : (r, c) its own.   away : (r, c) distance from its points, m.   low : (2,) corner.   pixel : size, m."""

    sheet: Flat | Rolled
    inside: BoolArray
    away: FloatArray
    low: FloatArray
    pixel: float

    def far(self, reach_m: float) -> BoolArray:
        """(r, c) pixels farther than that from the points of the face."""
        return np.asarray(self.inside & (self.away > reach_m))

    def away_from(self, places: FloatArray) -> FloatArray:
        """(r, c) distance of each pixel from places (k, 3) on the sheet, m; those off the picture do not count."""
        return _away(self.sheet.laid(places), self.low, self.pixel, self.inside.shape)

    def hull(self, corners: FloatArray) -> BoolArray:
        """(r, c) pixels in the convex hull of the corners (k, 3) of a flat face."""
        flat = (self.sheet.laid(corners) - self.low) / self.pixel
        ring = flat[ConvexHull(flat).vertices]
        return _painted(np.stack([np.broadcast_to(ring[0], ring[2:].shape), ring[1:-1], ring[2:]], axis=1), self.inside.shape)

    def places(self, at: IntArray) -> FloatArray:
        """(k, 3) middles of the pixels (k, 2)."""
        return self.sheet.places(self.low + (at + 0.5) * self.pixel)

    def normals(self, at: IntArray) -> FloatArray:
        """(k, 3) outward, there."""
        return self.sheet.normals(self.low + (at + 0.5) * self.pixel)


def pictures(mesh: TriangleMesh, points: FloatArray, spacing_m: float, reach_m: float, rolled: Mapping[int, Surface]) -> dict[int, Picture]:
    """Those of the faces (`face_region`) that have places farther than `reach_m` from their points, by number as in `regions`.

    rolled : the cylinders among the regions.
    """
    region, near, normals = regions(mesh), PointToMesh(mesh).nearest(points), face_normals(mesh)
    of, out = region[near.face], {}
    numbers = np.zeros(1, np.int64) if mesh.face_region is None else np.unique(mesh.face_region)
    for number in np.unique(region):
        own = np.flatnonzero(region == number)
        corners, seen = mesh.vertices[mesh.faces[own]], near.closest[of == number]
        surface = rolled.get(int(numbers[number]))
        if surface is None:
            plane = Plane(normal=normals[own[0]], offset=float((corners @ normals[own[0]]).mean()))
            sheet: Flat | Rolled = Flat(plane=plane)
        else:
            sheet = Rolled(surface=surface, seam=_seam(surface, seen))
        picture = _picture(sheet, corners, seen, spacing_m, reach_m)
        if picture is not None:
            out[int(number)] = picture
    return out


def _seam(surface: Surface, points: FloatArray) -> float:
    """The angle at which a cylinder is opened: where most of its points lie, so that no gap is parted."""
    across = (points - surface.point) @ surface.frame().T
    sector = np.floor(np.mod(np.arctan2(across[:, 1], across[:, 0]) / (2 * np.pi), 1.0) * SEAMS).astype(np.int64) % SEAMS
    return (int(np.argmax(np.bincount(sector, minlength=SEAMS))) + 0.5) * 2 * np.pi / SEAMS


def _picture(sheet: Flat | Rolled, corners: FloatArray, places: FloatArray, spacing_m: float, reach_m: float) -> Picture | None:
    """That of a face, None where it has no gap. corners : (k, 3, 3) its triangles.   places : (n, 3) of its points."""
    flat, seen_at = sheet.triangles(corners), sheet.laid(places)
    low, extent = flat.min(axis=(0, 1)), np.ptp(flat.reshape(-1, 2), axis=0)
    pixel = max(PIXEL * spacing_m, math.sqrt(float(np.prod(extent)) / MOST_PIXELS))
    shape = tuple((np.ceil(extent / pixel) + 1).astype(np.int64).tolist())
    away = _away(np.clip(seen_at, low, low + (np.array(shape) - 0.5) * pixel), low, pixel, shape)
    if away.max() <= reach_m:
        return None
    return Picture(sheet=sheet, inside=_painted((flat - low) / pixel, shape), away=away, low=low, pixel=pixel)


def _away(flat: FloatArray, low: FloatArray, pixel: float, shape: tuple[int, ...]) -> FloatArray:
    """(r, c) distance of each pixel from the places (k, 2) on the picture, m."""
    at = np.floor((flat - low) / pixel).astype(np.int64)
    at = at[((at >= 0) & (at < shape)).all(axis=1)]
    held = np.zeros(shape, bool)
    held[tuple(at.T)] = True
    return pixel * np.asarray(distance_transform_edt(~held), float) if len(at) else np.full(shape, math.inf)


def patches(chosen: BoolArray) -> list[IntArray]:
    """Pixels (k, 2) of each set that hangs together."""
    patch, n_patches = label(chosen)
    return [np.argwhere(patch == number) for number in range(1, n_patches + 1)]


def regions(mesh: TriangleMesh) -> IntArray:
    """(m,) number of the face that each triangle is of, from 0."""
    return np.zeros(len(mesh.faces), np.int64) if mesh.face_region is None else np.unique(mesh.face_region, return_inverse=True)[1].ravel()


def _painted(triangles: FloatArray, shape: tuple[int, ...]) -> BoolArray:
    """Pixels whose middles lie in one of the triangles (k, 3, 2), in pixels."""
    out = np.zeros(shape, bool)
    for a, b, c in triangles:
        low = np.maximum(np.floor(np.minimum(np.minimum(a, b), c) - 0.5), 0).astype(np.int64)
        high = np.minimum(np.ceil(np.maximum(np.maximum(a, b), c) + 0.5), shape).astype(np.int64)
        x, y = (np.arange(low[k], high[k]) + 0.5 for k in (0, 1))
        turns = [
            (q[0] - p[0]) * (y[None, :] - p[1]) - (q[1] - p[1]) * (x[:, None] - p[0]) for p, q in ((a, b), (b, c), (c, a))
        ]  # on its left or right, all alike inside
        out[low[0] : high[0], low[1] : high[1]] |= np.all([t >= 0 for t in turns], axis=0) | np.all([t <= 0 for t in turns], axis=0)
    return out
