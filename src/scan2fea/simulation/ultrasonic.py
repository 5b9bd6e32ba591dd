"""Ultrasonic ranging in air: a wide cone of sound, the nearest return in it, and a clock.

The sensor knows neither where in its cone the echo came from nor the true speed of sound: it puts the point on its axis, at a distance
reckoned with the temperature that it was told. Speed of sound in dry air: 331.3 m/s sqrt(1 + T / 273.15 C) (Cramer 1993, ideal gas).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.options import option
from scan2fea.simulation.beams import Echoes, ReachOptions, Shots, footprint, recorded
from scan2fea.simulation.casting import Target, hits, target_of
from scan2fea.simulation.motion import kinematics, path_of
from scan2fea.simulation.solids import Scene
from scan2fea.types import FloatArray, IntArray, Scan

_AT_ONCE = 4096
_MOST_PINGS = 10_000_000
_ROUNDS = 5  # of refinement about the nearest return, each in a cone of a third of the width
_NARROWER = 1 / 3


@dataclass(frozen=True, kw_only=True)
class UltrasonicOptions(ReachOptions):
    """A transducer on a path; it pings while it moves, or once at each position where it stands."""

    cone_deg: float = option(20.0, "Full opening of the cone of sound", unit="deg", minimum=0.1, maximum=120.0)
    pings_per_s: float = option(20.0, "Pings per second along the path", unit="1/s", minimum=0.001)
    stands: bool = option(False, "One ping at each position instead of pings along the way")
    air_c: float = option(20.0, "True temperature of the air", unit="C", minimum=-100.0, maximum=200.0)
    assumed_c: float = option(20.0, "Temperature that the sensor reckons with", unit="C", minimum=-100.0, maximum=200.0)
    clock_us: float = option(3.0, "Standard deviation (or half width) of the time of flight", unit="us", minimum=0.0)
    footprint_rays: int = option(400, "Rays cast over the cone to find the nearest return", minimum=16, maximum=100_000)
    min_range_m: float = option(0.02, "Nearer surfaces are not measured", unit="m", minimum=0.0)
    max_range_m: float = option(4.0, "Farther surfaces are not measured", unit="m", minimum=0.0)


def speed_of_sound(temperature_c: float) -> float:
    """Metres per second in dry air."""
    return 331.3 * math.sqrt(1.0 + temperature_c / 273.15)


def scan_ultrasonic(scene: Scene, options: UltrasonicOptions = UltrasonicOptions(), seed: int = 0) -> tuple[Scan, ...]:
    """One scan of all pings. Pings without echo are not kept: a surface that throws the sound aside is silent, not absent.

    Raises InputError without a position.
    """
    path, target = path_of(options, "ultrasonic"), target_of(scene)
    n = math.floor(path.duration_s * options.pings_per_s + 1e-6) + 1
    require(n <= _MOST_PINGS, InputError, f"sensor ultrasonic: {n:,} pings along the path, at most {_MOST_PINGS:,}: fewer pings_per_s")
    time = path.time_s if options.stands else path.time_s[0] + np.arange(n) / options.pings_per_s
    state = kinematics(path, time)
    shots = Shots(origin=state.position, direction=state.rotation[:, :, 0], time_s=time, ring=np.zeros(len(time), np.int64))
    echo = nearest_in_cone(target, shots.origin, shots.direction, options)
    factor = speed_of_sound(options.assumed_c) / speed_of_sound(options.air_c)
    reckoned = Echoes(range_m=echo.range_m * factor, thing=echo.thing, cosine=echo.cosine, shine=echo.shine)
    spread = options.clock_us * 1e-6 * speed_of_sound(options.assumed_c) / 2
    opening = math.radians(options.cone_deg)
    scan = recorded(shots, reckoned, options, np.random.default_rng([seed, 0]), opening_rad=opening, more_m=spread)
    # the echo lies anywhere on an even disc of radius R about the axis: standard deviation R / 2 along either axis
    across = np.linalg.norm(scan.cloud.points - shots.origin[scan.cloud.ray], axis=1) * math.tan(opening / 2) / 2
    cloud = scan.cloud.replaced(sigma_across_m=across)
    return (Scan(cloud=cloud, rays=scan.rays).compact(),)


def nearest_in_cone(target: Target, origin: FloatArray, axis: FloatArray, options: UltrasonicOptions) -> Echoes:
    """The nearest surface that returns sound, in the cone about each of (n, 3) axes; range nan where there is none.

    Many rays find about where it is, further rays about the best of them where exactly. A surface flatter to the ray than
    `max_incidence_deg` throws the sound aside.
    """
    parts = [_nearest(target, origin[k : k + _AT_ONCE], axis[k : k + _AT_ONCE], options) for k in range(0, len(origin), _AT_ONCE)]
    range_m, thing, cosine = (np.concatenate([p[i] for p in parts]) for i in range(3))
    return Echoes(range_m=range_m, thing=thing, cosine=cosine, shine=np.where(thing >= 0, 1.0, 0.0))


def _nearest(target: Target, origin: FloatArray, axis: FloatArray, options: UltrasonicOptions) -> tuple[FloatArray, IntArray, FloatArray]:
    opening, m = math.radians(options.cone_deg), options.footprint_rays
    flattest = math.cos(math.radians(options.max_incidence_deg))
    best, heading = np.full(len(origin), np.inf), axis.copy()
    thing, cosine = np.full(len(origin), -1, np.int64), np.zeros(len(origin))
    width = opening
    rays = np.concatenate([footprint(axis, opening, m), axis[:, None]], axis=1)
    for _ in range(_ROUNDS):
        k = rays.shape[1]
        hit = hits(target, np.repeat(origin, k, axis=0), rays.reshape(-1, 3))
        range_m = np.where(np.isfinite(hit.range_m) & (hit.cosine >= flattest), hit.range_m, np.inf).reshape(-1, k)
        first = np.argmin(range_m, axis=1)
        row = np.arange(len(origin))
        better = range_m[row, first] < best
        best = np.where(better, range_m[row, first], best)
        heading = np.where(better[:, None], rays[row, first], heading)
        thing = np.where(better, hit.thing.reshape(-1, k)[row, first], thing)
        cosine = np.where(better, hit.cosine.reshape(-1, k)[row, first], cosine)
        width *= _NARROWER
        rays = _within(footprint(heading, width, max(m // 8, 16)), axis, opening / 2)
    return np.where(np.isfinite(best), best, np.nan), thing, cosine


def _within(rays: FloatArray, axis: FloatArray, half: float) -> FloatArray:
    """(n, k, 3) rays; those outside the cone about (n, 3) axes are turned to its rim."""
    along = np.einsum("nkc,nc->nk", rays, axis)
    side = rays - along[:, :, None] * axis[:, None]
    size = np.linalg.norm(side, axis=2)
    outside = np.arctan2(size, along) > half
    rim = math.cos(half) * axis[:, None] + math.sin(half) * side / np.maximum(size, 1e-300)[:, :, None]
    return np.where(outside[:, :, None], rim, rays)
