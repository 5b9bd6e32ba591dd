"""Terrestrial laser scanner: a mirror turns about a level axis while the head turns about the upright one, a grid of equal angles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.options import option
from scan2fea.simulation.beams import BeamOptions, Shots, shoot
from scan2fea.simulation.casting import target_of
from scan2fea.simulation.motion import path_of
from scan2fea.simulation.solids import Scene
from scan2fea.types import FloatArray, Scan
from scan2fea.units import radians

_MOST_SHOTS = 30_000_000  # of one station: 8 GB while they are cast; a finer grid is a slip of the keyboard


@dataclass(frozen=True, kw_only=True)
class TerrestrialOptions(BeamOptions):
    """A phase-based scanner of the class of a Faro Focus or Leica RTC360."""

    step_deg: float = option(0.1, "Angle between neighbouring shots, both ways", unit="deg", minimum=1e-4, maximum=30.0)
    azimuth_deg: tuple[float, float] = option(
        (-180.0, 180.0), "First and last azimuth, from x forward to the left", unit="deg", minimum=-360.0, maximum=360.0
    )
    elevation_deg: tuple[float, float] = option((-60.0, 90.0), "First and last elevation", unit="deg", minimum=-90.0, maximum=90.0)
    points_per_s: float = option(500_000.0, "Shots per second, for their time", unit="1/s", minimum=1.0)
    noise_m: float = option(0.001, "Standard deviation (gaussian) or half width (uniform) of the noise", unit="m", minimum=0.0)
    divergence_mrad: float = option(0.3, "Full opening of the beam", unit="mrad", minimum=0.0, maximum=1000.0)
    min_range_m: float = option(0.4, "Nearer surfaces are not measured", unit="m", minimum=0.0)
    max_range_m: float = option(130.0, "Farther surfaces are not measured", unit="m", minimum=0.0)


def grid_directions(options: TerrestrialOptions) -> tuple[FloatArray, int]:
    """(n, 3) unit directions, azimuth by azimuth, in each from below to above; and the number of rows of one azimuth.

    Azimuths that close a full turn do not repeat the first. Raises InputError for an empty or endless grid.
    """
    a0, a1 = options.azimuth_deg
    e0, e1 = options.elevation_deg
    require(a1 > a0 and e1 > e0, InputError, f"the scanner's window {a0}..{a1} deg by {e0}..{e1} deg is empty: give the lesser angle first")
    n_a, n_e = math.floor((a1 - a0) / options.step_deg + 1e-9) + 1, math.floor((e1 - e0) / options.step_deg + 1e-9) + 1
    if (n_a - 1) * options.step_deg >= 360.0 - 1e-9:
        n_a = math.ceil(360.0 / options.step_deg - 1e-9)
    require(
        n_a * n_e <= _MOST_SHOTS,
        InputError,
        f"step_deg = {options.step_deg}: {n_a * n_e:,} shots of one station, at most {_MOST_SHOTS:,}: widen the step",
    )
    azimuth = radians(a0) + radians(options.step_deg) * np.arange(n_a)
    elevation = radians(e0) + radians(options.step_deg) * np.arange(n_e)
    a, e = np.repeat(azimuth, n_e), np.tile(elevation, n_a)
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1), n_e


def scan_terrestrial(scene: Scene, options: TerrestrialOptions = TerrestrialOptions(), seed: int = 0) -> tuple[Scan, ...]:
    """One scan per position; every shot of the grid is a row of its rays, ring = row of the grid.

    Raises InputError for a window or a step that makes no grid, and without a position.
    """
    path, target = path_of(options, "terrestrial"), target_of(scene)
    local, n_rows = grid_directions(options)
    ring = np.arange(len(local)) % n_rows
    scans = []
    for k, T in enumerate(path.T_world_sensor):
        shots = Shots(
            origin=np.tile(T[:3, 3], (len(local), 1)),
            direction=local @ T[:3, :3].T,
            time_s=path.time_s[k] + np.arange(len(local)) / options.points_per_s,
            ring=ring,
        )
        scans.append(shoot(target, shots, options, np.random.default_rng([seed, k]), frame=k))
    return tuple(scans)
