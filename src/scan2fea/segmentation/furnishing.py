"""What stands about in a scene of members: crates and heaps on the floor, which nobody asked to have modelled.

A box is furniture only where everything says so: at least two members are there (the scan is one of a structure), it looks like a box or a heap, it
is no member itself, it stands on a floor, and it touches nothing else: a pedestal carries a column, a block is bolted to a beam.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import spacing
from scan2fea.types import FloatArray, IntArray, PointCloud, Segments

KINDS = ("box", "clutter")
_STRUCTURE = 2  # members that make a structure
_REACH = 4.0  # spacings of the coarser one of two things that touch
_TAIL = 0.002


def furnishing(cloud: PointCloud, segments: Segments, names: Sequence[str], members: Collection[int]) -> list[int]:
    """Labels of the boxes and heaps that stand free on a floor of a scene with two members or more.

    names : kind of each segment ("floor", "box", ...).   members : labels of the slender objects.
    """
    if len(members) < _STRUCTURE:
        return []
    objects = [label for label, role in enumerate(segments.kinds) if role == "object"]
    asked = [label for label in objects if names[label] in KINDS and label not in members]
    floors = [cloud.points[segments.labels == label] for label, role in enumerate(segments.kinds) if role == "support" and names[label] == "floor"]
    found = []
    for label in asked:
        own = cloud.points[segments.labels == label]
        others = cloud.points[np.isin(segments.labels, [other for other in objects if other != label])]
        if any(_stands_on(own, floor) for floor in floors) and not _touches(own, others):
            found.append(label)
    return found


def _stands_on(own: FloatArray, floor: FloatArray) -> bool:
    """Whether the points (n, 3) begin at the plane of the floor (m, 3), above a part of it that was seen."""
    middle = floor.mean(axis=0)
    values, axes = np.linalg.eigh((floor - middle).T @ (floor - middle) / len(floor))
    height = (own - middle) @ axes[:, 0]
    height = height if np.median(height) >= 0 else -height
    reach = _REACH * max(spacing(floor), spacing(own)) + 3.0 * float(np.sqrt(max(values[0], 0.0)))
    foot = own[height <= reach]
    is_down = abs(float(np.quantile(height, _TAIL))) <= reach
    return bool(is_down and len(foot) and k_nearest(floor, 1, foot)[0].min() <= reach)


def _touches(own: FloatArray, others: FloatArray) -> bool:
    if not len(others):
        return False
    distance, near = k_nearest(others, 1, own)
    nearest: IntArray = near[:, 0]
    k = int(distance[:, 0].argmin())
    around = others[np.linalg.norm(others - others[nearest[k]], axis=1) <= float(np.linalg.norm(np.ptp(own, axis=0)))]
    return bool(distance[k, 0] <= _REACH * max(spacing(own), spacing(around)))
