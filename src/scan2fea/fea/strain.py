"""Strains, stresses and energies at the integration points, straight from the displacements: a second path beside the matrices."""

from __future__ import annotations

import numpy as np

from scan2fea.fea.assemble import lame
from scan2fea.fea.elements import quadrature, shape_gradient
from scan2fea.types import FloatArray, Material, TetMesh

_CHUNK = 20_000  # elements at a time, to bound the memory


def _gradients(mesh: TetMesh, rows: slice) -> tuple[FloatArray, FloatArray]:
    """(gradients of the shape functions (m, q, nodes, 3), volumes of the points (m, q))."""
    k = mesh.tets.shape[1]
    points, weights = quadrature(1 if k == 4 else 2)
    natural = shape_gradient(points, k)
    x = (mesh.nodes - mesh.nodes.mean(axis=0))[mesh.tets[rows]]
    jacobian = np.einsum("mna,qnc->mqac", x, natural, optimize=True)
    return np.einsum("qnc,mqca->mqna", natural, np.linalg.inv(jacobian), optimize=True), np.linalg.det(jacobian) * weights / 6


def _strain(gradient: FloatArray, values: FloatArray) -> FloatArray:
    """(m, q, 3, 3) symmetric part of the displacement gradient; values (m, nodes, 3) less their mean (a translation strains nothing)."""
    values = values - values.mean(axis=1, keepdims=True)
    h = np.einsum("mqna,mnb->mqab", gradient, values, optimize=True)
    return np.asarray((h + h.transpose(0, 1, 3, 2)) / 2)


def _stress(strain: FloatArray, material: Material) -> FloatArray:
    lam, mu = lame(material)
    return np.asarray(2 * mu * strain + lam * np.trace(strain, axis1=2, axis2=3)[..., None, None] * np.eye(3))


def energies(mesh: TetMesh, material: Material, fields: FloatArray) -> FloatArray:
    """(k, k) integrals of strain_i : stress_j, J, for displacement fields (k, n, 3), m: twice the strain energy on the diagonal."""
    total = np.zeros((len(fields), len(fields)))
    for first in range(0, len(mesh.tets), _CHUNK):
        rows = slice(first, first + _CHUNK)
        gradient, volume = _gradients(mesh, rows)
        strains = [_strain(gradient, field[mesh.tets[rows]]) for field in fields]
        right = np.stack([(_stress(s, material) * volume[..., None, None]).ravel() for s in strains])
        total += np.stack([s.ravel() for s in strains]) @ right.T
    return total


def stresses(mesh: TetMesh, material: Material, field: FloatArray) -> FloatArray:
    """(m, q, 3, 3) Pa at the integration points under the displacement (n, 3)."""
    found = []
    for first in range(0, len(mesh.tets), _CHUNK):
        rows = slice(first, first + _CHUNK)
        found.append(_stress(_strain(_gradients(mesh, rows)[0], field[mesh.tets[rows]]), material))
    return np.concatenate(found)


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
    stresses, volumes = [], []
    for first in range(0, len(mesh.tets), _CHUNK):
        rows = slice(first, first + _CHUNK)
        gradient, volume = _gradients(mesh, rows)
        s = _stress(_strain(gradient, field[mesh.tets[rows]]), material)
        deviator = s - np.trace(s, axis1=2, axis2=3)[..., None, None] * np.eye(3) / 3
        stresses.append(np.sqrt(1.5 * np.einsum("mqab,mqab->mq", deviator, deviator)).ravel())
        volumes.append(volume.ravel())
    return np.concatenate(stresses), np.concatenate(volumes)
