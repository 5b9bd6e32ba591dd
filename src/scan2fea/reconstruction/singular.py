"""From labelled tets to a surface that is closed and manifold at every edge and every vertex, whatever the labels were.

Round a vertex the tets of one label must hang together through facets, inside and outside alike. On the sphere of directions round the
vertex this makes the surface one closed curve, so the surface is a disc there, and no edge can have more than two faces (Jordan).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InternalError, ReconstructionError, require
from scan2fea.kernel.delaunay import FACETS, Tetrahedralisation
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

SMALL_PART = 0.002  # of the volume of the largest part
VOID_VOTES = 3.0  # sight lines that must leave an enclosed void for it to be kept as a cavity
VOLUME_PRICE = 20.0  # votes per cubic spacing
HEAT = 2.0  # a tet that was relabelled costs this many times more to relabel again: two fans cannot undo each other for ever
FREE_ROUNDS = 200
ANY_FLIP, DIG = 0, 1


@dataclass(frozen=True, eq=False, kw_only=True)
class Resolved(Value):
    """inside : (m,) bool, manifold.   n_singular : vertices that were not.   n_rounds : until none was left.   n_parts : that are left.

    n_dropped, n_filled : specks and voids that were relabelled.   n_dark : holes through walls that no sight line is known to pass (`pinholes`).
    """

    inside: BoolArray
    n_singular: int
    n_rounds: int
    n_parts: int
    n_dropped: int
    n_filled: int
    n_dark: int = 0


def resolve(tetra: Tetrahedralisation, inside: BoolArray, capacity: FloatArray, source: FloatArray, sink: FloatArray, spacing_m: float) -> Resolved:
    """Drop specks, fill enclosed voids, and relabel fans of tets until the surface is manifold.

    capacity : (m, 4), source, sink : (m,) the votes (see `cut.Votes`); they price every relabelling.
    Raises ReconstructionError if nothing is left inside.
    """
    cleaned, dropped, filled, _ = clean(tetra, inside, capacity, source)
    first, incident = tetra.incidence
    bulk = VOLUME_PRICE * tetra.volumes / spacing_m**3
    fill_price, dig_price = source + capacity.sum(axis=1) + bulk, sink + bulk
    label = np.array(cleaned)
    dirty = np.ones(tetra.n_input, np.bool_)
    rounds, n_singular = 0, -1
    while True:
        mode = ANY_FLIP if rounds < FREE_ROUNDS else DIG  # digging alone must end: every flip makes the inside smaller
        singular, flips, dirty = _relabel(tetra.tets, tetra.neighbors, first, incident, tetra.is_box, fill_price, dig_price, dirty, label, mode)
        n_singular = singular if n_singular < 0 else n_singular
        if singular == 0:
            break
        rounds += 1
        require(flips > 0, InternalError, f"{singular} singular vertices can be neither filled nor dug away")
    label, more_dropped, more_filled, n_parts = clean(tetra, label, capacity, source)
    return Resolved(
        inside=label, n_singular=n_singular, n_rounds=rounds, n_parts=n_parts, n_dropped=dropped + more_dropped, n_filled=filled + more_filled
    )


def clean(tetra: Tetrahedralisation, inside: BoolArray, capacity: FloatArray, source: FloatArray) -> tuple[BoolArray, int, int, int]:
    """Without parts below SMALL_PART of the largest, and with voids filled that no more than VOID_VOTES sight lines leave.

    Returns the labels, the number of parts dropped, of voids filled, and of parts left. Raises ReconstructionError if nothing is inside.
    """
    require(inside.any(), ReconstructionError, "nothing is left inside the surface: are the normals or the sensor positions wrong?")
    part, n = _components(tetra, inside)
    volume = np.bincount(part, weights=tetra.volumes, minlength=n)
    is_inside = np.zeros(n, bool)
    is_inside[part[inside]] = True
    small = is_inside & (volume < SMALL_PART * volume[is_inside].max())
    left = inside & ~small[part]

    part, n = _components(tetra, left)
    is_outer = np.zeros(n, bool)
    is_outer[part[tetra.is_box | left]] = True
    t, facet = np.nonzero(left[tetra.neighbors] & (tetra.neighbors >= 0) & ~left[:, None])
    votes = np.bincount(part, weights=source, minlength=n) + np.bincount(part[t], weights=capacity[t, facet], minlength=n)
    void = ~is_outer & (votes <= VOID_VOTES)
    return left | void[part], int(small.sum()), int(void.sum()), int((is_inside & ~small).sum())


def boundary(tetra: Tetrahedralisation, inside: BoolArray) -> tuple[TriangleMesh, IntArray]:
    """The surface of the inside, outward, and the point each of its vertices is."""
    t, facet = np.nonzero(inside[:, None] & ~(inside[tetra.neighbors] & (tetra.neighbors >= 0)))
    corners = tetra.tets[t[:, None], FACETS[facet]]
    is_used = np.zeros(len(tetra.points), bool)
    is_used[corners] = True
    used, faces = np.flatnonzero(is_used), (np.cumsum(is_used) - 1)[corners]
    return TriangleMesh(vertices=tetra.points[used], faces=faces.reshape(-1, 3).astype(np.int64)), used


def _components(tetra: Tetrahedralisation, inside: BoolArray) -> tuple[IntArray, int]:
    """(m,) number of the set of equally labelled tets, connected through facets, that each tet is in; how many sets."""
    part = np.full(len(tetra), -1, np.int64)
    return part, _flooded(tetra.neighbors, inside, part)


@jit
def _flooded(neighbors: IntArray, label: BoolArray, part: IntArray) -> int:
    """Number of sets; `part`, -1 everywhere, gets that of each tet, in the order of their first."""
    stack = np.zeros(len(part), np.int64)
    n = 0
    for seed in range(len(part)):
        if part[seed] >= 0:
            continue
        part[seed] = n
        stack[0] = seed
        height = 1
        while height > 0:
            height -= 1
            t = stack[height]
            for i in range(4):
                other = neighbors[t, i]
                if other >= 0 and part[other] < 0 and label[other] == label[t]:
                    part[other] = n
                    stack[height] = other
                    height += 1
        n += 1
    return n


@jit
def _fans(tets: IntArray, neighbors: IntArray, star: IntArray, v: int, label: BoolArray, slot: IntArray, fan: IntArray, stack: IntArray) -> int:
    """fan[k] = number of the fan (equal labels, connected through facets at v) of the k-th tet of the star; returns how many."""
    for k in range(len(star)):
        slot[star[k]] = k
        fan[k] = -1
    n = 0
    for k in range(len(star)):
        if fan[k] >= 0:
            continue
        fan[k] = n
        stack[0] = star[k]
        height = 1
        while height > 0:
            height -= 1
            t = stack[height]
            for i in range(4):
                other = neighbors[t, i]
                if tets[t, i] == v or other < 0 or label[other] != label[t] or fan[slot[other]] >= 0:
                    continue
                fan[slot[other]] = n
                stack[height] = other
                height += 1
        n += 1
    return n


@jit
def _cheapest(
    star: IntArray, fan: IntArray, n_fans: int, label: BoolArray, is_box: BoolArray, fill_price: FloatArray, dig_price: FloatArray, mode: int
) -> int:
    """The fan to relabel: the cheapest that `mode` allows; -1 if there is none."""
    price, filling = np.zeros(n_fans), np.zeros(n_fans, np.bool_)
    for k in range(len(star)):
        t = star[k]
        filling[fan[k]] = not label[t]
        price[fan[k]] += np.inf if is_box[t] else (dig_price[t] if label[t] else fill_price[t])
    best = -1
    for f in range(n_fans):
        allowed = mode == ANY_FLIP or not filling[f]
        if allowed and price[f] < np.inf and (best < 0 or price[f] < price[best]):
            best = f
    return best


@jit
def _relabel(
    tets: IntArray, neighbors: IntArray, first: IntArray, incident: IntArray, is_box: BoolArray,
    fill_price: FloatArray, dig_price: FloatArray, dirty: BoolArray, label: BoolArray, mode: int,
) -> tuple[int, int, BoolArray]:  # fmt: skip
    """One round over the dirty vertices, `label` and the prices changed in place: (singular vertices, flips, vertices to look at next)."""
    slot = np.zeros(len(tets), np.int64)
    largest = 0
    for v in range(len(dirty)):
        largest = max(largest, first[v + 1] - first[v])
    fan, stack = np.zeros(largest, np.int64), np.zeros(largest, np.int64)
    again = np.zeros(len(dirty), np.bool_)
    singular = flips = 0
    for v in range(len(dirty)):
        if not dirty[v]:
            continue
        star = incident[first[v] : first[v + 1]]
        n_fans = _fans(tets, neighbors, star, v, label, slot, fan, stack)
        if n_fans <= 2:  # one fan of each label: two neighbouring fans always differ
            continue
        singular += 1
        again[v] = True
        chosen = _cheapest(star, fan, n_fans, label, is_box, fill_price, dig_price, mode)
        if chosen < 0:
            continue
        flips += 1
        for k in range(len(star)):
            if fan[k] == chosen:
                t = star[k]
                label[t] = not label[t]
                fill_price[t] *= HEAT
                dig_price[t] *= HEAT
                for i in range(4):
                    if tets[t, i] < len(again):
                        again[tets[t, i]] = True
    return singular, flips, again
