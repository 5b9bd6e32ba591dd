"""Knife edges, slits and needles that no tet of a solver's quality fits: drawn smooth where the surface is free form."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.folds import interior_angles
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.quality import triangle_quality
from scan2fea.remeshing.relax import near_faces, relaxed
from scan2fea.types import IntArray, TriangleMesh

FOLD_DEG = 15.0  # twice the flattest angle that OptiStruct takes without an error is 6; warnings start at 15
NEEDLE_DEG = 6.0
ROUNDS = 8


def folded_faces(mesh: TriangleMesh) -> IntArray:
    """Faces at a fold sharper than FOLD_DEG, from inside or from outside, or with an angle under NEEDLE_DEG."""
    pairs, angle = interior_angles(mesh)
    folds = pairs[(angle < FOLD_DEG) | (angle > 360 - FOLD_DEG)].ravel()
    needles = np.flatnonzero(triangle_quality(mesh.vertices, mesh.faces)["min_angle_deg"] < NEEDLE_DEG)
    return np.unique(np.concatenate([folds, needles]))


def unfolded(mesh: TriangleMesh) -> TriangleMesh:
    """The surface with its folds relaxed, a ring wider each second round; never one with crossings or more folds than before."""
    best, bad = mesh, folded_faces(mesh)
    for attempt in range(ROUNDS):
        if not len(bad):
            break
        smooth = relaxed(best, near_faces(best, bad, rings=attempt // 2), steps=2 + attempt)
        left = folded_faces(smooth)
        if len(left) < len(bad) and not len(self_intersections(smooth)):
            best, bad = smooth, left
    return best
