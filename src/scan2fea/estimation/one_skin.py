"""Is what a tube takes for its inner and its outer face one skin, nearer to the axis here and farther there?

A bar turned down along part of its length, a plate in a step and an oval tube lie on both faces of a tube with a thin wall, but hardly ever on both
at one place. Of a tube whose inner face was seen the outer one was seen there too, or nowhere: a duct from within. Where the outer face is hidden
wherever the inner one was seen, and seen elsewhere, nobody can tell the two apart.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.types import BoolArray, FloatArray

_AROUND, _MOST = 16, 48  # cells around the axis, and along it at most
_CELL_POINTS, _FEW = 12, 6  # on average, and of which on it is asked
_ALONE = 1 / 6  # of the one face's points that the other has in a cell at most: clutter, and noise past the middle of the wall
_APART = 0.5  # share of each face's points that lie where the other was not seen


def is_one_skin(local: FloatArray, is_inner: BoolArray, length_m: float) -> bool:
    """Whether most points of either face of a tube lie where the other has none.

    local : (n, 3) points of its sides in the member's frame, m.   is_inner : (n,) whether the inner face is nearer.
    """
    n_z = int(np.clip(len(local) / (_AROUND * _CELL_POINTS), 1, _MOST))
    around = np.floor((np.arctan2(local[:, 1], local[:, 0]) / (2 * math.pi) + 0.5) * _AROUND).astype(np.int64) % _AROUND
    cell = around * n_z + np.clip((local[:, 2] / length_m * n_z).astype(np.int64), 0, n_z - 1)
    inner, outer = (np.bincount(cell[rows], minlength=_AROUND * n_z) for rows in (is_inner, ~is_inner))
    return all(one[(one >= _FEW) & (other <= _ALONE * one)].sum() > _APART * one.sum() for one, other in ((inner, outer), (outer, inner)))
