"""A ball that rolls through the Delaunay tets of a cloud: where it gets to, and how far the points lie from there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.delaunay import FACETS, Tetrahedralisation, depth_to
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Setting(Value):
    """What every candidate shares: tets, the axis of each point (sign unknown), the spacing; first, incident: `tetra.incidence`."""

    tetra: Tetrahedralisation
    axis: FloatArray
    spacing_m: float
    first: IntArray
    incident: IntArray

    @classmethod
    def of(cls, tetra: Tetrahedralisation, axis: FloatArray, spacing_m: float) -> Setting:
        first, incident = tetra.incidence
        return cls(tetra=tetra, axis=axis, spacing_m=spacing_m, first=first, incident=incident)


def reached(tetra: Tetrahedralisation, radius: float) -> BoolArray:
    """(m,) tets that a ball of `radius` reaches from outside, through facets and tets of larger circumradius."""
    label = spread(tetra.points, tetra.tets, tetra.neighbors, tetra.circumradius, tetra.is_box.copy(), radius)
    return np.asarray(label == 0)


def depths(setting: Setting, mask: BoolArray, cap: float, rows: IntArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Way from the points of `rows` (all) to the masked tets along their axis and against it; inf beyond `cap`."""
    tetra = setting.tetra
    asked = np.arange(tetra.n_input, dtype=np.int64) if rows is None else rows
    both = np.vstack([setting.axis[asked], -setting.axis[asked]])
    plus, minus = np.split(
        depth_to(tetra.points, tetra.tets, tetra.neighbors, setting.first, setting.incident, np.tile(asked, 2), both, mask, cap), 2
    )
    return plus, minus


@jit
def facet_radius2(points: FloatArray, a: int, b: int, c: int) -> float:
    """Squared circumradius of a triangle: (|u| |v| |u - v| / (2 |u x v|))^2; inf if it is flat."""
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    twice2 = nx * nx + ny * ny + nz * nz
    if twice2 <= 0.0:
        return np.inf
    sides = (ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz) * ((ux - vx) ** 2 + (uy - vy) ** 2 + (uz - vz) ** 2)
    return float(sides / (4.0 * twice2))


@jit
def spread(points: FloatArray, tets: IntArray, neighbors: IntArray, radii: FloatArray, start: BoolArray, radius: float) -> IntArray:
    """Label the tets a ball can be in: 0 reached from `start`; without any start each connected set gets its own number, from 0; -1 too tight."""
    label = np.full(len(tets), -1, np.int64)
    stack = np.zeros(len(tets), np.int64)
    height, n_labels = 0, 0
    seeded = start.any()
    for t in range(len(tets)):
        if start[t]:
            label[t] = 0
            stack[height] = t
            height += 1
    for seed in range(len(tets)):
        if height == 0:
            if seeded:
                break
            if label[seed] >= 0 or radii[seed] <= radius:
                continue
            label[seed] = n_labels
            stack[0] = seed
            height = 1
        current = 0 if seeded else n_labels
        while height > 0:
            height -= 1
            t = stack[height]
            for i in range(4):
                other = neighbors[t, i]
                if other < 0 or label[other] >= 0 or radii[other] <= radius:
                    continue
                if facet_radius2(points, tets[t, FACETS[i, 0]], tets[t, FACETS[i, 1]], tets[t, FACETS[i, 2]]) <= radius * radius:
                    continue
                label[other] = current
                stack[height] = other
                height += 1
        n_labels += 1
    return label


@jit
def facet_radii(points: FloatArray, tets: IntArray, neighbors: IntArray) -> FloatArray:
    """(m, 4) circumradius of each facet, on the lower of its two tets; -1 on the other and on the hull."""
    out = np.full((len(tets), 4), -1.0)
    for t in range(len(tets)):
        for i in range(4):
            if neighbors[t, i] > t:
                radius2 = facet_radius2(points, tets[t, FACETS[i, 0]], tets[t, FACETS[i, 1]], tets[t, FACETS[i, 2]])
                out[t, i] = np.sqrt(radius2)
    return out
