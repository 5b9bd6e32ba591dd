"""Perturbation (Tournois et al. 2009): a vertex of a sliver moves, and stays where it came to only if the worst angle round it rises.

Directions in their order: uphill for the worst angle itself, out of the sliver's sphere (its radius grows fastest), away from its flat side
(its volume grows fastest), then the middle of the neighbours and directions drawn at random. Steps halve until one helps.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.tetmeshing.cavity import squared_radius
from scan2fea.tetmeshing.work import MOST, Work, quality_of, star_of
from scan2fea.types import FloatArray, IntArray

STEPS = 7  # halvings, from a third of the shortest edge down to 1/200
DRAWS = 6  # random directions per vertex and round
ROUNDS = 6


@jit
def worst_round(w: Work, star: IntArray, n: int) -> float:
    worst = 2.0
    for k in range(n):
        worst = min(worst, quality_of(w, star[k]))
    return worst


@jit
def _slope(w: Work, v: int, star: IntArray, n: int, step: float, out: FloatArray) -> None:
    """Central differences of the worst quality round v; unit length, zero where flat."""
    for x in range(3):
        old = w.points[v, x]
        w.points[v, x] = old + step
        ahead = worst_round(w, star, n)
        w.points[v, x] = old - step
        out[x] = ahead - worst_round(w, star, n)
        w.points[v, x] = old
    _unit(out)


@jit
def _unit(d: FloatArray) -> None:
    length = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
    for x in range(3):
        d[x] = d[x] / length if length > 1e-300 else 0.0


@jit
def _off_flat_side(w: Work, v: int, t: int, out: FloatArray) -> None:
    """The direction in which the volume of t grows fastest: the inward normal of the face across v."""
    face = np.empty((3, 3))
    k = 0
    for i in range(4):
        if w.tets[t, i] != v:
            for x in range(3):
                face[k, x] = w.points[w.tets[t, i], x]
            k += 1
    ux, uy, uz = face[1, 0] - face[0, 0], face[1, 1] - face[0, 1], face[1, 2] - face[0, 2]
    sx, sy, sz = face[2, 0] - face[0, 0], face[2, 1] - face[0, 1], face[2, 2] - face[0, 2]
    out[0], out[1], out[2] = uy * sz - uz * sy, uz * sx - ux * sz, ux * sy - uy * sx
    side = 0.0
    for x in range(3):
        side += out[x] * (w.points[v, x] - face[0, x])
    if side < 0:
        for x in range(3):
            out[x] = -out[x]
    _unit(out)


@jit
def _middle(w: Work, v: int, star: IntArray, n: int, out: FloatArray) -> None:
    """From v to the mean of the other corners round it (not of unit length)."""
    out[:] = 0.0
    for k in range(n):
        for i in range(4):
            for x in range(3):
                out[x] += (w.points[w.tets[star[k], i], x] - w.points[v, x]) / (3 * n)


@jit
def _try(w: Work, v: int, star: IntArray, n: int, d: FloatArray, length: float, must: float) -> float:
    """Move v along d by the first of the halving steps that beats `must`; the quality reached, or `must`."""
    old = w.points[v].copy()
    for _ in range(STEPS):
        for x in range(3):
            w.points[v, x] = old[x] + length * d[x]
        found = worst_round(w, star, n)
        if found > must + 1e-9:
            return found
        length /= 2
    for x in range(3):
        w.points[v, x] = old[x]
    return must


@jit
def _out_of_sphere(w: Work, v: int, t: int, step: float, out: FloatArray) -> None:
    """The direction in which the sphere round t grows fastest, by central differences of its squared radius."""
    for x in range(3):
        old = w.points[v, x]
        w.points[v, x] = old + step
        ahead = squared_radius(w, t)
        w.points[v, x] = old - step
        out[x] = ahead - squared_radius(w, t)
        w.points[v, x] = old
        if not np.isfinite(out[x]):
            out[x] = 0.0
    _unit(out)


@jit
def _shortest_edge(w: Work, v: int, star: IntArray, n: int) -> float:
    shortest = np.inf
    for k in range(n):
        for i in range(4):
            u = w.tets[star[k], i]
            if u != v:
                away = 0.0
                for x in range(3):
                    away += (w.points[u, x] - w.points[v, x]) ** 2
                shortest = min(shortest, away)
    return float(np.sqrt(shortest))


@jit
def _worst_of(w: Work, star: IntArray, n: int) -> int:
    worst, at = 2.0, star[0]
    for k in range(n):
        q = quality_of(w, star[k])
        if q < worst:
            worst, at = q, star[k]
    return int(at)


@jit
def _try_gradients(w: Work, v: int, star: IntArray, n: int, edge: float, now: float) -> float:
    """Along the gradients in their order, up to the first that helps; the quality reached, or `now`."""
    d = np.empty(3)
    sliver = _worst_of(w, star, n)
    for which in range(4):
        if which == 0:
            _slope(w, v, star, n, 1e-4 * edge, d)
        elif which == 1:
            _out_of_sphere(w, v, sliver, 1e-4 * edge, d)
        elif which == 2:
            _off_flat_side(w, v, sliver, d)
        else:
            _middle(w, v, star, n, d)
        found = _try(w, v, star, n, d, 1.0 if which == 3 else edge / 3, now)
        if found > now:
            return found
    return now


@jit
def perturb_vertex(w: Work, v: int, seed: int) -> float:
    """Move v as long as the worst angle round it rises. Returns the rise; 0 for a held vertex."""
    star, d = np.empty(4 * MOST, np.int64), np.empty(3)
    n = 0 if w.held[v] else star_of(w, v, star)
    if n <= 0:
        return 0.0
    first = worst_round(w, star, n)
    now = first
    state = np.uint64((v + 1) * 2654435761 + seed * 97 + 12345)
    for _ in range(ROUNDS):
        began = now
        edge = _shortest_edge(w, v, star, n)
        now = _try_gradients(w, v, star, n, edge, now)
        for _ in range(DRAWS):
            if now > began:
                break
            for x in range(3):
                state = np.uint64(state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407))
                d[x] = float(state >> np.uint64(40)) / 2.0**23 - 1.0
            _unit(d)
            now = _try(w, v, star, n, d, edge / 3, now)
        if now <= began + 1e-4:
            break
    return now - first


@jit
def perturb_all(w: Work, queue: IntArray, bound: float, seed: int) -> int:
    """Perturb the free vertices of every queued tet that is flatter than `bound`. Returns how many moves were kept."""
    kept = 0
    for t in queue:
        for i in range(4):
            if w.tets[t, 0] < 0 or quality_of(w, t) >= bound:
                break
            if perturb_vertex(w, w.tets[t, i], seed) > 0:
                kept += 1
    return kept
