"""A vertex put into a tet that neither moves nor flips have made better: most often one whose four corners lie on the surface.

Places: the middle of the tet, of each inner face and of each inner edge. Round each a cavity grows as long as its worst cone is not good enough
(Klingner and Shewchuk 2007, "Aggressive tetrahedral mesh improvement"); the new vertex is then perturbed, and all is taken back unless the
worst angle has risen.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.tetmeshing.cavity import WORST, best_cone, fill_cone
from scan2fea.tetmeshing.perturb import perturb_vertex, worst_round
from scan2fea.tetmeshing.work import MOST, POINTS, Work, exchange, quality_of, ring_of, star_of
from scan2fea.types import FloatArray, IntArray

HOPE = 0.3  # of the quality of the tet: a cone this good may become better than it when its vertex is perturbed
PLACES = 11  # middle of the tet, four faces, six edges


@jit
def _place(w: Work, t: int, number: int, p: FloatArray, region: IntArray) -> int:
    """The place and the tets it lies in; how many, 0 where it lies on the boundary."""
    p[:] = 0.0
    if number == 0:
        for i in range(4):
            p += w.points[w.tets[t, i]] / 4
        region[0] = t
        return 1
    if number <= 4:
        face = number - 1
        if w.beside[t, face] < 0:
            return 0
        for i in range(4):
            if i != face:
                p += w.points[w.tets[t, i]] / 3
        region[0], region[1] = t, w.beside[t, face]
        return 2
    k = 5
    for i in range(4):
        for j in range(i + 1, 4):
            if k == number:
                a, b = w.tets[t, i], w.tets[t, j]
                p += (w.points[a] + w.points[b]) / 2
                around = np.empty(20, np.int64)
                return ring_of(w, t, a, b, around, region)
            k += 1
    return 0


@jit
def insert_at(w: Work, t: int, number: int, seed: int, rows: IntArray) -> tuple[float, int]:
    """Put a vertex at a place of t. Returns the worst quality round it where that beats t; else all is as before but for the row of t.

    The second figure is that row: what is taken back need not come to lie where it was.
    """
    if w.tally[POINTS] == len(w.points):
        return 0.0, t
    region, cone, p = np.empty(MOST, np.int64), np.empty((MOST, 3), np.int64), np.empty(3)
    n = _place(w, t, number, p, region)
    if n == 0:
        return 0.0, t
    must = quality_of(w, t)
    taken, faces, _ = best_cone(w, -1, p, region, n, WORST, 0.0, HOPE * max(must, 0.0), cone)
    if taken == 0:
        return 0.0, t
    old = np.empty((taken, 4), np.int64)
    for k in range(taken):
        for i in range(4):
            old[k, i] = w.tets[region[k], i]
        must = min(must, quality_of(w, region[k]))  # no more is asked for than what is taken out
    v = w.tally[POINTS]
    for x in range(3):
        w.points[v, x] = p[x]
    w.held[v] = 0
    if not fill_cone(w, v, region, taken, cone, faces, rows):
        return 0.0, t
    w.tally[POINTS] += 1
    perturb_vertex(w, v, seed)
    star = np.empty(4 * MOST, np.int64)
    found = worst_round(w, star, star_of(w, v, star))
    if found > must + 1e-9:
        return found, t
    exchange(w, rows, faces, old, taken, region)
    w.tet_of[v] = -1
    w.tally[POINTS] -= 1
    return 0.0, int(region[0])  # t came first


@jit
def insert_all(w: Work, queue: IntArray, bound: float, most: int, seed: int) -> int:
    """A vertex for every queued tet that is flatter than `bound`, at the first place that helps; `most` in all. Returns how many were put in."""
    rows = np.empty(2 * MOST, np.int64)
    done = 0
    for t in queue:
        if done == most:
            break
        if w.tets[t, 0] < 0 or quality_of(w, t) >= bound:
            continue
        for number in range(PLACES):
            found, t = insert_at(w, t, number, seed, rows)
            if found > 0:
                done += 1
                break
    return done
