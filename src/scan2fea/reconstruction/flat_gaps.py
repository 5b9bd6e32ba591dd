"""Volume that may hide behind gaps in the faces of a flat solid: such a face is far larger than the gaps in it, so each is looked at as a picture."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import distance_transform_edt, label
from scipy.spatial import cKDTree

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.primitives import Plane
from scan2fea.reconstruction.hidden_volume import REACH, hidden_check
from scan2fea.types import BoolArray, Check, FloatArray, TriangleMesh

PIXEL = 0.5  # spacings
MOST_PIXELS = 4e6  # of one face: a larger one is looked at more coarsely
BESIDE = ((1, 0), (-1, 0), (0, 1), (0, -1))


def hidden_volume_flat(mesh: TriangleMesh, points: FloatArray, spacing_m: float) -> Check:
    """As `hidden_volume`, of a solid of flat faces (`face_region` is set), each triangle of which is larger than the gaps in it.

    A gap is what lies farther than REACH spacings from the points of its face.
    points : (n, 3) measured, or inferred from a support that was seen.
    """
    region = np.zeros(len(mesh.faces), np.int64) if mesh.face_region is None else np.unique(mesh.face_region, return_inverse=True)[1].ravel()
    near, normals, tree = PointToMesh(mesh).nearest(points), face_normals(mesh), cKDTree(points)
    of, hidden, where = region[near.face], 0.0, [np.zeros((0, 3))]
    for number in np.unique(region):
        own = np.flatnonzero(region == number)
        corners = mesh.vertices[mesh.faces[own]]
        plane = Plane(normal=normals[own[0]], offset=float((corners @ normals[own[0]]).mean()))
        for size, perimeter, places in _gaps(plane, corners, near.closest[of == number], tree, spacing_m):
            hidden += size**2 / max(perimeter, math.sqrt(size))
            where.append(places)
    return hidden_check(hidden / abs(volume(mesh)), np.concatenate(where))


def _gaps(plane: Plane, corners: FloatArray, places: FloatArray, tree: cKDTree, spacing_m: float) -> list[tuple[float, float, FloatArray]]:
    """Area, perimeter and middles of pixels of each gap in a face. corners : (k, 3, 3) its triangles.   places : (n, 3) of its points.

    Where a gap meets the outline of the face it ends if points of other faces are near (tree : of all points); else it goes on round the edge.
    """
    axes = plane.axes()
    flat, seen_at = corners @ axes.T, places @ axes.T
    low, extent = flat.min(axis=(0, 1)), np.ptp(flat.reshape(-1, 2), axis=0)
    pixel = max(PIXEL * spacing_m, math.sqrt(float(np.prod(extent)) / MOST_PIXELS))
    shape = tuple((np.ceil(extent / pixel) + 1).astype(np.int64).tolist())
    seen = np.zeros(shape, bool)
    row, column = np.clip(((seen_at - low) / pixel).astype(np.int64), 0, np.array(shape) - 1).T
    seen[row, column] = True
    away = np.full(shape, math.inf) if not len(places) else pixel * np.asarray(distance_transform_edt(~seen))
    if away.max() <= REACH * spacing_m:
        return []
    inside = _painted((flat - low) / pixel, shape)
    patch, n_patches = label(inside & (away > REACH * spacing_m))
    found = []
    for number in range(1, n_patches + 1):
        at = np.argwhere(patch == number)
        middles = (low + (at + 0.5) * pixel) @ axes + plane.offset * plane.normal
        sides = np.zeros(len(at), np.int64)
        for step in BESIDE:
            i, j = (at + step).T
            on = (i >= 0) & (j >= 0) & (i < shape[0]) & (j < shape[1])
            on[on] = inside[i[on], j[on]]
            ends = ~on
            ends[on] = patch[i[on], j[on]] != number
            outer = np.flatnonzero(~on)
            ends[outer] = np.asarray(tree.query(middles[outer])[0]) <= REACH * spacing_m
            sides += ends
        found.append((len(at) * pixel**2, pixel * float(sides.sum()), middles))
    return found


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
