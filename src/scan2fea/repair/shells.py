"""Closed shells that stand apart in one file are as many bodies: an assembly, a plate of parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from scan2fea.kernel.distances import sample_surface, signed_distance
from scan2fea.kernel.measures import area, extent
from scan2fea.kernel.topology import face_components, surface_topology
from scan2fea.repair.clean import merged_vertices, oriented, taken, without_unused
from scan2fea.types import BoolArray, IntArray, TriangleMesh

_TOUCH = 1e-2  # of the smaller one's size: parts that fit into each other cross by the facets of their curves
_SAMPLES = 2_000
_MOST = 500  # shells: more are no assembly, and asking each pair would take long


def bodies(mesh: TriangleMesh, small: float) -> IntArray:
    """(n,) number from 0, the largest first, of the body that each vertex belongs to; all 0 where the file is one body.

    small : shells of less than this share of the largest one's area are no bodies of their own. It is one body, too, where a shell is open: pieces
    of a broken surface are no parts. A shell inside another, or through it, belongs to it: a cavity, or parts to be united.
    """
    one = np.zeros(len(mesh.vertices), np.int64)
    whole = merged_vertices(mesh)  # the faces stay as they are numbered
    n, label = face_components(whole.faces)
    if not 1 < n <= _MOST:
        return one
    shells = [oriented(without_unused(taken(whole, label == k))) for k in range(n)]
    areas = np.array([area(shell) for shell in shells])
    large = np.flatnonzero(areas >= small * areas.max())
    if len(large) < 2 or any(surface_topology(shells[k]).n_boundary_edges for k in large):
        return one
    pairs = [(i, j) for i in large for j in large if i != j and _is_in(shells[i], shells[j])]
    i, j = np.array(pairs, np.int64).reshape(-1, 2).T
    body = connected_components(csr_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)[1]
    body[areas < small * areas.max()] = body[areas.argmax()]  # scraps stay with the largest, whose repair drops them
    size = np.bincount(body, weights=areas)
    rank = np.empty(len(size), np.int64)
    rank[np.argsort(-size, kind="stable")] = np.arange(len(size))
    of_vertex = np.zeros(len(mesh.vertices), np.int64)
    of_vertex[mesh.faces] = rank[body][label][:, None]
    return of_vertex


def faces_among(mesh: TriangleMesh, keep: BoolArray) -> TriangleMesh:
    """The faces all of whose vertices are kept (n,), with these vertices, used or not, in their order."""
    number = np.cumsum(keep) - 1
    part = taken(mesh, np.asarray(keep[mesh.faces].all(axis=1)))
    deviation = None if mesh.deviation_m is None else mesh.deviation_m[keep]
    return replace(part, vertices=mesh.vertices[keep], faces=number[part.faces].astype(np.int64), deviation_m=deviation)


def _is_in(one: TriangleMesh, other: TriangleMesh) -> bool:
    """Whether something of one shell lies inside the other by more than parts that fit into each other do."""
    points = np.concatenate([one.vertices, sample_surface(one, _SAMPLES, 0)[0]])
    depth = _TOUCH * min(extent(one.vertices), extent(other.vertices))
    low, high = other.vertices.min(axis=0) + depth, other.vertices.max(axis=0) - depth
    near = ((points > low) & (points < high)).all(axis=1)
    return bool(near.any() and (signed_distance(points[near], other) < -depth).any())
