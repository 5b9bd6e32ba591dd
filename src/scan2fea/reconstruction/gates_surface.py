"""Checks of a surface against its own points: can the data carry it, and does it follow them."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import bdtrc

from scan2fea.kernel.coverage import largest_left_out, unmeasured_share
from scan2fea.kernel.distances import signed_distance
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.kernel.neighbors import k_nearest
from scan2fea.kernel.topology import edge_table, half_edges
from scan2fea.reconstruction.budget import EDGES_CUT, EDGES_GROWN, MIXED, SCANS
from scan2fea.reconstruction.evidence import PATCH, SAME_FACE, SAMPLES, Evidence, around, at_least, at_most, mm, patch_wall_m, wall_m
from scan2fea.reconstruction.outside import Flood
from scan2fea.types import BoolArray, Check, FloatArray, TriangleMesh

NOISE_OVER_WALL = 0.35  # above, the two faces of a wall mix: volume and thickness go wrong
NOISE_UNSIDED = 0.2  # the same where no sensor says on which face a point lies: then points between the faces no longer tell where a wall ends
SPACING_OVER_WALL = 1.1
SHEET, LEAST_THICK = "thickness of a sheet", 0.1  # spacings: walls below 1 / SPACING_OVER_WALL are refused in any case
SCANS_OPEN = 0.02  # of the volume that the places of the scans leave open, one standard deviation, as of planes
RIM_NOISE = 0.05  # of the volume that noise adds at rims, foretold: a simulated scan foretold 7.6 % was 8.9 % off
RIM_SPACING = 0.05  # of the volume that the spacing cuts off at rims
RIM_LOSS = 0.28  # h^2 per unit of mean curvature: what a surface through random points cuts off a square edge (0.22 h^2 per length)
REACH_SPACINGS, REACH_SIGMAS = 3.0, 3.0  # a place with no measured point of its own side nearer than this is not measured
INFERRED = 0.55  # of the area: the hidden face of a plate that lies on a table is a little less than half
MIXED_SHARE = 0.05  # of the volume that such points may take from walls
STRAY = 0.01
LEFT_OUT, SIDE_BY_SIDE, MOST_LEFT_OUT = "points left out side by side", 2.0, 11  # spacings between neighbours; a plane needs a dozen
AFLOAT, AFLOAT_SIGMAS = 0.5, 3.0  # spacings, and of the noise: a point farther off the surface is none of its own
AFLOAT_CHANCE = 0.0025  # that so many of those are inside
UNDER_FACES, UNDER_CHANCE = "points under faces", 1e-3
OWN, OWN_REACH = 3, 1.5  # three points within 1.5 spacings, where six are due
MERGED, MERGED_KURTOSIS = 0.02, 1.6  # two sheets in one: residuals of two values have kurtosis 1, a normal distribution 3
CORE_KURTOSIS = 2.3  # two sheets +-t/2 with noise 0.3 t: 1.9; one sheet: 2.8 over 32 points


def sheet(evidence: Evidence) -> tuple[Check, ...]:
    """Do the points enclose a solid? Told only of a surface thinner than any wall that this spacing can tell: 2 V / A of a sheet is nothing."""
    thick = 2.0 * abs(volume(evidence.mesh)) / float(face_areas(evidence.mesh).sum())
    says = (
        f"the points lie on one open sheet and enclose no solid ({mm(thick)} thick, points {mm(evidence.spacing_m)} apart): its other side was not "
        "seen; scan it too, or fit the member"
    )
    check = at_least(SHEET, thick / evidence.spacing_m, LEAST_THICK, says)
    return () if check.passed else (check,)


def resolution(evidence: Evidence) -> tuple[Check, ...]:
    """Noise and spacing against the wall; none where there is no wall to speak of."""
    wall = patch_wall_m(evidence)
    if not math.isfinite(wall):
        return ()
    noise, spacing = evidence.sigma_m, evidence.spacing_m
    limit, instead = (NOISE_UNSIDED, "give the sensor position, scan") if evidence.sensors is None else (NOISE_OVER_WALL, "scan")
    return (
        at_most(
            "noise against wall",
            noise / wall,
            limit,
            f"noise {mm(noise)} against a wall of {mm(wall)}: limit {limit} x wall; {instead} with less noise, or fit the member",
        ),
        at_most(
            "spacing against wall",
            spacing / wall,
            SPACING_OVER_WALL,
            f"points {mm(spacing)} apart against a wall of {mm(wall)}: limit {SPACING_OVER_WALL} x wall; scan more densely, or fit the member",
        ),
    )


def mixed(evidence: Evidence) -> tuple[Check, ...]:
    """Volume that may be lost where no sensor says on which face of a wall a point lies, and noise carries points past its middle.

    Of normal noise sigma about a face, the part beyond t/2 takes sigma phi(t / (2 sigma)) from the mean depth of its points if it is given to
    the other face; a wall has two.
    """
    wall = wall_m(evidence)
    if not math.isfinite(wall) or evidence.sigma_m <= 0.0:
        return ()
    noise = evidence.sigma_m / wall
    share = 2.0 * noise * math.exp(-0.125 / noise**2) / math.sqrt(2.0 * math.pi)
    says = (
        f"noise {mm(evidence.sigma_m)} carries points past the middle of a wall of {mm(wall)}: {share:.1%} of the volume is open "
        f"(limit {MIXED_SHARE:.0%}); give the sensor position, scan with less noise, or fit the member"
    )
    return (at_most(MIXED, share, MIXED_SHARE, says),)


def scans(evidence: Evidence) -> tuple[Check, ...]:
    """Volume that the places of the scans leave open: all points of one move together, so no number of them averages that away.

    Each scan moves its part of the area, shared with the others that saw it, by `between_m`: as far as it saw all of it from one side.
    """
    body = abs(volume(evidence.mesh))
    if evidence.frame is None or evidence.between_m <= 0.0 or body <= 0.0:
        return ()
    own = evidence.frame >= 0
    face, frame = evidence.nearest.face[own], evidence.frame[own]
    share = face_areas(evidence.mesh)[face] / np.bincount(face, minlength=len(evidence.mesh.faces))[face]
    std = evidence.between_m * float(np.linalg.norm(np.bincount(frame, share)))
    apart = math.sqrt(2.0) * evidence.between_m
    open_share = std / body
    says = f"scans lie {mm(apart)} off each other: {open_share:.1%} of the volume is open (limit {SCANS_OPEN:.0%}); register them better"
    return (at_most(SCANS, open_share, SCANS_OPEN, says),)


def rims(evidence: Evidence) -> tuple[Check, ...]:
    """Volume that noise adds and spacing cuts off at the edges, foretold from the total mean curvature M of the surface.

    A plate of thickness t and perimeter P has M = pi P / 2 however its rim is rounded. Noise carries the rim out by up to sigma: sigma t P;
    a surface through points h apart cuts a square edge by 0.22 h^2 of cross-section.
    """
    body = abs(volume(evidence.mesh))
    if body <= 0.0:
        return ()
    curvature = max(0.0, mean_curvature(evidence.mesh))
    wall = wall_m(evidence)
    lost = RIM_LOSS * evidence.spacing_m**2 * curvature / body
    cut = at_most(
        EDGES_CUT,
        lost,
        RIM_SPACING,
        f"points {mm(evidence.spacing_m)} apart cut about {min(lost, 1.0):.1%} of the volume off its edges (limit {RIM_SPACING:.0%}): "
        "scan more densely",
    )
    if not math.isfinite(wall):
        return (cut,)
    grown = 2.0 / math.pi * curvature * wall * evidence.sigma_m / body
    noise = at_most(
        EDGES_GROWN,
        grown,
        RIM_NOISE,
        f"noise {mm(evidence.sigma_m)} may add {grown:.0%} to the volume at edges and holes (limit {RIM_NOISE:.0%}): scan with less noise, "
        "or fit the member",
    )
    return cut, noise


def mean_curvature(mesh: TriangleMesh, without: BoolArray | None = None) -> float:
    """Half the sum of edge length x turning angle, convex edges positive, m: the integral of the mean curvature (Steiner 1840).

    without : (v,) vertices; edges between two of them are left out.
    """
    twin, ends = edge_table(mesh.faces).twin, half_edges(mesh.faces)
    chosen = twin > np.arange(len(twin))
    one = np.flatnonzero(chosen if without is None else chosen & ~without[ends].all(axis=1))
    normals = face_normals(mesh)
    a, b = normals[one // 3], normals[twin[one] // 3]
    edge = mesh.vertices[ends[one, 1]] - mesh.vertices[ends[one, 0]]
    length = np.linalg.norm(edge, axis=1)
    sine = np.einsum("ij,ij->i", np.cross(a, b), edge) / np.maximum(length, np.finfo(float).tiny)
    return float(0.5 * (length * np.arctan2(sine, np.einsum("ij,ij->i", a, b))).sum())


def coverage(evidence: Evidence, limit: float, sigma_m: float) -> tuple[Check, ...]:
    """Area that neither measured nor inferred points back, and area that inferred ones alone do."""
    reach = REACH_SPACINGS * evidence.spacing_m + REACH_SIGMAS * sigma_m
    bare = unmeasured_share(evidence.mesh, evidence.points, reach, evidence.nearest.face)
    check = at_most(
        "unmeasured area",
        bare,
        limit,
        f"{bare:.0%} of the surface has no measured point of its side within {mm(reach)} (limit {limit:.0%}): a side was not seen; "
        "scan it too, or fit the member",
    )
    if evidence.is_inferred is None or not evidence.is_inferred.any():
        return (check,)
    inferred = max(0.0, unmeasured_share(evidence.mesh, evidence.measured, reach, evidence.nearest_measured.face) - bare)
    says = f"{inferred:.0%} of the surface rests on inferred points alone (limit {INFERRED:.0%}): lift the part and scan the hidden side"
    return check, at_most("inferred area", inferred, INFERRED, says)


def deviation(distance: FloatArray, limit: float) -> Check:
    """95 % of the points lie within `limit` of the surface."""
    value = float(np.percentile(distance, 95)) if len(distance) else math.inf
    says = f"5 % of the points lie farther than {mm(value)} from the surface, more than the noise explains ({mm(limit)}): parts are missing or merged"
    return at_most("deviation p95", value, limit, says, "m")


def stray(points: FloatArray, distance: FloatArray, far: float) -> Check:
    """Hardly any point lies beyond `far`."""
    beyond = distance > far
    share = float(np.mean(beyond))
    says = f"{share:.1%} of the points lie farther than {mm(far)} from the surface (limit {STRAY:.0%}){around(points[beyond])}: a part was lost, "
    return at_most("stray points", share, STRAY, says + "or the cloud holds points that are not the object's")


def left_out(points: FloatArray, distance: FloatArray, before: TriangleMesh, far: float, spacing_m: float) -> Check:
    """Has a solid left out a part of the surface that it came from? A share of all points does not tell a rib of a hundredth of them.

    points : (n, 3).   distance : (n,) from the solid.   before : that surface. Points farther from the one than from the other by `far` are counted
    where they lie side by side: strays do not, and lie on neither.
    """
    lost = largest_left_out(points, distance, before, far, SIDE_BY_SIDE * spacing_m)
    says = f"{len(lost)} points side by side lie on the surface that they enclose and off its flat faces{around(points[lost])}: a part was lost"
    return at_most(LEFT_OUT, float(len(lost)), float(MOST_LEFT_OUT), says)


def afloat(mesh: TriangleMesh, points: FloatArray, distance: FloatArray, spacing_m: float, sigma_m: float) -> Check:
    """Of the points (n, 3) far off the surface, are more inside than outside? Strays may lie on either side, what was seen of a hollow within only.

    The limit is the count that chance puts inside once in AFLOAT_CHANCE (binomial, a half): eight of nine.
    """
    off = points[distance > AFLOAT * spacing_m + AFLOAT_SIGMAS * sigma_m]
    inside = signed_distance(off, mesh) < 0 if len(off) else np.zeros(0, bool)
    n, most = int(inside.sum()), int(np.argmax(bdtrc(np.arange(len(off) + 1), len(off), 0.5) < AFLOAT_CHANCE))
    says = (
        f"{n} points lie inside the solid, far from its surface, and {len(off) - n} outside (limit {most} of {len(off)})"
        f"{around(off[inside])}: it may be hollow there, seen through an opening"
    )
    return at_most("points afloat inside", float(n), float(most), says)


def under_faces(mesh: TriangleMesh, points: FloatArray, held: BoolArray, closest: FloatArray, spacing_m: float) -> Check:
    """Of the points (n, 3) that lie on no face, are more under faces that were seen there than over them? Noise carries as many to either side.

    held : (n,) those that lie on their face.   closest : (n, 3) of the mesh. Over a dent, a rounded edge or a chamfer the face has no points of
    its own; what was seen through an opening elsewhere lies under one that has them all round, as near as a wall is thick.
    """
    own, off = points[held], np.flatnonzero(~held)
    if len(own) >= OWN and len(off):
        off = off[k_nearest(own, OWN, closest[off])[0][:, -1] <= OWN_REACH * spacing_m]
    inside = signed_distance(points[off], mesh) < 0 if len(off) else np.zeros(0, bool)
    n, most = int(inside.sum()), int(np.argmax(bdtrc(np.arange(len(off) + 1), len(off), 0.5) < UNDER_CHANCE))
    says = (
        f"{n} points lie inside the solid, under faces that were seen, and {len(off) - n} over them (limit {most} of {len(off)})"
        f"{around(points[off[inside]])}: it may be hollow there, seen through an opening"
    )
    return at_most(UNDER_FACES, float(n), float(most), says)


def patch_moments(points: FloatArray, normals: FloatArray, signed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Second and fourth central moments of the signed distances of patches of 32 neighbouring points of one side."""
    rows = np.linspace(0, len(points) - 1, min(len(points), SAMPLES)).astype(np.int64)
    if len(points) < PATCH:
        return np.zeros(0), np.zeros(0)
    near = k_nearest(points, PATCH, points[rows])[1]
    same = np.einsum("nc,nkc->nk", normals[rows], normals[near]) > SAME_FACE
    count = same.sum(axis=1)
    mean = np.where(same, signed[near], 0.0).sum(axis=1) / np.maximum(count, 1)
    centred = np.where(same, signed[near] - mean[:, None], 0.0)
    second = (centred**2).sum(axis=1) / np.maximum(count, 1)
    fourth = (centred**4).sum(axis=1) / np.maximum(count, 1)
    full = count >= PATCH // 2
    return second[full], fourth[full]


def merged(second: FloatArray, fourth: FloatArray, least: float) -> Check:
    """Patches whose distances have two values: two sheets that became one. `least`: spread below which nothing is said."""
    share = float(np.mean((second > least**2) & (fourth < MERGED_KURTOSIS * second**2))) if len(second) else 0.0
    says = f"at {share:.1%} of the points two sheets seem merged into one (limit {MERGED:.0%}): the wall is too thin for this noise; "
    return at_most("merged sheets", share, MERGED, says + "scan with less noise, or fit the member")


def solid_core(flood: Flood, second: FloatArray, fourth: FloatArray, least: float) -> tuple[Check, ...]:
    """A void taken as solid: what looks like noise on one sheet must not be the two sheets of a wall."""
    spread = second > least**2
    if not flood.core_solid or not spread.any():
        return ()
    kurtosis = float(np.mean(fourth[spread] / second[spread] ** 2))
    says = f"an enclosed void may be hollow: the points lie in two sheets rather than one (kurtosis {kurtosis:.2f}, at least {CORE_KURTOSIS}); "
    return (at_least("solid core", kurtosis, CORE_KURTOSIS, says + "scan with less noise, or fit the member"),)
