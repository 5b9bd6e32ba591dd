"""Holes through a wall that no scan tells: where gaps of a random sample lie opposite each other the cut goes right through.

Outside tets too tight for a ball are gathered; a set of them that opens to the rest of the outside in two places or more is a channel. One that
buries few points when it is filled has no wall of its own: nothing was measured in it. Such are filled, if the surface then has fewer handles. A bore
that was scanned is wider, or keeps the points of its wall.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.kernel.delaunay import FACETS, Tetrahedralisation
from scan2fea.kernel.topology import surface_topology
from scan2fea.reconstruction.cut import Votes
from scan2fea.reconstruction.singular import Resolved, boundary, resolve
from scan2fea.types import BoolArray, FloatArray, IntArray

TIGHT = 1.5  # spacings, circumradius of such tets; bores of 2 spacings' radius are told (`empty_places`)
BURIED = 0.3  # of the points of a channel may come to lie inside: noise puts points into the wall


def without_pinholes(tetra: Tetrahedralisation, found: Resolved, votes: Votes, source: FloatArray, spacing_m: float) -> Resolved:
    """The labels with such channels filled; those that were given where there are none. votes, source : as for `resolve`."""
    handles = _handles(tetra, found.inside)
    channel = _channels(tetra, found.inside, TIGHT * spacing_m) if handles else np.zeros(0, bool)
    if not channel.any():
        return found
    filled = resolve(tetra, found.inside | channel, votes.capacity, source, votes.sink, spacing_m)
    return filled if _handles(tetra, filled.inside) < handles and filled.n_parts == found.n_parts else found


def _handles(tetra: Tetrahedralisation, inside: BoolArray) -> int:
    return surface_topology(boundary(tetra, inside)[0]).n_handles


def _channels(tetra: Tetrahedralisation, inside: BoolArray, radius_m: float) -> BoolArray:
    """(m,) outside tets of sets that no ball of `radius_m` enters, that open in two places or more, and that have no points of their own."""
    is_tight = ~inside & ~tetra.is_box & (tetra.circumradius <= radius_m)
    rows = np.flatnonzero(is_tight)
    place = np.full(len(tetra), -1)
    place[rows] = np.arange(len(rows))
    other = tetra.neighbors[rows]
    t, facet = np.nonzero((other >= 0) & is_tight[other])
    graph = coo_array((np.ones(len(t), np.int8), (t, place[other[t, facet]])), shape=(len(rows),) * 2)
    n, of = connected_components(graph, directed=False)
    part = np.asarray(of, np.int64)
    t, facet = np.nonzero((other >= 0) & ~is_tight[other] & ~inside[other])
    mouth = _openings(tetra.tets[rows[t][:, None], FACETS[facet]], part[t])
    n_open = np.bincount(part[t][np.unique(mouth, return_index=True)[1]], minlength=n)
    out = np.zeros(len(tetra), bool)
    is_channel = (n_open >= 2) & (_buried(tetra, inside, rows, part, n) <= BURIED)
    out[rows[is_channel[part]]] = True
    return out


def _openings(corners: IntArray, part: IntArray) -> IntArray:
    """(k,) number of the opening of each facet: those of one set that share an edge. corners : (k, 3).   part : (k,) its set."""
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edge = np.unique(np.column_stack([ends, np.repeat(part, 3)]), axis=0, return_inverse=True)[1].ravel()
    k = len(corners)
    graph = coo_array((np.ones(3 * k, np.int8), (np.repeat(np.arange(k), 3), k + edge)), shape=(4 * k, 4 * k))
    return np.asarray(connected_components(graph, directed=False)[1][:k])


def _buried(tetra: Tetrahedralisation, inside: BoolArray, rows: IntArray, part: IntArray, n: int) -> FloatArray:
    """(n,) share of the points of each set of tets with no other tet of the outside beside them. part : (k,) set of the tets `rows`."""
    outside = np.bincount(tetra.tets[~inside].ravel(), minlength=len(tetra.points))
    corner = tetra.tets[rows].ravel()
    pairs, own = np.unique(np.column_stack([np.repeat(part, 4), corner]), axis=0, return_counts=True)
    alone = own == outside[pairs[:, 1]]
    return np.asarray(np.bincount(pairs[:, 0], alone, minlength=n) / np.maximum(np.bincount(pairs[:, 0], minlength=n), 1))
