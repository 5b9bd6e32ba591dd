"""When a solid of flat and round faces must not be shipped: what its points, and the surface it was labelled by, say against it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import fdtrc

from scan2fea.kernel.coverage import unmeasured_share
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_areas, face_normals, volume
from scan2fea.kernel.primitives import Plane
from scan2fea.reconstruction.bare_ends import BARE_ENDS
from scan2fea.reconstruction.bare_faces import bare_faces
from scan2fea.reconstruction.budget import EDGES_CUT, EDGES_GROWN, HIDDEN_VOLUME, PLACE, VOLUME_IN_DOUBT, WALL_ENDS
from scan2fea.reconstruction.empty_places import discs_of, empty_places
from scan2fea.reconstruction.evidence import BY_FLOOD, BY_NORMALS, at_most, mm
from scan2fea.reconstruction.flat_gaps import flat_ends, half_seen_ends, hidden_volume_flat
from scan2fea.reconstruction.gates import failed, in_all
from scan2fea.reconstruction.gates_outside import CUT_HELD, GAPS_ENTERED, cut_agrees
from scan2fea.reconstruction.gates_round import one_region, out_of_round, rolled, round_distance
from scan2fea.reconstruction.gates_surface import afloat, deviation, left_out, mean_curvature, stray, under_faces
from scan2fea.reconstruction.inner_places import told_by_left_out
from scan2fea.reconstruction.lost_holes import lost_holes
from scan2fea.reconstruction.plane_growing import Planes, tolerance_m
from scan2fea.reconstruction.round_cuts import Shapes
from scan2fea.reconstruction.round_growing import CHORD
from scan2fea.reconstruction.rounds import on_rounds
from scan2fea.reconstruction.sight import Sight, blocked_lines
from scan2fea.reconstruction.unseen_rims import UNSEEN_RIMS
from scan2fea.reconstruction.visibility import DARK_HOLES, Reconstruction
from scan2fea.reconstruction.wall_ends import ends_left
from scan2fea.types import BoolArray, Check, FloatArray, IntArray, Scan, TriangleMesh

DIFFER = "solid and first surface"
UNEXPLAINED = 0.01  # of the points may lie on none of the flat faces
UNEXPLAINED_INSIDE = 0.002  # the same where gaps lead inside: of hollow bodies 0.3 % and more were seen through their mouths
EXCESS = 1.15  # scatter of the points about the faces against their noise
BENT = 0.01  # of the points may lie on faces that are bent
BEND_CHANCE, BEND_NOISE = 1e-6, 0.3  # a quadric bends by more than chance, and by more than this share of the noise
BEND_SPACING = 0.02
BEND_CHANCE_ONE = 1e-3  # of one face asked alone, where only an edge hangs on it
CURED = frozenset({
    BARE_ENDS, EDGES_GROWN, EDGES_CUT, VOLUME_IN_DOUBT, "deviation p95", "stray points", "unmeasured area", HIDDEN_VOLUME, DARK_HOLES, UNSEEN_RIMS,
    GAPS_ENTERED,
})  # fmt: skip
LEAST_POINTS, MANY = 10, 40  # of a face: to be tested whether it is bent, and to be tested alone
BESIDE_FLATS = "points beside flat faces"
UNCERTAIN = 0.02  # of the volume that the places of the planes leave open
APART = 0.03  # of the volume that the solid and the first surface differ by, besides what rims explain
UNMEASURED = 0.10
RIM_CUT = 0.3  # h^2 per length of edge that a surface through points cuts off


def gates_planar(scan: Scan, first: Reconstruction, mesh: TriangleMesh, every: Shapes, seen_through_m3: float | None = None) -> tuple[Check, ...]:
    """The checks of a solid of flat and round faces. first : the surface that told inside from outside.   every : what its face_region names.

    seen_through_m3 : where sight lines told it in its place, the volume of the solid that they pass through.
    """
    by_lines = seen_through_m3 is not None
    cloud = scan.cloud
    measured = cloud.points if cloud.is_inferred is None else cloud.points[~cloud.is_inferred]
    backed = np.concatenate([cloud.points, first.carried])
    h, sigma = first.spacing_m, first.sigma_m
    nearest = PointToMesh(mesh).nearest(measured)
    region = np.zeros(len(mesh.faces), np.int64) if mesh.face_region is None else mesh.face_region
    whole, unrolled, number = one_region(mesh, every), rolled(every), every.round_of[region // 2]
    of, face = number[nearest.face], nearest.face
    off = round_distance(measured, of, nearest.distance, every)
    reach = tolerance_m(h, sigma) + 0.03 * h + np.where(of >= 0, CHORD * h, 0.0)
    held = off <= reach
    flat, bowed = held & (of < 0), held & (of >= 0)
    share, far, unexplained = float(np.mean(~held)), 3.0 * sigma + 0.5 * h, UNEXPLAINED
    if GAPS_ENTERED in (check.name for check in first.checks):
        share, unexplained = share - _even_tails(mesh, measured, off / reach), UNEXPLAINED_INSIDE
    open_m3 = _open_m3(whole, every)
    known = first.thickness_m[np.isfinite(first.thickness_m)]
    wall = float(np.quantile(known, 0.25)) if len(known) else math.nan
    body, before = abs(volume(mesh)), abs(volume(first.mesh))
    cut, grown = _rims(mesh, h, sigma)
    larger = before / body - 1.0
    apart = max(0.0, larger - grown / body, -larger - cut / body) if seen_through_m3 is None else seen_through_m3 / body
    if apart > APART and not by_lines and first.source in (BY_FLOOD, BY_NORMALS) and larger < 0.0:
        off_first = PointToMesh(first.mesh).nearest(measured).distance
        own = off <= far
        apart = max(0.0, apart - told_by_left_out(measured[own], mesh, first.mesh, off_first[own], far) / body)
    walls, sight = discs_of(mesh, cloud.points), Sight.of(scan, first, lines=len(cloud)) if first.source == "sensors" else None
    flats = replace(mesh, faces=mesh.faces[number < 0], face_region=region[number < 0])
    checks = [
        at_most(
            BESIDE_FLATS, share, unexplained,
            f"{share:.1%} of the points lie on none of the faces (limit {unexplained:.1%}): the part has curved or missing ones",
        ),
        _scatter("scatter about flat faces", off[flat], EXCESS * sigma + BEND_SPACING * h, sigma),
        _bent(measured[flat], face[flat], region, every.planes, on_rounds(flats, measured[flat], h), sigma, h),
        *((
            _scatter("scatter about round faces", off[bowed], EXCESS * sigma + CHORD * h, sigma),
            out_of_round(measured[held], of[held], every, sigma, h),
        ) if len(every.rounds) else ()),
        at_most(
            PLACE, open_m3 / body, UNCERTAIN,
            f"the noise leaves {open_m3 / body:.1%} of the volume open (limit {UNCERTAIN:.0%}): scan more, or with less noise",
        ),
        at_most(
            DIFFER, apart, APART,
            f"sight lines pass through {apart:.1%} of the flat solid (limit {APART:.0%})" if by_lines else
            f"the flat solid and the surface it came from differ by {apart:.1%} of the volume more than edges explain (limit {APART:.0%})",
        ),
        *_inherited(first, mesh, by_lines),
        *((cut_agrees(_held(cloud.points, first.normals, mesh, far)),) if _lost_cut(first) else ()),
        deviation(off, 2.5 * sigma + 0.125 * h),
        stray(measured, off, far),
        left_out(measured, off, first.mesh, far, h),
        afloat(mesh, measured, off, h, sigma),
        *(() if first.source == "sensors" else (under_faces(mesh, measured, held, nearest.closest, h),)),
        hidden_volume_flat(whole, backed, h, unrolled, walls),
        *((
            flat_ends(whole, backed, h, unrolled, walls),
            half_seen_ends(whole, backed, sight, h, unrolled),
            blocked_lines(scan, mesh, h, sigma),
        ) if by_lines and sight is not None else ()),
        *(() if first.source == "sensors" else (lost_holes(first.mesh, mesh, measured, wall, h, sigma),)),  # sight lines tell holes themselves
        bare_faces(whole, cloud.points, scan.sensors(), h, sigma),
        *empty_places(mesh, cloud.points, sight, walls),
    ]  # fmt: skip
    bare = unmeasured_share(mesh, backed, 3.0 * h + 3.0 * sigma)
    checks.append(
        at_most("unmeasured area", bare, UNMEASURED, f"{bare:.0%} of the surface has no measured point of its side (limit {UNMEASURED:.0%})")
    )
    return in_all(*checks)


def _even_tails(mesh: TriangleMesh, points: FloatArray, off: FloatArray) -> float:
    """The share of the points that noise carries off their faces: up to twice as far as it is let, as many to one side as to the other.

    off : (n,) of what it is let. Along rays noise is no one normal distribution: widest on faces that are met squarely. What is seen of the inside
    of a hollow body lies on one side of its faces.
    """
    rows = np.flatnonzero((off > 1.0) & (off <= 2.0))
    inside = int(np.sum(PointToMesh(mesh).signed_distance(points[rows]) < 0.0)) if len(rows) else 0
    return 2.0 * min(inside, len(rows) - inside) / len(off)


def _scatter(name: str, off: FloatArray, limit: float, sigma_m: float) -> Check:
    """Do the points lie about their faces as their noise lets them?"""
    scatter = float(np.sqrt(np.mean(off**2))) if len(off) else 0.0
    says = f"points {name.replace('scatter', f'scatter {mm(scatter)}')} against a noise of {mm(sigma_m)}: faces are missing, or have another shape"
    return at_most(name, scatter, limit, says, "m")


def _inherited(first: Reconstruction, mesh: TriangleMesh, by_lines: bool) -> tuple[Check, ...]:
    """What was said of the first surface, but for what is measured again on the flat one, or cured: what noise and spacing do to edges.

    Ends of walls without points that it was refused for are ends where the flat solid has them too; it may go on across the gap. Where sensors are
    known cells labelled by sight lines come next, which are asked more: no cut told their inside, and that it lies under the points the lines say,
    which end on faces that they meet from outside. Without them what the cut lost under the points is asked of the flat solid.
    """
    again = bool(first.ends) and first.source != "sensors"
    cured = CURED | ({WALL_ENDS} if by_lines or again else set()) | ({CUT_HELD} if by_lines or _lost_cut(first) else set())
    left = tuple(check for check in first.checks if check.name not in cured)
    return (*left, ends_left(first.ends, mesh, first.spacing_m, first.sigma_m)) if again else left


def _lost_cut(first: Reconstruction) -> bool:
    """Did the first surface, made without sensors, lose the inside under points that the flat solid may hold?"""
    return first.source == "outside flood" and CUT_HELD in (check.name for check in failed(first.checks))


def _held(points: FloatArray, normals: FloatArray, mesh: TriangleMesh, far: float) -> float:
    """Share of the points that lie on the solid and have its inside under them. points, normals : (n, 3), these settled by the points alone."""
    nearest = PointToMesh(mesh).nearest(points)
    under = np.einsum("ij,ij->i", normals, face_normals(mesh)[nearest.face]) > 0.0
    return float(np.mean(under & (nearest.distance <= far)))


def _open_m3(whole: TriangleMesh, every: Shapes) -> float:
    """Volume that the noise leaves open, m^3: of each shape its area times what its place is known to, that of a cylinder its radius."""
    shape = np.zeros(len(whole.faces), np.int64) if whole.face_region is None else whole.face_region // 2
    std = np.append(every.planes.std_m[: every.n_flat], every.rounds.std_m)
    area = np.bincount(shape, face_areas(whole), minlength=len(std))
    return math.sqrt(float(((area * std) ** 2).sum()))


def _rims(mesh: TriangleMesh, spacing_m: float, sigma_m: float) -> tuple[float, float]:
    """Volume that a free surface loses, and gains, at the edges of a flat solid: 0.3 h^2, and a wall's noise, per length of edge."""
    curvature = max(0.0, mean_curvature(mesh))
    return RIM_CUT * spacing_m**2 * curvature, sigma_m * curvature * max(spacing_m, sigma_m)


def _bent(
    points: FloatArray, face: IntArray, region: IntArray, planes: Planes, rounds: BoolArray, sigma_m: float, spacing_m: float
) -> Check:
    """Points on faces whose residuals a quadric explains better than chance would: a barrel taken for flats.

    Faces of few points are tested together: five flats of a dozen points each round a bore bend all alike, none of them beyond chance.
    rounds : (n,) points on flats that one cylinder explains.
    """
    of = region[face]
    groups: dict[int, list[tuple[IntArray, float, float]]] = {}
    for number in np.unique(of):
        rows = np.flatnonzero(of == number)
        if len(rows) >= LEAST_POINTS:
            bend, left = _squares(points[rows], planes.plane(int(number) // 2))
            groups.setdefault(int(number) if len(rows) >= MANY else -1, []).append((rows, bend, left))
    bent: BoolArray = np.zeros(len(points), bool)
    for faces in groups.values():
        every = np.concatenate([rows for rows, _, _ in faces])
        bend, left = sum(b for _, b, _ in faces), sum(r for _, _, r in faces)
        terms, free = 3 * len(faces), len(every) - 6 * len(faces)
        ratio = bend / terms / max(left / free, 1e-300)
        swing = math.sqrt(bend / len(every))
        bent[every] = swing > BEND_NOISE * sigma_m + BEND_SPACING * spacing_m and float(fdtrc(terms, free, ratio)) < BEND_CHANCE
    share = float(np.mean(bent | rounds)) if len(bent) else 0.0
    return at_most("bent faces", share, BENT, f"{share:.1%} of the points lie on faces that are bent, not flat (limit {BENT:.0%})")


def is_flat(points: FloatArray, plane: Plane, sigma_m: float, spacing_m: float) -> bool:
    """Do the points (n, 3) of one plane bend no more than chance explains? Of fewer than LEAST_POINTS nothing is known: they may."""
    if len(points) < LEAST_POINTS:
        return False
    bend, left = _squares(points, plane)
    free = len(points) - 6
    swing = math.sqrt(bend / len(points))
    by_chance = float(fdtrc(3, free, bend / 3 / max(left / free, 1e-300))) >= BEND_CHANCE_ONE
    return by_chance or swing <= BEND_SPACING * spacing_m


def _squares(points: FloatArray, plane: Plane) -> tuple[float, float]:
    """Sums of squares of heights over a plane: what the three terms that bend of a quadric explain, and what it leaves."""
    across = points @ plane.axes().T
    x, y = ((across - across.mean(axis=0)) / np.maximum(across.std(axis=0), 1e-300)).T
    height = plane.distance(points)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    flat = basis[:, :3] @ np.linalg.lstsq(basis[:, :3], height, rcond=None)[0]
    curved = basis @ np.linalg.lstsq(basis, height, rcond=None)[0]
    return float(((curved - flat) ** 2).sum()), float(((height - curved) ** 2).sum())
