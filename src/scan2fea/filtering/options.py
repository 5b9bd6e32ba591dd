"""What the filters can be told."""

from __future__ import annotations

from dataclasses import dataclass

from scan2fea.options import option


@dataclass(frozen=True, kw_only=True)
class FilteringOptions:
    """Outliers and density."""

    outliers: str = option(
        "isolated",
        "isolated: far from its neighbours compared with these; density: thesis eq 2.3, corrected; statistical: mean distance to k neighbours",
        choices=("isolated", "density", "statistical", "none"),
    )
    neighbours: int = option(15, "Neighbours that each point is judged by", minimum=3, maximum=200)
    outlier_sd: float = option(1.0, "Standard deviations above the mean that density and statistical still keep", minimum=0.0)
    voxel_m: float | None = option(None, "Edge of cells whose points give way to their mean; none: only above max_points", unit="m", minimum=0.0)
    max_points: int = option(4_000_000, "A scan of more points is thinned by voxel means with an edge from the data", minimum=1000)
    disocclusion: str = option(
        "none",
        "Mark what stands before a surface seen on both of its sides, and put points there that nobody measured (is_inferred). planes: the plane "
        "or corner of both sides; diffusion: of the range (thesis eq 2.7); anisotropic: along the vertical alone. Needs the sensor's one place",
        choices=("none", "planes", "diffusion", "anisotropic"),
    )
    occlusion_tau_m: float | None = option(
        None, "How much farther the background of what stands in the way must be; auto: from noise and step of the ranges", unit="m", minimum=0.0
    )
