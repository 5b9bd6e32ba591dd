"""The face an object rests on: it was never seen, but the support it touches says where it is."""

from __future__ import annotations

from scan2fea.types import PointCloud, Segments


def contact_points(own: PointCloud, cloud: PointCloud, segments: Segments, label: int) -> PointCloud:
    """The object's points, with inferred ones on its resting face where they are certain. For now: the points as they are."""
    return own
