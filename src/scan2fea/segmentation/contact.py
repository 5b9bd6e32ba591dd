"""The face an object rests on: nobody has seen it, but the support it stands on says where it is.

Points are put there only where the data leave no other reading: inside a closed ring of the object's own points just above the support,
with the object overhead, and with no point of the support in between. A tube that stands open on the floor, a table on legs with the
floor seen under it, a box seen from three sides get none. What is put there is marked (`is_inferred`), carries no ray, and faces the support.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from scan2fea.kernel.noise import spacing
from scan2fea.segmentation.footprint import Grid, grid_on
from scan2fea.segmentation.planes import Plane, large_planes
from scan2fea.types import BoolArray, FloatArray, PointCloud, Segments

_CELL_SPACINGS = 2.0
_RING_SPACINGS = 3.0  # the ring: points up to this high above the support's band; a cell of a wall then holds about six
_AROUND = 1.5  # the support is fitted within this many times the object's box
_LEAST_SUPPORT = 150
_LEAST_SHARE = 0.2
_LOWEST = 0.002  # share of the object's points that may lie lower: noise


def contact_points(own: PointCloud, cloud: PointCloud, segments: Segments, label: int) -> PointCloud:
    """The object's points, and inferred ones on the face it rests on, where there is one support and the reading is certain.

    own : the points of `label` in `cloud`. The result is `own` itself if nothing is added.
    """
    h = spacing(own.points)
    if not h > 0:
        return own
    middle, reach = _ball(own.points)
    beside = (segments.labels >= 0) & (segments.labels != label)
    beside[beside] = np.linalg.norm(cloud.points[beside] - middle, axis=1) <= reach
    order = sorted(np.unique(segments.labels[beside]).tolist(), key=lambda other: (segments.kinds[other] != "support", other))
    for other in order:  # supports first, then what else it may stand on: a table is an object too
        below = cloud.points[beside & (segments.labels == other)]
        for plane in large_planes(below, 2, _LEAST_SHARE) if len(below) >= _LEAST_SUPPORT else []:
            up = plane if float(np.median(plane.height(own.points))) > 0 else plane.flipped()
            if _rests_on(up, own.points, h):
                points = _enclosed(up, own.points, below, h)
                if len(points):
                    return _with_inferred(own, points, -up.normal, up.sigma_m)
    return own


def _ball(points: FloatArray) -> tuple[FloatArray, float]:
    """Middle of the points' box, and the radius around it within which a support is looked for."""
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, _AROUND * float(np.linalg.norm(high - low)) / 2


def _rests_on(plane: Plane, own: FloatArray, h: float) -> bool:
    lowest = float(np.quantile(plane.height(own), _LOWEST))
    return -plane.band_m <= lowest <= plane.band_m + _RING_SPACINGS * h


def _enclosed(plane: Plane, own: FloatArray, below: FloatArray, h: float) -> FloatArray:
    """(k, 3) points on the plane, a spacing apart, in the cells that the object encloses and covers."""
    grid = grid_on(plane, own, 1.5 * _CELL_SPACINGS * h)  # the grid takes 1 / 1.5 of a link radius as its edge
    height = plane.height(own)
    ring = grid.occupied(own[height <= plane.band_m + _RING_SPACINGS * h])
    closed = ndimage.binary_closing(np.pad(ring, 2), np.ones((3, 3), bool))[2:-2, 2:-2]
    inside = ndimage.binary_fill_holes(closed) & ~closed
    if not inside.any():
        return np.zeros((0, 3))
    roof = ndimage.binary_dilation(grid.occupied(own[height > plane.band_m + _RING_SPACINGS * h]), np.ones((3, 3), bool))
    on_plane = below[np.abs(plane.height(below)) <= plane.band_m + h]  # not the underside of a table
    flat = np.c_[on_plane @ grid.u, on_plane @ grid.v]
    in_grid = ((flat >= grid.low) & (flat < grid.low + grid.edge_m * np.array(grid.shape))).all(axis=1)
    floor_seen = grid.occupied(on_plane[in_grid]) if in_grid.any() else np.zeros(grid.shape, bool)
    face = _whole_pieces(inside, roof & ~floor_seen) | (ndimage.binary_fill_holes(closed) & closed & ~ring & roof & ~floor_seen)
    return _lattice(grid, face, plane, h) if (face & inside).any() else np.zeros((0, 3))


def _whole_pieces(inside: BoolArray, allowed: BoolArray) -> BoolArray:
    """The connected pieces of `inside` that are allowed nearly everywhere (95 %): where the floor shows through a piece, none of it is a face."""
    pieces, n = ndimage.label(inside)
    share = ndimage.mean(allowed, pieces, np.arange(1, n + 1))
    good = np.concatenate([[False], np.asarray(share) >= 0.95])
    return np.asarray(good[pieces] & allowed)


def _lattice(grid: Grid, cells: BoolArray, plane: Plane, h: float) -> FloatArray:
    """Points h apart in the cells, on the plane."""
    per_cell = max(1, round(grid.edge_m / h))
    step = (np.arange(per_cell) + 0.5) / per_cell
    a, b = (shift.ravel() for shift in np.meshgrid(step, step, indexing="ij"))
    at = np.argwhere(cells)
    flat = (at[:, None, :] + np.stack([a, b], 1)[None]).reshape(-1, 2) * grid.edge_m + grid.low
    points: FloatArray = flat[:, :1] * grid.u + flat[:, 1:] * grid.v + plane.offset * plane.normal
    return points


def _with_inferred(own: PointCloud, points: FloatArray, normal: FloatArray, sigma_m: float) -> PointCloud:
    """Both, the inferred points last. Columns that say nothing about inferred points are nan, -1 or grey there."""
    n, k = len(own), len(points)
    normals = np.full((n, 3), np.nan) if own.normals is None else own.normals
    columns = {
        "points": np.concatenate([own.points, points]),
        "ray": np.concatenate([own.ray, np.full(k, -1)]),
        "frame": np.concatenate([own.frame, np.full(k, -1)]),
        "raw_index": np.concatenate([own.raw_index, np.full(k, -1)]),
        "normals": np.concatenate([normals, np.tile(normal, (k, 1))]),
        "is_inferred": np.concatenate([np.zeros(n, bool) if own.is_inferred is None else own.is_inferred, np.ones(k, bool)]),
    }
    filler = {"sigma_along_m": np.nan, "sigma_across_m": np.nan, "intensity": np.nan, "label": -1, "colour": 128}
    for name, value in filler.items():
        given = getattr(own, name)
        if given is not None:
            columns[name] = np.concatenate([given, np.full((k, *given.shape[1:]), value, given.dtype)])
    if columns.get("sigma_across_m") is not None:
        columns["sigma_across_m"][n:] = sigma_m
    return PointCloud(**columns)
