"""Exudation (Cheng et al. 2000): a vertex of a sliver is given weight, which changes what it is connected to; nothing moves.

As its weight w grows, the tets whose sphere it enters, |v - c|^2 - R^2 < w, fall and are filled anew from it. Every stage up to the largest
weight, (0.45 x its nearest neighbour)^2, is looked at; the one whose worst angle is best is kept where it beats the sliver.
"""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.tetmeshing.cavity import SLIVERS, best_cone, fill_cone
from scan2fea.tetmeshing.work import MOST, Work, quality_of, star_of
from scan2fea.types import IntArray

REACH = 0.45  # of the distance to the nearest neighbour: the root of the largest weight at which no vertex hides another


@jit
def exude_vertex(w: Work, v: int, must: float, rows: IntArray) -> int:
    """Pump vertex v where that beats the quality `must` of the worst tet round it. Returns the number of new tets."""
    region, cone = np.empty(MOST, np.int64), np.empty((MOST, 3), np.int64)
    n = star_of(w, v, region)
    if n <= 0:
        return 0
    near = np.inf
    for k in range(n):
        for i in range(4):
            u = w.tets[region[k], i]
            if u != v:
                away = 0.0
                for x in range(3):
                    away += (w.points[u, x] - w.points[v, x]) ** 2
                near = min(near, away)
    taken, faces, _ = best_cone(w, v, w.points[v], region, n, SLIVERS, REACH**2 * near, must, cone)
    if taken <= n:  # the star itself: nothing would change
        return 0
    return fill_cone(w, v, region, taken, cone, faces, rows)


@jit
def exude_all(w: Work, queue: IntArray, bound: float) -> int:
    """Pump the vertices of every queued tet that is flatter than `bound`. Returns how many vertices were pumped with gain."""
    rows, star = np.empty(MOST, np.int64), np.empty(4 * MOST, np.int64)
    pumped = 0
    for t in queue:
        for i in range(4):
            if w.tets[t, 0] < 0 or quality_of(w, t) >= bound:
                break
            v = w.tets[t, i]
            n = star_of(w, v, star)
            worst = 2.0
            for k in range(n):
                worst = min(worst, quality_of(w, star[k]))
            # only where t is the worst of the star: what is taken out with it is then no better than what comes in
            if n > 0 and worst >= quality_of(w, t) and exude_vertex(w, v, quality_of(w, t), rows):
                pumped += 1
                break
    return pumped
