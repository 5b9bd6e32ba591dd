"""Static scanners that aim: each station shoots at points spread evenly over the objects it sees, with noise along the ray.

The demo's detail scan (scanner.py) for any scene. Even coverage at the price of no real instrument's pattern: good for planning and tests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan2fea.errors import InputError, require
from scan2fea.kernel.measures import area
from scan2fea.options import option
from scan2fea.simulation.lab import Lab, SceneObject
from scan2fea.simulation.scanner import LabOptions, simulate
from scan2fea.simulation.solids import Scene
from scan2fea.types import Scan

_MOST_AIMS = 20_000_000  # of one object


@dataclass(frozen=True, kw_only=True)
class StationsOptions:
    """Static scanners that aim at the objects."""

    positions_m: tuple[tuple[float, float, float], ...] = option((), "Where the scanners stand", unit="m")
    noise_m: float = option(0.0, "Standard deviation of the range, along the ray", unit="m", minimum=0.0)
    density: float = option(1.0, "Factor on the number of points per area", minimum=1e-6)
    overview_deg: float = option(0.0, "Angular step of each station's overview sweep; 0 for none", unit="deg", minimum=0.0, maximum=90.0)
    max_incidence_deg: float = option(80.0, "Aim points seen at a flatter angle than this are not shot", unit="deg", minimum=0.0, maximum=90.0)


def scan_stations(scene: Scene, options: StationsOptions, seed: int) -> tuple[Scan, ...]:
    """One scan per position. Raises InputError without a position."""
    require(len(options.positions_m) > 0, InputError, "sensor stations: positions_m is empty: add where the scanners stand")
    for s in scene.solids:
        n = options.density * area(s.mesh) / s.spacing_m**2
        says = f"object {s.name}: spacing: {s.spacing_m:g} m makes {n:,.0f} aim points, at most {_MOST_AIMS:,}: raise it"
        require(n <= _MOST_AIMS, InputError, says)
    objects = tuple(
        SceneObject(
            name=s.name, kind=s.shape.kind, mesh=s.mesh, dimensions=s.shape.parameters, volume_m3=s.volume_m3, spacing_m=s.spacing_m, stands_on=""
        )
        for s in scene.solids
    )
    lab = Lab(objects=objects, stations=np.asarray(options.positions_m, float).reshape(-1, 3))
    chosen = LabOptions(
        noise_m=options.noise_m,
        density=options.density,
        overview_deg=options.overview_deg,
        max_incidence_deg=options.max_incidence_deg,
        seed=seed,
    )
    return simulate(lab, chosen).scans
