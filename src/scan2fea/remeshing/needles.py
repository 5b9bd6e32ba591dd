"""Edges far shorter than those around them, which only remain where planes and free form meet: taken out one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.predicates import self_intersections
from scan2fea.kernel.topology import degenerate_faces, edge_table
from scan2fea.types import IntArray, TriangleMesh

SHORT = 0.15  # of the median edge
MAX_TRIES = 60
SAME_SIDE = 0.5  # cosine a face may turn by
CRUMB = 0.4  # of the median size of a face


def without_needles(mesh: TriangleMesh) -> TriangleMesh:
    """Short edges collapsed, shortest first, where one end lies on every plane the other lies on; planes stay exactly flat.

    A collapse that would turn a face over, pinch the surface or make faces cross is left out.
    """
    if len(self_intersections(mesh)):
        return mesh  # no step could prove itself harmless
    best = mesh
    refused: set[tuple[float, ...]] = set()
    for _ in range(MAX_TRIES):
        edge = _shortest(best, refused)
        if edge is None:
            break
        made = _collapsed(best, *edge) or _collapsed(best, *edge[::-1])
        if made is None:
            refused.add(_name(best, edge))
        else:
            best = made
    return best


def _name(mesh: TriangleMesh, edge: tuple[int, int]) -> tuple[float, ...]:
    """An edge by its place: its numbers change with every collapse."""
    return tuple(mesh.vertices[list(edge)].ravel().tolist())


def _shortest(mesh: TriangleMesh, refused: set[tuple[float, ...]]) -> tuple[int, int] | None:
    edges = edge_table(mesh.faces).edges
    length = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    for k in np.argsort(length, kind="stable"):
        if length[k] >= SHORT * np.median(length):
            return None
        edge = (int(edges[k, 0]), int(edges[k, 1]))
        if _name(mesh, edge) not in refused:
            return edge
    return None


def _planes_at(mesh: TriangleMesh, vertex: int) -> set[int]:
    if mesh.face_region is None:
        return set()
    return {int(r) for r in mesh.face_region[(mesh.faces == vertex).any(axis=1)] if r >= 0}


def _collapsed(mesh: TriangleMesh, gone: int, stays: int) -> TriangleMesh | None:
    """The mesh with vertex `gone` moved into `stays`, or None where that is not allowed."""
    if not _planes_at(mesh, gone) <= _planes_at(mesh, stays):
        return None
    around = (mesh.faces == gone).any(axis=1)
    if len(np.intersect1d(mesh.faces[around], mesh.faces[(mesh.faces == stays).any(axis=1)])) != 4:
        return None  # besides the two ends others than the two tips of the edge's faces: the surface would be pinched
    faces: IntArray = np.where(mesh.faces == gone, stays, mesh.faces)
    kept = ~(around & (mesh.faces == stays).any(axis=1))
    changed = around & kept
    before, after = (TriangleMesh(vertices=mesh.vertices, faces=rows[changed]) for rows in (mesh.faces, faces))
    corners = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    whole = longest[changed] > CRUMB * np.median(longest[kept])  # crumbs of a tangle may turn as they like
    turned = np.einsum("ij,ij->i", face_normals(before), face_normals(after))[whole]
    if degenerate_faces(mesh.vertices, after.faces).any() or (turned <= SAME_SIDE).any():
        return None
    moved = mesh.vertices[after.faces]
    low, high = moved.min(axis=(0, 1)), moved.max(axis=(0, 1))
    near = kept & (corners.max(axis=1) >= low).all(axis=1) & (corners.min(axis=1) <= high).all(axis=1)  # only faces that changed can cross
    if len(self_intersections(TriangleMesh(vertices=mesh.vertices, faces=faces[near | changed]))):
        return None
    region = None if mesh.face_region is None else mesh.face_region[kept]
    packed = faces[kept] - (faces[kept] > gone)
    return replace(mesh, vertices=np.delete(mesh.vertices, gone, axis=0), faces=packed, face_region=region, face_origin=None, deviation_m=None)
