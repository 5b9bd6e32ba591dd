"""segments[] of report.json: what the scene fell into, and what becomes of each part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from scan2fea.pipeline.kinds import guess_row
from scan2fea.segmentation import Selection
from scan2fea.segmentation.kinds import Guess
from scan2fea.types import PointCloud, Segments


def segment_rows(cloud: PointCloud, segments: Segments, chosen: Selection, kinds: Sequence[Guess]) -> list[dict[str, Any]]:
    """segments[]: each label with role (object, support, clutter), kind, size and why it is, or is not, one to model.

    `object` is its number among the objects, if any.
    """
    rows = []
    numbers = {label: number for number, label in enumerate(chosen.labels, start=1)}  # of one that fell into members the last
    for label, (role, guess) in enumerate(zip(segments.kinds, kinds, strict=True)):
        own = cloud.points[segments.labels == label]
        low, high = (own.min(axis=0), own.max(axis=0)) if len(own) else (np.zeros(3), np.zeros(3))
        row = {"label": label, "role": role, **guess_row(guess), "n_points": len(own), "centre_m": (low + high) / 2, "size_m": high - low}
        rows.append({**row, "object": numbers.get(label), "why": chosen.why.get(label, "")})
    return rows
