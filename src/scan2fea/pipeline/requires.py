"""What a scan must meet to be converted (thesis 3.2, hypothesis 2): stated by the user, held against each object."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources

from scan2fea.kernel.noise import spacing
from scan2fea.options import option
from scan2fea.types import Check, PointCloud
from scan2fea.units import MILLIMETRES_PER_METRE


@dataclass(frozen=True, kw_only=True)
class RequireOptions:
    spacing_m: float | None = option(None, "an object whose points are farther apart than this fails; none: no demand", unit="m", minimum=1e-9)
    noise_m: float | None = option(None, "an object whose noise (standard deviation) exceeds this fails; none: no demand", unit="m", minimum=0.0)


def spacing_checks(cloud: PointCloud, options: RequireOptions) -> list[Check]:
    """Of the measured points of an object; none where nothing is demanded."""
    if options.spacing_m is None:
        return []
    points = cloud.points if cloud.is_inferred is None else cloud.points[~cloud.is_inferred]
    found = spacing(points)
    return [_check("require.spacing", found, options.spacing_m, "the points are", "apart", "scan from nearer or with a finer step")]


def noise_checks(sigma_m: float, options: RequireOptions) -> list[Check]:
    """Of the noise that the member or the surface was found with."""
    if options.noise_m is None:
        return []
    return [_check("require.noise", sigma_m, options.noise_m, "the noise of the points is", "", "use a more accurate scanner, or average scans")]


@cache
def conditions() -> Mapping[str, float]:
    """Largest spacing and noise of the free form, in walls (conditions.toml)."""
    text = resources.files("scan2fea.pipeline").joinpath("conditions.toml").read_text(encoding="utf-8")
    return {name: float(value) for name, value in tomllib.loads(text)["free_form"].items()}


def thinnest_wall(spacing_m: float, sigma_m: float) -> float:
    """m, that points so far apart and so noisy (nan: not known) let the free form convert."""
    limit = conditions()
    by_noise = sigma_m / limit["noise_walls"] if sigma_m == sigma_m else 0.0
    return max(spacing_m / limit["spacing_walls"], by_noise)


def _check(name: str, value: float, limit: float, what: str, after: str, do: str) -> Check:
    told = f"{what} {MILLIMETRES_PER_METRE * value:.3g} mm{f' {after}' if after else ''}"
    says = f"{told}; {name}_m = {MILLIMETRES_PER_METRE * limit:.3g} mm was demanded: {do}"
    return Check(name=name, value=value, limit=limit, unit="m", passed=bool(value <= limit), says=says)
