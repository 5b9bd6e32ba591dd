"""A smooth closed surface cut into four-sided patches with common borders: each triangle of a coarse mesh becomes three, grids of points lie on them.

Corners are the vertices of the coarse mesh, the middles of its edges and of its triangles, all put onto the surface; borders are curves of points on
the surface that two patches share to the last bit; grids lie between them (Coons 1967) and are put onto the surface as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.topology import edge_table
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value

SAMPLES = 13  # points along every border
SPREADS = 2  # rounds in which the points of a border are spread evenly along it


@dataclass(frozen=True, eq=False, kw_only=True)
class Quads(Value):
    """curves : (c, S, 3) points of each border.   sides : (q, 4) curves of each patch at v = 0, u = 1, v = 1, u = 0, along u or v.

    grids : (q, S, S, 3), u first; u x v points outward.
    """

    curves: FloatArray
    sides: IntArray
    grids: FloatArray


def quads_on(coarse: TriangleMesh, surface: TriangleMesh) -> Quads:
    """Three patches per triangle of a closed `coarse` mesh near `surface`."""
    onto = PointToMesh(surface)

    def put(points: FloatArray) -> FloatArray:
        return np.asarray(onto.nearest(points.reshape(-1, 3)).closest).reshape(points.shape)

    table = edge_table(coarse.faces)
    n_edges = len(table.edges)
    corner = put(coarse.vertices)
    whole = _spread(np.linspace(corner[table.edges[:, 0]], corner[table.edges[:, 1]], 2 * SAMPLES - 1, axis=1), put)
    halves = np.stack([whole[:, :SAMPLES], whole[:, : SAMPLES - 2 : -1]], axis=1)  # from either end to the middle
    edge_of = table.edge_of.reshape(-1, 3)
    centre = put(whole[edge_of, SAMPLES - 1].mean(1))
    spokes = _spread(np.linspace(whole[edge_of, SAMPLES - 1], np.repeat(centre[:, None], 3, axis=1), SAMPLES, axis=2).reshape(-1, SAMPLES, 3), put)
    curves = np.concatenate([halves.reshape(-1, SAMPLES, 3), spokes])
    k = np.arange(3)
    faces = np.arange(len(coarse.faces))[:, None]
    ahead, before = edge_of, edge_of[:, k - 1]  # of corner k: the edge to the next corner, the edge from the last one
    first = 2 * ahead + (coarse.faces != table.edges[ahead][..., 0])
    last = 2 * before + (coarse.faces != table.edges[before][..., 0])
    out, back = 2 * n_edges + 3 * faces + k, 2 * n_edges + 3 * faces + (k - 1) % 3
    sides = np.stack([first, out, back, last], axis=2).reshape(-1, 4)
    return Quads(curves=curves, sides=sides.astype(np.int64), grids=put(_coons(curves, sides)))


def _spread(curves: FloatArray, put: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Points (c, s, 3) between fixed ends put onto the surface and spread evenly along the way there."""
    for _ in range(SPREADS):
        curves = np.concatenate([curves[:, :1], put(curves[:, 1:-1]), curves[:, -1:]], axis=1)
        step = np.linalg.norm(np.diff(curves, axis=1), axis=2)
        along = np.concatenate([np.zeros((len(curves), 1)), np.cumsum(step, axis=1)], axis=1)
        share = np.linspace(0, 1, curves.shape[1])
        even = [np.stack([np.interp(share * a[-1], a, c[:, x]) for x in range(3)], axis=1) for a, c in zip(along, curves, strict=True)]
        curves = np.stack(even)
    return np.concatenate([curves[:, :1], put(curves[:, 1:-1]), curves[:, -1:]], axis=1)


def _coons(curves: FloatArray, sides: IntArray) -> FloatArray:
    """(q, S, S, 3) between four borders: corner, middle of an edge, middle of the triangle, middle of the other edge."""
    low, right = curves[sides[:, 0]], curves[sides[:, 1]]  # v = 0: along u; u = 1: along v
    top, left = curves[sides[:, 2]], curves[sides[:, 3]]  # v = 1: along u, u = 0: along v, both in the direction of the parameter
    s = np.linspace(0, 1, curves.shape[1])
    u, v = s[None, :, None, None], s[None, None, :, None]
    ruled = (1 - v) * low[:, :, None] + v * top[:, :, None] + (1 - u) * left[:, None] + u * right[:, None]
    a, b, c, d = low[:, 0], low[:, -1], top[:, -1], left[:, -1]
    corners = (
        (1 - u) * (1 - v) * a[:, None, None] + u * (1 - v) * b[:, None, None] + u * v * c[:, None, None] + (1 - u) * v * d[:, None, None]
    )  # fmt: skip
    grid = ruled - corners
    grid[:, :, 0], grid[:, :, -1], grid[:, 0], grid[:, -1] = low, top, left, right
    return np.asarray(grid)
