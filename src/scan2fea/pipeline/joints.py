"""Objects that neither one member nor a free form explains, as members that meet: a welded node of short tubes is one cluster of the scene.

Asked only of objects that were refused. Each member is an object of its own, held to every check of a member; free form would close it where it was
cut off its neighbour. They count where two or more are converted and hold the points of the object but for what may be clutter.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from scan2fea.estimation.explain import MAX_CLUTTER, MAX_CROWD
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.known import KnownObject
from scan2fea.pipeline.objects import parts_of
from scan2fea.pipeline.part import Part
from scan2fea.pipeline.route import RECONSTRUCTION
from scan2fea.pipeline.scene import Scene
from scan2fea.segmentation import Selection, joined_members
from scan2fea.types import Segments

Row = dict[str, Any]
Convert = Callable[[Sequence[Part], Config], tuple[list[Row], list[Row]]]


def with_joined(
    scene: Scene, segments: Segments, chosen: Selection, parts: Sequence[Part], made: Sequence[Row], config: Config, convert: Convert
) -> tuple[list[Row], list[Row], Selection]:
    """objects[] in which what is made of members that meet is these, the rows of stages[] that this took, and the selection with them.

    made : one row per part.   convert : parts to their rows and stages.   Numbers of new objects go on from the last one.
    """
    may = config.segmentation.members and config.segmentation.method == "euclidean" and config.route.mode != RECONSTRUCTION
    rows: list[Row] = []
    stages: list[Row] = []
    first = len(parts) + 1
    for part, row in zip(parts, made, strict=True):
        known = next((one for one in config.object if one.id == part.id), None)
        pieces = _pieces(scene, segments, chosen, part, first, config) if may and _is_open(part, row, known) else []
        if not pieces:
            rows.append(row)
            continue
        own = () if known is None else tuple(dataclasses.replace(known, id=piece.id) for piece in pieces)
        found: list[Row] = []
        took: list[Row] = []
        for piece in pieces:  # the largest first, and none in vain
            more, steps = convert([piece], dataclasses.replace(config, object=own))
            found, took = found + more, took + steps
            if sum(one["n_points"] for one in found if one["verdict"] != "converted") > MAX_CLUTTER * len(part.scan.cloud):
                break
        built = [one for one in found if one["verdict"] == "converted"]
        share = sum(one["n_points"] for one in built) / len(part.scan.cloud)
        if len(built) < 2 or share < 1 - MAX_CLUTTER:
            refused = [one["reason"] for one in found if one["verdict"] != "converted"]
            why = refused[0] if refused else f"these hold {share:.0%} of its points"
            rows.append({**row, "reason": f"{row['reason']}; nor is it {len(pieces)} members that meet: {why}"})
            continue
        first, stages = first + len(pieces), stages + took
        chosen = dataclasses.replace(chosen, labels=(*chosen.labels, *[chosen.labels[part.id - 1]] * len(pieces)))
        rows += [{**one, "reason": f"{one['reason']}; {_says(part, pieces, share)}"} for one in found]
    return rows, stages, chosen


def _is_open(part: Part, row: Mapping[str, Any], known: KnownObject | None) -> bool:
    """Whether an object was refused and nothing known of it is of all of it: a drawing, a length."""
    of_all = known is not None and (known.step or "length" in {**known.fixed, **known.nominal})
    return row["verdict"] != "converted" and part.mesh is None and not part.smeared and not of_all


def _pieces(scene: Scene, segments: Segments, chosen: Selection, part: Part, first: int, config: Config) -> list[Part]:
    """The members that an object may be made of, as parts numbered from `first`; none where they are not two or more."""
    label = chosen.labels[part.id - 1]
    at = np.flatnonzero((segments.labels == label) & ~scene.is_filled)
    found = joined_members(scene.scan.cloud.points[at], config.segmentation.seed, config.segmentation.min_points)
    if found is None or float((found < 0).mean()) > MAX_CROWD:  # what is of no member, but of the object, is a body that the solids would lack
        return []
    labels, n, n_pieces = segments.labels.copy(), len(segments.kinds), int(found.max()) + 1
    labels[segments.labels == label] = -1
    labels[at] = np.where(found >= 0, n + found, -1)
    cut = Segments(labels=labels, kinds=(*segments.kinds, *["object"] * n_pieces), how=segments.how)
    alone = Selection(labels=tuple(range(n, n + n_pieces)), notes=())
    made = []
    for k, piece in enumerate(parts_of(scene, cut, alone, config)):
        others = tuple(scene.scan.cloud.points[labels == n + other] for other in range(n_pieces) if other != k)
        made.append(dataclasses.replace(piece, id=first + k, cut_from=part.id, meets=others))
    return made


def _says(part: Part, pieces: Sequence[Part], share: float) -> str:
    """For the verdict's line of each piece."""
    others = ", ".join(str(piece.id) for piece in pieces)
    rest = f"; {1 - share:.0%} of its points are of none that was converted" if share < 0.995 else ""
    return f"one of the members that meet (objects {others}) in what no single member and no free form explains (object {part.id}{rest})"
