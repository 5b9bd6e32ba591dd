"""Mid nodes of TET10 on the curved faces that their edges are chords of, as long as every tet stays valid."""

from __future__ import annotations

import numpy as np

from scan2fea.kernel.quality import TET_LIMITS, scaled_jacobian
from scan2fea.types import FloatArray, IntArray, TetMesh

GOOD = float(TET_LIMITS["scaled_jacobian"].warn or 0.0)  # no tet falls below it for being curved; one that is below it falls no further


def curved(mesh: TetMesh, edges: IntArray, middles: FloatArray) -> tuple[TetMesh, int]:
    """The TET10 mesh with the middles of boundary edges where they are given, and how many edges had to stay straight.

    edges : (e, 2) corners of boundary edges, each once, in any direction.
    middles : (e, 3) metres, on the face or curve that the edge is a chord of.
    """
    n = len(mesh.nodes)
    ends, mids = np.sort(mesh.boundary[:, [[0, 1], [1, 2], [0, 2]]], axis=2).reshape(-1, 2), mesh.boundary[:, 3:].ravel()
    known, first = np.unique(ends[:, 0] * n + ends[:, 1], return_index=True)
    asked = np.sort(edges, axis=1)
    rows = mids[first][np.searchsorted(known, asked[:, 0] * n + asked[:, 1])]
    straight = np.asarray(mesh.nodes)
    nodes = straight.copy()
    nodes[rows] = middles
    tets = np.asarray(mesh.tets)
    least = np.minimum(scaled_jacobian(straight, tets), GOOD)
    bent = np.zeros(n, bool)
    bent[rows] = True
    at = np.flatnonzero(bent[tets].any(axis=1))
    flattened = 0
    while True:  # ends: each round makes edges straight
        at = at[scaled_jacobian(nodes, tets[at]) < (1 - 1e-9) * least[at]]
        spoiled = np.unique(tets[at][bent[tets[at]]])
        if not len(spoiled):
            return TetMesh(nodes=nodes, tets=mesh.tets, boundary=mesh.boundary, face_tag=mesh.face_tag, face_names=mesh.face_names), flattened
        nodes[spoiled], bent[spoiled] = straight[spoiled], False
        flattened += len(spoiled)
        at = np.flatnonzero(bent[tets].any(axis=1))
