"""What lies on a plane and what stands on it, seen from above on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from scan2fea.kernel.neighbors import radius_components
from scan2fea.segmentation.planes import Plane
from scan2fea.types import BoolArray, FloatArray, IntArray, Value

CELLS_PER_RADIUS = 1.5  # an edge of r / 1.5 holds 5 points of an evenly sampled surface: less than 1 % of its cells look empty
_MOST_CELLS = 4_000_000
DIRECTIONS = 4
_ROWS_BEYOND = 3.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Grid(Value):
    """Square cells on a plane. u, v : (3,) axes in the plane.   low : (2,) of the first cell.   shape : cells along u and v."""

    u: FloatArray
    v: FloatArray
    low: FloatArray
    edge_m: float
    shape: tuple[int, int]

    def cells(self, points: FloatArray) -> IntArray:
        """(n, 2) cell of each point; points outside count to the border cells."""
        flat = np.c_[points @ self.u, points @ self.v]
        at: IntArray = np.clip(np.floor((flat - self.low) / self.edge_m).astype(np.int64), 0, np.array(self.shape) - 1)
        return at

    def covers(self, points: FloatArray) -> BoolArray:
        """(n,) which points lie over the grid."""
        flat = np.c_[points @ self.u, points @ self.v] - self.low
        inside: BoolArray = ((flat >= 0) & (flat < self.edge_m * np.array(self.shape))).all(axis=1)
        return inside

    def occupied(self, points: FloatArray) -> BoolArray:
        """Mask of the grid's shape: cells that hold a point."""
        mask = np.zeros(self.shape, bool)
        at = self.cells(points)
        mask[at[:, 0], at[:, 1]] = True
        return mask


@dataclass(frozen=True, eq=False, kw_only=True)
class Standing(Value):
    """A part that touches the plane from above. rows : of the points above.   cells : its shadow on the grid."""

    rows: IntArray
    cells: BoolArray
    height_m: float


def grid_on(plane: Plane, points: FloatArray, radius_m: float, margin: int = 1) -> Grid:
    """A grid that covers the points, with an empty margin of some cells."""
    u = np.cross(plane.normal, np.eye(3)[int(np.argmin(np.abs(plane.normal)))])
    u /= np.linalg.norm(u)
    v = np.cross(plane.normal, u)
    flat = np.c_[points @ u, points @ v]
    low, size = flat.min(axis=0), np.ptp(flat, axis=0)
    edge = max(radius_m / CELLS_PER_RADIUS, float(np.sqrt(max(size[0] * size[1], 0.0) / _MOST_CELLS)), float(size.max()) / 100_000)
    n = np.floor(size / edge).astype(int) + 1 + 2 * margin
    return Grid(u=u, v=v, low=low - margin * edge, edge_m=edge, shape=(int(n[0]), int(n[1])))


def standing_parts(points: FloatArray, height: FloatArray, band_m: float, grid: Grid, radius_m: float, min_points: int) -> list[Standing]:
    """The connected parts above the plane's band that come within one radius of it, largest first."""
    above = np.flatnonzero(height > band_m)
    if len(above) == 0:
        return []
    labels = radius_components(points[above], radius_m)
    counts = np.bincount(labels)
    lowest = np.full(len(counts), np.inf)
    np.minimum.at(lowest, labels, height[above])
    touching = np.flatnonzero((counts >= min_points) & (lowest <= band_m + radius_m))
    parts = []
    for label in touching[np.argsort(-counts[touching], kind="stable")]:
        rows = above[labels == label]
        parts.append(Standing(rows=rows, cells=grid.occupied(points[rows]), height_m=float(height[rows].max())))
    return parts


def directions_beyond(part: BoolArray, plane: BoolArray) -> int:
    """In how many of the four directions of the part's own axes the plane goes on beyond it.

    part, plane : masks of one grid. Within the strip as wide as the part, at least three rows' worth of plane cells must follow it:
    one or two come and go with the place of the grid where part and plane end flush.
    """
    inside, on_plane = np.argwhere(part).astype(float), np.argwhere(plane).astype(float)
    centre = inside.mean(axis=0)
    axes = np.linalg.svd(inside - centre, full_matrices=False)[2] if len(inside) > 1 else np.eye(2)
    part_at, plane_at = (inside - centre) @ axes.T, (on_plane - centre) @ axes.T
    low, high = part_at.min(axis=0) - 0.5, part_at.max(axis=0) + 0.5
    count = 0
    for along, across in ((0, 1), (1, 0)):
        strip = (plane_at[:, across] >= low[across]) & (plane_at[:, across] <= high[across])
        rows = _ROWS_BEYOND * max(1.0, high[across] - low[across])
        count += int((strip & (plane_at[:, along] > high[along])).sum() >= rows)
        count += int((strip & (plane_at[:, along] < low[along])).sum() >= rows)
    return count


def share_along(part: BoolArray, plane: BoolArray) -> float:
    """Length of the part over that of the plane, along the part's long axis. part, plane : masks of one grid."""
    inside, on_plane = np.argwhere(part).astype(float), np.argwhere(plane).astype(float)
    if len(inside) < 2 or not len(on_plane):
        return 0.0
    axis = np.linalg.svd(inside - inside.mean(axis=0), full_matrices=False)[2][0]
    return float((np.ptp(inside @ axis) + 1.0) / (np.ptp(on_plane @ axis) + 1.0))


def least_extent(plane: BoolArray, edge_m: float) -> float:
    """Smaller side of the box around the plane's cells along their own axes, m."""
    at = np.argwhere(plane).astype(float)
    if len(at) < 2:
        return edge_m
    axes = np.linalg.svd(at - at.mean(axis=0), full_matrices=False)[2]
    return float((np.ptp(at @ axes.T, axis=0).min() + 1.0) * edge_m)


def is_covered(part: BoolArray) -> bool:
    """True where the part's shadow is no mere ring: at least half of what its outline encloses holds points (it has a top)."""
    return bool(part.sum() >= 0.5 * ndimage.binary_fill_holes(part).sum())


def border_share(plane: BoolArray, beside: BoolArray) -> float:
    """Share of the plane's outer border that has cells of `beside` within two cells."""
    filled = ndimage.binary_fill_holes(plane)
    border = filled & ~ndimage.binary_erosion(filled)
    near = ndimage.binary_dilation(beside, iterations=2)
    return float((border & near).sum() / max(1, border.sum()))
