"""The face an object rests on: nobody has seen it, but the support it stands on says where it is.

Points are put there only where the data leave no other reading: inside a closed ring of the object's own points that come down to the
support all around, with the object overhead, and with no point of the support in between. A tube that stands open on the floor, a table
on legs with the floor seen under it, a box seen from three sides, a lid held a little above the floor get none. What is put there is
marked (`is_inferred`), carries no ray, and faces the support.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from scan2fea.kernel.inferred import with_inferred
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import spacing
from scan2fea.segmentation.footprint import CELLS_PER_RADIUS, Grid, grid_on
from scan2fea.segmentation.planes import Plane, large_planes
from scan2fea.types import BoolArray, FloatArray, Footing, IntArray, PointCloud, Segments, Value

_STRIP = 3.0  # spacings: the ring is made of points up to this high above the support's band
_REACH = 2  # cells of one spacing: points of the ring up to four apart join; the largest gap that chance leaves in a whole ring is about two
_DOWN = 1.5  # spacings above the band that the ring comes down to ...
_DOWN_SHARE = 0.9  # ... nearly all around: what hangs lower than its shadow tells is no contact
_COVERED = 0.95  # of a piece has the object overhead
_SEEN = 0.05  # of the points that a visible floor would show in a piece
_BESIDE, _BESIDE_SHARE = 3.0, 0.5  # the support is seen within so many of its spacings of so much of the ring
_WAYS, _BEYOND = 3, 10  # of the four ways along and across the rim, in which so many points of the support lie beyond the object
_PER_SPACING2 = 0.956  # points per squared spacing of a random sheet (kernel.noise.spacing)
_SPARSE = 1.5  # the ring decides where it is this many times sparser than the object
_AROUND = 1.5  # the support is fitted within this many times the object's box
_LEAST_SUPPORT = 150
_LEAST_SHARE = 0.2
_LOWEST = 0.002  # share of the object's points that may lie lower: noise
_BANDS = 3.0  # of a plane: strays of its noise are its own up to there (`supports`)
_LEAST_FOOT = 25  # points of the object just above the plane
_UNKNOWNS = 3  # of a plane
_BOX = np.ones((3, 3), bool)
_DISC = np.hypot(*np.mgrid[-_REACH : _REACH + 1, -_REACH : _REACH + 1]) <= _REACH + 0.5


def contact_points(own: PointCloud, cloud: PointCloud, segments: Segments, label: int) -> PointCloud:
    """The object's points, and inferred ones on the face it rests on, where there is one support and the reading is certain.

    own : the points of `label` in `cloud`. The result is `own` itself if nothing is added.
    """
    h = spacing(own.points)
    for plane, below, taken in _planes_at(own.points, cloud, segments, label, h) if h > 0 else ():
        points = _enclosed(plane, own.points, below, taken, h)
        if len(points):
            return _resting(own, points, -plane.normal, plane.sigma_m)
    return own


def footings(own: PointCloud, cloud: PointCloud, segments: Segments, label: int) -> tuple[Footing, ...]:
    """The planes that the object may rest on: its lowest points are at them, and they go on beyond it on three of four sides.

    Whether a face of it rests there is not asked: an open section encloses nothing. Arguments as of `contact_points`.
    """
    h = spacing(own.points)
    found = []
    for plane, below, taken in _planes_at(own.points, cloud, segments, label, h) if h > 0 else ():
        near = below[np.abs(plane.height(below)) <= _BANDS * plane.band_m]
        floor = below[np.abs(plane.height(below)) <= plane.band_m + h]
        height = plane.height(own.points)
        low = height <= plane.band_m + _STRIP * h
        foot = own.points[low] - height[low, None] * plane.normal
        if len(foot) < _LEAST_FOOT or not _stands_amid(foot, own.points, floor, h):
            continue
        near = near[k_nearest(own.points[low], 1, near)[0][:, 0] <= _BESIDE * h + _BANDS * plane.band_m]
        std = plane.sigma_m * math.sqrt(_UNKNOWNS / len(floor))
        sized = {"sigma_m": plane.sigma_m, "std_m": std, "band_m": plane.band_m}
        found.append(Footing(normal=plane.normal, offset_m=plane.offset, points=near, is_support=len(taken) > 0, **sized))
    return tuple(found)


def _planes_at(own: FloatArray, cloud: PointCloud, segments: Segments, label: int, h: float) -> Iterator[tuple[Plane, FloatArray, FloatArray]]:
    """Planes that the lowest of the object's points (n, 3) are at; the points of what each is part of, and those of them that may be the object's."""
    middle, reach = _ball(own)
    beside = (segments.labels >= 0) & (segments.labels != label)
    beside[beside] = np.linalg.norm(cloud.points[beside] - middle, axis=1) <= reach
    order = sorted(np.unique(segments.labels[beside]).tolist(), key=lambda other: (segments.kinds[other] != "support", other))
    for other in order:  # supports first, then what else it may stand on: a table is an object too
        below = cloud.points[beside & (segments.labels == other)]
        taken = below if segments.kinds[other] == "support" else below[:0]
        for plane in _planes_under(below, own):
            if _rests_on(plane, own, taken, h):
                yield plane, below, taken


def _ball(points: FloatArray) -> tuple[FloatArray, float]:
    """Middle of the points' box, and the radius around it within which a support is looked for."""
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, _AROUND * float(np.linalg.norm(high - low)) / 2


def _planes_under(below: FloatArray, own: FloatArray) -> list[Plane]:
    """The large planes of what may be under the object, facing it; first the one that its lowest points are nearest to (the top of a slab)."""
    if len(below) < _LEAST_SUPPORT:
        return []
    planes = [plane if float(np.median(plane.height(own))) > 0 else plane.flipped() for plane in large_planes(below, 2, _LEAST_SHARE)]
    return sorted(planes, key=lambda plane: abs(_lowest(plane, own)))


def _lowest(plane: Plane, own: FloatArray) -> float:
    return float(np.quantile(plane.height(own), _LOWEST))


def _rests_on(plane: Plane, own: FloatArray, taken: FloatArray, h: float) -> bool:
    """The lowest points are at the plane, or where the support took those below them (its own band, on a warped floor)."""
    reach = plane.band_m + _STRIP * h
    height = plane.height(taken)
    height = height[height <= 2.0 * reach]
    return -plane.band_m <= _lowest(plane, own) <= max(reach, float(np.quantile(height, 1.0 - _LOWEST)) + h if len(height) else 0.0)


def _enclosed(plane: Plane, own: FloatArray, below: FloatArray, taken: FloatArray, h: float) -> FloatArray:
    """(k, 3) points on the plane, a spacing apart, in the cells that the object encloses and covers.

    below : points of the support.   taken : those of them that may belong to the object, within the band of the support but above the plane.
    """
    height, rise = plane.height(own), plane.height(taken)
    sparse = spacing(own[height <= plane.band_m + 3.0 * _STRIP * h])
    edge = min(sparse, 2.0 * h) if sparse > _SPARSE * h else h
    top = plane.band_m + _STRIP * edge
    foot = np.concatenate([own[height <= top], taken[(rise > plane.band_m) & (rise <= top)]])
    grid = grid_on(plane, own, CELLS_PER_RADIUS * edge, margin=2 * _REACH + 2)
    foot = foot[grid.covers(foot)]
    rises = plane.height(foot)
    ring, down = grid.occupied(foot), grid.occupied(foot[rises <= plane.band_m + _DOWN * h])
    roof = ndimage.binary_dilation(grid.occupied(own[height > top]), _BOX)  # nine cells of a random sheet are empty once in 5,000
    floor = below[np.abs(plane.height(below)) <= plane.band_m + h]  # not the underside of a table
    seen = _Seen.of(grid, floor[grid.covers(floor)])

    grown = _grown(ring)
    filled = ndimage.binary_erosion(ndimage.binary_fill_holes(grown), _DISC)
    holes = ndimage.binary_fill_holes(grown) & ~grown
    open_below = ndimage.binary_dilation(_grown(holes & ~_good_pieces(holes, roof, seen)), _BOX)
    inside = ndimage.binary_erosion(filled, _BOX) & ~ring & ~open_below  # the outermost cells may lie half outside
    face = _good_pieces(inside, roof, seen)
    rim = ring & _grown(face)
    comes_down = (rim & _grown(down)).sum() >= _DOWN_SHARE * rim.sum()
    if not face.any() or not rim.any() or not comes_down or not _stands_amid(_centres(grid, rim, plane), own, floor, edge):
        return np.zeros((0, 3))
    return _centres(grid, face, plane)


def _centres(grid: Grid, cells: BoolArray, plane: Plane) -> FloatArray:
    """(k, 3) middles of the cells, on the plane."""
    flat = (np.argwhere(cells) + 0.5) * grid.edge_m + grid.low
    centres: FloatArray = flat[:, :1] * grid.u + flat[:, 1:] * grid.v + plane.offset * plane.normal
    return centres


def _stands_amid(rim: FloatArray, own: FloatArray, floor: FloatArray, edge_m: float) -> bool:
    """Whether the support was seen beside at least half of the rim, and goes on beyond the object: a plane has no end, a table has.

    A leg of an angle of which the inner face was not seen ends with the other leg at both ends and on one side: it is no floor.
    """
    if len(floor) < _LEAST_SUPPORT:
        return False
    near = _BESIDE * spacing(floor) + _REACH * edge_m
    away = k_nearest(floor, 1, rim)[0][:, 0]
    middle = rim.mean(axis=0)
    ways = np.linalg.svd(rim - middle, full_matrices=False)[2][:2]
    ways = np.concatenate([ways, -ways])
    beyond = (floor - middle) @ ways.T > ((own - middle) @ ways.T).max(axis=0) + near
    return bool((away <= near).mean() >= _BESIDE_SHARE) and int((beyond.sum(axis=0) >= _BEYOND).sum()) >= _WAYS


def _grown(cells: BoolArray) -> BoolArray:
    grown: BoolArray = ndimage.binary_dilation(cells, _DISC)
    return grown


@dataclass(frozen=True, eq=False, kw_only=True)
class _Seen(Value):
    """Where the support was seen. count : of its points in each cell.   expected : in a cell, where it lies open."""

    count: IntArray
    expected: float

    @classmethod
    def of(cls, grid: Grid, floor: FloatArray) -> _Seen:
        count = np.zeros(grid.shape, np.int64)
        np.add.at(count, tuple(grid.cells(floor).T), 1)
        h = spacing(floor) if len(floor) >= _LEAST_SUPPORT else np.nan
        return cls(count=count, expected=_PER_SPACING2 * (grid.edge_m / h) ** 2 if h > 0 else 1.0)

    def through(self, piece: BoolArray) -> bool:
        """Whether the floor shows in the piece, its border aside (noise of the floor around it)."""
        inner = ndimage.binary_erosion(piece)
        inner = inner if inner.any() else piece
        return bool(self.count[inner].sum() > _SEEN * self.expected * inner.sum())


def _good_pieces(cells: BoolArray, roof: BoolArray, seen: _Seen) -> BoolArray:
    """The connected pieces that have a roof nearly everywhere and show no floor."""
    pieces, n = ndimage.label(cells)
    good = np.zeros(n + 1, bool)
    for k, place in enumerate(ndimage.find_objects(pieces), start=1):
        piece = pieces[place] == k
        own = _Seen(count=seen.count[place], expected=seen.expected)
        good[k] = roof[place][piece].mean() >= _COVERED and not own.through(piece)
    return np.asarray(good[pieces])


def _resting(own: PointCloud, points: FloatArray, normal: FloatArray, sigma_m: float) -> PointCloud:
    """The object's points and those on its support, which are as sure as that plane."""
    given = {} if own.sigma_across_m is None else {"sigma_across_m": sigma_m}
    return with_inferred(own, points, normal, **given)
