"""Where points lie to the outline of a section."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scan2fea.kernel.edges_distance import edges_distance
from scan2fea.kernel.sections import ROUND, drawn
from scan2fea.types import FloatArray, IntArray, Section


def edge_lengths(shape: Section) -> FloatArray:
    """(edges,) length of each edge of a section over all loops, m."""
    return np.concatenate([np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1) for loop in shape.loops])


def outline_distance(shape: Section, xy: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Signed distance (n,) of points (n, 2) to the outline, negative inside; the nearest edge (n,) over all loops, and how far along it (n,) m."""
    start = np.ascontiguousarray(np.concatenate(shape.loops), float)
    way = np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in shape.loops])
    return edges_distance(start, way, np.ascontiguousarray(xy, float))


def section_distance(family: str, values: Mapping[str, float], xy: FloatArray, *, filled: bool = False) -> FloatArray:
    """Signed distance (n,) of points (n, 2) to the section of a family, negative in its material. filled : without its opening; circles are exact."""
    if family in ROUND:
        r, radius = np.hypot(xy[:, 0], xy[:, 1]), values["d"] / 2
        return r - radius if filled or "t" not in values else np.maximum(r - radius, radius - values["t"] - r)
    shape = drawn(family, values)
    outer = Section(family=family, loops=shape.loops[:1], face_names=shape.face_names[:1])
    return outline_distance(outer if filled else shape, xy)[0]
