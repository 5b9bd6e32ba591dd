"""Other bodies around an object: one that lies on it hides what is below."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.noise import spacing
from scan2fea.types import FloatArray, PointCloud, Segments

_NEAR = 3.5  # spacings: neighbours on one surface
_LEAST = 4  # points


def bodies_around(own: PointCloud, cloud: PointCloud, segments: Segments, label: int) -> tuple[FloatArray, ...]:
    """Points (k, 3) of each other segment that reach into the box around an object, as much wider as the points lie apart; of supports none."""
    margin = _NEAR * max(spacing(own.points), 0.0)
    low, high = own.points.min(axis=0) - margin, own.points.max(axis=0) + margin
    near = (segments.labels >= 0) & (segments.labels != label)
    near[near] = ((cloud.points[near] > low) & (cloud.points[near] < high)).all(axis=1)
    found = []
    for other in np.unique(segments.labels[near]).tolist():
        points = cloud.points[near & (segments.labels == other)]
        if segments.kinds[other] != "support" and len(points) >= _LEAST:
            found.append(points)
    return tuple(found)
