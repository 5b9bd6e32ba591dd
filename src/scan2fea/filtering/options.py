"""What the filters can be told."""

from __future__ import annotations

from dataclasses import dataclass

from scan2fea.options import option


@dataclass(frozen=True, kw_only=True)
class FilteringOptions:
    """Outliers and density."""

    outliers: str = option(
        "isolated",
        "isolated: far from its neighbours compared with these; density: thesis eq 2.3, corrected; statistical: mean distance to k neighbours; "
        "radius: fewer than k others within radius_m",
        choices=("isolated", "density", "statistical", "radius", "none"),
    )
    neighbours: int = option(15, "Neighbours that each point is judged by", minimum=3, maximum=200)
    outlier_sd: float = option(1.0, "Standard deviations above the mean that density and statistical still keep", minimum=0.0)
    radius_m: float | None = option(None, "Of outliers = radius; auto: four times the median distance to the k-th neighbour", unit="m", minimum=0.0)
    moving: bool = option(False, "Leave out points that more of the other inputs have looked through than have seen again; needs sensor positions")
    crop_box_m: tuple[float, ...] = option((), "Keep what lies in the box: smallest x y z, largest x y z, in the coordinates of OUT", unit="m")
    crop_plane: tuple[float, ...] = option((), "Keep what lies beyond the plane: normal x y z, distance along it, in the coordinates of OUT [m]")
    crop_region_m: tuple[float, ...] = option((), "Keep what lies in a region in plan: x y of its corners, in the coordinates of OUT", unit="m")
    crop_outside: bool = option(False, "Keep what lies outside of box, plane and region instead")
    voxel_m: float | None = option(None, "Edge of cells whose points give way to their mean; none: no means", unit="m", minimum=0.0)
    max_points: int = option(4_000_000, "A scan of more points is thinned to so many, where it is dense; walls keep both faces", minimum=1000)
    disocclusion: str = option(
        "none",
        "Mark what stands before a surface seen on both of its sides, and put points there that nobody measured (is_inferred). planes: the plane "
        "or corner of both sides; diffusion: of the range (thesis eq 2.7); anisotropic: along the vertical alone. Needs the sensor's one place",
        choices=("none", "planes", "diffusion", "anisotropic"),
    )
    occlusion_tau_m: float | None = option(
        None, "How much farther the background of what stands in the way must be; auto: from noise and step of the ranges", unit="m", minimum=0.0
    )
