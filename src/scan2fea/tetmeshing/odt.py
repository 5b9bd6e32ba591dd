"""Optimal Delaunay triangulation (Chen and Xu 2004; Alliez et al. 2005): vertices move to where |x|^2 is interpolated best.

The error of a tet is V / 20 x the sum of its squared edges (d = 3 in |T| / ((d + 1)(d + 2)) x sum); over a closed star of fixed connections
it is least at sum V c / sum V, c the circumcentres. Boundary stars are not closed: their vertices are held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.tetmeshing.cavity import sphere_centre
from scan2fea.tetmeshing.relaxing import InVolume
from scan2fea.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Odt(InVolume):
    """ODT inside a held boundary, for `kernel.relaxation`."""

    def targets(self, points: FloatArray) -> FloatArray:
        return _targets(points, self.tets)

    def energy(self, points: FloatArray) -> float:
        return _energy(points, self.tets)


@jit
def _energy(p: FloatArray, tets: IntArray) -> float:
    total = 0.0
    for t in range(len(tets)):
        a, b, c, d = p[tets[t, 0]], p[tets[t, 1]], p[tets[t, 2]], p[tets[t, 3]]
        squares = 0.0
        for x in range(3):
            ab, ac, ad, bc, bd, cd = b[x] - a[x], c[x] - a[x], d[x] - a[x], c[x] - b[x], d[x] - b[x], d[x] - c[x]
            squares += ab * ab + ac * ac + ad * ad + bc * bc + bd * bd + cd * cd
        total += _volume(a, b, c, d) * squares / 20
    return total


@jit
def _volume(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> float:
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return float((ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)) / 6)


@jit
def _targets(p: FloatArray, tets: IntArray) -> FloatArray:
    """sum V c / sum V; a vertex of a tet that is not positive stays."""
    total, weight, centre = np.zeros(p.shape), np.zeros(len(p)), np.zeros(3)
    for t in range(len(tets)):
        a = p[tets[t, 0]]
        six = sphere_centre(a, p[tets[t, 1]], p[tets[t, 2]], p[tets[t, 3]], centre)
        for i in range(4):
            v = tets[t, i]
            weight[v] += six if six > 0 else -np.inf
            for x in range(3):
                total[v, x] += max(six, 0.0) * (centre[x] + a[x])
    for v in range(len(p)):
        for x in range(3):
            total[v, x] = total[v, x] / weight[v] if weight[v] > 0 else p[v, x]
    return total
