"""Rotating LiDAR: a fan of beams that turns, each firing from its own pose while the sensor moves.

Geometry of the Velodyne units (user manuals; the crossing point as velodyne-decoder has it): azimuth a runs clockwise seen from above, 0
along +x of the sensor; a beam of elevation w leaves the turning axis at height -f tan(w), so that all beams cross f in front of it, and
its range counts from the axis. The lasers of one firing go off one after the other while the head turns on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.lidar_units import HDL32E, VLP16
from scan2fea.options import option
from scan2fea.simulation.beams import BeamOptions, Shots, shoot
from scan2fea.simulation.casting import target_of
from scan2fea.simulation.motion import SensorPath, kinematics, path_of
from scan2fea.simulation.solids import Scene
from scan2fea.types import FloatArray, IntArray, Scan, Value

_MOST_SHOTS = 50_000_000  # of all frames: 4 GB of rays


@dataclass(frozen=True, kw_only=True)
class LidarOptions(BeamOptions):
    """A turning fan of beams: any table."""

    elevations_deg: tuple[float, ...] = option(
        (0.0,), "Elevation of each beam, in the order in which they fire", unit="deg", minimum=-90.0, maximum=90.0
    )
    azimuths_deg: tuple[float, ...] = option(
        (), "Azimuth by which each beam leads the head, clockwise; none: all 0", unit="deg", minimum=-360.0, maximum=360.0
    )
    focal_m: float = option(0.0, "Distance from the turning axis at which all beams cross", unit="m", minimum=-1.0, maximum=1.0)
    firing_us: float = option(HDL32E.firing_us, "Time from one firing of all beams to the next", unit="us", minimum=0.01)
    laser_us: float = option(0.0, "Time from one beam of a firing to the next", unit="us", minimum=0.0)
    rate_hz: float = option(10.0, "Turns per second", unit="Hz", minimum=0.01, maximum=1000.0)
    window_deg: tuple[float, float] = option((0.0, 360.0), "Azimuths at which it fires, clockwise", unit="deg", minimum=0.0, maximum=360.0)
    wobble_deg: float = option(0.0, "Standard deviation by which the head is ahead of or behind its even turn (and says so)", unit="deg", minimum=0.0)
    azimuth_step_deg: float = option(0.0, "Firings go off at multiples of this azimuth, as the unit tells it; 0: anywhere", unit="deg", minimum=0.0)
    frames: int | None = option(None, "Turns; auto: as many whole turns as the path lasts, one for a sensor that stands", minimum=1)
    keep_every: int = option(1, "Keep one turn in so many: 1 for all, 5 for 20 %", minimum=1)


@dataclass(frozen=True, kw_only=True)
class Hdl32eOptions(LidarOptions):
    """Velodyne HDL-32E. The wobble was measured on velodyne/monterey-first-100-packets.pcap."""

    elevations_deg: tuple[float, ...] = option(
        HDL32E.elevations_deg, "Elevation of each beam, in the order in which they fire", unit="deg", minimum=-90.0, maximum=90.0
    )
    focal_m: float = option(HDL32E.focal_m, "Distance from the turning axis at which all beams cross", unit="m", minimum=-1.0, maximum=1.0)
    laser_us: float = option(HDL32E.laser_us, "Time from one beam of a firing to the next", unit="us", minimum=0.0)
    rate_hz: float = option(20.0, "Turns per second", unit="Hz", minimum=5.0, maximum=20.0)
    wobble_deg: float = option(
        0.003, "Standard deviation by which the head is ahead of or behind its even turn (and says so)", unit="deg", minimum=0.0
    )
    azimuth_step_deg: float = option(0.01, "Firings go off at multiples of this azimuth, as the unit tells it; 0: anywhere", unit="deg", minimum=0.0)
    noise_m: float = option(0.02, "Standard deviation (gaussian) or half width (uniform) of the noise", unit="m", minimum=0.0)
    quantum_m: float = option(0.002, "Ranges are rounded to multiples of this; 0: not rounded", unit="m", minimum=0.0)
    divergence_mrad: float = option(3.0, "Full opening of the beam", unit="mrad", minimum=0.0, maximum=1000.0)
    min_range_m: float = option(1.0, "Nearer surfaces are not measured", unit="m", minimum=0.0)
    max_range_m: float = option(100.0, "Farther surfaces are not measured", unit="m", minimum=0.0)


@dataclass(frozen=True, kw_only=True)
class Vlp16Options(Hdl32eOptions):
    """Velodyne VLP-16 (Puck)."""

    elevations_deg: tuple[float, ...] = option(
        VLP16.elevations_deg, "Elevation of each beam, in the order in which they fire", unit="deg", minimum=-90.0, maximum=90.0
    )
    focal_m: float = option(VLP16.focal_m, "Distance from the turning axis at which all beams cross", unit="m", minimum=-1.0, maximum=1.0)
    firing_us: float = option(VLP16.firing_us, "Time from one firing of all beams to the next", unit="us", minimum=0.01)
    laser_us: float = option(VLP16.laser_us, "Time from one beam of a firing to the next", unit="us", minimum=0.0)
    rate_hz: float = option(10.0, "Turns per second", unit="Hz", minimum=5.0, maximum=20.0)
    wobble_deg: float = option(0.0, "Standard deviation by which the head is ahead of or behind its even turn (and says so)", unit="deg", minimum=0.0)
    noise_m: float = option(0.03, "Standard deviation (gaussian) or half width (uniform) of the noise", unit="m", minimum=0.0)


@dataclass(frozen=True, kw_only=True)
class PlanarOptions(LidarOptions):
    """A single-beam scanner of the class of a Sick LMS511: 190 degrees in one plane, about x forward."""

    firing_us: float = option(18.52, "Time from one firing of all beams to the next", unit="us", minimum=0.01)
    rate_hz: float = option(25.0, "Turns per second", unit="Hz", minimum=0.01, maximum=1000.0)
    window_deg: tuple[float, float] = option((265.0, 95.0), "Azimuths at which it fires, clockwise", unit="deg", minimum=0.0, maximum=360.0)
    noise_m: float = option(0.006, "Standard deviation (gaussian) or half width (uniform) of the noise", unit="m", minimum=0.0)
    divergence_mrad: float = option(4.7, "Full opening of the beam", unit="mrad", minimum=0.0, maximum=1000.0)
    max_range_m: float = option(80.0, "Farther surfaces are not measured", unit="m", minimum=0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Firings(Value):
    """The shots of one frame as the unit tells them: f firings of b beams, in firing order.

    time_s, azimuth_deg : (f,) when and where the first beam of each firing goes off, 0 <= azimuth < 360.
    range_m : (f, b) nan for none.   intensity : (f, b) 0..1.
    """

    time_s: FloatArray
    azimuth_deg: FloatArray
    range_m: FloatArray
    intensity: FloatArray


def rings_of(elevations_deg: tuple[float, ...]) -> IntArray:
    """(b,) number of each beam counted from the lowest."""
    order = np.argsort(np.asarray(elevations_deg), kind="stable")
    ring = np.empty(len(order), np.int64)
    ring[order] = np.arange(len(order))
    return ring


def scan_lidar(scene: Scene, options: LidarOptions = LidarOptions(), seed: int = 0) -> tuple[Scan, ...]:
    """One scan per kept turn, in the world's frame, motion within the turn included; rows of its rays are firing by firing, beam by beam.

    Raises InputError for an empty table or window, too many shots, and without a position.
    """
    path, target = path_of(options, "lidar"), target_of(scene)
    scans: list[Scan] = []
    for frame, time, azimuth in _turns(path, options, seed):
        shots = _shots(path, time, azimuth, options)
        scans.append(shoot(target, shots, options, np.random.default_rng([seed, frame]), frame=len(scans)))
    return tuple(scans)


def _turns(path: SensorPath, options: LidarOptions, seed: int) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Number of each kept turn, with the time and azimuth (radians) of each of its firings. A turn begins where the azimuth passes 0."""
    require(len(options.elevations_deg) > 0, InputError, "sensor lidar: elevations_deg is empty: give at least one beam")
    first, last = (math.radians(x) for x in options.window_deg)
    require(first != last, InputError, f"sensor lidar: window_deg = {list(options.window_deg)} is empty: give two azimuths that differ")
    # a path of 5 s at 20 Hz holds 100 turns, whatever 5 * 20 rounds to
    turns = options.frames or max(1, math.floor(path.duration_s * options.rate_hz + 1e-6))
    step = 2 * math.pi * options.rate_hz * options.firing_us * 1e-6
    shots = math.ceil(turns / options.keep_every) * 2 * math.pi / step * len(options.elevations_deg)
    require(shots <= _MOST_SHOTS, InputError, f"sensor lidar: {turns} turns make {shots:.3g} shots, at most {_MOST_SHOTS:.3g}: give fewer frames")
    for frame in range(0, turns, options.keep_every):
        number = np.arange(math.ceil(frame * 2 * math.pi / step - 1e-9), math.ceil((frame + 1) * 2 * math.pi / step - 1e-9))
        wobble = np.random.default_rng([seed, frame, 1]).standard_normal(len(number)) * math.radians(options.wobble_deg)
        azimuth = number * step + wobble
        if options.azimuth_step_deg > 0:
            azimuth = np.rint(azimuth / math.radians(options.azimuth_step_deg)) * math.radians(options.azimuth_step_deg)
        azimuth = azimuth % (2 * math.pi)
        fires = (azimuth >= first) & (azimuth <= last) if first < last else (azimuth >= first) | (azimuth <= last)
        time = path.time_s[0] + number * options.firing_us * 1e-6
        yield frame, time[fires], azimuth[fires]


def _shots(path: SensorPath, time: FloatArray, azimuth: FloatArray, options: LidarOptions) -> Shots:
    """Every beam of every firing in the world."""
    n_beams = len(options.elevations_deg)
    local, height = _beams(azimuth, options)
    state = kinematics(path, time)
    direction = np.einsum("fij,fbj->fbi", state.rotation, local)
    origin = state.position[:, None, :] + height[None, :, None] * state.rotation[:, None, :, 2]
    within = np.arange(n_beams) * options.laser_us * 1e-6
    return Shots(
        origin=origin.reshape(-1, 3),
        direction=direction.reshape(-1, 3),
        time_s=(time[:, None] + within).ravel(),
        ring=np.tile(rings_of(options.elevations_deg), len(time)),
    )


def _beams(azimuth: FloatArray, options: LidarOptions) -> tuple[FloatArray, FloatArray]:
    """Directions (f, b, 3) in the sensor's frame, and the height (b,) on the axis at which each beam leaves."""
    w = np.radians(np.asarray(options.elevations_deg))
    lead = np.radians(np.asarray(options.azimuths_deg or np.zeros(len(w))))
    require(
        len(lead) == len(w), InputError, f"sensor lidar: azimuths_deg has {len(lead)} entries, elevations_deg has {len(w)}: give as many, or none"
    )
    turned = 2 * math.pi * options.rate_hz * options.laser_us * 1e-6 * np.arange(len(w))
    a = azimuth[:, None] + lead + turned
    flat = np.broadcast_to(np.sin(w), a.shape)
    height: FloatArray = -options.focal_m * np.tan(w)
    return np.stack([np.cos(w) * np.cos(a), -np.cos(w) * np.sin(a), flat], axis=2), height


def firings_of(scan: Scan, options: LidarOptions) -> Firings:
    """What the unit itself would tell of one scan of `scan_lidar` made with these options: azimuths of the head, ranges and intensities.

    Raises InputError where the scan is not of this sensor.
    """
    n_beams = len(options.elevations_deg)
    rays = scan.rays
    if rays is None or rays.time_s is None or len(rays) % n_beams:
        raise InputError(
            f"a scan of {0 if rays is None else len(rays)} rays is none of a sensor of {n_beams} beams: give the options it was made with"
        )
    time = rays.time_s[::n_beams]
    rotation = kinematics(path_of(options, "lidar"), time).rotation
    local = np.einsum("fij,fi->fj", rotation, rays.direction[::n_beams])
    lead = options.azimuths_deg[0] if options.azimuths_deg else 0.0
    intensity = np.zeros(len(rays))
    if scan.cloud.intensity is not None:
        intensity[scan.cloud.ray] = scan.cloud.intensity
    return Firings(
        time_s=time,
        azimuth_deg=(np.degrees(np.arctan2(-local[:, 1], local[:, 0])) - lead) % 360.0,
        range_m=rays.range_m.reshape(-1, n_beams),
        intensity=intensity.reshape(-1, n_beams),
    )
