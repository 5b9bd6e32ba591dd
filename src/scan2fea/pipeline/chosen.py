"""Which segments of a scene are modelled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scan2fea.pipeline.objects import with_faces
from scan2fea.pipeline.scene import Scene
from scan2fea.segmentation import Selection, SelectOptions, select
from scan2fea.types import Segments


def chosen_of(scene: Scene, segments: Segments, options: SelectOptions, names: Sequence[str] = ()) -> Selection:
    """What `select` says, its places read as those of the input: the scene may be shifted. names : of the segments, what each is."""
    shift = scene.shift_m
    box = None if options.box_m is None else tuple((np.array(options.box_m) - np.tile(shift, 2)).tolist())
    near = None if options.near_m is None else tuple((np.array(options.near_m) - shift).tolist())
    return select(scene.scan.cloud, segments, replace(options, box_m=box, near_m=near), with_faces(scene, segments), names)
