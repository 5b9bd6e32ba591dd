"""One view per object: long things lie across the picture, up stays up, and pictures that are compared share it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.types import FloatArray, Value

AZIMUTH_RAD, ELEVATION_RAD = np.radians(32.0), np.radians(24.0)
ELONGATED = 1.6  # length / width above which an object decides how it lies
STEEP = 0.8  # sine of the slope above which the long axis counts as upright
MARGIN = 0.06  # of the picture left free on every side


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera(Value):
    """A parallel projection (lengths can be read off the picture anywhere).

    axes : (3, 3) rows right, up, towards the viewer; orthonormal, right-handed.   centre : (3,) metres, seen in the middle.
    width_px, height_px : size of the picture.   m_per_px : metres per pixel of the picture.
    """

    axes: FloatArray
    centre: FloatArray
    width_px: int
    height_px: int
    m_per_px: float

    def project(self, points: FloatArray) -> FloatArray:
        """(n, 3): pixels from the left, pixels from the top, nearness to the viewer in pixels."""
        seen = (np.asarray(points, float) - self.centre) @ self.axes.T / self.m_per_px
        return np.stack([0.5 * self.width_px + seen[:, 0], 0.5 * self.height_px - seen[:, 1], seen[:, 2]], axis=1)

    def turned(self, direction: FloatArray) -> FloatArray:
        """(n, 3) directions in the axes of the picture."""
        return np.asarray(direction, float) @ self.axes.T

    @property
    def width_m(self) -> float:
        return self.width_px * self.m_per_px


def look_at(points: FloatArray, *, width_px: int = 700, height_px: int = 450, normals: FloatArray | None = None) -> Camera:
    """The view of an object: seen from a corner, its length across the picture, from the side where most of it was measured.

    normals : (n, 3) outward normals weighted by what they count (area measured), or None: then the side is the upper one.
    height_px : of the highest picture; that of a long flat thing is lower.
    """
    points = np.asarray(points, float)
    frame = _rest_frame(points)
    views = [_view(frame, azimuth, ELEVATION_RAD) for azimuth in (AZIMUTH_RAD, np.pi - AZIMUTH_RAD, -AZIMUTH_RAD, np.pi + AZIMUTH_RAD)]
    chosen = 0
    if normals is not None and len(normals):
        views += [_view(frame, azimuth, -ELEVATION_RAD) for azimuth in (AZIMUTH_RAD, np.pi + AZIMUTH_RAD)]
        normals = np.nan_to_num(normals)
        whole = max(float(np.linalg.norm(normals, axis=1).sum()), 1e-300)
        shown = [float(np.maximum(normals @ view[2], 0).sum()) / whole for view in views]
        # in steps of a fortieth: where the sides are alike the first view wins; from below only where that shows much more
        shown = [round(40 * share * (1.0 if view[2] @ frame[1] > 0 else 0.75)) for share, view in zip(shown, views, strict=True)]
        chosen = int(np.argmax(shown))
    return framed(points, views[chosen], width_px, height_px, least_height_px=int(0.42 * height_px))


def look_down(points: FloatArray, *, width_px: int = 1100, height_px: int = 640) -> Camera:
    """The view of a whole scene: from a corner, higher up. Lone points far out are left outside the picture."""
    points = np.asarray(points, float)
    frame = np.eye(3) if len(points) < 3 else _level_frame(points)
    axes = _view(frame, AZIMUTH_RAD, np.radians(38.0))
    return framed(points, axes, width_px, height_px, share=0.002)


def framed(points: FloatArray, axes: FloatArray, width_px: int, height_px: int, *, least_height_px: int | None = None, share: float = 0.0) -> Camera:
    """The camera whose picture just holds the points (all but `share` of them at each end)."""
    seen = points @ axes.T if len(points) else np.zeros((1, 3))
    low, high = (np.quantile(seen, q, axis=0) for q in (share, 1 - share)) if share else (seen.min(axis=0), seen.max(axis=0))
    span = np.maximum(high - low, 1e-12)
    fill = 1 - 2 * MARGIN
    m_per_px = float(max(span[0] / (width_px * fill), span[1] / (height_px * fill)))
    needed_px = math.ceil(span[1] / m_per_px / fill)
    height_px = max(min(needed_px, height_px), least_height_px or height_px)
    return Camera(axes=axes, centre=axes.T @ (0.5 * (low + high)), width_px=width_px, height_px=height_px, m_per_px=m_per_px)


def _view(frame: FloatArray, azimuth: float, elevation: float) -> FloatArray:
    """Rows right, up, towards the viewer, for a viewer who stands before the length of the object and walks round it by `azimuth`."""
    right, up = frame[0], frame[1]
    front = np.cross(right, up)
    level = np.cos(azimuth) * front + np.sin(azimuth) * right
    towards = np.cos(elevation) * level + np.sin(elevation) * up
    across = np.cross(up, towards)
    across = across / np.linalg.norm(across)
    return np.stack([across, np.cross(towards, across), towards])


def _rest_frame(points: FloatArray) -> FloatArray:
    """Rows: the direction that lies across the picture, and up. An upright member is laid down; others keep the up of the scan (+z)."""
    if len(points) < 3:
        return np.eye(3)[[0, 2]]
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1].T[::-1]
    axes = axes * np.where(axes[np.arange(3), np.abs(axes).argmax(axis=1)] < 0, -1.0, 1.0)[:, None]  # the sign of an eigenvector is free
    extent = np.ptp(centred @ axes.T, axis=0)
    if extent[0] < ELONGATED * extent[1]:
        return _level_frame(points)
    up = np.array([0.0, 0.0, 1.0])
    if abs(axes[0, 2]) > STEEP:  # an upright column would fill a tenth of the picture: lay it down
        up = axes[2]
    up = up - (up @ axes[0]) * axes[0]
    return np.stack([axes[0], up / np.linalg.norm(up)])


def _level_frame(points: FloatArray) -> FloatArray:
    """Rows: the longest horizontal direction, and +z."""
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    values, vectors = np.linalg.eigh(flat.T @ flat)
    along = vectors[:, 1] if values[1] > 1.05 * values[0] else np.array([1.0, 0.0])
    along = along * (-1.0 if along[np.abs(along).argmax()] < 0 else 1.0)
    return np.array([[along[0], along[1], 0.0], [0.0, 0.0, 1.0]])
