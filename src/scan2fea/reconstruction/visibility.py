"""A closed surface from points, by what their sensors saw empty; or, where sensors are not known, by what can be reached from outside.

Side-aware denoising, Delaunay tets, a minimum cut between votes for inside and outside, and a relabelling that makes the result manifold:
closed and free of self-intersections by construction, for every input (reference/reconstruction.md, method "ab").
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.delaunay import Tetrahedralisation
from scan2fea.kernel.measures import volume
from scan2fea.kernel.noise import spacing
from scan2fea.kernel.topology import surface_topology
from scan2fea.options import option
from scan2fea.reconstruction.bores import Bore
from scan2fea.reconstruction.budget import WALL_ENDS
from scan2fea.reconstruction.carve import Carved, carve
from scan2fea.reconstruction.denoise import denoise, first_normals
from scan2fea.reconstruction.evidence import Ends, at_most
from scan2fea.reconstruction.gates import Evidence, failed, gates_seen
from scan2fea.reconstruction.hidden import hidden_points
from scan2fea.reconstruction.lost_bores import WHOLE, Told, closed_bores, facing_axis, in_bores
from scan2fea.reconstruction.opposite import with_opposite
from scan2fea.reconstruction.outside import OutsideOptions
from scan2fea.reconstruction.ranges import by_ranges, on_surface, ray_sigma
from scan2fea.reconstruction.raster import Images, images_of
from scan2fea.reconstruction.sensors import REJECTED, blocked_share, outer_side
from scan2fea.reconstruction.turned import with_turned
from scan2fea.reconstruction.unseen import FLOOD_SOURCE, unseen
from scan2fea.reconstruction.unseen_rims import UNSEEN_RIMS
from scan2fea.reconstruction.wall_ends import unseen_ends
from scan2fea.types import Check, FloatArray, IntArray, PointCloud, Scan, TriangleMesh, Value

LEAST_POINTS = 20
KNOWN_SHARE = 0.5  # of the measured points must have a sensor for the sensors to lead
ROUND_AN_AXIS = "round an axis"
UNSEEN_PLACES = {ROUND_AN_AXIS: with_turned, "to the other face of walls": with_opposite}
IN_ORDER = 0.9  # share of the points that come after the one before in the file: another order may have rows too, and tells no camera
DARK_HOLES = "holes that nobody saw"
SCANS_APART = "scans_apart_m"
SAME_VOLUME = 0.01  # two answers that agree so well are one: what the sensors say against it stands


@dataclass(frozen=True, kw_only=True)
class VisibilityOptions:
    quality_weight: float = option(
        0.3, "price of badly shaped facets against one sight line; smoother and less faithful when larger", minimum=0.0, maximum=10.0
    )
    use_sensors: bool = option(True, "use the sensor positions where they are known and stand the test")
    ball: tuple[float, ...] = option((1.4, 1.15, 2.0), "first radii of the rolling ball tried without sensors, in spacings, best first")
    seed: int = option(0, "seed of the jitter of the triangulation and of the draws of the tests", minimum=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Reconstruction(Value):
    """The surface of the solid under the points, and how far to trust it.

    mesh : closed, manifold, outward.   points, normals : (n, 3) the denoised cloud and its outward normals.   thickness_m : (n,) of the wall at
    each point, nan where no other face is near.   spacing_m, sigma_m : of the raw points.   source : what told outside from inside.
    sensor : what became of the sensor positions.   checks : the gates; a surface that fails one must not be shipped.   how : for the report.
    residual_m : noise left in the surface, where it is known to be less than that of the points; else None.   carried : (k, 3) points that were put
    on hidden faces of walls, whose thickness is known round about, or round the axis of a body of revolution.   ends : of walls without points, where
    a gate refuses the surface for them.   told : what the points tell besides by their normals, where that was asked.
    """

    mesh: TriangleMesh
    points: FloatArray
    normals: FloatArray
    thickness_m: FloatArray
    spacing_m: float
    sigma_m: float
    source: str
    sensor: str
    checks: tuple[Check, ...]
    how: Mapping[str, float | str]
    residual_m: float | None = None
    carried: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    ends: tuple[Ends, ...] = ()
    told: Told | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class First(Value):
    """A surface that nothing was mended of yet.   evidence : what it was judged on; None where there is no other way to look at the points."""

    surface: Reconstruction
    evidence: Evidence | None = None


class ToldSides(NamedTuple):
    """normals, sigma_m, between_m : as `FirstNormals`.   blocked : share of the sight lines that pass through nearer points."""

    normals: FloatArray
    sigma_m: float
    between_m: float
    blocked: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Sides(Value):
    """normals : (n, 3) outward, of the denoised points.   spacing_m, sigma_m : of the raw points."""

    normals: FloatArray
    spacing_m: float
    sigma_m: float


def visibility(scan: Scan, options: VisibilityOptions = VisibilityOptions()) -> Reconstruction:
    """The closed surface of one object.

    Raises ReconstructionError for fewer than LEAST_POINTS points, points that all coincide, or if nothing is inside.
    """
    return looked_again(scan, options, first_surface(scan, options))


def first_surface(scan: Scan, options: VisibilityOptions = VisibilityOptions()) -> First:
    """The surface by the sensors, or without those that are not known or do not stand the test. Raises ReconstructionError as `visibility`."""
    cloud = scan.cloud
    h = _spacing_of(scan, options)
    images = told_images(scan, options)
    if images is not None:
        return First(surface=_ranged(scan, options, images, h))
    sensors = scan.sensors()
    if not _sensors_lead(cloud, sensors, options):
        return First(surface=_unseen(scan, options, "unknown", {}))
    found = _seen(cloud, options, sensors, h)
    return First(surface=_unseen(scan, options, "rejected", {})) if found is None else First(surface=found[0], evidence=found[1])


def sides(scan: Scan, options: VisibilityOptions = VisibilityOptions()) -> Sides:
    """The outward normals of the denoised points; of their surface, where no sensors tell them. Raises ReconstructionError as `visibility`."""
    cloud, sensors = scan.cloud, scan.sensors()
    h = _spacing_of(scan, options)
    if _sensors_lead(cloud, sensors, options):
        told = _told_sides(cloud, options, sensors, h)
        if told is not None:
            clean = denoise(cloud.points, told.normals, h, told.sigma_m, told.between_m)
            return Sides(normals=clean.normals, spacing_m=h, sigma_m=told.sigma_m)
    found = visibility(scan, options)
    return Sides(normals=found.normals, spacing_m=found.spacing_m, sigma_m=found.sigma_m)


def looked_again(scan: Scan, options: VisibilityOptions, first: First) -> Reconstruction:
    """The surface by the sensors; where it is refused, with what follows from what was seen, or without the sensors if fewer checks refuse that."""
    cloud, evidence = scan.cloud, first.evidence
    if evidence is None or not failed(first.surface.checks):
        return first.surface
    h = evidence.spacing_m
    seen = _with_unseen(cloud, options, scan.sensors(), h, first.surface, evidence)
    if not failed(seen.checks):
        return seen
    try:  # sensors that stand the test can still be too few: one look along a beam grazes all its faces
        why: dict[str, float | str] = {"with_sensors": "; ".join(check.name for check in failed(seen.checks))}
        hidden = hidden_points(seen.mesh, cloud.points, h, options.seed)
        blind = _unseen(scan, options, "rejected", why, hidden, seen.ends)
    except ReconstructionError:
        return seen
    fewer = len(failed(blind.checks)) < len(failed(seen.checks))
    is_same = abs(volume(blind.mesh) - volume(seen.mesh)) <= SAME_VOLUME * abs(volume(seen.mesh))
    return blind if fewer and not is_same else seen  # planes may mend what is left


def _spacing_of(scan: Scan, options: VisibilityOptions) -> float:
    """Spacing of points that a surface can be found through, m. Raises ReconstructionError."""
    cloud = scan.cloud
    require(
        len(cloud) >= LEAST_POINTS,
        ReconstructionError,
        f"{len(cloud)} points are too few for a surface (limit {LEAST_POINTS}): select a larger object or scan more densely",
    )
    require(np.isfinite(cloud.points).all(), ReconstructionError, "some points are not finite: remove them before the reconstruction")
    h = spacing(cloud.points, options.seed)
    require(h > 0, ReconstructionError, "all points coincide: there is no surface to find")
    return h


def _sensors_lead(cloud: PointCloud, sensors: FloatArray, options: VisibilityOptions) -> bool:
    """Are the sensors of enough of the measured points known?"""
    measured = np.flatnonzero(np.ones(len(cloud), bool) if cloud.is_inferred is None else ~cloud.is_inferred)
    return options.use_sensors and bool(np.isfinite(sensors[measured]).all(axis=1).mean() >= KNOWN_SHARE)


def opened(scan: Scan, options: VisibilityOptions, first: First, bores: Sequence[Bore]) -> First:
    """The surface by the sensors again where it closes bores whose walls were scanned; as it is where they stay closed or more checks fail."""
    evidence = first.evidence
    if evidence is None or closed_bores(bores, first.surface.mesh).passed:
        return first
    try:
        found = _seen(scan.cloud, options, scan.sensors(), evidence.spacing_m, bores=bores)
    except ReconstructionError:  # the first surface is one, and is told to close them
        return first
    if found is None or not closed_bores(bores, found[0].mesh).passed or len(failed(found[0].checks)) > len(failed(first.surface.checks)):
        return first
    return First(surface=found[0], evidence=found[1])


def told_images(scan: Scan, options: VisibilityOptions) -> Images | None:
    """The images that the order of the points tells, where no sensor positions are known."""
    if not options.use_sensors or scan.rays is not None or scan.cloud.is_inferred is not None:
        return None
    if np.count_nonzero(np.diff(scan.cloud.raw_index) > 0) < IN_ORDER * (len(scan.cloud) - 1):
        return None
    return images_of(scan.cloud.points, scan.cloud.raw_index)


def frames_of(cloud: PointCloud) -> IntArray:
    """(n,) the scan that measured each point, -1 for those that none did."""
    return cloud.frame if cloud.is_inferred is None else np.where(cloud.is_inferred, -1, cloud.frame)


def scans_apart(between_m: float) -> dict[str, float]:
    """For the report: standard deviation of the difference of two points of different scans on one face. between_m : of each scan's place."""
    return {SCANS_APART: math.sqrt(2.0) * between_m} if between_m > 0.0 else {}


def _seen(
    cloud: PointCloud,
    options: VisibilityOptions,
    sensors: FloatArray,
    spacing_m: float,
    ends: tuple[Ends, ...] = (),
    bores: Sequence[Bore] = (),
) -> tuple[Reconstruction, Evidence] | None:
    """The surface by the sensors, and what it was judged on; None where they do not stand the test.

    ends : of walls, on which nothing was measured, that a surface before it had.   bores : that are open.
    """
    told = _told_sides(cloud, options, sensors, spacing_m)
    if told is None:
        return None
    normals, sigma, between, blocked = told
    for bore in bores:
        normals = facing_axis(bore, cloud.points, normals, spacing_m, sigma)
    carved = carve(
        cloud.points, normals, sensors, spacing_m, sigma, between_m=between, quality_weight=options.quality_weight, seed=options.seed,
        prior=partial(_in_bores, bores) if bores else None, kept=partial(in_bores, bores, share=WHOLE) if bores else None,
    )  # fmt: skip
    evidence = Evidence(
        points=cloud.points,
        mesh=carved.mesh,
        smoothed=carved.clean.points,
        normals=carved.clean.normals,
        thickness_m=carved.thickness_m,
        gap_m=carved.gap_m,
        spacing_m=spacing_m,
        sigma_m=sigma,
        is_inferred=cloud.is_inferred,
        sensors=sensors,
        ends_before=ends,
        frame=frames_of(cloud),
        between_m=between,
    )
    checks = (*gates_seen(evidence, carved.labels.held), *dark_holes(carved.resolved.n_dark))
    found = _result(carved, spacing_m, sigma, "sensors", "known", checks, {"rays_blocked": blocked, **scans_apart(between)})
    return replace(found, ends=_ends(checks, evidence)), evidence


def _told_sides(cloud: PointCloud, options: VisibilityOptions, sensors: FloatArray, spacing_m: float) -> ToldSides | None:
    """What the sensors tell of the points; None where they do not stand the test."""
    told = first_normals(cloud.points, outer_side(cloud.points, sensors, cloud.normals), spacing_m, frames_of(cloud))
    blocked = blocked_share(cloud.points, told.normals, sensors, spacing_m, told.sigma_m, options.seed)
    return None if blocked > REJECTED else ToldSides(*told, blocked)


def _in_bores(bores: Sequence[Bore], tetra: Tetrahedralisation) -> FloatArray:
    """(m,) votes for outside."""
    return np.where(in_bores(bores, tetra), FLOOD_SOURCE, 0.0)


def _with_unseen(
    cloud: PointCloud, options: VisibilityOptions, sensors: FloatArray, spacing_m: float, first: Reconstruction, evidence: Evidence
) -> Reconstruction:
    """The surface again with what follows from what was seen: gaps of a body of revolution, hidden faces of walls. That which fails fewest checks.

    A ring of which too little was measured may still have the other face of its wall: so faces of walls are looked for with the rings first.
    """
    best, n, begun = first, len(cloud), [("", cloud, first, evidence)]
    for name, put in UNSEEN_PLACES.items():
        for before, given, surface, told in begun[::-1]:
            more = put(given, told) if failed(best.checks) else None
            if more is None:
                continue
            k = len(more) - n
            ends = () if name == ROUND_AN_AXIS else surface.ends  # a rim is put where sight lines prove it; a face opposite tells no end of its wall
            try:
                found = _seen(more, options, np.concatenate([sensors, np.full((k, 3), np.nan)]), spacing_m, ends)
            except ReconstructionError:  # the first surface is one, and says what is against it
                continue
            if found is None:
                continue
            if name != ROUND_AN_AXIS:
                found = replace(found[0], checks=(*found[0].checks, *opened_holes(surface.mesh, found[0].mesh))), found[1]
            names = ", ".join(filter(None, (before, name)))
            begun.append((names, more, *found))
            if len(failed(found[0].checks)) < len(failed(best.checks)):
                best = _first_rows(replace(found[0], carried=more.points[n:], how={**found[0].how, "n_carried": k, "carried": names}), n)
    return best


def _ends(checks: tuple[Check, ...], evidence: Evidence) -> tuple[Ends, ...]:
    """Ends of walls without points, of this surface and of those before it, where it was refused for them."""
    return (unseen_ends(evidence), *evidence.ends_before) if WALL_ENDS in (check.name for check in failed(checks)) else ()


def _unseen(
    scan: Scan,
    options: VisibilityOptions,
    sensor: str,
    how: Mapping[str, float | str],
    hidden: FloatArray | None = None,
    ends: tuple[Ends, ...] = (),
) -> Reconstruction:
    """The surface by what can be reached from outside.

    hidden : (k, 3) places that no ray reached, which must not be taken for open.   ends : of walls, on which nothing was measured.
    """
    cloud, outside = scan.cloud, OutsideOptions(ball=options.ball, seed=options.seed)
    points, inferred = cloud.points, cloud.is_inferred
    if hidden is not None and len(hidden):
        inferred = np.append(np.zeros(len(points), bool) if inferred is None else inferred, np.ones(len(hidden), bool))
        points = np.concatenate([points, hidden])
        how = {**how, "n_hidden": len(hidden)}
    lines = None
    if hidden is not None:  # the sensors stood the test
        lines = np.full_like(points, np.nan)
        lines[: len(cloud)] = scan.sensors()
    frame = np.append(frames_of(cloud), np.full(len(points) - len(cloud), -1))
    normals = None
    if cloud.normals is not None:
        normals = np.concatenate([cloud.normals, np.zeros((len(points) - len(cloud), 3))])
    answer = unseen(points, inferred, outside, options.quality_weight, len(points) - len(cloud), lines, ends, frame, normals)
    flood, facts = answer.flood, {**how, "n_answers": answer.n_tried}
    if flood is not None:
        facts.update({"ball_m": flood.ball_m, "leak_share": flood.leak_share, "n_cavities": flood.n_cavities})
    facts.update(scans_apart(answer.evidence.between_m))
    checks = (*answer.checks, *dark_holes(answer.carved.resolved.n_dark))
    found = _result(answer.carved, spacing(cloud.points, options.seed), answer.evidence.sigma_m, answer.source, sensor, checks, facts)
    told = answer.told if len(points) == len(cloud) else None
    return _first_rows(replace(found, ends=_ends(answer.checks, answer.evidence), told=told), len(cloud))


def _first_rows(found: Reconstruction, n: int) -> Reconstruction:
    """The rows of the cloud that was given, without those of points that were put beside it."""
    return replace(found, points=found.points[:n], normals=found.normals[:n], thickness_m=found.thickness_m[:n])


def _ranged(scan: Scan, options: VisibilityOptions, images: Images, spacing_m: float) -> Reconstruction:
    """The surface by the rays of images that the order of the points has told."""
    points = scan.cloud.points
    found = by_ranges(points, images, ray_sigma(images), options.seed)
    place, normals, thickness = on_surface(points, images, found)
    known = thickness[np.isfinite(thickness)]
    facts: dict[str, float | str] = {
        "method": "visibility",
        "source": "images found in the order of the points",
        "n_images": images.n_images,
        "n_empty_rays": int((~images.is_hit).sum()),
        "spacing_m": spacing_m,
        "sigma_m": found.sigma_m,
        "residual_m": found.residual_m,
        "cell_m": found.cell_m,
        "wall_m": float(np.median(known)) if len(known) else float("nan"),
        "wall_share": len(known) / len(thickness),
        "volume_spread": found.volume_spread,
        "n_answers": found.n_tried,
    }
    return Reconstruction(
        mesh=found.fit.mesh,
        points=place,
        normals=normals,
        thickness_m=thickness,
        spacing_m=spacing_m,
        sigma_m=found.sigma_m,
        source="ranges",
        sensor="known",
        checks=found.checks,
        how=facts,
        residual_m=found.residual_m,
    )


def one_part(n_parts: int) -> Check:
    """One object is one piece."""
    says = f"the points enclose {n_parts} separate parts: segment them into objects of their own, or scan what joins them"
    return Check(name="parts", value=float(n_parts), limit=1.0, unit="1", passed=n_parts == 1, says=says)


def opened_holes(before: TriangleMesh, mesh: TriangleMesh) -> tuple[Check, ...]:
    """Faces of walls put where nobody saw them close a surface, and open no hole that it did not have (a lip seen by few rays: 3, and passed)."""
    n = surface_topology(mesh).n_handles - surface_topology(before).n_handles
    says = f"{n} holes go through walls one face of which was inferred: holes, or not scanned; scan the other face too"
    return (at_most(UNSEEN_RIMS, float(n), 0.0, says),) if n > 0 else ()


def dark_holes(n_dark: int) -> tuple[Check, ...]:
    """Each hole was seen through, or has a wall of its own."""
    says = f"{n_dark} holes go through walls where no sight line passed and hardly a point lies: holes, or not scanned; scan there too"
    return (Check(name=DARK_HOLES, value=float(n_dark), limit=0.0, unit="1", passed=False, says=says),) if n_dark else ()


def _result(
    carved: Carved, spacing_m: float, sigma_m: float, source: str, sensor: str, checks: tuple[Check, ...], how: Mapping[str, float | str]
) -> Reconstruction:
    resolved = carved.resolved
    one = one_part(resolved.n_parts)
    known = carved.thickness_m[np.isfinite(carved.thickness_m)]
    facts: dict[str, float | str] = {
        "method": "visibility",
        "source": source,
        "spacing_m": spacing_m,
        "sigma_m": sigma_m,
        "fit_radius_m": carved.clean.radius_m,
        "wall_m": float(np.median(known)) if len(known) else float("nan"),
        "wall_share": len(known) / len(carved.thickness_m),
        "quality_weight": carved.labels.quality_weight,
        "votes_held": carved.labels.held,
        "n_tets": len(carved.tetra),
        "n_singular": resolved.n_singular,
        "n_rounds": resolved.n_rounds,
        "n_parts_dropped": resolved.n_dropped,
        "n_voids_filled": resolved.n_filled,
        **how,
    }
    return Reconstruction(
        mesh=carved.mesh,
        points=carved.clean.points,
        normals=carved.clean.normals,
        thickness_m=carved.thickness_m,
        spacing_m=spacing_m,
        sigma_m=sigma_m,
        source=source,
        sensor=sensor,
        checks=(*checks, one),
        how=facts,
    )
