"""Fewer points of a large scan, where it is dense: each is kept as it was measured.

Means over cells would draw the two faces of a wall together that is thinner than a cell, and one point a cell would take as many from the noise's
tail as from the middle of a blurred face. So each point is kept by chance, all alike where the scan is about as dense: what fits a section to its
points reads edges from their density, and chances that changed from place to place would move these.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from scan2fea.kernel.voxels import voxel_mean
from scan2fea.types import FloatArray, IntArray

_LEANING = Rotation.from_quat((1.0, 2.0, 3.0, 4.0)).as_matrix()  # cells square to faces would hold whole faces, or none of their points
_WIDE = 3.0  # edges of cells of one point each: what is around a point
_GRIDS = 4  # shifted against each other: a face that only touches a cell of one fills a cell of another
_ALIKE = 8.0  # at the rim of a face there are half as many, in a corner of three twice as many


def thin_out(points: FloatArray, at_most: int, edge_m: float, seed: int = 0) -> IntArray:
    """(at_most,) ascending rows of so many of the points (n, 3), fewer of dense places. edge_m : of cells that are as many."""
    leaning, around = points @ _LEANING, np.zeros(len(points))
    for shift in np.linspace(0.0, _WIDE * edge_m, _GRIDS, endpoint=False):
        cells = voxel_mean(leaning + shift, _WIDE * edge_m)
        np.maximum(around, cells.count[cells.cell_of_point], out=around)
    alike = _ALIKE ** -np.floor(np.log(around.max() / around) / np.log(_ALIKE))  # of the densest place
    drawn = np.random.default_rng(seed).random(len(points)) * alike
    return np.sort(np.argpartition(drawn, at_most - 1)[:at_most])
