"""All planes of a noisy surface, wide and narrow, with borders that can be rebuilt."""

from __future__ import annotations

import numpy as np

from scan2fea.remeshing.borders import unpinched
from scan2fea.remeshing.planes import Labelled, Neighbours, Scale, grow_planes
from scan2fea.remeshing.regions import absorbed, merged, one_piece_each, tidied, without_islands
from scan2fea.remeshing.strips import bridged, narrow_planes
from scan2fea.types import TriangleMesh

ROUNDS = 4  # each settles what the one before left open


def find_planes(mesh: TriangleMesh, neighbours: Neighbours, scale: Scale) -> Labelled:
    """One label per face: its plane, -1 for free form; each plane one piece whose border passes no vertex twice."""
    labelled = merged(mesh, neighbours, absorbed(mesh, neighbours, grow_planes(mesh, neighbours, scale), scale), scale)
    labelled = narrow_planes(mesh, neighbours, labelled, scale)
    labelled = merged(mesh, neighbours, absorbed(mesh, neighbours, labelled, scale), scale)
    for _ in range(ROUNDS):
        before = labelled.label
        for step in (bridged, without_islands, merged, unpinched, tidied):
            labelled = step(mesh, neighbours, labelled, scale)
        if np.array_equal(before, labelled.label):
            break
    return one_piece_each(mesh, neighbours, unpinched(mesh, neighbours, labelled, scale))
