"""How much a cubic solution on the same mesh would differ: an error estimate without solving anything again.

The residual of the quadratic solution is tested with what cubic elements add, a function on each edge and each face, one at a time (Deuflhard, Leinen
and Yserentant 1989). The sum of what each would gain in energy estimates the energy of the difference.
"""

from __future__ import annotations

import itertools

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.assemble import lame
from scan2fea.fea.elements import EDGES, quadrature, shape, shape_gradient
from scan2fea.types import BoolArray, FloatArray, IntArray, Material, TetMesh

_DL = np.array([[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_TRIPLES = tuple(itertools.combinations(range(4), 3))
_CHUNK = 4_000


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
    n, dn = shape(points, 10), shape_gradient(points, 10)
    lam, mu = lame(material)
    x = mesh.nodes - mesh.nodes.mean(axis=0)
    sign = _signs(tets)
    for first in range(0, len(tets), _CHUNK):
        rows = slice(first, first + _CHUNK)
        own = tets[rows]
        jacobian = np.einsum("mna,qnc->mqac", x[own], dn, optimize=True)
        inverse, volume = np.linalg.inv(jacobian), np.linalg.det(jacobian) * weights / 6
        gradient = np.einsum("qnc,mqca->mqna", dn, inverse, optimize=True)
        extra = np.einsum("qsc,mqca->mqsa", slope, inverse, optimize=True) * sign[rows, None, :, None]
        at = number[rows].ravel()
        dot = np.einsum("mq,mqsa,mqsa->ms", volume, extra, extra, optimize=True)
        outer = np.einsum("mq,mqsa,mqsb->msab", volume, extra, extra, optimize=True)
        own_block = (lam + mu) * outer + mu * dot[..., None, None] * np.eye(3)
        np.add.at(block, at, own_block.reshape(-1, 3, 3))
        for k, field in enumerate(fields):
            u = field[own] - field[own].mean(axis=1, keepdims=True)
            h = np.einsum("mqna,mnb->mqab", gradient, u, optimize=True)
            stress = mu * (h + h.transpose(0, 1, 3, 2)) + lam * np.trace(h, axis1=2, axis2=3)[..., None, None] * np.eye(3)
            inner = np.einsum("mq,mqsa,mqab->msb", volume, extra, stress, optimize=True)
            force = np.einsum("mq,qs,qn,mnb->msb", volume, value, n, body[k][own], optimize=True) * sign[rows, :, None]
            np.add.at(residual[k], at, (force - inner).reshape(-1, 3))
    free = ~is_held
    gained = np.einsum("ksa,sab,ksb->k", residual[:, free], np.linalg.inv(block[free]), residual[:, free], optimize=True)
    return np.asarray(gained)


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
