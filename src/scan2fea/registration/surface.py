"""A frame made ready to be compared: voxel means of one edge for all frames, normals, and which side was seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.kernel.near_tree import NearTree, near_tree
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.noise import noise_sigma, sampled_rows, spacing
from scan2fea.kernel.normals import oriented_to, pca_normals
from scan2fea.kernel.voxels import voxel_mean
from scan2fea.registration.sight import TOLERANCE_EDGES, View, is_seen_through, view_of
from scan2fea.types import BoolArray, FloatArray, IntArray, Scan, Value

CELLS = 6_000  # of the largest frame: enough for a pose far below the edge of a cell, few enough for a tenth of a second each
LEAST_SPACINGS = 2.0  # a cell holds about four points of a surface: its mean has half their noise
LEAST_SIGMAS = 3.0  # cells that noise does not double
NORMAL_NEIGHBORS = 14
SAMPLE = 60_000  # points of a frame that are looked at for its scale
SMOOTH_EDGES = 0.25  # neighbours off their plane by less: at a square crease 0.5, by noise 0.17 at most (a cell: three deviations, four points)
SMALL_CELLS = 60  # a frame of fewer cells has no shape that tells its place
FLAT = 1e-3  # of the largest extent: thinner sideways is a line


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface(Value):
    """points : (n, 3) voxel means of edge `edge_m`.   normals : (n, 3) unit, toward the sensor where `is_seen` (n,) says so, else of
    any sign.   is_smooth : (n,) neighbours lie on one plane, not about a crease.   station : (3,) where all of it was seen from, nan where that is
    not known or not one place.   spacing_m, sigma_m : of the points before they were averaged; nan where they cannot be told.   view : what the
    station saw, None where that is not known.
    """

    points: FloatArray
    normals: FloatArray
    is_seen: BoolArray
    is_smooth: BoolArray
    station: FloatArray
    edge_m: float
    spacing_m: float
    sigma_m: float
    view: View | None = None

    _ROWS = (("points", "normals", "is_seen", "is_smooth"),)

    def __len__(self) -> int:
        return len(self.points)

    @property
    def is_small(self) -> bool:
        """True where nothing can be registered: too few cells, or all on a line."""
        if len(self) < SMALL_CELLS:
            return True
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(self.points.T)), 0.0))
        return bool(spread[1] <= FLAT * spread[2])

    def size_m(self) -> float:
        """Radius of gyration about the centre."""
        return float(np.sqrt(((self.points - self.points.mean(axis=0)) ** 2).sum(axis=1).mean())) if len(self) else 0.0

    def few(self, rows: IntArray) -> Surface:
        """Some of the points."""
        return replace(self, points=self.points[rows], normals=self.normals[rows], is_seen=self.is_seen[rows], is_smooth=self.is_smooth[rows])

    def tree(self) -> NearTree:
        return near_tree(self.points)


def common_edge(clouds: Sequence[FloatArray], cells: int = CELLS) -> float:
    """One edge for the voxels of all frames, m: the largest frame gets about `cells`, none is finer than its spacing and noise allow.

    clouds : (n, 3) each. 0 where no frame has a surface.
    """
    drawn = [points[sampled_rows(len(points), SAMPLE, 0)] for points in clouds if len(points) >= SMALL_CELLS]
    if not drawn:
        return 0.0
    gaps = np.array([spacing(points) * (len(points) / _full(points, clouds)) ** 0.5 for points in drawn])
    noise = [noise_sigma(points) for points in drawn[:3]]
    floor = max(LEAST_SPACINGS * float(np.median(gaps)), LEAST_SIGMAS * float(np.nan_to_num(np.nanmedian([*noise, 0.0]))))
    largest = max(drawn, key=len)
    edge = max(floor, 1e-9 * float(np.ptp(largest, axis=0).max()))
    if edge <= 0:
        return 0.0
    for _ in range(12):
        n = voxel_mean(largest, edge).n_cells
        if n <= 1.1 * cells:
            break
        edge *= max(1.05, (n / cells) ** 0.5)
    return float(edge)


def _full(points: FloatArray, clouds: Sequence[FloatArray]) -> int:
    """Number of points the draw stands for."""
    return max([len(points), *[len(c) for c in clouds if len(c) > SAMPLE and len(points) == SAMPLE]])


def surface_of(scan: Scan, edge_m: float, station: FloatArray | None = None) -> Surface:
    """Voxel means with normals. A normal points to where its points were seen from.

    station : (3,) where all of it was seen from as far as the points tell, for a scan that does not say. It gives sides and a view; the share of
    blocked rays is asked only of stations that are stated.
    """
    cloud = scan.cloud
    cells = voxel_mean(cloud.points, edge_m)
    points = cells.mean
    if len(points) < 3:
        unknown, nothing = np.full(3, np.nan), np.zeros(len(points), bool)
        return Surface(
            points=points,
            normals=np.zeros_like(points),
            is_seen=nothing,
            is_smooth=nothing,
            station=unknown,
            edge_m=edge_m,
            spacing_m=np.nan,
            sigma_m=np.nan,
        )
    normals = pca_normals(points, NORMAL_NEIGHBORS)
    sensors = scan.sensors()[cells.first_row] if station is None else np.tile(station, (len(points), 1))
    is_seen = np.asarray(np.isfinite(sensors).all(axis=1))
    # points of the frame itself tell the noise, its voxel means would tell less
    rows = sampled_rows(len(cloud), SAMPLE, 0)
    sigma = noise_sigma(cloud.points[rows]) if len(rows) >= SMALL_CELLS else float("nan")
    one_place = is_seen.all() and bool((np.ptp(sensors, axis=0) <= edge_m).all())
    place = sensors.mean(axis=0) if one_place else np.full(3, np.nan)
    return Surface(
        points=points,
        normals=oriented_to(normals, points, sensors),
        is_seen=is_seen,
        is_smooth=_off_plane(points, normals) < SMOOTH_EDGES * edge_m,
        station=place if station is None else np.full(3, np.nan),
        edge_m=edge_m,
        spacing_m=spacing(cloud.points),
        sigma_m=sigma,
        view=view_of(cloud.points, place) if one_place else None,
    )


def _off_plane(points: FloatArray, normals: FloatArray) -> FloatArray:
    """(n,) root mean square distance of the neighbours that gave a normal from their plane, m."""
    near = points[k_nearest(points, NORMAL_NEIGHBORS)[1]]
    height = np.einsum("nkc,nc->nk", near - near.mean(axis=1, keepdims=True), normals)
    return np.asarray(np.sqrt((height**2).mean(axis=1)))


def sees_through(a: Surface, b: Surface, T_a_b: FloatArray, edges: float = TOLERANCE_EDGES) -> bool:
    """True where surface of one stands in space that the other's station saw empty; False where either view is not known."""
    if a.view is None or b.view is None:
        return False
    return is_seen_through(a.view, b.view, T_a_b, edges * max(a.edge_m, b.edge_m))


def spread_rows(points: FloatArray, edge_m: float) -> IntArray:
    """Rows nearest to the centre of each voxel of edge `edge_m`: a stride over the surface."""
    cells = voxel_mean(points, edge_m)
    _, near = k_nearest(points, 1, cells.mean)
    return np.unique(near[:, 0])
