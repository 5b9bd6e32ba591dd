"""Lloyd's relaxation (Du, Faber and Gunzburger 1999): each vertex moves to the centroid of its Voronoi cell, clipped at the boundary.

A cell is put together from the tets of its star: a tet gives each corner i, for each edge i j and face i j k, the piece between i, the middle of
the edge, the centre of the face's circle and the centre of the tet's sphere. Its three legs a, b, c are at right angles; its volume is
a b c / 6 with signs, its share of the energy, the integral of |x - i|^2, is volume x (6 a^2 + 3 b^2 + c^2) / 10.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.jit import jit
from scan2fea.tetmeshing.cavity import sphere_centre
from scan2fea.tetmeshing.relaxing import InVolume
from scan2fea.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Lloyd(InVolume):
    """Lloyd inside a held boundary, for `kernel.relaxation`."""

    def targets(self, points: FloatArray) -> FloatArray:
        return _cells(points, self.tets)[0]

    def energy(self, points: FloatArray) -> float:
        return float(_cells(points, self.tets)[1])


@jit
def _cells(p: FloatArray, tets: IntArray) -> tuple[FloatArray, float]:
    """Centroids of the cells, and the energy of all of them; inf with a tet that is not positive."""
    total, weight, energy = np.zeros(p.shape), np.zeros(len(p)), 0.0
    ball, circle = np.zeros(3), np.zeros(3)
    for t in range(len(tets)):
        if sphere_centre(p[tets[t, 0]], p[tets[t, 1]], p[tets[t, 2]], p[tets[t, 3]], ball) <= 0:
            return total, np.inf
        for x in range(3):
            ball[x] += p[tets[t, 0], x]
        for k in range(4):  # the face across corner k
            face = (tets[t, (k + 1) % 4], tets[t, (k + 2) % 4], tets[t, (k + 3) % 4])
            up = _circle_centre(p[face[0]], p[face[1]], p[face[2]], p[tets[t, k]], ball, circle)
            for e in range(3):
                energy += _two_pieces(p, face[e], face[(e + 1) % 3], face[(e + 2) % 3], circle, ball, up, total, weight)
    for v in range(len(p)):
        for x in range(3):
            total[v, x] = total[v, x] / weight[v] if weight[v] > 0 else p[v, x]
    return total, energy


@jit
def _circle_centre(a: FloatArray, b: FloatArray, c: FloatArray, top: FloatArray, ball: FloatArray, out: FloatArray) -> float:
    """The centre of the circle through a, b, c below that of the sphere, `ball`; its height over the face, positive on the side of `top`."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    doubled = np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / doubled, ny / doubled, nz / doubled
    up = nx * (ball[0] - a[0]) + ny * (ball[1] - a[1]) + nz * (ball[2] - a[2])
    out[0], out[1], out[2] = ball[0] - up * nx, ball[1] - up * ny, ball[2] - up * nz
    side = nx * (top[0] - a[0]) + ny * (top[1] - a[1]) + nz * (top[2] - a[2])
    return float(up if side > 0 else -up)


@jit
def _two_pieces(
    p: FloatArray, a: int, b: int, c: int, circle: FloatArray, ball: FloatArray, up: float, total: FloatArray, weight: FloatArray
) -> float:
    """Enter the pieces of the edge a b in the face a b c; their energy. The side of the edge that c lies on counts as positive."""
    half2, in2, facing = 0.0, 0.0, 0.0
    for x in range(3):
        middle = (p[a, x] + p[b, x]) / 2
        half2 += (p[b, x] - p[a, x]) ** 2 / 4
        in2 += (circle[x] - middle) ** 2
        facing += (circle[x] - middle) * (p[c, x] - middle)  # circle - middle is at right angles to the edge
    depth = np.sqrt(in2) if facing > 0 else -np.sqrt(in2)
    volume = np.sqrt(half2) * depth * up / 6
    weight[a] += volume
    weight[b] += volume
    for x in range(3):
        inner = ((p[a, x] + p[b, x]) / 2 + circle[x] + ball[x]) / 4
        total[a, x] += volume * (p[a, x] / 4 + inner)
        total[b, x] += volume * (p[b, x] / 4 + inner)
    return float(2 * volume * (6 * half2 + 3 * in2 + up * up) / 10)
