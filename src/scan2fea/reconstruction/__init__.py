"""Reconstruction: points of one object to a closed surface. The only place where the name of a method becomes a function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scan2fea.errors import UsageError, require
from scan2fea.kernel.coordinate_steps import spread
from scan2fea.kernel.face_tree import morton_order
from scan2fea.options import option
from scan2fea.reconstruction.advancing_front import FrontOptions, advancing_front
from scan2fea.reconstruction.ball_pivoting import PivotOptions, ball_pivoting
from scan2fea.reconstruction.bores import Bore, distinct_bores
from scan2fea.reconstruction.coordinate_rounding import with_rounding
from scan2fea.reconstruction.gates import failed
from scan2fea.reconstruction.gates_planar import CURED
from scan2fea.reconstruction.lost_bores import BORES_CLOSED, closed_bores, told_by
from scan2fea.reconstruction.open_sheet import open_sheet
from scan2fea.reconstruction.planar import planar, served
from scan2fea.reconstruction.plane_growing import Planes
from scan2fea.reconstruction.plugged import unplugged
from scan2fea.reconstruction.poisson import poisson
from scan2fea.reconstruction.rounded import served_smooth
from scan2fea.reconstruction.scale_space import ScaleSpaceOptions, scale_space
from scan2fea.reconstruction.sharpened import served_sharp
from scan2fea.reconstruction.thin import distinct, thinned
from scan2fea.reconstruction.two_answers import contradicted
from scan2fea.reconstruction.visibility import Reconstruction, VisibilityOptions, first_surface, looked_again, opened, told_images, visibility
from scan2fea.types import Scan

METHODS: Mapping[str, Callable[[Scan, VisibilityOptions], Reconstruction]] = {
    "visibility": visibility,
    "planar": planar,
    "advancing_front": advancing_front,
    "scale_space": scale_space,
    "ball_pivoting": ball_pivoting,
    "poisson": poisson,
}


@dataclass(frozen=True, kw_only=True)
class ReconstructionOptions(ScaleSpaceOptions, FrontOptions, PivotOptions):
    method: str = option("visibility", "how the surface is found", choices=tuple(METHODS))
    flat: bool = option(True, "visibility: faces exactly flat and creases exactly sharp where planes explain all points")
    smooth: bool = option(True, "visibility: faces bend between points where these show the part to be smooth at their spacing")
    max_points: int = option(150_000, "a denser scan of one object is thinned to this many of its points; checks still use all", minimum=100)


def reconstruct(scan: Scan, options: ReconstructionOptions = ReconstructionOptions()) -> Reconstruction:
    """The closed surface of one object by `options.method`. Raises UsageError for an unknown method, ReconstructionError where there is none."""
    require(options.method in METHODS, UsageError, f"reconstruction.method {options.method!r}: use one of {', '.join(METHODS)}")
    fewer = thinned(distinct(scan), options.max_points)
    if len(fewer.cloud) and np.isfinite(fewer.cloud.points).all() and told_images(fewer, options) is None:
        # neighbours side by side in memory: half the time
        fewer = Scan(cloud=fewer.cloud.take(morton_order(fewer.cloud.points)), rays=fewer.rays)
    fewer, step_m = spread(fewer, options.seed)
    if options.method != "visibility":
        found = METHODS[options.method](fewer, options)
        return _nothing_lost(found, () if failed(found.checks) else _planes_and_bores(fewer, found)[1], step_m)
    found, flats, bores = _with_flats(fewer, options)
    found = served_smooth(fewer, found) if options.smooth else found
    found = served_sharp(fewer, found) if options.flat else found
    found = unplugged(fewer, found, flats, options.seed)
    found = contradicted(fewer, found, flats, options.seed)  # asked of what is shipped: led out edges may have mended the rest
    return _nothing_lost(found, bores, step_m)


def _with_flats(scan: Scan, options: ReconstructionOptions) -> tuple[Reconstruction, tuple[Reconstruction, ...], Sequence[Bore]]:
    """The surface, of flat faces where these explain the points; the solids of flat faces that were refused; the bores that the points tell.

    Where flat faces may cure all that is against the first surface they are asked before it is looked for again: that takes several times as long.
    """
    begun = first_surface(scan, options)
    grown, bores = _planes_and_bores(scan, begun.surface)
    begun, closed = opened(scan, options, begun, bores), begun
    if begun is not closed:
        grown, bores = _planes_and_bores(scan, begun.surface, bores)
    found = begun.surface
    flats: tuple[Reconstruction, ...] = ()
    against = {check.name for check in failed(found.checks)}
    curable = options.flat and against <= CURED
    if curable:
        found, flats = served(scan, found, options.seed, bores, grown)
    if not against or not failed(found.checks):
        return found, flats, bores
    again = looked_again(scan, options, begun)
    if not options.flat or (curable and again is begun.surface):
        return (found if curable else again), flats, bores
    grown, bores = _planes_and_bores(scan, again, bores)
    return *served(scan, again, options.seed, bores, grown), bores


def _planes_and_bores(scan: Scan, found: Reconstruction, before: Sequence[Bore] = ()) -> tuple[Planes | None, Sequence[Bore]]:
    """The planes under the points of a surface, and the bores that the points tell beside them, or told `before` beside others."""
    told = found.told or told_by(scan.cloud.points, found.normals, found.spacing_m, found.sigma_m)
    return told.grown, distinct_bores([*before, *told.bores])


def _nothing_lost(found: Reconstruction, bores: Sequence[Bore], step_m: float) -> Reconstruction:
    """What is shipped, with checks of whether it has the bores that were scanned, and of what the steps of the coordinates leave open."""
    found = with_rounding(found, step_m)
    if failed(found.checks):
        return found
    others = (check for check in found.checks if check.name != BORES_CLOSED)
    return replace(found, checks=(*others, closed_bores(bores, found.mesh)))


__all__ = [
    "METHODS",
    "Reconstruction",
    "ReconstructionOptions",
    "VisibilityOptions",
    "advancing_front",
    "ball_pivoting",
    "open_sheet",
    "planar",
    "poisson",
    "reconstruct",
    "scale_space",
    "visibility",
]
