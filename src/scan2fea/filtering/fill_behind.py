"""Every input that was seen from one place: what stands in the way is marked, and points are put behind it that nobody measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.filtering.disocclusion import METHODS, disocclude
from scan2fea.filtering.options import FilteringOptions
from scan2fea.filtering.range_image import range_image, range_noise
from scan2fea.kernel.inferred import with_inferred
from scan2fea.kernel.transforms import applied, inverse
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud, Scan, Value

LEAST_POINTS = 100
ONE_PLACE = 0.02  # of the median range: a station that moved more while it scanned has no range image


@dataclass(frozen=True, eq=False, kw_only=True)
class Behind(Value):
    """cloud : the measured points, then the inferred ones (ray -1, raw_index -1, normals toward the station).   is_occluder : (n,) points that
    stand in the way.   source : (n,) row of a measured point of the surface that an inferred point continues, -1 for measured ones.
    notes : for the report.
    """

    cloud: PointCloud
    is_occluder: BoolArray
    source: IntArray
    notes: tuple[str, ...]


def fill_behind(scan: Scan, T_world_frame: FloatArray, names: Sequence[str], options: FilteringOptions = FilteringOptions()) -> Behind:
    """Each frame on its own. T_world_frame : (k, 4, 4), whose z axes are those of the stations. Nothing is done with `disocclusion` "none"."""
    cloud = scan.cloud
    is_occluder, nothing = np.zeros(len(cloud), bool), np.full(len(cloud), -1, np.int64)
    if options.disocclusion == "none":
        return Behind(cloud=cloud, is_occluder=is_occluder, source=nothing, notes=())
    require(options.disocclusion in METHODS, UsageError, f"filtering.disocclusion {options.disocclusion!r}: use none, {', '.join(METHODS)}")
    made: list[_Made] = []
    notes: list[str] = []
    for k, T in enumerate(T_world_frame):
        rows = np.flatnonzero(cloud.frame == k)
        if not len(rows):
            continue
        rows = rows[cloud.ray[rows] >= 0]
        why = _why_not(scan, rows)
        if why:
            notes.append(f"{names[k]}: nothing was put behind what stands in the way, {why}")
            continue
        own = _one_frame(scan, rows, T, k, options)
        is_occluder[rows[own.is_occluder]] = True
        made.append(own)
    n_new = sum(len(m.points) for m in made)
    notes.append(
        f"{int(is_occluder.sum())} points stand before a surface seen on both of their sides; {n_new} points were put behind them "
        f"(filtering.disocclusion = {options.disocclusion}), marked is_inferred and used in no fit"
    )
    return Behind(
        cloud=_with_inferred(cloud, made) if n_new else cloud,
        is_occluder=np.concatenate([is_occluder, np.zeros(n_new, bool)]),
        source=np.concatenate([nothing, *[m.source for m in made]]),
        notes=tuple(notes),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Made(Value):
    """What one frame gave, in the world. is_occluder : over the rows of the frame."""

    is_occluder: BoolArray
    points: FloatArray
    normals: FloatArray
    sigma_m: FloatArray
    source: IntArray
    frame: int


def _why_not(scan: Scan, rows: IntArray) -> str:
    if scan.rays is None or not len(rows):
        return "its sensor position is not known"
    if len(rows) < LEAST_POINTS:
        return f"it has {len(rows)} points"
    ray = scan.cloud.ray[rows]
    origin = scan.rays.origin[ray]
    moved = float(np.linalg.norm(np.ptp(origin, axis=0)))
    far = float(np.median(np.linalg.norm(scan.cloud.points[rows] - origin, axis=1)))
    return f"its sensor moved by {moved:.3g} m while it scanned" if moved > ONE_PLACE * far else ""


def _one_frame(scan: Scan, rows: IntArray, T_world_frame: FloatArray, frame: int, options: FilteringOptions) -> _Made:
    if scan.rays is None:
        raise UsageError("a range image needs rays")
    ray = scan.cloud.ray[rows]
    back = inverse(T_world_frame)
    own, stations = applied(back, scan.cloud.points[rows]), applied(back, scan.rays.origin[ray])
    ring = None if scan.rays.ring is None else scan.rays.ring[ray]
    image = range_image(own, np.asarray(np.median(stations, axis=0)), ring if ring is not None and bool((ring >= 0).all()) else None)
    found = disocclude(image, range_noise(image), options.disocclusion, options.occlusion_tau_m)
    points = applied(T_world_frame, found.points)
    toward = applied(T_world_frame, image.station[None]) - points
    return _Made(
        is_occluder=found.is_occluder,
        points=points,
        normals=toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-300),
        sigma_m=found.sigma_m,
        source=rows[found.source],
        frame=frame,
    )


def _with_inferred(cloud: PointCloud, made: Sequence[_Made]) -> PointCloud:
    """Both, the inferred points last."""
    points, normals, sigma = (np.concatenate([getattr(m, name) for m in made]) for name in ("points", "normals", "sigma_m"))
    return with_inferred(cloud, points, normals, sigma_along_m=sigma, frame=np.repeat([m.frame for m in made], [len(m.points) for m in made]))
