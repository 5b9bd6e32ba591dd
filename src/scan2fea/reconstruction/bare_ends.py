"""Ends of the part that nobody saw: caps over what the scan left open, which the whole part lies behind.

A pipe seen from the side alone, or a bar, is closed by a cap at either end: of little area, and hiding little by it. Where it ends, and whether it is
hollow, nobody knows. A gap in a smooth surface is none: there the points round it look the way the cap does; round an end they look aside.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.reconstruction.evidence import Evidence, around, at_most
from scan2fea.reconstruction.hidden_volume import REACH, bare_faces_of
from scan2fea.reconstruction.wall_ends import JOINED, ends_part, joined
from scan2fea.types import Check, FloatArray

BARE_ENDS = "ends of the part without points"
SIGMAS = 3.0  # of the noise: how rugged a plane may be, besides JOINED spacings
BESIDE = 2.0  # of REACH from a cap: the points round it
ASIDE = 0.7  # cosine between these and the cap: on a smooth surface they look as it does


def bare_ends(evidence: Evidence) -> Check:
    """How many caps without points of their own are ends of the part?

    A cap is flat, the whole part lies behind its plane, more than half of that plane lies in circles without a point, of which its faces are the
    middles, and the points round it look aside. So the mouth of a tube of which the rim alone was seen is such a cap.
    """
    mesh, reach_m = evidence.mesh, REACH * evidence.spacing_m
    near, normals, areas = evidence.nearest_backed, face_normals(mesh), face_areas(mesh)
    looks = normals[near.face]
    bare = bare_faces_of(mesh, near.closest, looks, reach_m)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    rough = JOINED * evidence.spacing_m + SIGMAS * evidence.sigma_m
    caps = [own for own in joined(mesh.faces, np.flatnonzero(bare)) if ends_part(own, mesh, normals, areas, rough, reach_m)]
    tree = cKDTree(near.closest) if len(near.closest) else None
    ends = [middle[own] for own in caps if _looks_aside(tree, looks, middle[own], areas[own] @ normals[own], BESIDE * reach_m)]
    n = len(ends)
    says = (
        f"nobody saw where the part ends, at {n} of its ends{around(np.concatenate([np.zeros((0, 3)), *ends]))}: it may go on there, or be hollow; "
        "scan the ends too, or fit the member"
    )
    return at_most(BARE_ENDS, float(n), 0.0, says)


def _looks_aside(tree: cKDTree | None, looks: FloatArray, cap: FloatArray, way: FloatArray, reach_m: float) -> bool:
    """Do the points round a cap, (k, 3) middles of its faces, look aside of its `way`, most of them? looks : (n, 3) normals at those of the tree."""
    if tree is None:
        return True
    rows = np.unique(np.concatenate([np.asarray(own, np.int64) for own in tree.query_ball_point(cap, reach_m)]))
    return not len(rows) or float(np.median(looks[rows] @ way)) < ASIDE * float(np.linalg.norm(way))
