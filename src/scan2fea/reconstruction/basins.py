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

from scan2fea.kernel.jit import jit
from scan2fea.kernel.union_find import root
from scan2fea.reconstruction.flooding import Setting, depths, facet_radii
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
    outside = np.asarray(kind[label] == BOX)
    left = [int(v) for v in np.flatnonzero(kind == BASIN)]
    solid: list[int] = []
    while left:  # a pocket that is outside may be what lies behind the points of another basin
        backed = [_backed(setting, label == v, outside) for v in left]
        least = int(np.argmin(backed))
        if backed[least] < BACKED:
            outside |= label == left[least]
        else:
            solid.append(left[least])
        left.pop(least)
    while unsure := [v for v in solid if not _goes_on(setting, one, other, width, label == v, outside)]:
        outside |= np.isin(label, unsure)
        solid = [v for v in solid if v not in unsure]
    return outside


def _facets(setting: Setting, radius: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Tets on both sides of the facets that a ball of `radius` passes, and the radius of the largest that does; widest first."""
    tetra = setting.tetra
    radii = facet_radii(tetra.points, tetra.tets, tetra.neighbors)
    one, side = (np.asarray(x, np.int64) for x in np.nonzero(radii > radius))
    width = radii[one, side]
    order = np.argsort(-width, kind="stable")
    return one[order], tetra.neighbors[one, side][order], width[order]


def _backed(setting: Setting, basin: BoolArray, outside: BoolArray) -> float:
    """Share of the points right beside the basin that have the outside right behind them."""
    vertices = np.unique(setting.tetra.tets[basin])
    rows = vertices[vertices < setting.tetra.n_input]
    near = BEHIND * setting.spacing_m
    plus, minus = (way <= near for way in depths(setting, basin, near, rows))
    out_plus, out_minus = (way <= near for way in depths(setting, outside, near, rows))
    beside = plus | minus
    return float(((plus & out_minus) | (minus & out_plus))[beside].mean()) if beside.any() else 0.0


def _goes_on(setting: Setting, one: IntArray, other: IntArray, width: FloatArray, basin: BoolArray, outside: BoolArray) -> bool:
    """Are the openings of the basin such that the faces round them go on across them?"""
    tetra = setting.tetra
    rows = np.flatnonzero((basin[one] & outside[other]) | (basin[other] & outside[one]))
    if not len(rows):
        return True
    pair = np.concatenate([tetra.tets[one[rows]], tetra.tets[other[rows]]], axis=1)
    pair.sort(axis=1)
    twice = pair[:, 1:] == pair[:, :-1]
    corner = pair[:, 1:][twice].reshape(-1, 3)  # two tets share three vertices
    a, b, c = (tetra.points[corner[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    size = np.linalg.norm(across, axis=1)
    axis = np.concatenate([setting.axis, np.zeros((len(tetra.points) - tetra.n_input, 3))])
    along = np.abs(np.einsum("fc,fkc->fk", across, axis[corner])).mean(axis=1)
    of = _mouths(corner, len(tetra.points))
    goes_on = np.bincount(of, along) >= GOES_ON * np.bincount(of, size)
    wide = np.zeros(len(goes_on), bool)
    wide[of[width[rows] > SMALL_MOUTH * setting.spacing_m]] = True
    return bool(goes_on[wide].all())


def _mouths(corner: IntArray, n: int) -> IntArray:
    """(k,) number of the opening of each facet: facets that share a vertex are one."""
    rows = np.repeat(np.arange(len(corner)), 3)
    graph = coo_array((np.ones(len(rows), np.int8), (rows, len(corner) + corner.ravel())), shape=(len(corner) + n,) * 2)
    return np.unique(connected_components(graph, directed=False)[1][: len(corner)], return_inverse=True)[1].ravel()


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
