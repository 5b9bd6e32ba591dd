"""Shape functions and quadrature of the 4- and 10-node tetrahedron.

Node order is that of `TetMesh`: four corners, then the middles of the edges 01 12 02 03 13 23 (VTK, Abaqus and Nastran agree on it).
"""

from __future__ import annotations

import itertools

import numpy as np

from scan2fea.types import FloatArray, IntArray

EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
# faces S1..S4 of C3D4 and C3D10 in the Abaqus and CalculiX numbering, outward
FACES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))

# d(barycentric coordinate) / d(xi, eta, zeta), with L0 = 1 - xi - eta - zeta
_DL = np.array([[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def _orbit(*coordinates: float) -> list[tuple[float, ...]]:
    return sorted(set(itertools.permutations(coordinates)))


def quadrature(degree: int) -> tuple[FloatArray, FloatArray]:
    """Barycentric points (q, 4) and weights (q,) that sum to 1; exact to `degree` <= 5, all weights positive.

    Degree 1 and 2: centroid and the 4-point rule (Hammer and Stroud 1956). Degree 5: the 14-point rule (Walkington 2000).
    """
    if degree <= 1:
        return np.full((1, 4), 0.25), np.ones(1)
    if degree == 2:
        b = (5 - np.sqrt(5)) / 20
        return np.array(_orbit(b, b, b, 1 - 3 * b)), np.full(4, 0.25)
    a1, w1 = 0.31088591926330060980, 0.11268792571801585080
    a2, w2 = 0.092735250310891226402, 0.073493043116361949544
    a3, w3 = 0.045503704125649649492, 0.042546020777081466438
    groups = [(_orbit(a1, a1, a1, 1 - 3 * a1), w1), (_orbit(a2, a2, a2, 1 - 3 * a2), w2), (_orbit(a3, a3, 0.5 - a3, 0.5 - a3), w3)]
    points = [p for group, _ in groups for p in group]
    weights = [w for group, w in groups for _ in group]
    return np.array(points), np.array(weights) / np.sum(weights)


def shape(points: FloatArray, n_nodes: int) -> FloatArray:
    """(q, n_nodes) shape functions at barycentric points (q, 4)."""
    if n_nodes == 4:
        return np.array(points)
    middle = np.stack([4 * points[:, i] * points[:, j] for i, j in EDGES], axis=1)
    return np.concatenate([points * (2 * points - 1), middle], axis=1)


def shape_gradient(points: FloatArray, n_nodes: int) -> FloatArray:
    """(q, n_nodes, 3) derivatives of the shape functions along xi, eta, zeta."""
    if n_nodes == 4:
        return np.repeat(_DL[None], len(points), axis=0)
    corner = (4 * points - 1)[:, :, None] * _DL[None]
    middle = np.stack([4 * (points[:, i, None] * _DL[j] + points[:, j, None] * _DL[i]) for i, j in EDGES], axis=1)
    return np.concatenate([corner, middle], axis=1)


def surface_volume(nodes: FloatArray, boundary: IntArray) -> float:
    """Volume inside the boundary triangles (k, 3) or (k, 6), m3, by the divergence theorem: (1/3) of the flux of x.

    Curved triangles are integrated exactly: the integrand is of degree 4 (6-point rule of Dunavant 1985).
    """
    x = nodes - nodes.mean(axis=0)
    a, b = 0.445948490915965, 0.091576213509771
    bary = np.array(_orbit(a, a, 1 - 2 * a) + _orbit(b, b, 1 - 2 * b))
    weights = np.array([0.223381589678011] * 3 + [0.109951743655322] * 3)
    p = x[boundary]
    d = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    total = 0.0
    for bc, w in zip(bary, weights / weights.sum(), strict=True):
        if boundary.shape[1] == 3:
            n, dn = bc, d
        else:
            edges = ((0, 1), (1, 2), (0, 2))
            n = np.concatenate([bc * (2 * bc - 1), [4 * bc[i] * bc[j] for i, j in edges]])
            dn = np.concatenate([(4 * bc - 1)[:, None] * d, [4 * (bc[i] * d[j] + bc[j] * d[i]) for i, j in edges]])
        at = np.einsum("n,knc->kc", n, p)
        normal = np.cross(np.einsum("n,knc->kc", dn[:, 0], p), np.einsum("n,knc->kc", dn[:, 1], p))
        total += w * float(np.einsum("kc,kc->", at, normal)) / 6
    return total
