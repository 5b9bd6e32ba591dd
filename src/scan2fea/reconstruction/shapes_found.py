"""Which planes and cylinders the points of a part lie on: cylinders by their normals and by the holes of flat walls, planes among the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from scan2fea.errors import ReconstructionError, require
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import face_normals
from scan2fea.kernel.surfaces import Surface
from scan2fea.reconstruction.bores import LEAST_POINTS, distinct_cylinders, is_same, wall_bores
from scan2fea.reconstruction.lost_bores import told_bores
from scan2fea.reconstruction.plane_growing import MOST_PLANES, Planes, assigned, grow_planes, settled, tolerance_m
from scan2fea.reconstruction.regular import EXACT
from scan2fea.reconstruction.round_growing import NO_ROUNDS, Rounds, grow_rounds, nearest_round, off_round_m, radius_std
from scan2fea.reconstruction.slots import is_in_slot, slot_ends
from scan2fea.reconstruction.strips import ALIKE_DEG, EXACTLY, needed, planes_kept, ways_of, with_strips
from scan2fea.reconstruction.visibility import Reconstruction
from scan2fea.types import BoolArray, FloatArray, IntArray, TriangleMesh, Value

EXPLAINED = 0.8  # of a cylinder's points lie on planes or larger cylinders: normals blended along an edge turn as round ones do
MEETING = 3  # planes that may be one cylinder with blended normals: those of an edge, or of a corner
DIGITS = 1e-9  # spacings: what counts as no distance at all
CYLINDER_TERMS, PLANE_TERMS = 5, 3
FACES_OFF = 0.5  # spacings that faces of a first surface lie off the cylinder they are of, besides the noise: chords between points
FACES_LEAN = 0.3  # cosine
LEAST_PLANES = 2  # of a solid, but for its rims: of a plate
NARROW = 4.0  # times how far points may lie off their plane: of a narrower face half lies within reach of those beside it
FILLED, SMALL = 0.5, 0.1  # of the strip that points of a plane spread over; of the points of the largest plane
TAIL = 2.0  # times how far points may lie off their cylinder: so far the noise still throws one of thousands


@dataclass(frozen=True, eq=False, kw_only=True)
class Faces(Value):
    """planes : narrow ones too.   rounds : cylinders, none with planes alone. Rows of both labels are those of the points."""

    planes: Planes
    rounds: Rounds = NO_ROUNDS


def flat_faces(points: FloatArray, first: Reconstruction, grown: Planes | None = None) -> Faces:
    """The planes alone. points : (n, 3) raw, in the rows of `first`.   grown : what `told_by` says, where it was asked.

    Raises ReconstructionError where they are too few for a solid, or too many.
    """
    require(grown is None or len(grown) >= LEAST_PLANES, ReconstructionError, f"{_says(grown)}: they are no solid of flat faces")
    return Faces(planes=planes_beside(points, first, NO_ROUNDS, grown))


def outlined_faces(points: FloatArray, first: Reconstruction, grown: Planes | None) -> Faces | None:
    """The planes alone, the narrow ones by the outlines of walls; None where none is narrow, all are, or each looks along a direction of wide ones.

    Across a face as narrow as the noise reaches, points tell no tilt, and their normals are blended with those beside it: planes grown there lean.
    So do small planes whose points leave most of what they spread over bare, or they are faces in pieces, which look along others.
    Raises ReconstructionError as `flat_faces`.
    """
    if grown is None:
        return None
    sure = _sure(points, first.normals, grown, first.spacing_m, first.sigma_m)
    return None if sure is None else Faces(planes=planes_beside(points, first, NO_ROUNDS, sure))


def _sure(points: FloatArray, normals: FloatArray, grown: Planes, spacing_m: float, sigma_m: float) -> Planes | None:
    """The planes without those that `outlined_faces` doubts; None where it doubts none. points, normals : (n, 3), in the rows of `grown`."""
    h, sigma = spacing_m, sigma_m
    if sigma <= EXACT:
        return None
    grown = needed(points, grown, h, sigma)
    extent = np.array([_extent(points[grown.label == k], h) for k in range(len(grown))]).reshape(-1, 2)
    count = np.bincount(grown.label[grown.label >= 0], minlength=len(grown))
    is_narrow = extent[:, 0] <= NARROW * tolerance_m(h, sigma)
    is_bare = (extent[:, 1] < FILLED) & (count < SMALL * count.max(initial=0))
    sure = grown.normal[~(is_narrow | is_bare)]
    leans = (grown.normal @ ways_of(sure).T).max(axis=1) < EXACTLY if len(sure) else np.zeros(len(grown), bool)
    if not ((is_narrow | is_bare) & leans).any():
        return None
    is_narrow |= is_bare & leans
    return settled(points, normals, [grown.plane(int(k)) for k in np.flatnonzero(~is_narrow)], h, sigma)


def _says(planes: Planes | None) -> str:
    return f"the points lie on {0 if planes is None else len(planes)} planes"


def _extent(own: FloatArray, spacing_m: float) -> tuple[float, float]:
    """Of the strip that points of a plane would fill evenly: its width, m, and the share of it that so many points fill. 0, 0 of too few.

    A plane that cuts across edges takes the points at its crossings with the faces of them, whose normals are blended.
    """
    if len(own) < LEAST_POINTS:
        return 0.0, 0.0
    across, along = np.sqrt(12.0 * np.maximum(0.0, np.linalg.eigvalsh(np.cov(own.T))))[1:]
    return float(across), float(len(own) * spacing_m**2 / max(across * along, 1e-300))


def round_faces(points: FloatArray, first: Reconstruction, rounds: Rounds) -> Faces | None:
    """Cylinders, and the planes beside them; None where no cylinder is needed. Raises ReconstructionError as `flat_faces`.

    rounds : as `rounds_of` finds them.
    """
    return _beside_rounds(points, first, rounds, partial(planes_beside, points, first))


def outlined_round_faces(points: FloatArray, first: Reconstruction, rounds: Rounds) -> Faces | None:
    """As `round_faces`, with planes as in `outlined_faces`; None, too, where it would doubt none of them."""

    def planes(kept: Rounds) -> Planes | None:
        rest = _of_planes(points, first, kept)[0]
        axes = np.array([surface.axis for surface in kept.surfaces]).reshape(-1, 3)
        grown = grow_planes(points[rest], first.normals[rest], first.spacing_m, first.sigma_m, axes)
        sure = _sure(points[rest], first.normals[rest], grown, first.spacing_m, first.sigma_m)
        return None if sure is None else planes_beside(points, first, kept, sure)

    return _beside_rounds(points, first, rounds, planes)


def _beside_rounds(points: FloatArray, first: Reconstruction, rounds: Rounds, beside: Callable[[Rounds], Planes | None]) -> Faces | None:
    """The cylinders that are needed, and the planes that `beside` finds with them."""
    rounds = _largest_first(rounds)
    planes = beside(rounds) if len(rounds) else None
    if planes is None:
        return None
    kept = _needed(points, rounds, planes, first.spacing_m, first.sigma_m)
    if len(kept) < len(rounds):
        planes = beside(kept) if len(kept) else None
    return None if planes is None else Faces(planes=planes, rounds=kept)


def rounds_of(points: FloatArray, first: Reconstruction, flat: Faces | None = None) -> Rounds:
    """Cylinders through the points, those too that planes explain as well; none where none is found. points : (n, 3) raw, in the rows of `first`.

    flat : as `flat_faces` finds them, where it does.
    """
    h, sigma = first.spacing_m, first.sigma_m
    grown = grow_rounds(points, first.normals, h, sigma)
    if flat is not None:
        is_flat = [_is_flat(points[grown.label == k], surface, flat.planes, h, sigma) for k, surface in enumerate(grown.surfaces)]
        grown = _of(grown, np.flatnonzero(~np.array(is_flat, bool)).tolist())
    rest = grown.label < 0
    try:
        planes = grow_planes(points[rest], first.normals[rest], h, sigma)
    except ReconstructionError:
        return grown
    number = np.full(len(points), -1, np.int64)
    number[rest] = planes.label
    # along the directions of the faces, which a dozen points cannot tell
    faces = replace(planes, label=number)
    told = [*wall_bores(points, faces, h, sigma), *told_bores(points, first.normals, h, sigma, faces)]
    ends = slot_ends(points, faces if flat is None else flat.planes, h, sigma)
    bores = [*ends, *(s for s in distinct_cylinders(told, off_round_m(h, sigma)) if not is_in_slot(s, ends))]
    found = [*(surface for surface in grown.surfaces if not any(is_same(surface, bore) for bore in bores)), *bores]
    label = _given(points, first.normals, found, planes, h, sigma)
    kept = [k for k in range(len(found)) if np.sum(label == k) >= LEAST_POINTS]
    if not kept:
        return NO_ROUNDS
    number = np.full(len(found) + 1, -1, np.int64)
    number[kept] = np.arange(len(kept))
    std = np.array([radius_std(found[k], points[label == k], sigma) for k in kept])
    return Rounds(surfaces=tuple(found[k] for k in kept), label=number[label], std_m=std)


def _is_flat(own: FloatArray, surface: Surface, flat: Planes, spacing_m: float, sigma_m: float) -> bool:
    """Do planes that meet explain the points (n, 3) of a cylinder better than this does, with what they have more terms (Schwarz 1978)?

    Normals that are blended along an edge suggest a cylinder that grows over a face as small as they reach.
    """
    off = np.abs(own @ flat.normal.T - flat.offset)
    most = np.argsort(-np.sum(off <= tolerance_m(spacing_m, sigma_m), axis=0), kind="stable")[:MEETING]
    off = off[:, most].min(axis=1, initial=np.inf)
    on = off <= tolerance_m(spacing_m, sigma_m)
    if np.mean(on) <= EXPLAINED:
        return False
    planar, rounded = (max(float(np.sqrt(np.mean(d[on] ** 2))), DIGITS * spacing_m) for d in (off, surface.distance(own)))
    n = int(on.sum())
    return bool(n * np.log(rounded / planar) > 0.5 * (len(most) * PLANE_TERMS - CYLINDER_TERMS) * np.log(n))


def _largest_first(rounds: Rounds) -> Rounds:
    size = np.bincount(rounds.label[rounds.label >= 0], minlength=len(rounds))
    return _of(rounds, np.argsort(-size, kind="stable").tolist())


def _of(rounds: Rounds, rows: list[int]) -> Rounds:
    """Some of the cylinders, in the order of `rows`."""
    number = np.full(len(rounds) + 1, -1, np.int64)
    number[rows] = np.arange(len(rows))
    return Rounds(surfaces=tuple(rounds.surfaces[k] for k in rows), label=number[rounds.label], std_m=rounds.std_m[rows])


def _needed(points: FloatArray, rounds: Rounds, planes: Planes, spacing_m: float, sigma_m: float) -> Rounds:
    """The cylinders, largest first, without those whose points lie on planes, or on larger cylinders, anyway."""
    on = np.zeros(len(points), bool)
    for k in range(len(planes)):
        on |= np.abs(planes.plane(k).distance(points)) <= tolerance_m(spacing_m, sigma_m)
    kept: list[int] = []
    for k, surface in enumerate(rounds.surfaces):
        if np.mean(on[rounds.label == k]) <= EXPLAINED:
            kept.append(k)
            on |= np.abs(surface.distance(points)) <= off_round_m(spacing_m, sigma_m)
    return _of(rounds, kept)


def _given(points: FloatArray, normals: FloatArray, found: list[Surface], planes: Planes, spacing_m: float, sigma_m: float) -> IntArray:
    """(n,) the cylinder that each point is of: the nearest of its side; where its normal is of no shape it lies on, the nearest at all, -1 none.

    Few points on the wall of a bore have normals blended with those of the faces.
    """
    off = off_round_m(spacing_m, sigma_m)
    if not found:
        return np.full(len(points), -1, np.int64)
    label = nearest_round(points, normals, found, off)
    on_plane = assigned(points, normals, [planes.plane(k) for k in range(len(planes))], tolerance_m(spacing_m, sigma_m)) >= 0
    left = np.flatnonzero((label < 0) & ~on_plane)
    distance = np.abs([surface.distance(points[left]) for surface in found])
    best = np.argmin(distance, axis=0)
    label[left] = np.where(distance[best, np.arange(len(left))] <= off, best, -1)
    return label


def _of_planes(points: FloatArray, first: Reconstruction, rounds: Rounds) -> tuple[IntArray, IntArray, TriangleMesh]:
    """Rows of the points that are of no cylinder, these and those of cylinders that lie on faces beside them, and the faces that are of none."""
    every = np.arange(len(points))
    if not len(rounds):
        return every, every, first.mesh
    h, sigma = first.spacing_m, first.sigma_m
    is_beside = beside(first.mesh, rounds, h, sigma)
    on_beside = is_beside[PointToMesh(first.mesh).nearest(points).face]
    tail = nearest_round(points, first.normals, rounds.surfaces, TAIL * off_round_m(h, sigma)) >= 0
    rest = np.flatnonzero((rounds.label < 0) & (on_beside | ~tail))
    rows = np.concatenate([rest, np.flatnonzero((rounds.label >= 0) & on_beside)])
    return rest, rows, TriangleMesh(vertices=first.mesh.vertices, faces=first.mesh.faces[is_beside])


def planes_beside(points: FloatArray, first: Reconstruction, rounds: Rounds, grown: Planes | None = None) -> Planes:
    """The planes of the points that no cylinder has, narrow ones too.   grown : those that are wide, in the rows of these points, where known.

    Raises ReconstructionError where planes and cylinders are too few for a solid, or too many.
    """
    h, sigma = first.spacing_m, first.sigma_m
    known = first.thickness_m[np.isfinite(first.thickness_m)]
    wall = float(np.quantile(known, 0.25)) if len(known) else float("nan")
    rest, rows, mesh = _of_planes(points, first, rounds)
    require(len(rest) >= LEAST_POINTS and len(mesh.faces), ReconstructionError, "the points lie on cylinders alone: no plane ends them")
    axes = np.array([surface.axis for surface in rounds.surfaces]).reshape(-1, 3)
    planes = grow_planes(points[rest], first.normals[rest], h, sigma, axes) if grown is None else grown
    if len(rounds):
        given = replace(planes, label=np.append(planes.label, np.full(len(rows) - len(rest), -1)))
        planes = with_strips(points[rows], given, mesh, wall, h, sigma, axes)
        least = 1
    else:
        is_known = grown is not None or len(planes) >= LEAST_PLANES
        require(is_known, ReconstructionError, f"{_says(planes)}: they are no solid of flat faces")
        planes = with_strips(points[rest], planes, mesh, wall, h, sigma)
        least = 4
    says = f"the points would need {len(planes)} planes ({least} to {MOST_PLANES}): they are no solid of flat faces"
    require(least <= len(planes) <= MOST_PLANES, ReconstructionError, says)
    label = np.full(len(points), -1, np.int64)
    label[rest] = planes.label[: len(rest)]  # what a cylinder has stays its own
    return replace(planes, label=label)


def beside(mesh: TriangleMesh, rounds: Rounds, spacing_m: float, sigma_m: float) -> BoolArray:
    """(f,) the faces of a first surface that are of no cylinder."""
    middle, normals = mesh.vertices[mesh.faces].mean(axis=1), face_normals(mesh)
    of: BoolArray = np.zeros(len(middle), bool)
    for surface in rounds.surfaces:
        near = np.abs(surface.distance(middle)) <= FACES_OFF * spacing_m + sigma_m
        of |= near & (np.einsum("ij,ij->i", surface.normals(middle), normals) >= FACES_LEAN)
    return ~of


def joined_faces(points: FloatArray, faces: Faces, spacing_m: float, sigma_m: float) -> Faces | None:
    """The faces with small planes made one with a larger one of their direction that lies within reach of the noise; None where there is none.

    They are of points along edges, which the noise throws to one side: the planes meet nowhere near their faces.
    """
    planes = faces.planes
    size = np.bincount(planes.label[planes.label >= 0], minlength=len(planes))
    into = np.arange(len(planes))
    off, alike = tolerance_m(spacing_m, sigma_m), np.cos(np.radians(ALIKE_DEG))
    for k in np.argsort(-size, kind="stable").tolist():  # the larger first: it may be one with another itself
        own = points[planes.label == k]
        apart = np.abs(np.median(own @ planes.normal.T, axis=0) - planes.offset) if len(own) else np.full(len(planes), np.inf)
        one = (planes.normal @ planes.normal[k] >= alike) & (apart <= off) & (size[k] < SMALL * size) & (into == np.arange(len(planes)))
        if one.any():
            into[k] = int(np.argmax(np.where(one, size, -1)))
    kept = np.flatnonzero(into == np.arange(len(planes)))
    if len(kept) == len(planes):
        return None
    label = np.append(into, -1)[planes.label]
    return replace(faces, planes=planes_kept(replace(planes, label=label), kept.tolist()))


def moved_planes(planes: Planes, every: Planes) -> Planes:
    """The planes where `every` has them: cylinders keep their place."""
    return replace(planes, offset=every.offset[: len(planes)])
