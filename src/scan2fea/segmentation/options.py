"""What the segmentation can be told."""

from __future__ import annotations

from dataclasses import dataclass

from scan2fea.options import option


@dataclass(frozen=True, kw_only=True)
class SegmentationOptions:
    """How the cloud falls into objects."""

    method: str = option("euclidean", "euclidean: parts nearer than radius_m; given: labels of the file; single: all one object")
    supports: bool = option(True, "Find floors, table tops and walls and keep them apart from what stands on them")
    radius_m: float | None = option(None, "Points nearer than this belong together; none: from the spacing of the points", unit="m", minimum=0.0)
    min_points: int = option(100, "A smaller part joins its near neighbour, or is no object", minimum=3)
    seed: int = option(0, "Seed of the plane search", minimum=0)


@dataclass(frozen=True, kw_only=True)
class SelectOptions:
    """Which segments are worth modelling."""

    min_points: int = option(500, "Segments of fewer points are left out", minimum=4)
    min_share: float = option(0.01, "Segments of fewer points than this share of the largest object are left out", minimum=0.0, maximum=1.0)
    max_objects: int = option(50, "At most this many objects, the largest", minimum=1)
    kinds: tuple[str, ...] = option(("object",), "Kinds of segments to model: object, support, clutter")
