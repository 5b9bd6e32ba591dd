"""Forces that strained elements put on their nodes, straight from the displacements.

The assembled matrix times a displacement is the small difference of large numbers where the part moves far and strains little: on a bar 400 times as
long as thick it leaves 4e-6 of a reaction. Per element, with its own translation taken off first, the difference is of what really strains.
"""

from __future__ import annotations

import numpy as np

from scan2fea.fea.assemble import _jacobian, lame
from scan2fea.fea.elements import quadrature, shape_gradient
from scan2fea.kernel.jit import jit
from scan2fea.types import FloatArray, IntArray, Material, TetMesh


@jit
def _forces(
    nodes: FloatArray, tets: IntArray, dshape: FloatArray, weights: FloatArray, constants: FloatArray, u: FloatArray, out: FloatArray
) -> None:
    n = tets.shape[1]
    lam, mu = constants[0], constants[1]
    inverse = np.zeros((3, 3))
    g = np.zeros((n, 3))
    own = np.zeros((n, 3))
    for e in range(len(tets)):
        for a in range(n):
            for c in range(3):
                own[a, c] = u[tets[e, a], c] - u[tets[e, 0], c]
        for q in range(len(weights)):
            det = _jacobian(nodes, tets[e], dshape[q], inverse)
            h = np.zeros((3, 3))
            for a in range(n):
                for c in range(3):
                    g[a, c] = (dshape[q, a, 0] * inverse[0, c] + dshape[q, a, 1] * inverse[1, c] + dshape[q, a, 2] * inverse[2, c]) / det
                for r in range(3):
                    for c in range(3):
                        h[r, c] += own[a, r] * g[a, c]
            trace = lam * (h[0, 0] + h[1, 1] + h[2, 2])
            w = weights[q] * det / 6.0
            for a in range(n):
                for r in range(3):
                    force = trace * g[a, r]
                    for c in range(3):
                        force += mu * (h[r, c] + h[c, r]) * g[a, c]
                    out[tets[e, a], r] += w * force


class InnerForces:
    """u (n, 3) to the forces (n, 3), N, on the nodes of the mesh: the stiffness times u, without the loss of digits."""

    def __init__(self, mesh: TetMesh, material: Material) -> None:
        points, weights = quadrature(1 if mesh.order == 1 else 2)
        self._nodes = np.array(mesh.nodes - mesh.nodes.mean(axis=0), float)
        self._tets = np.array(mesh.tets, np.int64)
        self._rule = (shape_gradient(points, self._tets.shape[1]), weights, lame(material))

    def __call__(self, u: FloatArray) -> FloatArray:
        out = np.zeros((len(self._nodes), 3))
        _forces(self._nodes, self._tets, *self._rule, np.ascontiguousarray(u, float), out)
        return out
