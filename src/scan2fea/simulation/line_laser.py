"""Line laser scanner: a sheet of light and a camera beside it; where the camera cannot see the stripe there is no point.

The head looks along x; the sheet lies in its x, y plane; the camera sits `baseline_m` above the laser (along z). Triangulation turns an
error of the stripe's place in the picture into an error of the range r that grows with its square: r^2 sigma_px / (f baseline).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.options import option
from scan2fea.simulation.beams import BeamOptions, Echoes, Shots, echoes, recorded
from scan2fea.simulation.casting import Target, is_visible, target_of
from scan2fea.simulation.motion import kinematics, path_of
from scan2fea.simulation.solids import Scene
from scan2fea.types import FloatArray, Scan

_MOST_SHOTS = 30_000_000  # 8 GB while they are cast


@dataclass(frozen=True, kw_only=True)
class LineLaserOptions(BeamOptions):
    """A profile scanner moved along a path."""

    fan_deg: float = option(40.0, "Full opening of the sheet of light", unit="deg", minimum=0.1, maximum=170.0)
    points_per_profile: int = option(640, "Points across one profile", minimum=2, maximum=100_000)
    profiles_per_s: float = option(50.0, "Profiles per second along the path; a head that stands takes one per position", unit="1/s", minimum=0.001)
    baseline_m: float = option(0.15, "Distance between laser and camera", unit="m", minimum=1e-6)
    focal_px: float = option(2000.0, "Focal length of the camera", unit="px", minimum=1.0)
    stripe_px: float = option(0.1, "Standard deviation (or half width) of the stripe's place in the picture", unit="px", minimum=0.0)
    min_range_m: float = option(0.2, "Nearer surfaces are not measured", unit="m", minimum=0.0)
    max_range_m: float = option(1.5, "Farther surfaces are not measured", unit="m", minimum=0.0)
    max_incidence_deg: float = option(85.0, "A surface seen at a flatter angle than this returns nothing", unit="deg", minimum=0.0, maximum=90.0)


def scan_line_laser(scene: Scene, options: LineLaserOptions = LineLaserOptions(), seed: int = 0) -> tuple[Scan, ...]:
    """One scan of the whole path; ring = number of the point in its profile.

    Rays without return are not kept: no stripe in the picture does not mean that the place is empty. Raises InputError without a position.
    """
    path, target = path_of(options, "line_laser"), target_of(scene)
    n_profiles = len(path) if len(path) == 1 else math.floor(path.duration_s * options.profiles_per_s + 1e-6) + 1
    count = n_profiles * options.points_per_profile
    require(count <= _MOST_SHOTS, InputError, f"sensor line_laser: {count:,} points along the path, at most {_MOST_SHOTS:,}: fewer profiles_per_s")
    time = path.time_s[0] + np.arange(n_profiles) / options.profiles_per_s
    state = kinematics(path, time)
    half = math.tan(math.radians(options.fan_deg) / 2)
    across = np.linspace(half, -half, options.points_per_profile)  # evenly over the picture, not over the angle
    local = np.stack([np.ones_like(across), across, np.zeros_like(across)], axis=1)
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    shots = Shots(
        origin=np.repeat(state.position, len(local), axis=0),
        direction=np.einsum("fij,bj->fbi", state.rotation, local).reshape(-1, 3),
        time_s=np.repeat(time, len(local)),
        ring=np.tile(np.arange(len(local)), n_profiles),
    )
    camera = np.repeat(state.position + options.baseline_m * state.rotation[:, :, 2], len(local), axis=0)
    echo = _seen(target, shots, echoes(target, shots, options), camera)
    spread = echo.range_m**2 * options.stripe_px / (options.focal_px * options.baseline_m)
    opening = options.divergence_mrad * 1e-3
    return (recorded(shots, echo, options, np.random.default_rng([seed, 0]), opening_rad=opening, more_m=spread).compact(),)


def _seen(target: Target, shots: Shots, echo: Echoes, camera: FloatArray) -> Echoes:
    """The echoes whose light the camera sees."""
    lit = np.flatnonzero(np.isfinite(echo.range_m))
    point = shots.origin[lit] + echo.range_m[lit, None] * shots.direction[lit]
    range_m = np.full(len(shots), np.nan)
    range_m[lit] = np.where(is_visible(target, camera[lit], point, shots.direction[lit]), echo.range_m[lit], np.nan)
    return Echoes(range_m=range_m, thing=echo.thing, cosine=echo.cosine, shine=echo.shine)
