"""From bare tets to a TetMesh: boundary, face tags, mid nodes, and the proof that the tets fill what they should."""

from __future__ import annotations

import numpy as np

from scan2fea.errors import MeshingError, require
from scan2fea.kernel.measures import tet_volumes
from scan2fea.kernel.quality import TET_EDGES, TET_FACES
from scan2fea.kernel.topology import surface_topology
from scan2fea.types import FloatArray, IntArray, TetMesh, TriangleMesh

VOLUME_AGREES = 1e-6  # relative: plane faces and kept triangles leave nothing to approximate


def boundary_of(tets: IntArray) -> IntArray:
    """(k, 3) faces of exactly one tet, outward, in the order of the tets. Raises MeshingError where a face has more than two tets."""
    faces = tets[:, TET_FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    require((count <= 2).all(), MeshingError, f"{int((count > 2).sum())} faces belong to more than two tets (a fault of the mesher)")
    return np.asarray(faces[np.sort(first[count == 1])], np.int64)


def tagged(boundary: IntArray, triangles: IntArray, tag: IntArray) -> IntArray:
    """(k,) tag of the triangle with the same three corners. Raises MeshingError where one has none."""
    n = int(max(boundary.max(initial=0), triangles.max(initial=0))) + 1
    known, asked = (_key(f, n) for f in (triangles, boundary))
    order = np.argsort(known)
    at = np.minimum(np.searchsorted(known[order], asked), len(order) - 1)
    lost = int((known[order[at]] != asked).sum())
    require(lost == 0, MeshingError, f"{lost} boundary triangles of the tets are not triangles of the surface (a fault of the mesher)")
    return np.asarray(tag[order[at]], np.int64)


def _key(faces: IntArray, n: int) -> IntArray:
    a, b, c = np.sort(faces, axis=1).T
    return np.asarray((a * n + b) * n + c, np.int64)


class WrongVolumeError(MeshingError):
    """Tets that are all right but do not fill what they should."""


def proved(nodes: FloatArray, tets: IntArray, boundary: IntArray, volume_m3: float, agrees: float = VOLUME_AGREES) -> None:
    """Raises MeshingError unless all tets are positive, conform, and fill `volume_m3` (to `agrees`) inside one closed manifold surface."""
    require(len(tets) > 0, MeshingError, "the mesher gave no tets: does the surface enclose a volume?")
    volumes = tet_volumes(nodes, tets)
    require((volumes > 0).all(), MeshingError, f"{int((volumes <= 0).sum())} of {len(tets)} tets have no positive volume")
    used, rows = np.unique(boundary, return_inverse=True)
    found = surface_topology(TriangleMesh(vertices=nodes[used], faces=rows.reshape(-1, 3).astype(np.int64)))
    whole = found.is_closed and found.is_manifold and found.is_oriented and found.n_components == 1
    require(whole, MeshingError, "the boundary of the tets is not one closed surface")
    off = abs(float(volumes.sum()) / volume_m3 - 1)
    says = f"the tets fill {volumes.sum():.9g} m3, the solid holds {volume_m3:.9g} m3 (limit {agrees:g} of it)"
    require(off <= agrees, WrongVolumeError, says)


def with_mid_nodes(nodes: FloatArray, tets: IntArray, boundary: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Order 2: one node half-way along each edge, after the corners, in the order of the edges; tets (m, 10), boundary (k, 6), VTK order."""
    n = len(nodes)
    ends = np.sort(tets[:, TET_EDGES], axis=2)
    key, first, number = np.unique((ends[..., 0] * n + ends[..., 1]).ravel(), return_index=True, return_inverse=True)
    middle = nodes[ends.reshape(-1, 2)[first]].mean(1)
    rim = np.sort(boundary[:, [[0, 1], [1, 2], [0, 2]]], axis=2)
    on_rim = n + np.searchsorted(key, rim[..., 0] * n + rim[..., 1])
    return np.vstack([nodes, middle]), np.hstack([tets, n + number.reshape(-1, 6)]), np.hstack([boundary, on_rim])


def tet_mesh(nodes: FloatArray, tets: IntArray, boundary: IntArray, face_tag: IntArray, face_names: tuple[str, ...], order: int) -> TetMesh:
    if order == 2:
        nodes, tets, boundary = with_mid_nodes(nodes, tets, boundary)
    return TetMesh(nodes=nodes, tets=tets, boundary=boundary, face_tag=face_tag, face_names=face_names)
