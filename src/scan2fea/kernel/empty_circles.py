"""Circles in a plane that hold no point."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, QhullError

from scan2fea.types import FloatArray


def empty_circles(flat: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middles (m, 2) and radii (m,) of the circles through three of the points (n, 2) that hold no other."""
    try:
        corners = flat[Delaunay(flat).simplices]
    except QhullError:
        return np.zeros((0, 2)), np.zeros(0)
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    twice = 2.0 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    kept = np.abs(twice) > 1e-12 * (u**2).sum(axis=1)
    a, u, v, twice = a[kept], u[kept], v[kept], twice[kept]
    uu, vv = (u**2).sum(axis=1), (v**2).sum(axis=1)
    off = np.stack([v[:, 1] * uu - u[:, 1] * vv, u[:, 0] * vv - v[:, 0] * uu], axis=1) / twice[:, None]
    return a + off, np.linalg.norm(off, axis=1)
