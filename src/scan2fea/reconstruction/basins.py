"""Insides that the rolling ball enters through gaps of the scan, told from the outside by what lies behind their points.

A gap wider than the ball lets it into a thick solid, and no larger ball helps where the gap is wider than a bore. But the solid is as wide as its
gap: as the ball shrinks, the inside is a basin of its own until the ball passes the gap (a watershed on the radii of the facets of the Delaunay tets,
as in the persistence of alpha shapes). What decides is local: behind the points of a solid lies the outside, behind those of a tank or a pocket its
wall. The gap itself must be one in a face, which goes on across it: where the border of an opening turns into it (the mouth of a tube, of a vessel,
the end of what was seen of a bore), nobody knows what is inside.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scan2fea.kernel.delaunay import crossed
from scan2fea.kernel.jit import jit
from scan2fea.kernel.union_find import root
from scan2fea.reconstruction.flooding import Setting, facet_radii
from scan2fea.types import BoolArray, FloatArray, IntArray

LEAST_VOLUME = 200.0  # cubic spacings: smaller pockets are what every surface is full of; and at least half a ball, the one that fills the mouth
WIDEST_SHARE, DENSITY = 0.02, 0.85  # of the area: a gap beyond it is refused in any case; points per squared spacing of a random sample
BEHIND = 0.8  # spacings: right beside a point
BACKED = 0.5  # of the points of a solid, with the outside behind them
SMALL_MOUTH = 4.0  # spacings: radius of mouths that any ball may close unasked
GOES_ON = 0.5  # cosine between an opening and the faces on its border, where these go on across it


def parted(setting: Setting, radius: float) -> BoolArray:
    """(m,) tets that a ball of `radius` reaches from outside, without those of solids that it enters through gaps of their faces."""
    one, other, width = _facets(setting, radius)
    tetra, h = setting.tetra, setting.spacing_m
    widest = h * math.sqrt(WIDEST_SHARE * tetra.n_input / (DENSITY * math.pi))
    volumes = np.where(tetra.is_box, 0.0, tetra.volumes)
    label, kind = _watershed(one, other, width, volumes, tetra.is_box, LEAST_VOLUME * h**3, widest)
    names = np.flatnonzero(kind != NOTHING)
    names = names[np.argsort(kind[names], kind="stable")]  # the outside comes first
    number = np.full(len(tetra), -1)
    number[names] = np.arange(len(names))
    basin = number[label]
    outside = _joined(*_beside(setting, basin), len(names), BACKED)
    apart = basin[one] != basin[other]
    openings = one[apart], other[apart], width[apart]
    while unsure := [v for v in np.flatnonzero(~outside).tolist() if not _goes_on(setting, *openings, basin, v, outside)]:
        outside[unsure] = True
    return np.asarray((basin >= 0) & outside[basin])


def _facets(setting: Setting, radius: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Tets on both sides of the facets that a ball of `radius` passes, and the radius of the largest that does; widest first."""
    tetra = setting.tetra
    radii = facet_radii(tetra.points, tetra.tets, tetra.neighbors)
    one, side = (np.asarray(x, np.int64) for x in np.nonzero(radii > radius))
    width = radii[one, side]
    order = np.argsort(-width, kind="stable")
    return one[order], tetra.neighbors[one, side][order], width[order]


def _beside(setting: Setting, basin: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """The basins right beside the points of basins, the outside (0) among them, by point: (point, basin, on which side: 1, 2 or 3 for both)."""
    tetra = setting.tetra
    rows = np.unique(tetra.tets[basin > 0])
    rows = rows[rows < tetra.n_input]
    both = np.vstack([setting.axis[rows], -setting.axis[rows]])
    ray, tet = crossed(tetra.points, tetra.tets, tetra.neighbors, setting.first, setting.incident, np.tile(rows, 2), both, BEHIND * setting.spacing_m)
    told = basin[tet] >= 0
    ray, met = ray[told], basin[tet][told]
    n = max(len(rows), 1)
    key, of = np.unique(ray % n * len(basin) + met, return_inverse=True)
    side = np.bincount(of[ray < n], minlength=len(key)).astype(bool) + 2 * np.bincount(of[ray >= n], minlength=len(key)).astype(bool)
    return key // len(basin), key % len(basin), side


@jit
def _joined(point: IntArray, basin: IntArray, side: IntArray, n: int, backed: float) -> BoolArray:
    """(n,) basins that are outside: 0, and the others, least backed first, until all that are left have it behind `backed` of their points.

    point, basin, side : of `_beside`. A basin that joins the outside may be what lies behind the points of another.
    """
    ends = np.bincount(point).cumsum()
    order = np.argsort(basin, kind="mergesort")
    beside = np.bincount(basin, minlength=n)
    last = beside.cumsum()
    outside, behind, count = np.zeros(n, np.bool_), np.zeros(len(ends), np.int64), np.zeros(n)
    joins = 0
    while joins >= 0:
        outside[joins] = True
        for q in order[last[joins] - beside[joins] : last[joins]]:
            i = point[q]
            known = behind[i]
            behind[i] |= side[q] >> 1 | (side[q] & 1) << 1  # the other side
            for k in range(ends[i - 1] if i else 0, ends[i]):
                if side[k] & known == 0 and side[k] & behind[i]:
                    count[basin[k]] += 1
        joins, least = -1, backed
        for v in range(n):
            share = count[v] / max(beside[v], 1)
            if not outside[v] and share < least:
                joins, least = v, share
    return outside


def _goes_on(setting: Setting, one: IntArray, other: IntArray, width: FloatArray, basin: IntArray, which: int, outside: BoolArray) -> bool:
    """Are the openings of basin `which`, of these facets between basins, such that the faces round them go on across them?"""
    tetra = setting.tetra
    here, there = basin[one], basin[other]
    rows = np.flatnonzero(((here == which) & outside[there]) | ((there == which) & outside[here]))
    if not len(rows):
        return True
    pair = np.concatenate([tetra.tets[one[rows]], tetra.tets[other[rows]]], axis=1)
    pair.sort(axis=1)
    twice = pair[:, 1:] == pair[:, :-1]
    vertices, corner = np.unique(pair[:, 1:][twice], return_inverse=True)  # two tets share three vertices
    corner = corner.reshape(-1, 3)
    a, b, c = (tetra.points[vertices[corner[:, k]]] for k in range(3))
    across = np.cross(b - a, c - a)
    size = np.linalg.norm(across, axis=1)
    axis = np.zeros((len(vertices), 3))
    axis[vertices < tetra.n_input] = setting.axis[vertices[vertices < tetra.n_input]]
    along = np.abs(np.einsum("fc,fkc->fk", across, axis[corner])).mean(axis=1)
    of = _mouths(corner, len(vertices))
    goes_on = np.bincount(of, along) >= GOES_ON * np.bincount(of, size)
    wide = np.zeros(len(goes_on), bool)
    wide[of[width[rows] > SMALL_MOUTH * setting.spacing_m]] = True
    return bool(goes_on[wide].all())


def _mouths(corner: IntArray, n: int) -> IntArray:
    """(k,) number of the opening of each facet: facets that share one of the n vertices are one."""
    rows = np.repeat(np.arange(len(corner)), 3)
    graph = coo_array((np.ones(len(rows), np.int8), (rows, len(corner) + corner.ravel())), shape=(len(corner) + n,) * 2)
    return np.asarray(connected_components(graph, directed=False)[1][: len(corner)])


NOTHING, BOX, BASIN = 0, 1, 2


@jit
def _watershed(
    one: IntArray, other: IntArray, width: FloatArray, volume: FloatArray, is_box: BoolArray, least: float, widest: float
) -> tuple[IntArray, IntArray]:
    """The basin of each tet, named by one of its tets, and what each basin is: the outside, one of its own, or nothing (tets no ball passes).

    one, other, width : of the facets, widest first. Two basins meet at a facet: the one that is less wide is kept apart if it is as wide and
    holds `least` and the half ball that lies behind so wide a mouth, unless the facet is larger than `widest`; else it becomes part of the other.
    """
    m = len(volume)
    parent = np.arange(m)
    held, breadth, kind = volume.copy(), np.zeros(m), np.zeros(m, np.int64)
    box = -1
    for t in range(m):
        if is_box[t]:
            box = t if box < 0 else box
            parent[t] = box
    kind[box], breadth[box] = BOX, np.inf
    for k in range(len(one)):
        a, b = root(parent, one[k]), root(parent, other[k])
        if a == b or (kind[a] != NOTHING and kind[b] != NOTHING):
            continue
        if kind[b] != NOTHING or (kind[a] == NOTHING and breadth[b] > breadth[a]):
            a, b = b, a
        if breadth[b] >= width[k] and width[k] <= widest and held[b] > max(least, 2.0 / 3.0 * math.pi * width[k] ** 3):
            kind[b] = BASIN
            kind[a] = BASIN if kind[a] == NOTHING else kind[a]
            continue
        parent[b] = a
        held[a] += held[b]
        breadth[a] = max(breadth[a], breadth[b], width[k])
    label = np.empty(m, np.int64)
    for t in range(m):
        label[t] = root(parent, t)
    return label, kind
