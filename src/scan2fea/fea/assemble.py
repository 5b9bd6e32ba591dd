"""Stiffness and consistent mass of a tetrahedral mesh, full isoparametric (straight or curved sides).

The matrices live on the graph of the nodes: a stiffness is one 3 x 3 block per pair of nodes that share an element, a mass is one
number per pair (the same along x, y and z). The graph is built once, sorted, and both are filled into it in element order, so the
same mesh gives the same bytes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from scan2fea.errors import SolveError, require
from scan2fea.fea.elements import EDGES, quadrature, shape, shape_gradient
from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray, Material, TetMesh, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class System(Value):
    """Stiffness and mass on the node graph of a mesh.

    indptr : (n + 1,), indices : (nnz,), sorted by row.   stiffness : (nnz, 3, 3), N/m.   mass : (nnz,), kg.
    nodes : (n, 3) metres from their mean.   ends : (n, 2) the corners between which a node is the middle; a corner twice itself.
    """

    indptr: IntArray
    indices: IntArray
    stiffness: FloatArray
    mass: FloatArray
    nodes: FloatArray
    ends: IntArray

    @property
    def n_nodes(self) -> int:
        return len(self.indptr) - 1

    def stiffness_matrix(self) -> sp.bsr_array:
        """(3n, 3n), blocks of 3."""
        n = 3 * self.n_nodes
        return sp.bsr_array((self.stiffness, self.indices, self.indptr), shape=(n, n))

    def mass_matrix(self) -> sp.csr_array:
        """(n, n): it acts alike on x, y and z."""
        return sp.csr_array((self.mass, self.indices, self.indptr), shape=(self.n_nodes, self.n_nodes))


def node_graph(tets: IntArray, n_nodes: int) -> tuple[IntArray, IntArray]:
    """(indptr, indices) of the nodes that share an element, each row sorted, the diagonal included."""
    m, k = tets.shape
    incidence = sp.csr_array((np.ones(m * k, np.int32), tets.ravel(), np.arange(0, m * k + 1, k)), shape=(m, n_nodes))
    graph = sp.csr_array(incidence.T @ incidence)
    graph.sort_indices()
    return graph.indptr.astype(np.int64), graph.indices.astype(np.int64)


@jit
def entry(indices: IntArray, low: int, high: int, column: int) -> int:
    """Position of `column` in the sorted indices[low:high], where it is known to be."""
    while low < high - 1:
        middle = (low + high) // 2
        if indices[middle] <= column:
            low = middle
        else:
            high = middle
    return low


@jit
def _jacobian(nodes: FloatArray, tet: IntArray, dshape: FloatArray, inverse: FloatArray) -> float:
    """Determinant of dx/dxi at one point; `inverse` becomes dxi/dx times the determinant."""
    j = np.zeros((3, 3))
    for a in range(len(tet)):
        for r in range(3):
            for c in range(3):
                j[r, c] += nodes[tet[a], r] * dshape[a, c]
    for r in range(3):
        for c in range(3):
            r1, r2, c1, c2 = (r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3
            inverse[c, r] = j[r1, c1] * j[r2, c2] - j[r1, c2] * j[r2, c1]
    return float(j[0, 0] * inverse[0, 0] + j[0, 1] * inverse[1, 0] + j[0, 2] * inverse[2, 0])


@jit
def _element_stiffness(g: FloatArray, w: float, lam: float, mu: float, element: FloatArray) -> None:
    """Add one point's w (lam g_a g_b' + mu g_b g_a' + mu g_a.g_b) for the pairs a <= b; g (nodes, 3) are gradients."""
    for a in range(len(g)):
        for b in range(a, len(g)):
            dot = mu * w * (g[a, 0] * g[b, 0] + g[a, 1] * g[b, 1] + g[a, 2] * g[b, 2])
            for r in range(3):
                for c in range(3):
                    element[a, b, r, c] += w * (lam * g[a, r] * g[b, c] + mu * g[a, c] * g[b, r])
                element[a, b, r, r] += dot


@jit
def _fill_stiffness(
    nodes: FloatArray, tets: IntArray, indptr: IntArray, indices: IntArray, dshape: FloatArray, weights: FloatArray, lame: FloatArray, out: FloatArray
) -> int:
    """Add every element's stiffness to `out`; the number of the first element with a determinant <= 0, or -1."""
    n = tets.shape[1]
    inverse = np.zeros((3, 3))
    g = np.zeros((n, 3))
    element = np.zeros((n, n, 3, 3))
    for e in range(len(tets)):
        element[:] = 0.0
        for q in range(len(weights)):
            det = _jacobian(nodes, tets[e], dshape[q], inverse)
            if det <= 0.0:
                return e
            for a in range(n):
                for c in range(3):
                    g[a, c] = (dshape[q, a, 0] * inverse[0, c] + dshape[q, a, 1] * inverse[1, c] + dshape[q, a, 2] * inverse[2, c]) / det
            _element_stiffness(g, weights[q] * det / 6.0, lame[0], lame[1], element)
        for a in range(n):
            row = tets[e, a]
            for b in range(n):
                k = entry(indices, indptr[row], indptr[row + 1], tets[e, b])
                for r in range(3):
                    for c in range(3):
                        out[k, r, c] += element[a, b, r, c] if a <= b else element[b, a, c, r]
    return -1


@jit
def _fill_mass(
    nodes: FloatArray,
    tets: IntArray,
    indptr: IntArray,
    indices: IntArray,
    shapes: FloatArray,
    dshape: FloatArray,
    weights: FloatArray,
    out: FloatArray,
) -> int:
    """Add every element's integral of N_a N_b to `out`; the number of the first element with a determinant <= 0, or -1."""
    n = tets.shape[1]
    inverse = np.zeros((3, 3))
    element = np.zeros((n, n))
    for e in range(len(tets)):
        element[:] = 0.0
        for q in range(len(weights)):
            det = _jacobian(nodes, tets[e], dshape[q], inverse)
            if det <= 0.0:
                return e
            for a in range(n):
                for b in range(n):
                    element[a, b] += weights[q] * det / 6.0 * shapes[q, a] * shapes[q, b]
        for a in range(n):
            row = tets[e, a]
            for b in range(n):
                out[entry(indices, indptr[row], indptr[row + 1], tets[e, b])] += element[a, b]
    return -1


def lame(material: Material) -> FloatArray:
    """The constants (lambda, mu) in Pa."""
    e, nu = material.youngs_pa, material.poisson
    return np.array([e * nu / ((1 + nu) * (1 - 2 * nu)), e / (2 * (1 + nu))])


def assemble(mesh: TetMesh, material: Material) -> System:
    """Stiffness (4 points in a TET10, 1 in a TET4: exact for straight sides) and consistent mass (14 points).

    Raises SolveError where an element is turned inside out at a point of either rule, or where a node belongs to no element.
    """
    # the coordinates are taken about their mean: far from the origin the differences would lose digits
    nodes = np.array(mesh.nodes - mesh.nodes.mean(axis=0), float)
    tets = np.array(mesh.tets, np.int64)
    n_free = len(nodes) - len(np.unique(tets))
    require(n_free == 0, SolveError, f"{n_free} of {len(nodes)} nodes belong to no element: the mesh must hold only nodes in use")
    indptr, indices = node_graph(tets, len(nodes))
    k = tets.shape[1]
    points, weights = quadrature(1 if k == 4 else 2)
    stiffness = np.zeros((len(indices), 3, 3))
    bad = _fill_stiffness(nodes, tets, indptr, indices, shape_gradient(points, k), weights, lame(material), stiffness)
    points, weights = quadrature(5)
    mass = np.zeros(len(indices))
    if bad < 0:
        bad = _fill_mass(nodes, tets, indptr, indices, shape(points, k), shape_gradient(points, k), weights, mass)
    require(bad < 0, SolveError, f"element {bad} has a Jacobian <= 0: it is turned inside out or flat; mesh again with another size")
    ends = np.repeat(np.arange(len(nodes))[:, None], 2, axis=1)
    ends[tets[:, 4:]] = tets[:, np.array(EDGES)][:, : k - 4]
    return System(indptr=indptr, indices=indices, stiffness=stiffness, mass=mass * material.density_kg_m3, nodes=nodes, ends=ends)
