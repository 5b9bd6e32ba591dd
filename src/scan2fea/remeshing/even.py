"""Even triangles on a surface that was drawn, fine enough that its curved faces can be told.

The triangles of a file from a CAD program are as long as a plane and as thin as a chord of a circle. Neither says where a face ends: a search that
grows faces over triangles needs many small ones on each. What they leave of a curve is its chords, which lie inside it by their height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.measures import face_areas, face_normals
from scan2fea.kernel.quality import triangle_quality
from scan2fea.kernel.topology import edge_table
from scan2fea.remeshing.exact import SHARP_DEG, drawn
from scan2fea.remeshing.remesh import POOR_DEG, RemeshOptions, remesh
from scan2fea.types import TriangleMesh, Value

FACES = 40_000  # a detail is told from about six edges on: a fortieth of the size of a compact part
MORE = 2  # times as many may come out where it bends or is thin
THIN = 0.3  # share of the area in triangles of less than POOR_DEG from which the edges of a file are those of a drawing
FLAT_RAD = 1e-4  # faces that turn by less are of one plane
CHORDS = 0.95  # quantile of the heights that stands for all


@dataclass(frozen=True, eq=False, kw_only=True)
class Evened(Value):
    """mesh : of even triangles.   edge_m : their edge length.   chord_m : by how much drawn curves bulge beyond it; 0 of planes alone."""

    mesh: TriangleMesh
    edge_m: float
    chord_m: float


def looks_drawn(mesh: TriangleMesh) -> bool:
    """Whether a mesh holds exact planes, or the thin triangles of curves that were cut into chords."""
    areas = face_areas(mesh)
    is_thin = triangle_quality(mesh.vertices, mesh.faces)["min_angle_deg"] < POOR_DEG
    return float(areas[is_thin].sum()) >= THIN * float(areas.sum()) or drawn(mesh) is not None


def evened(mesh: TriangleMesh, n_faces: int = FACES) -> Evened:
    """A drawn surface in even triangles. mesh : closed, manifold, free of crossings (`repair`); raises MeshingError as `remesh` does."""
    edge = math.sqrt(float(face_areas(mesh).sum()) / n_faces * 4 / math.sqrt(3))
    even = remesh(mesh, RemeshOptions(edge_m=edge, max_faces=MORE * n_faces), spacing_m=edge, sigma_m=0.0).mesh
    return Evened(mesh=even, edge_m=edge, chord_m=chord_height(mesh))


def chord_height(mesh: TriangleMesh) -> float:
    """By how much the curves that a mesh was drawn from bulge beyond its faces, metres: of two that turn by an angle a over a width w, a w / 8."""
    table, normal = edge_table(mesh.faces), face_normals(mesh)
    half = np.flatnonzero(table.twin > np.arange(len(table.twin)))
    f, g = half // 3, table.twin[half] // 3
    angle = np.arctan2(np.linalg.norm(np.cross(normal[f], normal[g]), axis=1), (normal[f] * normal[g]).sum(axis=1))
    ends = table.edges[table.edge_of[half]]
    length = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    areas = face_areas(mesh)
    width = 2 * np.minimum(areas[f], areas[g]) / np.maximum(length, 1e-300)
    bends = (angle > FLAT_RAD) & (angle < math.radians(SHARP_DEG))
    return float(np.quantile(angle[bends] * width[bends] / 8, CHORDS)) if bends.any() else 0.0
