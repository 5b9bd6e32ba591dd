"""From a field to a closed manifold surface of even triangles: points on its level zero, their Delaunay tets, each inside or outside by the field."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.delaunay import Tetrahedralisation, tetrahedralise
from scan2fea.kernel.distances import signed_distance
from scan2fea.reconstruction.occupancy import Field
from scan2fea.reconstruction.singular import boundary, resolve
from scan2fea.types import BoolArray, FloatArray, TriangleMesh

EDGE_CELLS = 0.9
NEAREST = 0.6  # edges between two vertices, at least


def isosurface(field: Field, seed: int = 0) -> tuple[TriangleMesh, int]:
    """The surface and the number of its parts. Raises ReconstructionError if the field holds nothing."""
    edge = EDGE_CELLS * field.cell_m
    points = spread(_crossings(field), NEAREST * edge)
    says = "the rays leave nothing filled behind the points: seen from one side only, or not one object; scan the other side too, or segment it"
    require(len(points) >= 4, ReconstructionError, says)
    tetra = tetrahedralise(points, edge, seed)
    middle = tetra.points[tetra.tets].mean(axis=1)
    value = map_coordinates(field.value, ((middle - field.low) / field.cell_m).T, order=1, mode="nearest")
    return _surface(tetra, np.asarray(value > 0), edge)


def rebuilt(mesh: TriangleMesh, seed: int = 0) -> tuple[TriangleMesh, int]:
    """A surface through the same vertices that does not cross itself: the tets whose middle lies inside `mesh`."""
    edge = float(np.median(np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)))
    tetra = tetrahedralise(mesh.vertices, edge, seed)
    inside = ~tetra.is_box
    inside[inside] = signed_distance(tetra.points[tetra.tets[inside]].mean(axis=1), mesh) < 0
    return _surface(tetra, inside, edge)


def _surface(tetra: Tetrahedralisation, inside: BoolArray, edge: float) -> tuple[TriangleMesh, int]:
    none = np.zeros(len(tetra))
    resolved = resolve(tetra, inside & ~tetra.is_box, np.zeros((len(tetra), 4)), none, none, edge)
    return boundary(tetra, resolved.inside)[0], resolved.n_parts


def _crossings(field: Field) -> FloatArray:
    """(n, 3) where the edges of the grid cross level zero."""
    out = []
    for axis in range(3):
        n = field.value.shape[axis]
        a, b = np.take(field.value, range(n - 1), axis=axis), np.take(field.value, range(1, n), axis=axis)
        at = np.argwhere((a > 0) != (b > 0))
        first, second = a[tuple(at.T)].astype(float), b[tuple(at.T)].astype(float)
        place = at.astype(float)
        place[:, axis] += first / (first - second)
        out.append(field.low + field.cell_m * place)
    return np.concatenate(out)


def spread(points: FloatArray, apart_m: float) -> FloatArray:
    """The points without those nearer than `apart_m` to one kept before."""
    pairs = cKDTree(points).query_pairs(apart_m, output_type="ndarray") if len(points) else np.zeros((0, 2), np.int64)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    keep = np.ones(len(points), bool)
    for i, j in pairs[order].tolist():
        if keep[i] and keep[j]:
            keep[j] = False
    return points[keep]
