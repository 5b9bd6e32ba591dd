"""When a surface fitted to ranges must not be shipped: what its own rays say against it."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import binary_dilation, label

from scan2fea.kernel.coverage import unmeasured_share
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import area, face_normals
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.reconstruction.budget import HIDDEN_VOLUME, WALL_ENDS
from scan2fea.reconstruction.evidence import around, at_most, mm
from scan2fea.reconstruction.hidden_volume import unseen_volume
from scan2fea.reconstruction.range_fit import Fit
from scan2fea.reconstruction.raster import Images
from scan2fea.types import BoolArray, Check

UNMEASURED = 0.10  # of the area: as where sensor positions are given
UNSEEN_VOLUME = 0.02  # of the volume that may hide behind what no ray has met
NOT_SEEN = ("unmeasured area", HIDDEN_VOLUME, WALL_ENDS)
UNSEEN_ENDS = 0.01  # half of the 2 % that a volume may be off: whole scans have 0.0007 at most
REACH = 3.0  # spacings of the rays on the surface: a place farther from any is not measured
PLACES = 17
FAR_SIGMAS, FAR = 4.0, 0.02  # ranges farther off than any noise, and rays that miss
EXCESS = 1.1  # scatter of the ranges against their noise
HOLE_PIXELS = 3  # side by side without a return, where one ray in a thousand tells nothing (`occupancy.STRAY`): 1e-5 in a scan of 10,000
PASSED, RIM_PIXELS = 0.01, 0.5  # rays without a return that cross the inside this deep, against those with one
NOISE_OVER_WALL = 0.15  # noise left in the surface
PIXEL_OVER_WALL = 1.1
BESIDE, AROUND = np.zeros((2, 3, 3, 3), bool)  # pixels of the same image that share an edge, or a corner
BESIDE[1, 1, :] = BESIDE[1, :, 1] = True
AROUND[1] = True
HALVES = 0.02  # two halves of the rays must agree in volume
OWN_IMAGE = 0.01  # half of the 2 % that a volume may be off: what the rays do not resolve of the true shape comes on top


def gates_ranges(
    fit: Fit, images: Images, sigma_m: float, residual_m: float, wall_m: float, pixel_m: float, volume_spread: float
) -> tuple[Check, ...]:
    """The checks of a fitted surface.

    residual_m : noise left in it.   wall_m : its thinner walls, nan: none.   pixel_m : of the images, on the surface.   volume_spread : relative,
    between the two halves of the rays, of their mean.
    """
    hit = images.is_hit
    met = hit & (fit.face >= 0) & (np.abs(np.nan_to_num(fit.off_m)) < FAR_SIGMAS * sigma_m)
    far = float(_lost(fit, images, hit & ~met, sigma_m, pixel_m) / max(1, hit.sum()))
    scatter = float(np.sqrt(np.mean(fit.off_m[met] ** 2))) / sigma_m if met.any() else math.inf
    places = images.origin[met] + (images.range_m[met] - fit.off_m[met])[:, None] * images.direction[met]
    reach = REACH * math.sqrt(area(fit.mesh) / max(1, len(places)))
    reach = max(reach, REACH * pixel_m)
    bare = unmeasured_share(fit.mesh, places, reach)
    unseen, where = unseen_volume(fit.mesh, places, face_normals(fit.mesh)[fit.face[met]], reach)
    checks = [
        at_most(
            NOT_SEEN[0],
            bare,
            UNMEASURED,
            f"{bare:.0%} of the surface was met by no ray within {mm(reach)} (limit {UNMEASURED:.0%}){around(where)}: scan that side too, "
            "or fit the member",
        ),
        at_most(
            NOT_SEEN[1],
            unseen,
            UNSEEN_VOLUME,
            f"{unseen:.0%} of the volume may hide behind surface that no ray has met (limit {UNSEEN_VOLUME:.0%}){around(where)}: scan there too",
        ),
        at_most("rays that miss", far, FAR, f"{far:.1%} of the ranges are not explained by the surface (limit {FAR:.0%}): a part was lost"),
        at_most(
            "scatter of the ranges",
            scatter,
            EXCESS,
            f"ranges scatter {scatter:.2f} times their noise about the surface (limit {EXCESS}): parts are missing or merged",
        ),
        _passing(fit, images, pixel_m),
        closed_holes(fit, images),
        at_most(
            "halves of the rays",
            volume_spread,
            HALVES,
            f"two halves of the rays differ by {volume_spread:.1%} in volume (limit {HALVES:.0%}): the noise decides; scan more, or with less noise",
        ),
    ]
    if math.isfinite(wall_m):
        checks += [
            at_most(
                "noise against wall",
                residual_m / wall_m,
                NOISE_OVER_WALL,
                f"noise {mm(residual_m)} is left in the surface against a wall of {mm(wall_m)}: limit {NOISE_OVER_WALL} x wall; scan more, or with "
                "less noise, or fit the member",
            ),
            at_most(
                "spacing against wall",
                pixel_m / wall_m,
                PIXEL_OVER_WALL,
                f"pixels {mm(pixel_m)} apart against a wall of {mm(wall_m)}: limit {PIXEL_OVER_WALL} x wall; scan more densely, or fit the member",
            ),
        ]
    return tuple(checks)


def own_image(bias: float) -> Check:
    """bias : relative change of the volume where a simulated scan of the surface is reconstructed in the same way."""
    says = f"a scan of this surface with this noise would come out {bias:+.1%} in volume (limit {OWN_IMAGE:.0%}): scan more, or with less noise"
    return at_most("own image", abs(bias), OWN_IMAGE, says)


def _passing(fit: Fit, images: Images, pixel_m: float) -> Check:
    """Rays that came back from nowhere but cross the inside deeper than at a rim."""
    rays = np.flatnonzero(~images.is_hit & (fit.face >= 0))
    share = 0.0
    if len(rays):
        scene = scene_of(fit.mesh)
        enter, _ = first_hits(scene, images.origin[rays], images.direction[rays])
        inside = images.origin[rays] + (enter + 1e-3 * pixel_m)[:, None] * images.direction[rays]
        leave, _ = first_hits(scene, inside, images.direction[rays])
        middle = images.origin[rays] + (enter + 0.5 * np.where(np.isfinite(leave), leave, 0.0))[:, None] * images.direction[rays]
        share = float((PointToMesh(fit.mesh).nearest(middle).distance > RIM_PIXELS * pixel_m).sum() / max(1, images.is_hit.sum()))
    says = (
        f"rays that found nothing pass through the inside, as many as {share:.1%} of those that came back (limit {PASSED:.0%}): too much was filled"
    )
    return at_most("empty rays stopped", share, PASSED, says)


def closed_holes(fit: Fit, images: Images) -> Check:
    """Holes of the part that the surface closes: pixels side by side that nothing came back from, where no ray passes it, nor one pixel beside.

    Too few rays to count as `_passing` tell of a hole that was lost whole; one drawn too narrow or beside its place lets some by.
    """
    seen, image = np.unique(images.image, return_inverse=True)
    place = images.pixel - images.pixel.min(axis=0)
    at = (image, place[:, 0], place[:, 1])
    empty, passed = np.zeros((2, len(seen), *(place.max(axis=0) + 1)), bool)
    empty[at], passed[at] = ~images.is_hit, fit.face < 0
    island, n = label(empty, BESIDE)
    open_ones = np.unique(island[binary_dilation(passed, AROUND) & empty])
    lost = np.setdiff1d(np.flatnonzero(np.bincount(island.ravel(), minlength=n + 1) >= HOLE_PIXELS), [0, *open_ones])
    rays = np.flatnonzero(np.isin(island[at], lost) & ~images.is_hit)
    way, _ = first_hits(scene_of(fit.mesh), images.origin[rays], images.direction[rays])
    where = images.origin[rays] + way[:, None] * images.direction[rays]
    says = f"{len(lost)} holes are closed that rays without a return pass (limit 0){around(where)}: scan nearer, or from more sides"
    return at_most("holes closed", float(len(lost)), 0.0, says)


def _lost(fit: Fit, images: Images, unmet: BoolArray, sigma_m: float, pixel_m: float) -> int:
    """How many of the rays pass the surface by more than a pixel wherever their range, within its noise, puts them."""
    rays = np.flatnonzero(unmet)
    if not len(rays):
        return 0
    places = np.linspace(-FAR_SIGMAS, FAR_SIGMAS, PLACES) * sigma_m
    along = images.origin[rays, None] + (images.range_m[rays, None] + places)[..., None] * images.direction[rays, None]
    near = PointToMesh(fit.mesh).nearest(along.reshape(-1, 3)).distance.reshape(-1, PLACES).min(axis=1)
    return int((near > pixel_m).sum())
