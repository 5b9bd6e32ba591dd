"""Kinds of the segments of a scene: guessed before anything is modelled, given by a person, or known once a member was built.

They are told and can be selected by. What an object is modelled as, and its verdict, never depend on them: they stay outside of its own process.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from scan2fea.kernel.distances import sample_surface
from scan2fea.pipeline.results import number
from scan2fea.pipeline.scene import Scene
from scan2fea.segmentation import Selection
from scan2fea.segmentation.kinds import UNKNOWN, Guess, guess_kinds, segment_kinds
from scan2fea.segmentation.options import SegmentationOptions
from scan2fea.segmentation.weights import weights_named
from scan2fea.types import Segments

BUILT_KINDS = {"RHS": "rectangular tube", "CHS": "pipe", "rect": "rectangular bar", "round": "round bar"}  # other families are words already
SHAPES = ("plate", "box", "free form")  # guesses that an object which no member explains may go by
_ON_A_MESH = 5_000


def kinds_of(scene: Scene, segments: Segments, options: SegmentationOptions = SegmentationOptions()) -> tuple[Guess, ...]:
    """One guess per segment: what a person gave, else what the network says of the measured points (of points spread over a given mesh).

    Raises InputError for weights that cannot be read.
    """
    network = weights_named(options.weights).network
    measured = ~scene.is_filled
    cloud = scene.scan.cloud.take(measured)
    seen = Segments(labels=segments.labels[measured], kinds=segments.kinds, how={})
    found = list(segment_kinds(network, cloud, seen, options.seed))
    for given in scene.meshes:
        labels = segments.labels[scene.scan.cloud.frame == given.frame]
        label = int(labels.max(initial=-1))
        if label >= 0 and len(given.mesh.faces):
            (guess,) = guess_kinds(network, [sample_surface(given.mesh, _ON_A_MESH, options.seed)[0]], options.seed)
            found[label] = Guess(kind=guess.kind, confidence=guess.confidence, source="mesh")
    for label, name in enumerate(segments.named):
        if name:
            found[label] = Guess(kind=name, confidence=math.nan, source="user")
    return tuple(found)


def guess_row(guess: Guess) -> dict[str, Any]:
    """kind, confidence (three digits, cut off: the last ones of a network are those of the machine, and no guess is certain) and who says so."""
    sure = number(guess.confidence)
    return {"kind": guess.kind, "confidence": None if sure is None else min(math.floor(1000 * sure) / 1000, 0.999), "source": guess.source}


def with_kinds(objects: Sequence[Mapping[str, Any]], chosen: Selection, kinds: Sequence[Guess]) -> list[dict[str, Any]]:
    """objects[] with `kind`: that of the member it was built as, else the guess, which is told beside it as `guess`.

    An object that was converted as no member is no angle, and no clutter either, whatever it looked like: then it is a free form.
    """
    rows = []
    for row in objects:
        guess = kinds[chosen.labels[row["id"] - 1]]
        family = (row.get("member") or {}).get("family")
        is_shape = row.get("verdict") != "converted" or guess.kind in SHAPES or guess.source == "user"
        kind = BUILT_KINDS.get(family, family) if family else guess.kind if is_shape else "free form"
        rows.append({**row, "kind": kind, "guess": guess_row(guess)})
    return rows


def names_of(segments: Segments, kinds: Sequence[Guess]) -> list[str]:
    """What to call each segment: its kind, or its role where that is not known."""
    return [role if guess.kind == UNKNOWN else guess.kind for role, guess in zip(segments.kinds, kinds, strict=True)]


def n_kinds(kinds: Sequence[Guess]) -> int:
    """How many different ones there are."""
    return len(np.unique([guess.kind for guess in kinds])) if kinds else 0
