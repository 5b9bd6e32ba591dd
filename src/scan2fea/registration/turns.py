"""Motions that leave a flat face of a surface on itself: half a turn about its middle, of a square one a quarter too.

What has flat faces looks alike after such a turn more often than after any other motion: a box from behind, a table, a beam. The search by features
seldom proposes the right one of two such places, because views from opposite sides share little. So they are asked for by name.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.transforms import rigid, rotation_about
from scan2fea.registration.surface import Surface
from scan2fea.types import FloatArray

FLAT = math.cos(math.radians(15.0))  # neighbours whose normals differ by less lie on one face
LEAST = 12  # cells of a face: its middle is told to a quarter of an edge
AT_MOST = 6  # faces, the largest
_NEIGHBOURS = 8
_SQUARE_EDGES = 2.0  # sides that differ by less may be equal


def turns(surface: Surface) -> list[FloatArray]:
    """(4, 4) motions in the frame of the surface."""
    found = []
    for points, normal in _faces(surface):
        middle, sides = _rectangle(points, normal)
        quarters = (1, 2, 3) if abs(sides[0] - sides[1]) < _SQUARE_EDGES * surface.edge_m else (2,)
        for q in quarters:
            R = rotation_about(normal, q * math.pi / 2)
            found.append(rigid(R, middle - R @ middle))
    return found


def _faces(surface: Surface) -> list[tuple[FloatArray, FloatArray]]:
    """Points and normal of the flat faces, the largest first."""
    points, normals, n = surface.points, surface.normals, len(surface)
    if n <= _NEIGHBOURS:
        return []
    near = k_nearest(points, _NEIGHBOURS + 1)[1][:, 1:]
    alike = np.abs(np.einsum("nc,nkc->nk", normals, normals[near])) >= FLAT
    flat = alike.mean(axis=1) > 0.5
    joined = alike & flat[:, None] & flat[near]
    i, k = np.nonzero(joined)
    label = connected_components(coo_matrix((np.ones(len(i), np.int8), (i, near[i, k])), shape=(n, n)), directed=False)[1]
    size = np.bincount(label[flat], minlength=label.max() + 1)
    found = []
    for c in np.argsort(-size, kind="stable")[:AT_MOST]:
        rows = np.flatnonzero((label == c) & flat)
        if len(rows) < LEAST:
            break
        normal = np.linalg.eigh(normals[rows].T @ normals[rows])[1][:, 2]
        height = points[rows] @ normal
        own = rows[(np.abs(height - np.median(height)) < 0.5 * surface.edge_m) & (np.abs(normals[rows] @ normal) >= FLAT)]
        if len(own) >= max(LEAST, 0.5 * len(rows)):  # a bent one has no such turn
            found.append((points[own], normal))
    return found


def _rectangle(points: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle (3,) and sides (2,) of the smallest rectangle about a flat face."""
    centre = points.mean(axis=0)
    u = np.linalg.svd(normal[None])[2][1:]
    flat = (points - centre) @ u.T
    try:
        hull = flat[ConvexHull(flat).vertices]
    except QhullError:
        return centre, np.array([np.inf, 0.0])
    best = (math.inf, centre, np.zeros(2))
    for side in np.roll(hull, -1, axis=0) - hull:
        x = side / max(float(np.linalg.norm(side)), 1e-300)
        axes = np.array([x, [-x[1], x[0]]])
        low, high = (hull @ axes.T).min(axis=0), (hull @ axes.T).max(axis=0)
        area = float(np.prod(high - low))
        if area < best[0]:
            best = (area, centre + 0.5 * (low + high) @ axes @ u, high - low)
    return best[1], best[2]
