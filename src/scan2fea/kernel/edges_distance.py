"""Where points of a plane lie to the edges of polygons."""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray


@jit
def edges_distance(start: FloatArray, way: FloatArray, xy: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Signed distance (n,) of points xy (n, 2) to closed rings of edges, negative inside; the nearest edge (n,), and how far along it (n,).

    start, way : (e, 2) where each edge begins and what leads to its end, in any order.
    """
    n = len(xy)
    distance, edge, along = np.empty(n), np.zeros(n, np.int64), np.zeros(n)
    square = way[:, 0] ** 2 + way[:, 1] ** 2
    for i in range(n):
        x, y = xy[i, 0], xy[i, 1]
        best, at, share, odd = np.inf, 0, 0.0, False
        for e in range(len(start)):
            dx, dy = x - start[e, 0], y - start[e, 1]
            t = min(max((dx * way[e, 0] + dy * way[e, 1]) / square[e], 0.0), 1.0) if square[e] > 0.0 else 0.0
            ex, ey = dx - t * way[e, 0], dy - t * way[e, 1]
            d = ex * ex + ey * ey
            if d < best:
                best, at, share = d, e, t
            up = way[e, 1]
            if up != 0.0 and (start[e, 1] > y) != (start[e, 1] + up > y) and dx < dy * way[e, 0] / up:
                odd = not odd
        distance[i] = -math.sqrt(best) if odd else math.sqrt(best)
        edge[i], along[i] = at, share * math.sqrt(square[at])
    return distance, edge, along
