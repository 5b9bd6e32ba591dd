"""The plain faults of a triangle mesh: repeated, flat and unused parts, faces that look the wrong way, edges with too many faces."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.kernel.measures import vertex_normals, volume
from scan2fea.kernel.topology import corner_fans, degenerate_faces, edge_table, face_components, half_edges
from scan2fea.types import BoolArray, IntArray, TriangleMesh

PART = 0.01  # of the shortest edge at a vertex: how far it is drawn from its twin


def taken(mesh: TriangleMesh, keep: BoolArray) -> TriangleMesh:
    """The faces of `keep`, with their columns; vertices stay."""
    columns: dict[str, Any] = {name: None if (old := getattr(mesh, name)) is None else old[keep] for name in ("face_origin", "face_region")}
    return replace(mesh, faces=mesh.faces[keep], **columns)


def without_unused(mesh: TriangleMesh) -> TriangleMesh:
    """Vertices that no face uses left out; the order is kept."""
    used, packed = np.unique(mesh.faces, return_inverse=True)
    deviation = None if mesh.deviation_m is None else mesh.deviation_m[used]
    return replace(mesh, vertices=mesh.vertices[used], faces=packed.reshape(-1, 3).astype(np.int64), deviation_m=deviation)


def merged_vertices(mesh: TriangleMesh) -> TriangleMesh:
    """Vertices at exactly equal places made one (what STL files need)."""
    _, first, inverse = np.unique(mesh.vertices, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first, kind="stable"), kind="stable")  # keep the order of first appearance
    order = np.sort(first)
    deviation = None if mesh.deviation_m is None else mesh.deviation_m[order]
    return replace(mesh, vertices=mesh.vertices[order], faces=rank[inverse.ravel()][mesh.faces].astype(np.int64), deviation_m=deviation)


def without_duplicates(mesh: TriangleMesh) -> TriangleMesh:
    """Faces over the same three vertices: one stays where their number is odd, none where two look opposite ways (a folded sheet)."""
    key = np.sort(mesh.faces, axis=1)
    _, inverse, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.ravel()
    first = np.unique(inverse, return_index=True)[1]
    turn = np.array([1, -1])[_is_odd(mesh.faces, key)]
    balance = np.bincount(inverse, weights=turn, minlength=len(count))
    keep = np.zeros(len(key), bool)
    keep[first] = (count == 1) | (balance != 0)
    return taken(mesh, keep)


def _is_odd(faces: IntArray, key: IntArray) -> IntArray:
    """1 where a face runs through its sorted vertices backwards."""
    start = faces.argmin(axis=1)
    second = faces[np.arange(len(faces)), (start + 1) % 3]
    return np.asarray(second != key[:, 1], np.int64)


def without_flat_faces(mesh: TriangleMesh) -> TriangleMesh:
    """Faces with a repeated vertex or without area taken out; a flat face between distinct vertices is folded into its neighbour across its
    longest edge, so that no crack opens.
    """
    f = mesh.faces
    repeated = (f[:, 0] == f[:, 1]) | (f[:, 1] == f[:, 2]) | (f[:, 2] == f[:, 0])
    mesh = taken(mesh, ~repeated)
    for _ in range(20):
        flat = np.flatnonzero(degenerate_faces(mesh.vertices, mesh.faces))
        if not len(flat):
            break
        table = edge_table(mesh.faces)
        ends = half_edges(mesh.faces)
        length = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1).reshape(-1, 3)
        faces, touched, drop = mesh.faces.copy(), np.zeros(len(mesh.faces), bool), np.zeros(len(mesh.faces), bool)
        for face in flat:
            h = 3 * int(face) + int(length[face].argmax())
            twin = int(table.twin[h])
            if touched[face] or (twin >= 0 and touched[twin // 3]):
                continue
            touched[face] = True
            if twin < 0:
                drop[face] = True
                continue
            apex, across = faces[face, (h + 2) % 3], faces[twin // 3, (twin + 2) % 3]
            a, b = ends[h]
            touched[twin // 3] = True
            faces[face], faces[twin // 3] = (a, across, apex), (across, b, apex)
            drop[face] |= len({int(a), int(across), int(apex)}) < 3
            drop[twin // 3] |= len({int(b), int(across), int(apex)}) < 3
        mesh = taken(replace(mesh, faces=faces), ~drop)
    return mesh


def oriented(mesh: TriangleMesh) -> TriangleMesh:
    """Neighbours made to agree over every edge of two faces, breadth first, then each component turned outward by its volume.

    A component inside another keeps looking outward: cavities are told apart by `components`.
    """
    table = edge_table(mesh.faces)
    ends = half_edges(mesh.faces)
    pair = table.twin
    flip = np.zeros(len(mesh.faces), bool)
    seen = np.zeros(len(mesh.faces), bool)
    same_way = np.zeros(len(pair), bool)
    known = pair >= 0
    same_way[known] = ends[known, 0] == ends[pair[known], 0]
    if same_way.any():
        for seed in range(len(mesh.faces)):
            if seen[seed]:
                continue
            seen[seed] = True
            queue = deque([seed])
            while queue:
                f = queue.popleft()
                for h in (3 * f, 3 * f + 1, 3 * f + 2):
                    g = int(pair[h]) // 3
                    if pair[h] < 0 or seen[g]:
                        continue
                    seen[g] = True
                    flip[g] = flip[f] ^ bool(same_way[h])
                    queue.append(g)
    faces = np.where(flip[:, None], mesh.faces[:, ::-1], mesh.faces)
    mesh = replace(mesh, faces=faces)
    n, label = face_components(faces)
    for part in range(n):
        of = label == part
        if volume(taken(mesh, of)) < 0:
            faces = np.where(of[:, None], faces[:, ::-1], faces)
    return replace(mesh, faces=faces)


def without_fins(mesh: TriangleMesh) -> TriangleMesh:
    """Sheets with an open border that hang on crowded edges of something without one taken off."""
    table = edge_table(mesh.faces)
    if not (table.count > 2).any():
        return mesh
    n, part = face_components(mesh.faces, table.count == 2)
    is_open = np.zeros(n, bool)
    is_open[part[np.flatnonzero(table.count[table.edge_of] == 1) // 3]] = True
    if is_open.all() or not is_open.any():
        return mesh
    return taken(mesh, ~is_open[part])


def split_fans(mesh: TriangleMesh) -> TriangleMesh:
    """Edges of more than two faces and pinched vertices cut open: every fan of faces gets a vertex of its own."""
    table = edge_table(mesh.faces)
    crowded = table.count[table.edge_of] > 2
    faces = mesh.faces
    fan = corner_fans(faces, table) if not crowded.any() else _fans_without(faces, crowded)
    flat = faces.ravel()
    pairs, inverse = np.unique(np.stack([flat, fan], axis=1), axis=0, return_inverse=True)
    if len(pairs) == len(np.unique(flat)):
        return mesh
    deviation = None if mesh.deviation_m is None else mesh.deviation_m[pairs[:, 0]]
    return replace(mesh, vertices=mesh.vertices[pairs[:, 0]], faces=inverse.reshape(-1, 3).astype(np.int64), deviation_m=deviation)


def parted(mesh: TriangleMesh) -> TriangleMesh:
    """Vertices at the same place drawn a little into their own side, so that fans that were cut apart do not touch, in any file format."""
    _, place, count = np.unique(mesh.vertices, axis=0, return_inverse=True, return_counts=True)
    twins = np.flatnonzero(count[place.ravel()] > 1)
    if not len(twins):
        return mesh
    ends = half_edges(mesh.faces)
    shortest = np.full(len(mesh.vertices), np.inf)
    np.minimum.at(shortest, ends[:, 0], np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1))
    points = mesh.vertices.copy()
    points[twins] -= PART * shortest[twins, None] * vertex_normals(mesh)[twins]
    return replace(mesh, vertices=points)


def _fans_without(faces: IntArray, crowded: BoolArray) -> IntArray:
    """Fans when the half-edges of `crowded` join nothing: each such half-edge gets an edge of its own."""
    flat = faces.ravel()
    ends = half_edges(faces)
    table = edge_table(faces)
    join = np.flatnonzero(~crowded & (table.twin > np.arange(len(flat))))
    other = table.twin[join]
    corner_end = join // 3 * 3 + (join + 1) % 3
    other_end = other // 3 * 3 + (other + 1) % 3
    same = ends[join, 0] == ends[other, 0]
    a = np.concatenate([join, corner_end])
    b = np.concatenate([np.where(same, other, other_end), np.where(same, other_end, other)])
    graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(len(flat), len(flat)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)
