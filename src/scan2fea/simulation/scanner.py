"""Static scanners in a scene of exact solids: every ray is cast, every point keeps its ray, and noise acts along the ray.

Detail scans: the instrument aims at points spread evenly over each object (by area, at the object's own spacing) instead of stepping
through equal angles, which would waste most rays on the floor and starve the thin parts. Each aim point is shot from one of the
stations that see it, chosen with probability proportional to the cosine of incidence. An overview sweep in equal angles is added; its
rays that leave the room are kept as misses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area, face_normals
from scan2fea.kernel.rays import RayScene, first_hits, ray_scene
from scan2fea.options import option
from scan2fea.simulation.lab import Lab, SceneObject, demo_lab
from scan2fea.types import FloatArray, IntArray, PointCloud, Rays, Scan, Value
from scan2fea.units import radians

# mean distance to the 6 nearest points of a random sheet, in units of 1 / sqrt(points per area): mean of Gamma(k + 1/2) / (Gamma(k) sqrt(pi))
_POISSON_MEAN = 0.978


@dataclass(frozen=True, kw_only=True)
class LabOptions:
    """How the scene is scanned."""

    noise_m: float = option(0.0005, "Standard deviation of the range, along the ray", unit="m", minimum=0.0)
    density: float = option(1.0, "Factor on the number of points per area", minimum=1e-6)
    overview_deg: float = option(3.0, "Angular step of each station's overview sweep; 0 for none", unit="deg", minimum=0.0, maximum=90.0)
    max_incidence_deg: float = option(80.0, "Aim points seen at a flatter angle than this are not shot", unit="deg", minimum=0.0, maximum=90.0)
    seed: int = option(0, "Seed of aim points and noise", minimum=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class LabScan(Value):
    """scans : one per station, in the world's frame; cloud.label is the object's number.   truth : the objects.

    seen : (k,) share of each object's aim points that at least one station sees.
    """

    scans: tuple[Scan, ...]
    truth: tuple[SceneObject, ...]
    seen: FloatArray


SCENES: dict[str, Callable[[], Lab]] = {"lab": demo_lab}


def simulate(lab: Lab, options: LabOptions = LabOptions()) -> LabScan:
    """Scan the lab from its stations. The same lab, options and seed give the same bytes.

    Raises InputError if there is no station or no object.
    """
    require(len(lab.stations) > 0, InputError, "the scene has no sensor: add a station")
    require(len(lab.objects) > 0, InputError, "the scene has no object to scan")
    scene, object_of_face = _scene(lab)
    rng = np.random.default_rng(options.seed)
    seen = np.zeros(len(lab.objects))
    aims: list[tuple[FloatArray, IntArray]] = []
    for number, thing in enumerate(lab.objects):
        target, station, seen[number] = _aimed(lab, thing, scene, options, rng)
        aims.append((target, station))
    target = np.concatenate([a[0] for a in aims])
    station = np.concatenate([a[1] for a in aims])
    shots = [target[station == s] for s in range(len(lab.stations))]
    scans = tuple(_scan(lab, s, shot, scene, object_of_face, options) for s, shot in enumerate(shots))
    return LabScan(scans=scans, truth=lab.objects, seen=seen)


def simulate_lab(options: LabOptions = LabOptions()) -> LabScan:
    """Scan the demo lab."""
    return simulate(demo_lab(), options)


def _scene(lab: Lab) -> tuple[RayScene, IntArray]:
    first = np.cumsum([0] + [len(o.mesh.vertices) for o in lab.objects])
    vertices = np.concatenate([o.mesh.vertices for o in lab.objects])
    faces = np.concatenate([o.mesh.faces + f for o, f in zip(lab.objects, first, strict=False)])
    return ray_scene(vertices, faces), np.repeat(np.arange(len(lab.objects)), [len(o.mesh.faces) for o in lab.objects])


def _aimed(lab: Lab, thing: SceneObject, scene: RayScene, options: LabOptions, rng: np.random.Generator) -> tuple[FloatArray, IntArray, float]:
    """Aim points (k, 3) on one object, the station (k,) that shoots each, and the share of all aim points that is seen."""
    n = round(options.density * area(thing.mesh) * (_POISSON_MEAN / thing.spacing_m) ** 2)
    target, face = sample_surface(thing.mesh, max(n, 1), int(rng.integers(2**31)))
    normal = face_normals(thing.mesh)[face]
    weight = np.zeros((len(target), len(lab.stations)))
    flattest = np.cos(radians(options.max_incidence_deg))
    for s, position in enumerate(lab.stations):
        away = target - position
        distance = np.linalg.norm(away, axis=1)
        cosine = -np.einsum("nc,nc->n", away, normal) / distance
        facing = np.flatnonzero(cosine > flattest)
        t, _ = first_hits(scene, np.broadcast_to(position, (len(facing), 3)), away[facing] / distance[facing, None])
        weight[facing, s] = np.where(t > distance[facing] * (1 - 1e-9), cosine[facing], 0.0)
    total = np.cumsum(weight, axis=1)
    seen = total[:, -1] > 0
    draw = rng.random(len(target)) * total[:, -1]
    station = (draw[:, None] >= total).sum(axis=1)
    return target[seen], station[seen].clip(max=len(lab.stations) - 1), float(seen.mean())


def _overview(step_rad: float) -> FloatArray:
    """Unit directions of a sweep in equal angles, 60 degrees below to 90 above the horizon, azimuth by azimuth as an instrument turns."""
    azimuth = np.arange(0.0, 2 * np.pi, step_rad)
    elevation = np.arange(-radians(60.0), radians(90.0), step_rad)
    a, e = (grid.ravel() for grid in np.meshgrid(azimuth, elevation, indexing="ij"))
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], 1)


def _scan(lab: Lab, s: int, target: FloatArray, scene: RayScene, object_of_face: IntArray, options: LabOptions) -> Scan:
    """All rays of one station, with their returns; the station's own stream of noise."""
    rng = np.random.default_rng([options.seed, s])
    position = lab.stations[s]
    direction = target - position
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    if options.overview_deg > 0:
        direction = np.concatenate([direction, _overview(radians(options.overview_deg))])
    origin = np.tile(position, (len(direction), 1))
    t, face = first_hits(scene, origin, direction)
    hit = face >= 0
    distance = np.where(hit, t + options.noise_m * rng.standard_normal(len(t)), np.nan)
    ray = np.flatnonzero(hit)
    points = origin[ray] + distance[ray, None] * direction[ray]
    cloud = PointCloud(
        points=points,
        ray=ray,
        frame=np.full(len(ray), s),
        raw_index=np.arange(len(ray)),
        label=object_of_face[face[ray]],
        sigma_along_m=np.full(len(ray), options.noise_m),
    )
    return Scan(cloud=cloud, rays=Rays(origin=origin, direction=direction, range_m=distance))
