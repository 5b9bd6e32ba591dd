"""Which segments are worth modelling. What is left out stays in the cloud, with its label and the reason."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from scan2fea.segmentation.options import SelectOptions
from scan2fea.types import PointCloud, Segments

KINDS = ("object", "support", "clutter")


@dataclass(frozen=True, kw_only=True)
class Selection:
    """labels : of the objects to model, largest first, ties by the first point.   notes : one sentence per segment left out, or per group of them.

    why : label -> why it is modelled or is not, in a few words.
    """

    labels: tuple[int, ...]
    notes: tuple[str, ...]
    why: Mapping[int, str] = field(default_factory=dict)


def select(cloud: PointCloud, segments: Segments, options: SelectOptions = SelectOptions(), given: Collection[int] = ()) -> Selection:
    """The segments of the wanted kinds that have enough points, largest first.

    given : labels of segments that came with faces: of those no number of points is too few, for the vertices of a mesh do not tell its size.
    The order depends on the points alone: by number of points, descending, then by the first point.
    """
    n = len(segments.kinds)
    counts = np.bincount(segments.labels[segments.labels >= 0], minlength=n)
    first = np.full(n, len(cloud))
    np.minimum.at(first, segments.labels[segments.labels >= 0], np.flatnonzero(segments.labels >= 0))
    order = sorted((label for label in range(n) if counts[label]), key=lambda label: (-counts[label], first[label]))
    wanted = [label for label in order if segments.kinds[label] in options.kinds]
    least = max(float(options.min_points), options.min_share * max((counts[label] for label in wanted), default=0))
    enough = {label: bool(counts[label] >= least or label in given) for label in wanted}
    chosen = [label for label in wanted if enough[label]]
    left_out = {f"of kind {kind}": [label for label in order if segments.kinds[label] == kind] for kind in KINDS if kind not in options.kinds}
    few = f"with fewer than {round(least)} points (select.min_points, select.min_share)"
    left_out[few] = [label for label in wanted if not enough[label]]
    left_out[f"beyond select.max_objects = {options.max_objects}"] = chosen[options.max_objects :]
    why = {label: f"not modelled: {reason}" for reason, labels in left_out.items() for label in labels}
    labels = tuple(chosen[: options.max_objects])
    why |= {label: f"to be modelled: object {number}" for number, label in enumerate(labels, start=1)}
    notes = (_note(labels, reason) for reason, labels in left_out.items())
    return Selection(labels=labels, notes=tuple(note for note in notes if note), why=why)


def _note(labels: list[int], why: str) -> str:
    """What was left out and why; empty if nothing was."""
    if not labels:
        return ""
    shown = ", ".join(str(label) for label in labels[:8]) + (", ..." if len(labels) > 8 else "")
    return f"not modelled: {len(labels)} segment{'s' if len(labels) > 1 else ''} {why} (label {shown})"
