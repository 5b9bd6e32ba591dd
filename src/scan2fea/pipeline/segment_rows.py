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

    `object` is its number among the objects, if any; of one that fell into members that meet the first of theirs, and `why` names all.
    """
    rows = []
    for label, (role, guess) in enumerate(zip(segments.kinds, kinds, strict=True)):
        own = cloud.points[segments.labels == label]
        low, high = (own.min(axis=0), own.max(axis=0)) if len(own) else (np.zeros(3), np.zeros(3))
        row = {"label": label, "role": role, **guess_row(guess), "n_points": len(own), "centre_m": (low + high) / 2, "size_m": high - low}
        numbers = [number for number, one in enumerate(chosen.labels, start=1) if one == label]
        why, pieces = chosen.why.get(label, ""), numbers[1:]
        why += f"; it fell into members that meet: objects {', '.join(map(str, pieces))}" if pieces else ""
        rows.append({**row, "object": next(iter(pieces or numbers), None), "why": why})
    return rows
