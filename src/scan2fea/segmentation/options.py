"""What the segmentation can be told."""

from __future__ import annotations

from dataclasses import dataclass

from scan2fea.options import option

LINKAGES = ("single", "complete", "average", "ward")


@dataclass(frozen=True, kw_only=True)
class SegmentationOptions:
    """How the cloud falls into objects."""

    method: str = option(
        "euclidean",
        "euclidean: parts nearer than radius_m; kmeans, fuzzy_cmeans, agglomerative, divisive: clusters of points near each other; "
        "learned: points named by a trained forest, parts of one class; primitives: planes, cylinders, spheres; given: labels of the file; "
        "single: all one object",
    )
    supports: bool = option(True, "Find floors, table tops and walls and keep them apart from what stands on them")
    members: bool = option(True, "euclidean: cut what is made of two or more long members (frames, trusses) into these")
    slenderness: float = option(
        6.0, "members: how many times as long as wide two of them must be for a cluster to fall apart; 2 cuts nodes of short tubes", minimum=1.0
    )
    radius_m: float | None = option(None, "Points nearer than this belong together; none: from the spacing of the points", unit="m", minimum=0.0)
    min_points: int = option(100, "A smaller part joins its near neighbour, or is no object", minimum=3)
    max_points: int | None = option(None, "euclidean: a larger part is no object (the thesis: 50000)", minimum=3)
    clusters: int | None = option(
        None, "kmeans, fuzzy_cmeans, agglomerative, divisive: number of clusters; none: from the data (single linkage: cut at radius_m)", minimum=2
    )
    most_clusters: int = option(20, "The largest number of clusters that is tried where it comes from the data", minimum=2, maximum=1000)
    restarts: int = option(8, "kmeans, fuzzy_cmeans: runs from different starts, of which the best is kept", minimum=1, maximum=1000)
    fuzziness: float = option(2.0, "fuzzy_cmeans: the exponent m of the memberships", minimum=1.05, maximum=10.0)
    linkage: str = option("single", "agglomerative: distance of two clusters", choices=LINKAGES)
    weights: str = option("", "learned, and the guesses of kinds: weights that `scan2fea train` wrote; empty: those shipped")
    seed: int = option(0, "Seed of the plane search and of the starts of clusters", minimum=0)


@dataclass(frozen=True, kw_only=True)
class SelectOptions:
    """Which segments are worth modelling."""

    min_points: int = option(500, "Segments of fewer points are left out", minimum=4)
    min_share: float = option(0.01, "Segments of fewer points than this share of the largest object are left out", minimum=0.0, maximum=1.0)
    max_objects: int = option(50, "At most this many objects, the largest", minimum=1)
    kinds: tuple[str, ...] = option(
        ("object",),
        "What to model: object, support, clutter; member (an object three times as long as deep); or kinds as guessed: "
        "I, L, C, T, plate, box, pipe, free form, floor, wall, unknown",
    )
    furnishing: bool = option(False, "Model boxes and heaps that stand free on the floor of a scene of members, too")
    labels: tuple[int, ...] = option((), "Only these labels of labels.csv, whatever their kind; none: all")
    least_m: float = option(0.0, "Segments whose box has a shorter diagonal are left out", unit="m", minimum=0.0)
    most_m: float | None = option(None, "Segments whose box has a longer diagonal are left out; none: no limit", unit="m", minimum=0.0)
    box_m: tuple[float, float, float, float, float, float] | None = option(
        None, "Only segments whose middle lies in this box of the input: x, y, z of one corner, then of the opposite one", unit="m"
    )
    near_m: tuple[float, float, float] | None = option(None, "Only the segment with the point nearest to this place of the input", unit="m")
