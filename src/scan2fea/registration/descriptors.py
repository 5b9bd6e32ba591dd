"""The 66-partition feature: how far the surroundings of a point reach in 66 directions of its own frame (thesis 2.3.1).

The directions are the vertices of an octahedron split twice (6, 18, 66). The thesis assigns each neighbour to a partition and sums rho, its
distance; raw sums follow the density of the points, so neighbours are weighted by eq 2.1 and the feature has length 1.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.registration.frame import SIGNS
from scan2fea.registration.keypoints import within
from scan2fea.types import FloatArray, IntArray

N_BINS = 66


def octahedral_directions(times: int = 2) -> FloatArray:
    """(6, 18, 66, ... 3) unit vectors: vertices of an octahedron whose edges were halved `times` times, pushed to the unit sphere.

    The set is its own mirror image in each coordinate plane, which is why turning a frame by its signs only permutes the partitions.
    """
    vertices = [np.array(v, float) for v in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]]
    faces = [(a, b, c) for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    for _ in range(times):
        middle: dict[tuple[int, int], int] = {}

        def half(i: int, j: int, known: dict[tuple[int, int], int] = middle) -> int:
            key = (min(i, j), max(i, j))
            if key not in known:
                m = vertices[i] + vertices[j]
                known[key] = len(vertices)
                vertices.append(m / np.linalg.norm(m))
            return known[key]

        finer = []
        for a, b, c in faces:
            ab, bc, ca = half(a, b), half(b, c), half(c, a)
            finer += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = finer
    return np.array(vertices)


DIRECTIONS = octahedral_directions()
# row v: where each partition goes when the frame takes its signs v
PERMUTATION = np.array([[int(np.argmax(DIRECTIONS @ (d * s))) for d in DIRECTIONS] for s in SIGNS])


def descriptors(points: FloatArray, rows: IntArray, frames: FloatArray, weight: FloatArray, radius_m: float) -> FloatArray:
    """(m, 66) features of some of the points in their frames (m, 3, 3), each of length 1 (0 where a point is alone).

    weight : (n,) of eq 2.1. Partition = nearest of the 66 directions; its value is the square root of the share of sum w rho (Hellinger: the
    distance of two features is then that of two distributions).
    """
    begin, near = within(points, rows, radius_m)
    xyz = np.ascontiguousarray(points, float)
    bins = _sums(xyz, np.ascontiguousarray(rows, np.int64), np.ascontiguousarray(frames), weight, begin, near, DIRECTIONS)
    total = bins.sum(axis=1, keepdims=True)
    return np.asarray(np.sqrt(np.divide(bins, total, out=np.zeros_like(bins), where=total > 0)))


def turned(features: FloatArray, variant: int) -> FloatArray:
    """The features as they would be in the frame with its signs `variant`."""
    return np.asarray(features[:, PERMUTATION[variant]])


@jit
def _sums(
    points: FloatArray, rows: IntArray, frames: FloatArray, weight: FloatArray, begin: IntArray, near: IntArray, directions: FloatArray
) -> FloatArray:
    bins = np.zeros((len(rows), len(directions)))
    for r in range(len(rows)):
        p = rows[r]
        for a in range(begin[r], begin[r + 1]):
            q = near[a]
            if q == p:
                continue
            dx, dy, dz = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2]
            x = frames[r, 0, 0] * dx + frames[r, 1, 0] * dy + frames[r, 2, 0] * dz
            y = frames[r, 0, 1] * dx + frames[r, 1, 1] * dy + frames[r, 2, 1] * dz
            z = frames[r, 0, 2] * dx + frames[r, 1, 2] * dy + frames[r, 2, 2] * dz
            best, most = 0, -np.inf
            for d in range(len(directions)):
                along = x * directions[d, 0] + y * directions[d, 1] + z * directions[d, 2]
                if along > most:
                    best, most = d, along
            bins[r, best] += weight[q] * np.sqrt(dx * dx + dy * dy + dz * dz)
    return bins
