"""How much a cubic solution on the same mesh would differ: an error estimate without solving anything again.

The residual of the quadratic solution is tested with what cubic elements add, a function on each edge and each face, one at a time (Deuflhard, Leinen
and Yserentant 1989). The sum of what each would gain in energy estimates the energy of the difference.
"""

from __future__ import annotations

import itertools

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.assemble import _jacobian, lame
from scan2fea.fea.elements import EDGES, quadrature, shape, shape_gradient
from scan2fea.kernel.jit import jit
from scan2fea.types import BoolArray, FloatArray, IntArray, Material, TetMesh

_DL = np.array([[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_TRIPLES = tuple(itertools.combinations(range(4), 3))


def energy_of_error(mesh: TetMesh, material: Material, fields: FloatArray, body: FloatArray, held: BoolArray) -> FloatArray:
    """(k,) twice the strain energy, J, of the difference to a cubic solution.

    fields : (k, n, 3) displacements.   body : (k, n, 3) the force per volume they answer, N/m3, at the nodes.   held : (n,) nodes that do not move.
    Raises SolveError for meshes of first order.
    """
    require(mesh.order == 2, SolveError, "the error estimate is for quadratic elements")
    tets = np.asarray(mesh.tets, np.int64)
    number, n_extra, is_held = _extras(tets, len(mesh.nodes), held)
    residual = np.zeros((len(fields), n_extra, 3))
    block = np.zeros((n_extra, 3, 3))
    points, weights = quadrature(5)
    value, slope = _cubics(points)
    x = np.array(mesh.nodes - mesh.nodes.mean(axis=0), float)
    _fill(
        x, tets, number, _signs(tets), value, slope, shape(points, 10), shape_gradient(points, 10), weights, lame(material),
        np.array(fields, float), np.array(body, float), residual, block,
    )  # fmt: skip
    free = ~is_held
    gained = np.einsum("ksa,sab,ksb->k", residual[:, free], np.linalg.inv(block[free]), residual[:, free], optimize=True)
    return np.asarray(gained)


@jit
def _fill(
    nodes: FloatArray,
    tets: IntArray,
    number: IntArray,
    sign: FloatArray,
    value: FloatArray,
    slope: FloatArray,
    shapes: FloatArray,
    dshape: FloatArray,
    weights: FloatArray,
    constants: FloatArray,
    fields: FloatArray,
    body: FloatArray,
    residual: FloatArray,
    block: FloatArray,
) -> None:
    """Add what every element's added functions feel of each field: `residual` (k, s, 3), and their own stiffness `block` (s, 3, 3)."""
    lam, mu = constants[0], constants[1]
    inverse, g, e, h, f = np.zeros((3, 3)), np.zeros((10, 3)), np.zeros((10, 3)), np.zeros((3, 3)), np.zeros(3)
    for t in range(len(tets)):
        for q in range(len(weights)):
            det = _jacobian(nodes, tets[t], dshape[q], inverse)
            w = weights[q] * det / 6.0
            for a in range(10):
                for c in range(3):
                    g[a, c] = (dshape[q, a, 0] * inverse[0, c] + dshape[q, a, 1] * inverse[1, c] + dshape[q, a, 2] * inverse[2, c]) / det
                    e[a, c] = slope[q, a, 0] * inverse[0, c] + slope[q, a, 1] * inverse[1, c] + slope[q, a, 2] * inverse[2, c]
                    e[a, c] *= sign[t, a] / det
            _add_stiffness(e, w, lam, mu, number[t], block)
            for k in range(len(fields)):
                h[:], f[:] = 0.0, 0.0
                for a in range(10):
                    n = tets[t, a]
                    for c in range(3):
                        # from the first node: far from the origin, or moved as a whole, the sum would lose digits
                        u = fields[k, n, c] - fields[k, tets[t, 0], c]
                        f[c] += shapes[q, a] * body[k, n, c]
                        for r in range(3):
                            h[r, c] += g[a, r] * u
                _add_residual(e, h, f, value[q], sign[t], w, lam, mu, number[t], residual[k])


@jit
def _add_stiffness(e: FloatArray, w: float, lam: float, mu: float, number: IntArray, block: FloatArray) -> None:
    """One point's own stiffness of the added functions; e (10, 3) their gradients."""
    for a in range(10):
        s = number[a]
        dot = w * mu * (e[a, 0] ** 2 + e[a, 1] ** 2 + e[a, 2] ** 2)
        for r in range(3):
            block[s, r, r] += dot
            for c in range(3):
                block[s, r, c] += w * (lam + mu) * e[a, r] * e[a, c]


@jit
def _add_residual(
    e: FloatArray, h: FloatArray, f: FloatArray, value: FloatArray, sign: FloatArray, w: float, lam: float, mu: float, at: IntArray, out: FloatArray
) -> None:
    """One point's work on the added functions: of the force per volume f, less that of the stress under the gradient h[r, c] = du_c / dx_r."""
    spread = lam * (h[0, 0] + h[1, 1] + h[2, 2])
    for a in range(10):
        for c in range(3):
            inner = e[a, c] * spread
            for r in range(3):
                inner += mu * e[a, r] * (h[r, c] + h[c, r])
            out[at[a], c] += w * (value[a] * sign[a] * f[c] - inner)


def _cubics(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(values (q, 10), natural gradients (q, 10, 3)) of L_i L_j (L_i - L_j) on the edges and L_i L_j L_k on the faces."""
    values, slopes = [], []
    for i, j in EDGES:
        a, b = points[:, i], points[:, j]
        values.append(a * b * (a - b))
        slopes.append((2 * a * b - b * b)[:, None] * _DL[i] + (a * a - 2 * a * b)[:, None] * _DL[j])
    for i, j, k in _TRIPLES:
        a, b, c = points[:, i], points[:, j], points[:, k]
        values.append(a * b * c)
        slopes.append((b * c)[:, None] * _DL[i] + (a * c)[:, None] * _DL[j] + (a * b)[:, None] * _DL[k])
    return np.stack(values, axis=1), np.stack(slopes, axis=1)


def _extras(tets: IntArray, n_nodes: int, held: BoolArray) -> tuple[IntArray, int, BoolArray]:
    """((m, 10) numbers of the added functions of each element, their count, (count,) whether one lies on what is held)."""
    middles, edge = np.unique(tets[:, 4:], return_inverse=True)
    triples = np.sort(tets[:, :4][:, np.array(_TRIPLES)].reshape(-1, 3), axis=1)
    key = (triples[:, 0] * n_nodes + triples[:, 1]) * n_nodes + triples[:, 2]
    _, first, face = np.unique(key, return_index=True, return_inverse=True)
    number = np.concatenate([edge.reshape(-1, 6), len(middles) + face.reshape(-1, 4)], axis=1)
    on_edge = held[middles]  # the middle of an edge is held only where its ends are
    on_face = held[triples[first]].all(axis=1)
    return number.astype(np.int64), len(middles) + len(first), np.concatenate([on_edge, on_face])


def _signs(tets: IntArray) -> FloatArray:
    """(m, 10): the function of an edge changes its sign with the direction; it runs from the lower node to the higher."""
    out = np.ones((len(tets), 10))
    for k, (i, j) in enumerate(EDGES):
        out[:, k] = np.where(tets[:, i] < tets[:, j], 1.0, -1.0)
    return out
