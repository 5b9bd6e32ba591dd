"""Strains, stresses and energies at the integration points, straight from the displacements: a second path beside the matrices."""

from __future__ import annotations

import numpy as np

from scan2fea.fea.assemble import _jacobian, lame
from scan2fea.fea.elements import quadrature, shape_gradient
from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray, Material, TetMesh


@jit
def _strain_at(tet: IntArray, dshape: FloatArray, inverse: FloatArray, det: float, u: FloatArray, out: FloatArray) -> None:
    """The strain (3, 3) of the displacements u (n, 3) at one point. They are taken from the first node on: a translation strains nothing."""
    out[:] = 0.0
    for a in range(1, len(tet)):
        for c in range(3):
            g = (dshape[a, 0] * inverse[0, c] + dshape[a, 1] * inverse[1, c] + dshape[a, 2] * inverse[2, c]) / det
            for r in range(3):
                half = 0.5 * g * (u[tet[a], r] - u[tet[0], r])
                out[r, c] += half
                out[c, r] += half


@jit
def _fill_strains(
    nodes: FloatArray, tets: IntArray, dshape: FloatArray, weights: FloatArray, u: FloatArray, strain: FloatArray, volume: FloatArray
) -> None:
    inverse = np.zeros((3, 3))
    for e in range(len(tets)):
        for q in range(len(weights)):
            det = _jacobian(nodes, tets[e], dshape[q], inverse)
            volume[e, q] = weights[q] * det / 6.0
            _strain_at(tets[e], dshape[q], inverse, det, u, strain[e, q])


@jit
def _add_energies(
    nodes: FloatArray, tets: IntArray, dshape: FloatArray, weights: FloatArray, constants: FloatArray, fields: FloatArray, out: FloatArray
) -> None:
    """The lower half of `out` (k, k): integrals of strain_i : stress_j of fields (k, n, 3)."""
    inverse, strain = np.zeros((3, 3)), np.zeros((len(fields), 3, 3))
    for e in range(len(tets)):
        for q in range(len(weights)):
            det = _jacobian(nodes, tets[e], dshape[q], inverse)
            w = weights[q] * det / 6.0
            for i in range(len(fields)):
                s = strain[i]
                _strain_at(tets[e], dshape[q], inverse, det, fields[i], s)
                for j in range(i + 1):
                    t = strain[j]
                    dot = s[0, 0] * t[0, 0] + s[1, 1] * t[1, 1] + s[2, 2] * t[2, 2]
                    dot += 2.0 * (s[0, 1] * t[0, 1] + s[0, 2] * t[0, 2] + s[1, 2] * t[1, 2])
                    traces = (s[0, 0] + s[1, 1] + s[2, 2]) * (t[0, 0] + t[1, 1] + t[2, 2])
                    out[i, j] += w * (2.0 * constants[1] * dot + constants[0] * traces)


def _arguments(mesh: TetMesh) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Nodes about their mean, tets, gradients of the shape functions at the points of the stiffness, and their weights."""
    points, weights = quadrature(1 if mesh.order == 1 else 2)
    tets = np.array(mesh.tets, np.int64)
    return np.array(mesh.nodes - mesh.nodes.mean(axis=0), float), tets, shape_gradient(points, tets.shape[1]), weights


def energies(mesh: TetMesh, material: Material, fields: FloatArray) -> FloatArray:
    """(k, k) integrals of strain_i : stress_j, J, for displacement fields (k, n, 3), m: twice the strain energy on the diagonal."""
    total = np.zeros((len(fields), len(fields)))
    _add_energies(*_arguments(mesh), lame(material), np.array(fields, float), total)
    return np.asarray(total + np.tril(total, -1).T)


def _strains(mesh: TetMesh, field: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(strains (m, q, 3, 3), volumes of the points (m, q))."""
    nodes, tets, dshape, weights = _arguments(mesh)
    strain, volume = np.zeros((len(tets), len(weights), 3, 3)), np.zeros((len(tets), len(weights)))
    _fill_strains(nodes, tets, dshape, weights, np.array(field, float), strain, volume)
    return strain, volume


def _stress(strain: FloatArray, material: Material) -> FloatArray:
    lam, mu = lame(material)
    stress = 2 * mu * strain
    pressed = lam * (strain[..., 0, 0] + strain[..., 1, 1] + strain[..., 2, 2])
    for k in range(3):
        stress[..., k, k] += pressed
    return np.asarray(stress)


def stresses(mesh: TetMesh, material: Material, field: FloatArray) -> FloatArray:
    """(m, q, 3, 3) Pa at the integration points under the displacement (n, 3)."""
    return _stress(_strains(mesh, field)[0], material)


def at_nodes(mesh: TetMesh, per_point: FloatArray, volume: FloatArray) -> FloatArray:
    """(n,) mean over the elements at each node, by volume, of values (m q,) at the integration points."""
    m, k = mesh.tets.shape
    weight = volume.reshape(m, -1).sum(axis=1)
    mean = (per_point * volume).reshape(m, -1).sum(axis=1)
    rows = mesh.tets.ravel()
    total, share = (np.bincount(rows, np.repeat(x, k), len(mesh.nodes)) for x in (mean, weight))
    return np.asarray(total / np.maximum(share, 1e-300))


def von_mises(mesh: TetMesh, material: Material, field: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(von Mises stress (m q,), Pa, volume (m q,), m3) at the integration points under the displacement (n, 3)."""
    strain, volume = _strains(mesh, field)
    s = _stress(strain, material)
    x, y, z = s[..., 0, 0], s[..., 1, 1], s[..., 2, 2]
    shear = s[..., 0, 1] ** 2 + s[..., 0, 2] ** 2 + s[..., 1, 2] ** 2
    return np.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2 + 3 * shear).ravel(), volume.ravel()
