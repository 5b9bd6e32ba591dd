"""Photogrammetry and stereo: features of the surface, found in two pictures or more, become points.

Each feature is projected into every camera that sees it, its place in each picture is disturbed, and the lines of sight are met again by
least squares of the pixels: so the error in depth grows with range^2 / baseline by itself, not by a formula. Cameras look along x; their
picture lies in y, z. Bare parts of a surface have no features. Structure from motion knows the pictures alone: the same points, in a frame and a
scale of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.distances import sample_surface
from scan2fea.kernel.measures import area
from scan2fea.kernel.transforms import applied, compose, inverse, rigid, rotated
from scan2fea.options import option
from scan2fea.simulation.casting import Target, is_visible, target_of
from scan2fea.simulation.motion import PathOptions, path_of
from scan2fea.simulation.solids import Scene
from scan2fea.types import BoolArray, FloatArray, IntArray, PointCloud, Rays, Scan, Value

_MOST_FEATURES = 5_000_000  # a gigabyte for each ten pictures
_WAVES = 24  # waves of the random field that says where a surface is bare


@dataclass(frozen=True, kw_only=True)
class CameraOptions(PathOptions):
    """Pinhole cameras and the texture that they need."""

    width_px: int = option(4000, "Width of a picture", unit="px", minimum=1)
    height_px: int = option(3000, "Height of a picture", unit="px", minimum=1)
    focal_px: float = option(3500.0, "Focal length", unit="px", minimum=1.0)
    noise_px: float = option(0.3, "Standard deviation of a feature's place in a picture, along each axis", unit="px", minimum=0.0)
    features_per_m2: float = option(2000.0, "Features per area that pictures find again, where the surface has texture", unit="1/m2", minimum=0.0)
    bare_share: float = option(0.3, "Share of the surface without texture, in patches", minimum=0.0, maximum=1.0)
    patch_m: float = option(0.2, "Size of the patches", unit="m", minimum=1e-6)
    max_incidence_deg: float = option(65.0, "A surface seen at a flatter angle than this is not matched", unit="deg", minimum=0.0, maximum=90.0)
    mismatch_share: float = option(0.0, "Share of the points that are wrong matches: anywhere along the line of sight", minimum=0.0, maximum=1.0)
    max_range_m: float = option(100.0, "Farther surfaces are not matched", unit="m", minimum=0.0)


@dataclass(frozen=True, kw_only=True)
class PhotogrammetryOptions(CameraOptions):
    """One camera at each position, all pictures solved together."""

    min_views: int = option(2, "Pictures that must show a feature", minimum=2)
    min_angle_deg: float = option(2.0, "Least angle between two lines of sight to a feature", unit="deg", minimum=0.01, maximum=90.0)


@dataclass(frozen=True, kw_only=True)
class SfmOptions(PhotogrammetryOptions):
    """Pictures without known places: frame and scale are the solution's own, as structure from motion leaves them."""

    scale: float = option(0.0, "Lengths of the scan per metre of the world; 0: the first two cameras lie 1 apart", minimum=0.0)


@dataclass(frozen=True, kw_only=True)
class StereoOptions(CameraOptions):
    """A rig of two cameras at each position, solved by itself."""

    baseline_m: float = option(0.3, "Distance between the two cameras, left and right of the position", unit="m", minimum=1e-6)


@dataclass(frozen=True, eq=False, kw_only=True)
class Features(Value):
    """n places on surfaces that pictures find again. point : (n, 3).   normal : (n, 3) outward.   thing : (n,) object."""

    point: FloatArray
    normal: FloatArray
    thing: IntArray


def scan_photogrammetry(scene: Scene, options: PhotogrammetryOptions = PhotogrammetryOptions(), seed: int = 0) -> tuple[Scan, ...]:
    """One scan from all pictures. Its rays run from the nearest camera that saw the point; there are no misses.

    Raises InputError for fewer than two positions.
    """
    path, target = path_of(options, "photogrammetry"), target_of(scene)
    require(len(path) >= 2, InputError, f"sensor photogrammetry: {len(path)} position: two pictures or more are needed")
    features = features_of(target, options, seed)
    cameras = path.T_world_sensor
    return (_solved(target, features, cameras, path.time_s, options, options.min_views, math.radians(options.min_angle_deg), [seed, 0], 0),)


def sfm_frame(options: SfmOptions) -> tuple[FloatArray, float]:
    """(4, 4) pose of the scan's frame in the world, and the scan's lengths per metre: world = T (points / scale).

    Raises InputError where the first two cameras stand in one place and no scale is given.
    """
    path = path_of(options, "sfm")
    require(len(path) >= 2, InputError, f"sensor sfm: positions_m: {len(path)} position: two pictures or more are needed")
    apart = float(np.linalg.norm(path.T_world_sensor[1][:3, 3] - path.T_world_sensor[0][:3, 3]))
    says = "sensor sfm: positions_m: the first two cameras stand in one place, so that they give no scale: move one, or give `scale`"
    require(options.scale > 0 or apart > 0, InputError, says)
    return path.T_world_sensor[0], options.scale if options.scale > 0 else 1.0 / apart


def in_frame(scan: Scan, T_world_frame: FloatArray, scale: float) -> Scan:
    """The scan in a frame and a scale of its own: all its lengths (points, origins, ranges, deviations) times `scale`."""
    own = inverse(T_world_frame)
    cloud, rays = scan.cloud, scan.rays
    along, across = cloud.sigma_along_m, cloud.sigma_across_m
    cloud = replace(
        cloud, points=scale * applied(own, cloud.points), sigma_along_m=None if along is None else scale * along,
        sigma_across_m=None if across is None else scale * across,
    )  # fmt: skip
    if rays is not None:
        rays = replace(rays, origin=scale * applied(own, rays.origin), direction=rotated(own, rays.direction), range_m=scale * rays.range_m)
    return replace(scan, cloud=cloud, rays=rays)


def scan_stereo(scene: Scene, options: StereoOptions = StereoOptions(), seed: int = 0) -> tuple[Scan, ...]:
    """One scan per position of the rig. Raises InputError without a position."""
    path, target = path_of(options, "stereo"), target_of(scene)
    features = features_of(target, options, seed)
    sides = [rigid(np.eye(3), (0.0, side * options.baseline_m / 2, 0.0)) for side in (1.0, -1.0)]
    scans = []
    for k, T in enumerate(path.T_world_sensor):
        cameras = np.stack([compose(T, side) for side in sides])
        scans.append(_solved(target, features, cameras, np.full(2, path.time_s[k]), options, 2, 0.0, [seed, k + 1], k))
    return tuple(scans)


def features_of(target: Target, options: CameraOptions, seed: int) -> Features:
    """Features spread at random over the textured part of all surfaces. Raises InputError where there would be too many."""
    n = round(area(target.mesh) * options.features_per_m2)
    require(n <= _MOST_FEATURES, InputError, f"features_per_m2 = {options.features_per_m2}: {n:,} features, at most {_MOST_FEATURES:,}: lower it")
    if n == 0:
        return Features(point=np.zeros((0, 3)), normal=np.zeros((0, 3)), thing=np.zeros(0, np.int64))
    rng = np.random.default_rng([seed, 7])
    point, face = sample_surface(target.mesh, n, int(rng.integers(2**31)))
    kept = ~_is_bare(point, options, rng)
    return Features(point=point[kept], normal=target.normal[face[kept]], thing=target.object_of_face[face[kept]])


def _is_bare(point: FloatArray, options: CameraOptions, rng: np.random.Generator) -> BoolArray:
    """(n,) True on patches without texture: where a random field of the given wavelength is below its quantile."""
    way = rng.standard_normal((_WAVES, 3))
    wave = way / np.linalg.norm(way, axis=1, keepdims=True) * (math.pi / options.patch_m)
    phase = rng.uniform(0, 2 * math.pi, _WAVES)
    field = np.zeros(len(point))
    for k, p in zip(wave, phase, strict=True):
        field += np.cos(point @ k + p)
    bare: BoolArray = field < np.quantile(field, options.bare_share) if options.bare_share < 1 else np.ones(len(point), bool)
    return bare


def sees(target: Target, T_world_camera: FloatArray, features: Features, options: CameraOptions) -> BoolArray:
    """(n,) True for the features that one camera shows: in the picture, not too flat, nothing before them."""
    local = (features.point - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    depth, distance = local[:, 0], np.linalg.norm(local, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = np.abs(local[:, 1] / depth) * options.focal_px, np.abs(local[:, 2] / depth) * options.focal_px
    away = features.point - T_world_camera[:3, 3]
    facing = -np.einsum("nc,nc->n", away, features.normal) >= math.cos(math.radians(options.max_incidence_deg)) * distance
    seen: BoolArray = (depth > 0) & (u <= options.width_px / 2) & (v <= options.height_px / 2) & facing & (distance <= options.max_range_m)
    seen &= distance > 0
    rows = np.flatnonzero(seen)
    eye = np.tile(T_world_camera[:3, 3], (len(rows), 1))
    seen[rows] = is_visible(target, eye, features.point[rows], -features.normal[rows])
    return seen


def _solved(
    target: Target,
    features: Features,
    cameras: FloatArray,
    time_s: FloatArray,
    options: CameraOptions,
    min_views: int,
    min_angle: float,
    seed: list[int],
    frame: int,
) -> Scan:
    """Points of the features that enough cameras see, with their standard deviations from the pixels' noise."""
    rng = np.random.default_rng(seed)
    seen = np.stack([sees(target, T, features, options) for T in cameras], axis=1)
    usable = (seen.sum(axis=1) >= min_views) & (_widest(features.point, cameras, seen) >= min_angle)
    point, seen, thing = features.point[usable], seen[usable], features.thing[usable]
    n = len(point)
    sight = [_sight(T, point, options, rng) for T in cameras]
    solved, covariance = _met(cameras, sight, seen, point, options)
    nearest = np.argmin(np.where(seen, np.stack([np.linalg.norm(point - T[:3, 3], axis=1) for T in cameras], axis=1), np.inf), axis=1)
    origin = cameras[nearest, :3, 3]
    wrong = rng.random(n) < options.mismatch_share
    share = rng.uniform(0.3, 3.0, n)  # a wrong match meets the line of sight anywhere
    solved = np.where(wrong[:, None], origin + share[:, None] * (point - origin), solved)
    away = solved - origin
    distance = np.linalg.norm(away, axis=1)
    direction = away / distance[:, None]
    along = np.einsum("ni,nij,nj->n", direction, covariance, direction)
    across = np.maximum(np.trace(covariance, axis1=1, axis2=2) - along, 0.0) / 2
    cloud = PointCloud(
        points=solved,
        ray=np.arange(n, dtype=np.int64),
        frame=np.full(n, frame, np.int64),
        raw_index=np.arange(n, dtype=np.int64),
        sigma_along_m=np.sqrt(along),
        sigma_across_m=np.sqrt(across),
        label=np.where(wrong, -1, thing),
    )
    rays = Rays(
        origin=origin,
        direction=direction,
        range_m=distance,
        time_s=time_s[nearest],
        ring=nearest.astype(np.int64),
        footprint_rad=np.full(n, 1.0 / options.focal_px),
    )
    return Scan(cloud=cloud, rays=rays)


def _widest(point: FloatArray, cameras: FloatArray, seen: BoolArray) -> FloatArray:
    """(n,) widest angle between two lines of sight to each point, 0 where fewer than two cameras see it."""
    widest = np.zeros(len(point))
    unit = [(point - T[:3, 3]) / np.maximum(np.linalg.norm(point - T[:3, 3], axis=1, keepdims=True), 1e-300) for T in cameras]
    for a in range(len(cameras)):
        for b in range(a):
            angle = np.arctan2(np.linalg.norm(np.cross(unit[a], unit[b]), axis=1), np.einsum("nc,nc->n", unit[a], unit[b]))
            widest = np.where(seen[:, a] & seen[:, b], np.maximum(widest, angle), widest)
    return widest


def _sight(T: FloatArray, point: FloatArray, options: CameraOptions, rng: np.random.Generator) -> FloatArray:
    """(n, 2) place in the picture, y / x and z / x of the camera, disturbed."""
    local = (point - T[:3, 3]) @ T[:3, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        place: FloatArray = local[:, 1:] / local[:, :1]
    return place + rng.standard_normal((len(point), 2)) * (options.noise_px / options.focal_px)


def _met(cameras: FloatArray, sight: list[FloatArray], seen: BoolArray, start: FloatArray, options: CameraOptions) -> tuple[FloatArray, FloatArray]:
    """Least squares of the pixels by Gauss and Newton: points (n, 3) and their covariance (n, 3, 3).

    Each picture gives two equations y - u x = 0 and z - v x = 0 in the camera's axes, weighted by 1 / x.
    """
    p = start.copy()
    for _ in range(4):  # converges quadratically: residuals are pixels, the second step is below rounding
        normal, right = np.zeros((len(p), 3, 3)), np.zeros((len(p), 3))
        for k, T in enumerate(cameras):
            local = (p - T[:3, 3]) @ T[:3, :3]
            x = np.where(seen[:, k], local[:, 0], 1.0)
            for axis in (1, 2):
                gradient = (T[:3, axis] - (local[:, axis] / x)[:, None] * T[:3, 0]) / x[:, None]
                weight = seen[:, k].astype(float)
                residual = np.where(seen[:, k], sight[k][:, axis - 1] - local[:, axis] / x, 0.0)
                normal += weight[:, None, None] * gradient[:, :, None] * gradient[:, None, :]
                right += (weight * residual)[:, None] * gradient
        if len(p):
            p = p + np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    spread = np.asarray(np.linalg.inv(normal), float) * (options.noise_px / options.focal_px) ** 2 if len(p) else np.zeros((0, 3, 3))
    return p, spread
