"""Where points lie to the outline of a section."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.edges_distance import edges_distance
from scan2fea.types import FloatArray, IntArray, Section


def outline_distance(shape: Section, xy: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Signed distance (n,) of points (n, 2) to the outline, negative inside; the nearest edge (n,) over all loops, and how far along it (n,) m."""
    start = np.ascontiguousarray(np.concatenate(shape.loops), float)
    way = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    return edges_distance(start, way, np.ascontiguousarray(xy, float))
