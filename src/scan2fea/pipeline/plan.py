"""`scan2fea plan`: what a planned scan will be able to tell, before anybody carries a scanner.

The planned sensors scan the exact scene once without noise: that gives each object's points per station and per face of its section. From these and
the sensor's noise follows the Cramer-Rao bound of each dimension of each member (simulation/bounds.py). How large a share of a surface a station
sees is told from rays to samples of it, so that it does not depend on how densely the instrument shoots.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.measures import area
from scan2fea.kernel.transforms import applied, inverse, rotated
from scan2fea.simulation.bounds import bounds_from_points, observable
from scan2fea.simulation.sampling import noise_sd
from scan2fea.simulation.scene_checks import check_scene, check_sensor
from scan2fea.simulation.scene_file import SceneFile
from scan2fea.simulation.sensors import SENSORS
from scan2fea.simulation.solids import Solid
from scan2fea.simulation.visibility import Seen, seen_from
from scan2fea.types import FloatArray, IntArray, PointCloud, Scan

_MOST_PLACES = 48


@dataclass(frozen=True, kw_only=True)
class PlannedStation:
    """One scan (a station, a turn of a moving sensor) on one object."""

    name: str
    seen_share: float
    n_points: int


@dataclass(frozen=True, kw_only=True)
class PlannedDimension:
    """std_m : Cramer-Rao bound; None where the data do not tell the dimension at all."""

    name: str
    value_m: float
    std_m: float | None
    observable: bool


@dataclass(frozen=True, kw_only=True)
class PlannedObject:
    """seen_share : of the surface, by any station.   spacing_m : sqrt(area seen / points), or None without points.   dimensions : of members."""

    name: str
    kind: str
    seen_share: float
    n_points: int
    spacing_m: float | None
    sigma_m: float | None
    stations: tuple[PlannedStation, ...]
    dimensions: tuple[PlannedDimension, ...]


@dataclass(frozen=True, kw_only=True)
class Plan:
    objects: tuple[PlannedObject, ...]

    def as_tree(self) -> dict[str, Any]:
        """For JSON."""
        return dataclasses.asdict(self)


def plan_scene(given: SceneFile, *, seed: int = 0) -> Plan:
    """What the sensors of the scene will see and tell. Raises InputError for a scene without sensor, or that no scan can be made of."""
    require(len(given.sensors) > 0, InputError, "the scene has no sensor: add a [[sensor]] to plan with, or --sensor")
    check_scene(given.scene)
    names: list[str] = []
    scans: list[Scan] = []
    laws: list[tuple[str, float, float]] = []  # law, size (nan: the points say), size per metre of range: of each scan
    for k, sensor in enumerate(given.sensors):
        positions = np.asarray(getattr(sensor.options, "positions_m", ()), float).reshape(-1, 3)
        require(len(positions) > 0, InputError, f"sensor {sensor.kind}: positions_m is empty: add where the sensor stands")
        check_sensor(given.scene, positions, sensor.kind)
        made = SENSORS[sensor.kind].scan(given.scene, _exact(sensor.options), seed + k)
        names += [f"{sensor.kind}_{n:02d}" for n in range(len(made))]
        scans += made
        options = sensor.options
        law = (getattr(options, "noise", "gaussian"), float(getattr(options, "noise_m", math.nan)), float(getattr(options, "noise_per_m", 0.0)))
        laws += [law] * len(made)
    places = _places(scans)
    seen = seen_from(given.scene, np.concatenate(places), seed)
    groups = np.repeat(np.arange(len(places)), [len(p) for p in places])
    objects = tuple(_planned(given, k, names, scans, laws, seen, groups) for k in range(len(given.scene.solids)))
    return Plan(objects=objects)


def _exact(options: Any) -> Any:
    """The sensor without what disturbs it."""
    off = {"noise_m": 0.0, "noise_per_m": 0.0, "outlier_share": 0.0, "quantum_m": 0.0, "footprint_rays": 1, "wobble_deg": 0.0}
    own = {f.name for f in dataclasses.fields(options)}
    return dataclasses.replace(options, **{key: value for key, value in off.items() if key in own})


def _places(scans: Sequence[Scan]) -> list[FloatArray]:
    """Where each scan was made from: of a moving sensor a few places, fewer where there are many scans."""
    each = max(1, _MOST_PLACES // max(1, len(scans)))
    out = []
    for scan in scans:
        require(scan.rays is not None and len(scan.rays) > 0, InputError, "this sensor keeps no rays: it cannot be planned with")
        origins = np.unique(scan.rays.origin, axis=0)  # type: ignore[union-attr]
        out.append(origins[np.unique(np.linspace(0, len(origins) - 1, min(each, len(origins))).astype(int))])
    return out


def _planned(
    given: SceneFile, k: int, names: Sequence[str], scans: Sequence[Scan], laws: Sequence[tuple[str, float, float]], seen: Seen, groups: IntArray
) -> PlannedObject:
    solid = given.scene.solids[k]
    own = seen.solid == k
    points, sigmas, rays, counts, is_pictured = [], [], [], [], False
    for scan, (law, size, per_m) in zip(scans, laws, strict=True):
        rows = np.flatnonzero(scan.cloud.label == k)
        counts.append(len(rows))
        points.append(scan.cloud.points[rows])
        away = scan.cloud.points[rows] - scan.rays.origin[scan.cloud.ray[rows]]  # type: ignore[union-attr]
        distance = np.linalg.norm(away, axis=1)
        rays.append(away / distance[:, None])
        told = _told(scan.cloud, rows)
        own_noise = told if math.isnan(size) else np.hypot(np.nan_to_num(told), noise_sd(law, 1.0) * np.hypot(size, per_m * distance))
        is_pictured |= bool((told > 0).any())
        sigmas.append(own_noise)
    cloud, sigma = np.concatenate(points), np.concatenate(sigmas)
    share = float(seen.seen[own].any(axis=1).mean())
    stations = tuple(
        PlannedStation(name=name, seen_share=float(seen.seen[own][:, groups == n].any(axis=1).mean()), n_points=counts[n])
        for n, name in enumerate(names)
    )
    is_isotropic = is_pictured or all(getattr(sensor.options, "noise_along", "ray") == "isotropic" for sensor in given.sensors)
    typical = float(np.sqrt(np.mean(sigma**2))) if len(sigma) else 0.0  # nan where a sensor does not say how noisy it is
    spacing = math.sqrt(share * area(solid.mesh) / len(cloud)) if len(cloud) and share > 0 else None
    known = typical if math.isfinite(typical) else None
    return PlannedObject(
        name=solid.name, kind=solid.shape.kind, seen_share=share, n_points=len(cloud), spacing_m=spacing, sigma_m=known, stations=stations,
        dimensions=_dimensions(solid, cloud, typical, None if is_isotropic else np.concatenate(rays)),
    )  # fmt: skip


def _told(cloud: PointCloud, rows: IntArray) -> FloatArray:
    """(n,) standard deviation, along and across together, that points still state where ranges are exact (pictures, sound); nan where none."""
    if cloud.sigma_along_m is None:
        return np.full(len(rows), np.nan)
    across = np.zeros(len(rows)) if cloud.sigma_across_m is None else cloud.sigma_across_m[rows]
    return np.asarray(np.hypot(cloud.sigma_along_m[rows], across))


def _dimensions(solid: Solid, cloud: FloatArray, sigma_m: float, rays: FloatArray | None) -> tuple[PlannedDimension, ...]:
    """The bounds of a member from the points on each face of its section; of other objects none."""
    shape = solid.shape
    if not shape.section or solid.defects or not math.isfinite(sigma_m):
        return ()
    T_shape_world = inverse(solid.T_world_shape)
    own, along = applied(T_shape_world, cloud), None if rays is None else rotated(T_shape_world, rays)
    bounds = bounds_from_points(shape.family, shape.parameters, own, sigma_m, along=along)
    told = observable(bounds, shape.parameters, sigma_m)
    return tuple(
        PlannedDimension(name=name, value_m=shape.parameters[name], std_m=bound if math.isfinite(bound) else None, observable=told[name])
        for name, bound in bounds.items()
    )
