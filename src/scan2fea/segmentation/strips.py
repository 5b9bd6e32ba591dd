"""Strips beside an object: narrow things as long as it is, which may be all that was seen of another wall of it, or of the rest of it.

Of a tee whose web hides its own sides from the scanner only the end of the web is left, a strip far off the flange: connectivity makes it an
object of its own; of an I whose web was half seen there are a flange and a tee. Whether it goes on where the member goes on is for estimation to
say (`estimation.beside`).
"""

from __future__ import annotations

import numpy as np

from scan2fea.types import FloatArray, PointCloud, Segments

_LONG = 0.5  # of the object's own length
_NARROW = 0.25  # of its length, a strip's width
_LEAST = 30  # points


def strips_beside(own: PointCloud, cloud: PointCloud, segments: Segments, label: int) -> tuple[FloatArray, ...]:
    """Points (k, 3) of each strip in a box around the object, as far out again as that is wide; of its own label none, of supports none."""
    low, high = own.points.min(axis=0), own.points.max(axis=0)
    extent = _spread(own.points)
    margin = 2 * extent[1]
    near = (segments.labels >= 0) & (segments.labels != label)
    near[near] = ((cloud.points[near] > low - margin) & (cloud.points[near] < high + margin)).all(axis=1)
    found = []
    for other in np.unique(segments.labels[near]).tolist():
        points = cloud.points[near & (segments.labels == other)]
        if segments.kinds[other] == "support" or len(points) < _LEAST:
            continue
        size = _spread(points)
        if size[0] > _LONG * extent[0] and size[1] < _NARROW * size[0]:
            found.append(points)
    return tuple(found)


def _spread(points: FloatArray) -> FloatArray:
    """(3,) sizes along the principal axes, largest first: of what is spread evenly, from the root mean square."""
    if len(points) < 2:
        return np.zeros(3)
    middle = points - points.mean(axis=0)
    return np.asarray(np.sqrt(12 * np.maximum(np.linalg.eigvalsh(middle.T @ middle / len(points))[::-1], 0.0)))
