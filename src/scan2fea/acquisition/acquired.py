"""What every sensor of this room hands on: one frame per picture, pair or log, with its uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.types import FloatArray, PointCloud, Rays, Scan, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class Frame(Value):
    """One input. name : of the file that stands for it.   scan : points in the frame of the sensor, rays from it; empty where it was not used.
    T_world_frame : its pose, None where registration is to find it.   reason : why it was not used, or empty.
    """

    name: str
    scan: Scan
    T_world_frame: FloatArray | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Acquired(Value):
    """All frames of one acquisition. unit_source : "format", "option" or "assumed" for metres, "unknown" where lengths have no scale.
    how : figures for the report.   notes : sentences for the report.
    """

    frames: tuple[Frame, ...]
    unit_source: str
    how: Mapping[str, Any]
    notes: tuple[str, ...] = ()


def seen_from(origin: FloatArray, points: FloatArray, along_m: FloatArray, across_m: FloatArray, **columns: Any) -> Scan:
    """A scan whose points (n, 3) were all seen from `origin` (3,) or (n, 3), with standard deviations along and across their rays, (n,) each."""
    n = len(points)
    start = np.broadcast_to(np.asarray(origin, float), (n, 3))
    offset = points - start
    distance = np.linalg.norm(offset, axis=1)
    rays = Rays(origin=start.copy(), direction=offset / np.maximum(distance, 1e-300)[:, None], range_m=distance)
    cloud = PointCloud.of(points, ray=np.arange(n, dtype=np.int64), sigma_along_m=along_m, sigma_across_m=across_m, **columns)
    return Scan(cloud=cloud, rays=rays if n else None)


def nothing() -> Scan:
    """A scan without points."""
    return Scan(cloud=PointCloud.of(np.zeros((0, 3))))
