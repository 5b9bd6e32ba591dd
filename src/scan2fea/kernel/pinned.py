"""Which dimensions of a section the faces that were seen fix, by where those faces lie.

How far a face reaches is no evidence of a dimension: the scan may have ended there, not the wall. Where two parallel faces were seen, their distance
is. Every face lies at an offset that is linear in the dimensions and in the place of the section, so a dimension is fixed where its unit vector is
a combination of the offsets of the faces that were seen.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from scan2fea.kernel.sections import PARAMETERS, ROUND, corner_factors, edge_names

SEEN = 0.1  # of a face: what the noise of a neighbour carries around the corner is less


def pinned(family: str, seen: Collection[str]) -> frozenset[str]:
    """Names of the dimensions that the distances between the faces `seen` fix. Of a round section any arc of a face fixes its circle."""
    names = PARAMETERS[family]
    if family in ROUND:
        circles = {"OUTER": {"d": 1.0}, "INNER": {"d": 1.0, "t": -2.0}}
        rows = [[circles[face].get(name, 0.0) for name in names] for face in ("OUTER", "INNER")[: len(names)] if face in seen]
        return _spanned(names, np.array(rows).reshape(-1, len(names)))
    rows = []
    for factors, edges in zip(corner_factors(family), edge_names(family), strict=True):
        for i, name in enumerate(edges):
            if name in seen:
                both = factors[[i, (i + 1) % len(edges)]]
                across = 0 if np.array_equal(both[0, 0], both[1, 0]) else 1
                rows.append([*both[0, across], float(across == 0), float(across == 1)])
    return _spanned(names, np.array(rows).reshape(-1, len(names) + 2))


def _spanned(names: tuple[str, ...], rows: np.ndarray) -> frozenset[str]:
    """Names whose unit vectors lie in the span of the rows."""
    rank = int(np.linalg.matrix_rank(rows)) if rows.size else 0
    unit = np.eye(len(names), rows.shape[1])
    return frozenset(name for k, name in enumerate(names) if rank and int(np.linalg.matrix_rank(np.vstack([rows, unit[k]]))) == rank)
