"""Fewer points where a scan is denser than its surface needs: none twice, and no more than a surface is worth: the cost grows with every one."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from scan2fea.kernel.face_tree import morton_order
from scan2fea.kernel.noise import noise_sigma, spacing
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.types import Scan

TRIES = 12
LEANING = Rotation.from_quat((1.0, 2.0, 3.0, 4.0)).as_matrix()  # cells square to faces would part whole faces along their middle: +0.3 % in a wall
DENSE = 2  # points a cell: of a dozen one lies in the noise's tail and fills a cell there; of two hardly any
SMALL = 0.25  # noise against the edge of a cell: at 0.2 walls of two cells grow by 0.2 %, at 0.32 by 1.8 %


def distinct(scan: Scan) -> Scan:
    """The scan itself, or the first of its points in each place where several coincide: copies tell nothing, and make the rest seem far apart."""
    points = scan.cloud.points
    order = np.lexsort(points.T)
    is_copy = np.zeros(len(points), bool)
    is_copy[order[1:]] = (points[order[1:]] == points[order[:-1]]).all(axis=1)  # the sort is stable: the first of a place comes first
    if not is_copy.any():
        return scan
    return Scan(cloud=scan.cloud.take(np.flatnonzero(~is_copy)), rays=scan.rays).compact()


def thinned(scan: Scan, max_points: int) -> Scan:
    """The scan itself, or at most `max_points` of its points: the first of each cell of the finest grid that has no more cells than that.

    Points are picked, not averaged: a mean would draw the two faces of a thin wall together. Where the noise is not small against the cells, every
    k-th point along a Morton curve (systematic sampling): cells thin out the dense middle of a blurred face, not its tails, and a wall grows. The
    more points a cell has the more: of a dense scan DENSE a cell are taken first, likewise.
    """
    if len(scan.cloud) > DENSE * max_points:
        scan = _every_kth(scan, DENSE * max_points)
    points = scan.cloud.points
    if len(points) <= max_points:
        return scan
    edge = spacing(points) * math.sqrt(len(points) / max_points)  # points on a surface: their number goes with the square of the edge
    leaning = points @ LEANING
    if not noise_sigma(points) <= SMALL * edge:
        return _every_kth(scan, max_points)
    for _ in range(TRIES):
        cells = voxel_mean(leaning, edge)
        if cells.n_cells <= max_points:
            break
        edge *= 1.02 * math.sqrt(cells.n_cells / max_points)
    return Scan(cloud=scan.cloud.take(np.sort(cells.first_row)[:max_points]), rays=scan.rays).compact()


def _every_kth(scan: Scan, n: int) -> Scan:
    """n of the points of a scan, as far from each other along a Morton curve."""
    points = scan.cloud.points
    rows = morton_order(points)[((np.arange(n) + 0.5) * (len(points) / n)).astype(np.int64)]
    return Scan(cloud=scan.cloud.take(np.sort(rows)), rays=scan.rays).compact()
