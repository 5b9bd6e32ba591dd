"""What is wrong with a surface that no mesher could fill, by place: needles and folds."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.planar_regions import edge_pairs
from scan2fea.kernel.quality import triangle_angles
from scan2fea.types import FloatArray, TriangleMesh

SUSPECT_DEG = 5.0  # no tet can have a larger angle than the wedge or the triangle it fills; verification asks for 5


def smallest_angles(mesh: TriangleMesh) -> tuple[float, FloatArray, float, FloatArray]:
    """Smallest angle of a triangle and its place, smallest angle between neighbouring faces (on either side) and its place; degrees, metres."""
    angle = np.degrees(triangle_angles(mesh.vertices, mesh.faces)).min(1)
    needle = int(angle.argmin())
    pairs = edge_pairs(np.asarray(mesh.faces), len(mesh.vertices))
    normal = face_normals(mesh)
    a, b = normal[pairs[:, 0]], normal[pairs[:, 1]]
    sharp = 180.0 - np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(1)))
    flat = ~(a.any(1) & b.any(1))  # beside a face without area there is no angle
    sharp[flat] = 180.0
    fold = int(sharp.argmin())
    place = mesh.vertices[pairs[fold, 2:]].mean(0)
    return float(angle[needle]), mesh.vertices[mesh.faces[needle]].mean(0), float(sharp[fold]), place


def faults_in_words(mesh: TriangleMesh) -> str:
    """A sentence on the worst needle and the worst fold; empty where neither is suspect."""
    needle, needle_at, fold, fold_at = smallest_angles(mesh)
    parts = []
    if fold < SUSPECT_DEG:
        parts.append(f"it folds back on itself to {fold:.2g} deg at {_place(fold_at)}")
    if needle < SUSPECT_DEG:
        parts.append(f"its thinnest triangle has {needle:.2g} deg at {_place(needle_at)}")
    return f"; of the surface: {', '.join(parts)}" if parts else ""


def _place(point: FloatArray) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point.tolist()) + ") m"
