"""Even density: one point per occupied cell (thesis eq 2.4), or fewer points where a scan has more than a run can use (`thin_out`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.filtering.options import FilteringOptions
from scan2fea.filtering.thin_out import thin_out
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.types import PointCloud

_TRIES = 12
_PROBE = 200_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Downsampled:
    """cloud : what is left.   edge_m : of the cells that means were taken over, None where none were.   how : for the report."""

    cloud: PointCloud
    edge_m: float | None
    how: Mapping[str, Any]


def downsample(cloud: PointCloud, options: FilteringOptions = FilteringOptions()) -> Downsampled:
    """Mean position of the points of each cell of a grid anchored at 0; without an edge, points as they are, of dense places fewer.

    Everything else (ray, frame, raw_index, colour, normal, ...) is that of the cell's first point. A cell wider than a wall merges its
    two faces: give an edge below the thinnest wall. Raises UsageError for an edge that is not positive.
    """
    edge = options.voxel_m
    require(edge is None or (math.isfinite(edge) and edge > 0), UsageError, f"filtering.voxel_m is {edge}: it must be a positive length in metres")
    if edge is not None:
        cells = voxel_mean(cloud.points, edge)
        thinned = cloud.take(cells.first_row).replaced(points=cells.mean)
    elif len(cloud) > options.max_points:
        thinned = cloud.take(thin_out(cloud.points, options.max_points, _edge_for(cloud, options.max_points)))
    else:
        return Downsampled(cloud=cloud, edge_m=None, how={"voxel_m": None})
    return Downsampled(cloud=thinned, edge_m=edge, how={"voxel_m": edge, "n_before": len(cloud), "n_after": len(thinned)})


def _edge_for(cloud: PointCloud, at_most: int) -> float:
    """The smallest edge of a ladder of steps 1.25 that leaves at most `at_most` cells.

    Starts from the surface law: cells ~ 1 / edge^2, with the constant measured at one coarse edge on the whole cloud.
    """
    size = float(np.ptp(cloud.points, axis=0).max()) or 1.0
    rows = sampled_rows(len(cloud), _PROBE, 0)
    coarse = size / 200.0
    edge = coarse * math.sqrt(voxel_mean(cloud.points[rows], coarse).n_cells / at_most)
    for _ in range(_TRIES):
        if voxel_mean(cloud.points, edge).n_cells <= at_most:
            return edge
        edge *= 1.25
    return edge
