"""Knife edges, slits and needles that no tet of a solver's quality fits: drawn smooth where the surface is free form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.kernel.folds import interior_angles
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.quality import triangle_quality
from scan2fea.kernel.topology import edge_table, face_components
from scan2fea.remeshing.needles import without_needles
from scan2fea.remeshing.relax import near_faces, relaxed
from scan2fea.types import IntArray, TriangleMesh

FOLD_DEG = 15.0  # twice the flattest angle that OptiStruct takes without an error is 6; warnings start at 15
NEEDLE_DEG = 6.0
ROUNDS = 8
GIVE_UPS = 3
PASSES = 4


def folded_faces(mesh: TriangleMesh) -> IntArray:
    """Faces at a fold sharper than FOLD_DEG, from inside or from outside, or with an angle under NEEDLE_DEG."""
    pairs, angle = interior_angles(mesh)
    folds = pairs[(angle < FOLD_DEG) | (angle > 360 - FOLD_DEG)].ravel()
    needles = np.flatnonzero(triangle_quality(mesh.vertices, mesh.faces)["min_angle_deg"] < NEEDLE_DEG)
    return np.unique(np.concatenate([folds, needles]))


def flattest_deg(mesh: TriangleMesh) -> float:
    """The least angle of a fold, from inside or from outside, or of a face: no tet of the surface is much better."""
    _, angle = interior_angles(mesh)
    needle = triangle_quality(mesh.vertices, mesh.faces)["min_angle_deg"]
    return float(min(np.minimum(angle, 360 - angle).min(), needle.min()))


def meshable(mesh: TriangleMesh) -> TriangleMesh:
    """The surface without needles and folds, as far as they go: each may lay bare one of the other."""
    for _ in range(PASSES):
        mesh = unfolded(without_needles(mesh))
        if not len(folded_faces(mesh)):
            break
    return mesh


def unfolded(mesh: TriangleMesh) -> TriangleMesh:
    """The surface with its folds relaxed; never one with crossings or more folds than before.

    Free form is tried first. Where a plane holds the fold in place, the faces round it give the plane up, a ring more at every try.
    """
    best, bad = mesh, folded_faces(mesh)
    for give_up in range(GIVE_UPS + 1):
        loose = best if not give_up else free_round(best, bad, give_up)
        for attempt in range(ROUNDS):
            if not len(bad):
                return best
            smooth = relaxed(loose, near_faces(loose, bad, rings=attempt // 2), steps=2 + attempt)
            left = folded_faces(smooth)
            if len(left) < len(bad) and not len(self_intersections(smooth)):
                best, loose, bad = smooth, smooth, left
    return best


def free_round(mesh: TriangleMesh, faces: IntArray, rings: int) -> TriangleMesh:
    """The mesh with the faces within `rings` of the given ones taken out of their planes; pieces of a plane are numbered anew."""
    if mesh.face_region is None:
        return mesh
    near = near_faces(mesh, faces, rings)
    region = np.where(near[mesh.faces].any(axis=1), -1, mesh.face_region)
    held = np.flatnonzero(region >= 0)
    table = edge_table(mesh.faces[held])
    half = np.flatnonzero(table.twin >= 0)
    same = region[held[half // 3]] == region[held[table.twin[half] // 3]]
    joined = np.zeros(len(table.edges), bool)
    joined[table.edge_of[half[same]]] = True
    _, piece = face_components(mesh.faces[held], joined)
    first = np.full(int(piece.max(initial=-1)) + 1, len(held))
    np.minimum.at(first, piece, np.arange(len(held)))
    region[held] = np.argsort(np.argsort(first, kind="stable"), kind="stable")[piece]
    return replace(mesh, face_region=region)
