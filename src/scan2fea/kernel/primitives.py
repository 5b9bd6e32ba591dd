"""Planes through noisy points, and where planes meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.types import FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Plane:
    """Points x with normal . x = offset. normal : (3,) unit, outward where it bounds a solid.   rms_m : of the points it was fitted to."""

    normal: FloatArray
    offset: float
    rms_m: float = 0.0

    def distance(self, points: FloatArray) -> FloatArray:
        """(n,) signed distance of (n, 3) points, positive along the normal."""
        return np.asarray(points @ self.normal - self.offset)

    def projected(self, points: FloatArray) -> FloatArray:
        """(n, 3) points moved along the normal onto the plane."""
        return np.asarray(points - self.distance(points)[:, None] * self.normal)

    def axes(self) -> FloatArray:
        """(2, 3) unit vectors in the plane; with the normal they are right-handed."""
        first = np.cross(self.normal, np.eye(3)[np.abs(self.normal).argmin()])
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(self.normal, first)])


def fit_plane(points: FloatArray, weights: FloatArray | None = None, towards: FloatArray | None = None) -> Plane:
    """Weighted least squares plane through (n, 3) points, n >= 3; its normal has a positive part along `towards`."""
    w = np.ones(len(points)) if weights is None else weights
    mean = w @ points / w.sum()
    local = points - mean
    values, vectors = np.linalg.eigh((local * w[:, None]).T @ local / w.sum())
    normal = vectors[:, 0]
    if towards is not None and normal @ towards < 0:
        normal = -normal
    return Plane(normal=normal, offset=float(normal @ mean), rms_m=float(np.sqrt(max(values[0], 0.0))))


def meeting_point(planes: list[Plane], near: FloatArray, rank_tolerance: float = 0.1) -> FloatArray:
    """The point common to the planes that is nearest to `near` (3,): a corner of three, a foot on the line of two, on one plane.

    Directions in which the planes barely differ (singular value under `rank_tolerance`) are left as in `near`.
    """
    normals = np.stack([plane.normal for plane in planes])
    gaps = np.array([plane.offset - plane.normal @ near for plane in planes])
    u, s, vt = np.linalg.svd(normals, full_matrices=False)
    keep = s > rank_tolerance
    step = vt[keep].T @ ((u[:, keep].T @ gaps) / s[keep])
    point = near + step
    for _ in range(2):  # a second step takes out the rounding of the first
        gaps = np.array([plane.offset - plane.normal @ point for plane in planes])
        point = point + vt[keep].T @ ((u[:, keep].T @ gaps) / s[keep])
    return np.asarray(point)
