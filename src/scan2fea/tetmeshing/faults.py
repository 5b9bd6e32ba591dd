"""What is wrong with a surface that no mesher could fill, by place: open edges, crossings, needles and folds."""

from __future__ import annotations

import numpy as np

from scan2fea.errors import MeshingError, require
from scan2fea.kernel.measures import face_normals, volume
from scan2fea.kernel.planar_regions import edge_pairs
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.quality import triangle_angles
from scan2fea.kernel.topology import surface_topology
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


def require_solid(mesh: TriangleMesh) -> None:
    """Raises MeshingError with the count of what keeps the surface from bounding one solid."""
    found = surface_topology(mesh)
    says = f"the surface is open: {found.n_boundary_edges} edges belong to one face only; repair it first"
    require(found.n_boundary_edges == 0, MeshingError, says)
    bad = found.n_nonmanifold_edges + found.n_repeated_directed_edges + found.n_pinched_vertices
    says = f"the surface is not manifold or not oriented at {bad} edges and vertices; repair it first"
    require(bad == 0, MeshingError, says)
    says = f"the surface consists of {found.n_components} shells, one inside or beside another; one object must be one shell"
    require(found.n_components == 1, MeshingError, says)
    held = volume(mesh)
    require(held > 0, MeshingError, f"the surface encloses {held:.6g} m3: it is inside out or flat; repair it first")


def faults_in_words(mesh: TriangleMesh) -> str:
    """A sentence on crossing faces, the worst needle and the worst fold; empty where nothing is suspect."""
    needle, needle_at, fold, fold_at = smallest_angles(mesh)
    parts = []
    crossed = self_intersections(mesh)
    if len(crossed):
        place = mesh.vertices[mesh.faces[crossed[0]]].reshape(-1, 3).mean(0)
        parts.append(f"{len(crossed)} pairs of its faces cross, one at {_place(place)}")
    if fold < SUSPECT_DEG:
        parts.append(f"it folds back on itself to {fold:.2g} deg at {_place(fold_at)}")
    if needle < SUSPECT_DEG:
        parts.append(f"its thinnest triangle has {needle:.2g} deg at {_place(needle_at)}")
    return f"; of the surface: {', '.join(parts)}" if parts else ""


def _place(point: FloatArray) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point.tolist()) + ") m"
