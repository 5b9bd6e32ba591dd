"""Planes that were grown become regions: given the rounded bands along creases, merged, freed of islands and specks, each in one piece."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scan2fea.kernel.primitives import fit_plane
from scan2fea.kernel.topology import face_components
from scan2fea.remeshing.planes import Labelled, Neighbours, Scale, inner_vertices
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh

ISLAND_AREA = 12.0  # square spacings: larger pieces of free form are features
SPECK_AREA = 7.0  # square spacings: smaller pieces of a plane are not worth a face
PARALLEL = 0.94  # cosine of normals: planes nearer to parallel do not meet in a crease
MERGE_DEG = 12.0  # two neighbours under this angle are one plane or none


def absorbed(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """Faces between planes given to the nearest one where every vertex lies on it or on another plane next to the gap that is not parallel to it:
    the chamfers by which a reconstruction cuts off its creases.
    """
    label = labelled.label.copy()
    n_planes = len(labelled.offset)
    if not n_planes:
        return labelled
    on = np.abs(mesh.vertices @ labelled.normal.T - labelled.offset) <= labelled.loose  # (n, p)
    meets = (np.abs(labelled.normal @ labelled.normal.T) < PARALLEL) | np.eye(n_planes, dtype=bool)
    centre = mesh.vertices[mesh.faces].mean(1)
    for _ in range(200):
        front = np.flatnonzero((label < 0) & (label[neighbours.of] >= 0).any(1))
        if not len(front):
            break
        part = np.full(len(label), -1, np.int64)
        part[label < 0] = face_components(mesh.faces[label < 0])[1]
        around = planes_around(label, neighbours.of, part, n_planes)[part[front]]
        best, best_cost = np.full(len(front), -1, np.int64), np.full(len(front), np.inf)
        for side in range(3):
            k = label[neighbours.of[front, side]]
            usable = (around & meets[k])[:, None, :]
            covered = (on[mesh.faces[front]] & usable).any(2).all(1)
            height = np.abs(np.einsum("ij,ij->i", centre[front], labelled.normal[k]) - labelled.offset[k])
            facing = np.einsum("ij,ij->i", neighbours.normals[front], labelled.normal[k])
            fits = (k >= 0) & covered & (height <= scale.reach_m)
            cost = np.where(fits, height + 0.5 * scale.spacing_m * (1 - facing), np.inf)
            better = cost < best_cost
            best[better], best_cost[better] = k[better], cost[better]
        taken = best >= 0
        if not taken.any():
            break
        label[front[taken]] = best[taken]
    return replace(labelled, label=label)


def merged(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """Neighbouring regions of one plane made one: those whose joint fit holds the vertices of both. Of two that are nearly parallel yet not one
    plane the smaller becomes free form: their line of intersection would be anywhere.
    """
    label = labelled.label.copy()
    normal, offset = labelled.normal.copy(), labelled.offset.copy()
    while True:
        a, b = label[neighbours.table.twin // 3], np.repeat(label, 3)
        pairs = np.unique(np.stack([a, b], axis=1)[(a < b) & (a >= 0)], axis=0)
        close = pairs[np.einsum("ij,ij->i", normal[pairs[:, 0]], normal[pairs[:, 1]]) > np.cos(np.radians(MERGE_DEG))] if len(pairs) else pairs
        if not len(close):
            return replace(labelled, label=label, normal=normal, offset=offset)
        i, j = close[0]
        rows = np.flatnonzero((label == i) | (label == j))
        inner = inner_vertices(mesh, rows)
        if len(inner) >= 3:
            plane = fit_plane(mesh.vertices[inner], towards=normal[i])
            far = [np.percentile(np.abs(plane.distance(mesh.vertices[mesh.faces[label == k]].reshape(-1, 3))), 90) for k in (i, j)]
        if len(inner) >= 3 and max(far) <= max(labelled.loose[i], labelled.loose[j]):
            label[rows] = i
            normal[i], offset[i] = plane.normal, plane.offset
        else:
            areas = [neighbours.areas[label == k].sum() for k in (i, j)]
            label[label == (i, j)[int(areas[1] < areas[0])]] = -1


def planes_around(label: IntArray, of: IntArray, part: IntArray, n_planes: int) -> BoolArray:
    """(parts, planes) True where a plane borders an unlabelled part."""
    out = np.zeros((int(part.max(initial=-1)) + 1, n_planes), bool)
    face, side = np.nonzero((part >= 0)[:, None] & (label[of] >= 0))
    out[part[face], label[of[face, side]]] = True
    return out


def without_islands(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """Islands of free form whose vertices all lie near the planes around them, face by face given to the nearest of these.

    Near: within reach for a small island, within the noise for a large one (a fillet is larger and farther). A small one inside a single plane is
    filled however deep it is: nothing of its size can be told from an outlier. Not where two of the planes are parallel: between the sides of a
    plate the island is the wall of a hole.
    """
    label = labelled.label.copy()
    free = np.flatnonzero(label < 0)
    if not len(free) or not len(labelled.offset):
        return labelled
    n_parts, part = face_components(mesh.faces[free])
    area = np.bincount(part, weights=neighbours.areas[free], minlength=n_parts)
    order = np.argsort(part, kind="stable")
    start = np.searchsorted(part[order], np.arange(n_parts + 1))
    for number in range(n_parts):
        rows = free[order[start[number] : start[number + 1]]]
        names = np.unique(label[neighbours.of[rows]])
        names = names[names >= 0]
        cosine = np.abs(labelled.normal[names] @ labelled.normal[names].T)
        if not len(names) or (cosine - np.eye(len(names)) > PARALLEL).any():
            continue
        gap = np.abs(mesh.vertices[mesh.faces[rows]] @ labelled.normal[names].T - labelled.offset[names])  # (f, 3, p)
        small = area[number] < ISLAND_AREA * scale.spacing_m**2
        if (small and len(names) == 1) or gap.min(2).max() <= (scale.reach_m if small else scale.strip_m):
            label[rows] = names[gap.max(1).argmin(1)]
    return replace(labelled, label=label)


def tidied(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, scale: Scale) -> Labelled:
    """Specks of planes given to the neighbour with the longest common border that they lie near to."""
    label = labelled.label.copy()
    lengths = np.linalg.norm(mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, -1, axis=1)], axis=2)
    for _ in range(6):
        same = label[neighbours.table.twin // 3] == np.repeat(label, 3)
        joined = np.zeros(len(neighbours.table.edges), bool)
        joined[neighbours.table.edge_of[same]] = True
        n, part = face_components(mesh.faces, joined)
        area = np.bincount(part, weights=neighbours.areas, minlength=n)
        small = (area[part] < SPECK_AREA * scale.spacing_m**2) & (label >= 0)
        before = label.copy()
        for number in np.unique(part[small]):
            rows = np.flatnonzero(part == number)
            label[rows] = _best_neighbour(mesh, neighbours, labelled, label, rows, lengths, scale.reach_m)
        if np.array_equal(label, before):
            break
    return replace(labelled, label=label)


def _best_neighbour(
    mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled, label: IntArray, rows: IntArray, lengths: FloatArray, reach: float
) -> int:
    """The label with the longest common border with `rows`; -1 if they lie too far from that plane."""
    beyond = label[neighbours.of[rows]].ravel()
    other = beyond != label[rows[0]]
    if not other.any():
        return int(label[rows[0]])
    names, index = np.unique(beyond[other], return_inverse=True)
    winner = int(names[np.bincount(index, weights=lengths[rows].ravel()[other]).argmax()])
    if winner >= 0 and np.abs(mesh.vertices[mesh.faces[rows]] @ labelled.normal[winner] - labelled.offset[winner]).max() > reach:
        return -1
    return winner


def one_piece_each(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled) -> Labelled:
    """Pieces of one plane that do not touch become regions of their own, numbered by first face."""
    label = labelled.label
    same = label[neighbours.table.twin // 3] == np.repeat(label, 3)
    joined = np.zeros(len(neighbours.table.edges), bool)
    joined[neighbours.table.edge_of[same]] = True
    _, part = face_components(mesh.faces, joined)
    on_plane = np.flatnonzero(label >= 0)
    if not len(on_plane):
        return Labelled(label=label, normal=np.zeros((0, 3)), offset=np.zeros(0), loose=np.zeros(0))
    _, first, packed = np.unique(part[on_plane], return_index=True, return_inverse=True)
    out = np.full(len(label), -1, np.int64)
    out[on_plane] = packed
    old = label[on_plane[first]]
    return Labelled(label=out, normal=labelled.normal[old], offset=labelled.offset[old], loose=labelled.loose[old])


def centred(mesh: TriangleMesh, neighbours: Neighbours, labelled: Labelled) -> Labelled:
    """Each plane moved along its normal until its faces enclose as much as before: for a surface that bulges between the creases that it rounds."""
    rows = np.flatnonzero(labelled.label >= 0)
    name = labelled.label[rows]
    normal = labelled.normal[name]
    facing = neighbours.areas[rows] * np.einsum("ij,ij->i", neighbours.normals[rows], normal)
    height = np.einsum("ij,ij->i", mesh.vertices[mesh.faces[rows]].mean(1), normal)
    n = len(labelled.offset)
    weight, total = np.bincount(name, facing, n), np.bincount(name, facing * height, n)
    return replace(labelled, offset=np.where(weight > 0, total / np.where(weight > 0, weight, 1.0), labelled.offset))
