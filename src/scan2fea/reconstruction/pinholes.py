"""Holes through a wall that no scan tells: where gaps of a random sample lie opposite each other the cut goes right through.

Outside tets too tight for a ball are gathered; a set of them that opens to the rest of the outside in two places or more is a channel. One that
buries few points when it is filled has no wall of its own: nothing was measured in it. Such are filled, if the surface then has fewer handles. A bore
that was scanned is wider, or keeps the points of its wall. Where both skins of a wall were hidden such a channel may be wider; then only what no
sight line has crossed is filled, and one beside which other points lie stays, and is told: it may be a bore.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.kernel.delaunay import FACETS, Tetrahedralisation
from scan2fea.reconstruction.cut import Votes
from scan2fea.reconstruction.singular import Resolved, resolve
from scan2fea.types import BoolArray, FloatArray, IntArray

TIGHT = 1.5  # spacings, circumradius of such tets; bores of 2 spacings' radius are told (`empty_places`)
WIDE = 3.0  # spacings, the same of channels in the dark: as far from points a surface still counts as measured (`gates_surface.REACH_SPACINGS`)
ON_SKIN = 0.5  # cosine of a point's normal with the wall's
CROSSED = 0.5  # votes of sight lines across a facet of a tet: it was seen empty
BURIED = 0.3  # of the points of a channel may come to lie inside: noise puts points into the wall


def without_pinholes(
    tetra: Tetrahedralisation, found: Resolved, votes: Votes, source: FloatArray, spacing_m: float, normals: FloatArray | None = None
) -> Resolved:
    """The labels with such channels filled; those that were given where there are none. n_dark: holes that stay though no sight line passed them.

    votes, source : as for `resolve`.   normals : (n, 3) of the points, where sight lines are known; None: nothing is told to be dark.
    """
    found = _filled(tetra, found, votes, source, spacing_m, lambda inside: _channels(tetra, inside, TIGHT * spacing_m)[0])
    if normals is None:
        return found
    dark = ~_crossed(tetra, votes.capacity)
    found = _filled(tetra, found, votes, source, spacing_m, lambda inside: dark & _between_skins(tetra, inside, WIDE * spacing_m, normals))
    without = _filled(tetra, found, votes, source, spacing_m, lambda inside: dark & _channels(tetra, inside, WIDE * spacing_m)[0])
    return replace(found, n_dark=_handles(tetra, found.inside) - _handles(tetra, without.inside))


def _filled(
    tetra: Tetrahedralisation, found: Resolved, votes: Votes, source: FloatArray, spacing_m: float, chosen: Callable[[BoolArray], BoolArray]
) -> Resolved:
    """The labels with the tets that are chosen filled, if the surface then has fewer handles and no more parts."""
    handles = _handles(tetra, found.inside)
    channel = chosen(found.inside) if handles else np.zeros(0, bool)
    if not channel.any():
        return found
    filled = resolve(tetra, found.inside | channel, votes.capacity, source, votes.sink, spacing_m)
    return filled if _handles(tetra, filled.inside) < handles and filled.n_parts == found.n_parts else found


def _between_skins(tetra: Tetrahedralisation, inside: BoolArray, radius_m: float, normals: FloatArray) -> BoolArray:
    """(m,) tets of channels whose points all lie on the two skins of one wall: of a bore that was scanned some lie on its own wall."""
    chosen, part = _channels(tetra, inside, radius_m)
    out = np.zeros(len(tetra), bool)
    for number in np.unique(part[chosen]):
        own = chosen & (part == number)
        corner = np.unique(tetra.tets[own])
        normal = normals[corner[corner < len(normals)]]
        across = np.linalg.eigh(normal.T @ normal)[1][:, -1]
        out |= own & bool((np.abs(normal @ across) >= ON_SKIN).all())
    return out


def _crossed(tetra: Tetrahedralisation, capacity: FloatArray) -> BoolArray:
    """(m,) tets that sight lines enter or leave."""
    lines = capacity.max(axis=1)
    t, facet = np.nonzero(tetra.neighbors >= 0)
    np.maximum.at(lines, tetra.neighbors[t, facet], capacity[t, facet])
    return np.asarray(lines >= CROSSED)


def _handles(tetra: Tetrahedralisation, inside: BoolArray) -> int:
    """Holes that go through the surface between the labels, which is manifold (V - E + F = 2 C - 2 G): counted without its edges."""
    t, facet = np.nonzero(inside[:, None] & ~(inside[tetra.neighbors] & (tetra.neighbors >= 0)))
    corners = tetra.tets[t[:, None], FACETS[facet]]
    used = np.zeros(len(tetra.points), bool)
    used[corners] = True
    faces, n = (np.cumsum(used) - 1)[corners], int(used.sum())
    joined = coo_array((np.ones(2 * len(faces), np.int8), (faces[:, :2].T.ravel(), faces[:, 1:].T.ravel())), shape=(n, n))
    return int(connected_components(joined, directed=False)[0]) - (n - len(faces) // 2) // 2


def _channels(tetra: Tetrahedralisation, inside: BoolArray, radius_m: float) -> tuple[BoolArray, IntArray]:
    """(m,) outside tets of sets that no ball of `radius_m` enters, that open in two places or more, and that have no points of their own.

    And (m,) the number of the set of each tet, -1: of none.
    """
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
    number = np.full(len(tetra), -1, np.int64)
    number[rows] = part
    return out, number


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
