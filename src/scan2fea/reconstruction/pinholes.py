"""Holes through a wall that no scan tells: where gaps of a random sample lie opposite each other the cut goes right through.

Outside tets too tight for a ball are gathered; a set of them that opens to the rest of the outside in two places or more is a channel. One that
buries few points when it is filled has no wall of its own: nothing was measured in it. Such are filled, if the surface then has fewer handles. A bore
that was scanned is wider, or keeps the points of its wall. The ball of a channel through a wall of two spacings is larger than its mouths: there
the points that its wall would hold are counted against those it has, and the mouths against the gaps that chance leaves in so many points. Where both
skins of a wall were hidden such a channel may be wider still; then only what no sight line has crossed is filled, and one beside which other points
lie stays, and is told: it may be a bore; but one that no line enters at all is filled, whatever lies beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import pdtr

from scan2fea.kernel.delaunay import FACETS, Tetrahedralisation
from scan2fea.reconstruction.cut import Votes
from scan2fea.reconstruction.singular import Resolved, resolve
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

TIGHT = 1.5  # spacings, circumradius of such tets; bores of 2 spacings' radius are told (`empty_places`)
WIDE = 3.0  # spacings, the same of channels in the dark: as far from points a surface still counts as measured (`gates_surface.REACH_SPACINGS`)
ON_SKIN = 0.5  # cosine of a point's normal with the wall's
CROSSED = 0.5  # votes of sight lines across a facet of a tet: it was seen empty
BURIED = 0.3  # of the points of a channel may come to lie inside: noise puts points into the wall
RADII = (1.75, 2.0, 2.25, 2.5, 2.75, WIDE)  # spacings: a larger ball leaves out more of the mouths, until channels and corners are one set
SMOOTH = 0.5  # of the area of facets between random points is that of the wall they lie on, at least
DOUBTED = 0.5  # the same chance: a channel with more points is a hole, one with fewer, but too many to be filled, nobody can tell
BARE = 0.01  # chance of a wall with so few points, or of gaps so wide: a scanned bore is not filled, and no bore's mouths are gaps of a sample


@dataclass(frozen=True, eq=False, kw_only=True)
class _Sets(Value):
    """Connected tets of the outside that no ball enters. rows : (k,) tets.   part : (k,) the set of each.   And of each set:

    n_open : openings to the rest of the outside.   buried : points with no other tet of the outside beside them.   points : all.
    mouths_m2, walls_m2 : area of the facets to the rest of the outside, and to the inside.
    """

    rows: IntArray
    part: IntArray
    n_open: IntArray
    buried: FloatArray
    points: FloatArray
    mouths_m2: FloatArray
    walls_m2: FloatArray

    def chosen(self, is_channel: BoolArray, n: int) -> BoolArray:
        """(n,) tets of the sets that are chosen."""
        out = np.zeros(n, bool)
        out[self.rows[is_channel[self.part]]] = True
        return out


def without_pinholes(
    tetra: Tetrahedralisation,
    found: Resolved,
    votes: Votes,
    source: FloatArray,
    spacing_m: float,
    normals: FloatArray | None = None,
    bores: BoolArray | None = None,
) -> Resolved:
    """The labels with such channels filled; those that were given where there are none. n_dark: holes that stay though no sight line passed them.

    votes, source : as for `resolve`.   normals : (n, 3) of the points, where sight lines are known; None: holes are told by their points alone.
    bores : (m,) tets that are not filled, or None.
    """
    free = np.ones(len(tetra), bool) if bores is None else ~bores
    found = _filled(tetra, found, votes, source, spacing_m, lambda inside: free & _channels(tetra, inside, TIGHT * spacing_m)[0])
    dark = free if normals is None else free & ~_crossed(tetra, votes.capacity)
    found = _filled(tetra, found, votes, source, spacing_m, lambda inside: dark & _by_chance(tetra, inside, spacing_m))
    if normals is None:
        without = _filled(tetra, found, votes, source, spacing_m, lambda inside: free & _by_chance(tetra, inside, spacing_m, DOUBTED, BARE**2))
        return replace(found, n_dark=_handles(tetra, found.inside) - _handles(tetra, without.inside))
    found = _filled(tetra, found, votes, source, spacing_m, lambda inside: dark & _between_skins(tetra, inside, WIDE * spacing_m, normals))
    found = _filled(tetra, found, votes, source, spacing_m, lambda inside: _unlit(tetra, inside, WIDE * spacing_m, dark))
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


def _unlit(tetra: Tetrahedralisation, inside: BoolArray, radius_m: float, dark: BoolArray) -> BoolArray:
    """(m,) tets of channels no tet of which a sight line enters: what lies beside them was not seen through them, or was put there (`turned`)."""
    sets = _sets(tetra, inside, radius_m)
    n_lit = np.bincount(sets.part, ~dark[sets.rows], minlength=len(sets.n_open))
    return sets.chosen((sets.n_open >= 2) & (n_lit == 0), len(tetra))


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
    sets = _sets(tetra, inside, radius_m)
    number = np.full(len(tetra), -1, np.int64)
    number[sets.rows] = sets.part
    return sets.chosen((sets.n_open >= 2) & (sets.buried <= BURIED * np.maximum(sets.points, 1)), len(tetra)), number


def _by_chance(tetra: Tetrahedralisation, inside: BoolArray, spacing_m: float, few: float = BARE, wide: float = BARE) -> BoolArray:
    """(m,) outside tets of channels with too few points for a wall of their own, whose mouths together are no wider than gaps that chance leaves.

    few : chance that a wall has so few points.   wide : that gaps have such mouths: of n random points, one a square spacing,
    n (1 + s + s^2 / 2) exp(-s) pairs of gaps opposite each other have s square spacings or more together.
    """
    n, out = len(tetra.points), np.zeros(len(tetra), bool)
    s = np.log(n / wide)
    s += np.log1p(s + s * s / 2)
    for radius in RADII:
        sets = _sets(tetra, inside, radius * spacing_m)
        bare = pdtr(sets.buried, SMOOTH * sets.walls_m2 / spacing_m**2) <= few
        out |= sets.chosen((sets.n_open >= 2) & bare & (sets.mouths_m2 <= s * spacing_m**2), len(tetra))
    return out


def _sets(tetra: Tetrahedralisation, inside: BoolArray, radius_m: float) -> _Sets:
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
    open_to = tetra.tets[rows[t][:, None], FACETS[facet]]
    w, side = np.nonzero((other >= 0) & inside[other])
    mouth = _openings(open_to, part[t])
    buried, points = _buried(tetra, inside, rows, part, n)
    return _Sets(
        rows=rows, part=part, n_open=np.bincount(part[t][np.unique(mouth, return_index=True)[1]], minlength=n), buried=buried, points=points,
        mouths_m2=_sums(part[t], _areas(tetra.points[open_to]), n),
        walls_m2=_sums(part[w], _areas(tetra.points[tetra.tets[rows[w][:, None], FACETS[side]]]), n),
    )  # fmt: skip


def _sums(part: IntArray, weight: FloatArray, n: int) -> FloatArray:
    return np.bincount(part, weight, minlength=n).astype(float)


def _areas(corners: FloatArray) -> FloatArray:
    """(k,) of triangles. corners : (k, 3, 3)."""
    return np.asarray(np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2)


def _openings(corners: IntArray, part: IntArray) -> IntArray:
    """(k,) number of the opening of each facet: those of one set that share an edge. corners : (k, 3).   part : (k,) its set."""
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    n, k = int(corners.max(initial=0)) + 1, len(corners)
    edge = np.unique((np.repeat(part, 3) * n + ends[:, 0]) * n + ends[:, 1], return_inverse=True)[1]  # one number a row: a tenth of the time
    graph = coo_array((np.ones(3 * k, np.int8), (np.repeat(np.arange(k), 3), k + edge)), shape=(4 * k, 4 * k))
    return np.asarray(connected_components(graph, directed=False)[1][:k])


def _buried(tetra: Tetrahedralisation, inside: BoolArray, rows: IntArray, part: IntArray, n: int) -> tuple[FloatArray, FloatArray]:
    """(n,) points of each set of tets with no other tet of the outside beside them, and all of its points. part : (k,) set of the tets `rows`."""
    outside = np.bincount(tetra.tets[~inside].ravel(), minlength=len(tetra.points))
    pairs, own = np.unique(np.repeat(part, 4) * len(outside) + tetra.tets[rows].ravel(), return_counts=True)
    of, corner = np.divmod(pairs, len(outside))
    return _sums(of, (own == outside[corner]).astype(float), n), np.bincount(of, minlength=n).astype(float)
