"""A surface whose parts lie on planes, cylinders, cones and spheres, as the solid of these true faces; or why it is none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scan2fea.cad.boxed import with_exact_box
from scan2fea.cad.brep import OCC_RESOLUTION_M, CadOptions
from scan2fea.cad.cells import cell_solid
from scan2fea.cad.compared import FIT_POINTS, LEFT_OUT, Compared, Scale, compared, faces_of, triangles_of
from scan2fea.cad.evidence import asked_for
from scan2fea.cad.fillets import Fillet, fitted_fillets, renumbered, rounded, without_fillets
from scan2fea.cad.live import is_valid, moved_by, surface_of
from scan2fea.cad.naming import named_faces
from scan2fea.cad.patches import Patches, segmented
from scan2fea.cad.readback import ReadBack, read_back, volume_of
from scan2fea.cad.resting import LEAST_POINTS, Resting, nearest_points, resting_planes
from scan2fea.cad.revolved import turned_solid
from scan2fea.cad.roundings import free_share, inner_faces, smooth_share, unexplained, widened, without_roundings
from scan2fea.cad.sheets import MOST_AREA, MOST_TRIANGLES, as_facet, sewn_sheet, sheet, walls_of, without_walls
from scan2fea.cad.step_occ import named, step_of_solid
from scan2fea.cad.surfaces import Fit, Snap, simplest, snapped
from scan2fea.cad.tangent import touching
from scan2fea.errors import CadError
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import extent, face_areas
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.surfaces import CONE, PLANE, SPHERE, Surface, covariance
from scan2fea.types import Brep, FloatArray, IntArray, TriangleMesh, Value
from scan2fea.units import MILLIMETRES_PER_METRE

MAX_SURFACES = 120  # cells are cut by every surface with every other: more take minutes
TOLERANCES = (1.0, 2.0)  # times the noise of the vertices for which the segmentation is tried
MARGINS = (1.0, 3.0, 8.0)  # times the reach by which faces are drawn beyond their region
SMOOTH = 0.5  # share of the borders of patches without an angle: more is free form in pieces (0 to 0.3 on bodies of few faces, 0.83 on a blob)
UNEXPLAINED = 0.004  # share of the area that may lie on no surface: more is free form
SCRAPS = 0.01  # of the area: surfaces that a wider tolerance does without
NO_FILLETS = "rounded edges could not be made"
FITTED = 30  # points: with fewer inside its region a surface is fitted to those at its border too
READS_BACK = 1e-6  # relative difference of volume between the shape and its file


@dataclass(frozen=True, eq=False, kw_only=True)
class Trued(Value):
    """brep, mesh : the solid of true faces and its triangles, whose face_region is the face of the B-Rep; None where the surface is free form.

    reason : why.   snaps : relations tested.   how : figures for the report.
    """

    brep: Brep | None
    mesh: TriangleMesh | None
    reason: str
    snaps: tuple[Snap, ...] = ()
    how: Mapping[str, Any]


@dataclass(frozen=True, eq=False, kw_only=True)
class Measured(Value):
    """points : (n, 3).   face : (n,) of the surface, next to each.   density : per m2, 0 where they need not lie everywhere on the surface."""

    points: FloatArray
    face: IntArray
    density: float


def true_solid(
    mesh: TriangleMesh,
    points: FloatArray,
    options: CadOptions = CadOptions(),
    *,
    spacing_m: float,
    noise_m: float,
    resting: tuple[FloatArray, FloatArray] | None = None,
) -> Trued:
    """The solid of true faces of a closed surface.

    points : (n, 3) measured, which the faces are fitted to.   spacing_m : of these.   noise_m : left in the vertices of `mesh`.
    resting : (k, 3) points inferred where the object stands on something, and their normals (k, 3) out of it.
    Nothing is raised where there is none: `reason` says why.
    """
    scale = Scale(spacing_m=spacing_m, noise_m=noise_m, size_m=extent(mesh.vertices))
    if not options.true_faces:
        return _none("cad.true_faces is off")
    reason = ""
    stands = [] if resting is None else resting_planes(*resting, scale.tolerance_m)
    known = [r.surface for r in stands]
    used = points[sampled_rows(len(points), FIT_POINTS, 0)]
    at = PointToMesh(mesh).nearest(used)
    is_given = float(at.distance.max(initial=0.0)) <= 1e-9 * scale.size_m  # vertices of the surface lie where its triangles end, not everywhere
    mixed: list[Patches] = []
    near = Measured(points=used, face=at.face, density=0.0 if is_given else len(used) / float(face_areas(mesh).sum()))
    for factor, patches, sharp, fillets in _candidates(mesh, near, known, scale):
        lost = unexplained(mesh, patches, factor * scale.reach_m, near.face, near.density)
        said = _refused(patches, lost)
        if said:  # a head that is no ball leaves none where nothing blurs it
            found = _built(mesh, points, patches, scale, stands, may_cut=False, may_turn=True) if lost > UNEXPLAINED else None
            if found is not None and found.brep is not None:
                return found
            reason = reason or said
            mixed.append(patches)
            continue
        if fillets:
            found = _built(mesh, points, sharp, scale, stands, fillets, may_cut=smooth_share(mesh, sharp) <= SMOOTH)
            if found.brep is not None:
                return found
        smooth = smooth_share(mesh, patches)
        found = _built(mesh, points, patches, scale, stands, may_cut=smooth <= SMOOTH)
        if found.brep is not None:
            return found
        if smooth > SMOOTH:  # with twice the tolerance the pieces are larger, and no sharper
            return _none(f"{found.reason}{len(patches.surfaces)} pieces of surfaces that pass smoothly into each other: a free form")
        reason = found.reason
        mixed.append(patches)
    for patches in mixed:
        found = _mixed(mesh, points, patches, scale, stands)
        if found.brep is not None:
            return found
    return _none(reason)


_Candidate = tuple[float, Patches, Patches, tuple[Fillet, ...]]  # times the tolerance; patches; these without fillets; fillets


def _candidates(mesh: TriangleMesh, near: Measured, known: list[Surface], scale: Scale) -> Iterator[_Candidate]:
    """The segmentations, the tight one first unless what it has more than the wide one are scraps: rounded creases in pieces."""
    made = (_candidate(mesh, near, known, scale, factor) for factor in TOLERANCES)
    tight = next(made)
    if smooth_share(mesh, tight[2]) > SMOOTH:
        yield tight
        yield from made
        return
    wide = next(made)
    area = face_areas(mesh)
    sizes = np.sort(np.bincount(tight[1].label + 1, weights=area, minlength=len(tight[1].surfaces) + 1)[1:])
    more = len(tight[1].surfaces) - len(wide[1].surfaces)
    scraps = more > 0 and float(sizes[:more].sum()) <= SCRAPS * float(area.sum()) and len(wide[3]) >= len(tight[3])
    wide_first = scraps and not _refused(wide[1], unexplained(mesh, wide[1], wide[0] * scale.reach_m, near.face, near.density))
    yield from (wide, tight) if wide_first else (tight, wide)


def _candidate(mesh: TriangleMesh, near: Measured, known: list[Surface], scale: Scale, factor: float) -> _Candidate:
    def evident(given: Patches) -> Patches:
        told = near.points, near.face, scale.tolerance_m
        return asked_for(mesh, without_roundings(mesh, given, factor * scale.reach_m, known, told), near.points, near.face, near.density)

    found = segmented(mesh, factor * scale.tolerance_m, known)
    patches = evident(found)
    sharp, fillets = without_fillets(mesh, found, factor * scale.tolerance_m, near.points, near.face, scale.tolerance_m)
    if fillets:
        sharp, fillets = renumbered(evident(sharp), sharp, fillets)
    return factor, patches, sharp if fillets else patches, fillets


def _none(reason: str) -> Trued:
    return Trued(brep=None, mesh=None, reason=reason, how={})


def _refused(patches: Patches, lost: float) -> str:
    if lost > UNEXPLAINED:
        return f"{lost:.1%} of the area lies on no plane, cylinder, cone or sphere"
    if len(patches.surfaces) < 2:
        return "fewer than two surfaces"
    return ""


def _built(
    mesh: TriangleMesh,
    points: FloatArray,
    patches: Patches,
    scale: Scale,
    stands: Sequence[Resting],
    fillets: Sequence[Fillet] = (),
    *,
    may_cut: bool,
    may_turn: bool = False,
    walls: Sequence[IntArray] = (),
) -> Trued:
    """Fit, snap, cut, round the edges, check; the first margin that passes."""
    fits, snaps, is_whole = _fits(mesh, points, patches, scale, stands)
    middle = (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    local = TriangleMesh(vertices=(mesh.vertices - middle) * MILLIMETRES_PER_METRE, faces=mesh.faces)
    regions = [local.vertices[rows] for rows in widened(mesh, patches, fits, scale.reach_m)]
    best, as_found = [_in_mm(s, middle) for s in fits], [_in_mm(s, middle) for s in patches.surfaces]
    mm = MILLIMETRES_PER_METRE
    own = [local.vertices[np.unique(mesh.faces[patches.label == k])] for k in range(len(best))]
    best, limits = touching(best, own, scale.tolerance_m * mm, scale.reach_m * mm)
    reason = ""
    if may_turn or any(s.kind == SPHERE for s in best):  # heads that are no spheres come as rings of them, which cannot be cut with each other
        turned, reason = turned_solid(
            local, (points - middle) * mm, patches, best if is_whole else as_found, scale.spacing_m * mm, scale.noise_m * mm, scale.reach_m * mm
        )  # fmt: skip
        if turned is not None:
            found = compared(turned, mesh, points, middle, scale)
            reason = found.problem
            if not reason:
                return _result(turned, middle, scale, (), found)
        reason = f"turned about an axis: {reason}; "
    if not may_cut:
        return _none(reason)
    if len(best) > MAX_SURFACES:
        return _none(f"{reason}{len(best)} surfaces, more than {MAX_SURFACES}")
    if fillets:
        used = points[sampled_rows(len(points), FIT_POINTS, 0)]
        fillets = fitted_fillets(fillets, fits, used, PointToMesh(mesh).nearest(used).face, scale.tolerance_m)
    beyond = [max((f.reach_m * mm for f in fillets if k in (f.first, f.second)), default=0.0) for k in range(len(best))]
    first = ""
    free = [sewn_sheet(sheet(local, rows, patches.label, best, scale.tolerance_m * mm, scale.reach_m * mm)) for rows in walls]
    for drawn, ends in ((best, limits),) if fillets or walls else ((best, limits), (as_found, None)):
        for factor in MARGINS:
            margin = max(factor * (scale.reach_m + scale.tolerance_m) * mm, 0.01 * factor * scale.size_m * mm)
            solid = cell_solid(drawn, regions, [margin + more for more in beyond], local, ends, free)
            solid, problem = _with_fillets(solid, fillets, drawn, local)
            if problem == NO_FILLETS:  # wider faces meet in the same edges
                return _none(f"{reason}{len(fillets)} {problem}")
            found = Compared(problem=problem) if problem else compared(solid, mesh, points, middle, scale)
            problem = found.problem
            if not problem:
                return _result(solid, middle, scale, snaps, found, fillets, drawn if walls else None)
            first = problem if problem.endswith(LEFT_OUT) else first or problem
        if first.endswith(LEFT_OUT):  # the surfaces as they were found leave it out too
            break
    return _none(reason + first)


def _mixed(mesh: TriangleMesh, points: FloatArray, patches: Patches, scale: Scale, stands: Sequence[Resting]) -> Trued:
    """True faces where surfaces explain the points, and facets on the walls between them that are free form."""
    if free_share(mesh, patches) > MOST_AREA:
        return _none("most of the area is free form")
    fits = _fits(mesh, points, patches, scale, stands)[0]
    own = [mesh.vertices[np.unique(mesh.faces[patches.label == k])] for k in range(len(fits))]
    best, _ = touching(fits, own, scale.tolerance_m, scale.reach_m)
    walls = walls_of(mesh, replace(patches, surfaces=tuple(best)), scale.reach_m)
    n, area = sum(map(len, walls)), face_areas(mesh)
    share = sum(float(area[rows].sum()) for rows in walls) / float(area.sum())
    if not n or n > MOST_TRIANGLES or share > MOST_AREA:
        return _none(f"{share:.0%} of the area in {n} triangles are free form" if n else "")
    return _built(mesh, points, without_walls(patches, walls), scale, stands, may_cut=True, walls=walls)


def _with_fillets(solid: Any | None, fillets: Sequence[Fillet], drawn: Sequence[Surface], local: TriangleMesh) -> tuple[Any | None, str]:
    """The solid with its fillets, and "", or why there is none."""
    if solid is None or not is_valid(solid):
        return None, "the faces close no valid solid"
    if not fillets:
        return solid, ""
    made = rounded(solid, fillets, drawn, local)
    return made, "" if made is not None else NO_FILLETS


def _fits(
    mesh: TriangleMesh, points: FloatArray, patches: Patches, scale: Scale, stands: Sequence[Resting] = ()
) -> tuple[list[Surface], tuple[Snap, ...], bool]:
    """The surfaces fitted to the measured points of their regions, away from borders, with relations applied. One with too few points stays as the
    vertices of its patch have it; the last value tells whether there was none.
    """
    used = points[sampled_rows(len(points), FIT_POINTS, 0)]
    inner = inner_faces(mesh, patches.label)
    at = PointToMesh(mesh).nearest(used)
    near = at.distance <= 4 * scale.noise_m + 4 * scale.tolerance_m + scale.spacing_m
    label = np.where(near, patches.label[at.face], -1)
    deep = near & inner[at.face]
    fits: list[Fit] = []
    is_whole = True
    flat = [s.axis for s in patches.surfaces if s.kind == PLANE]
    for k, surface in enumerate(patches.surfaces):
        rows = np.flatnonzero((label == k) & deep)
        if len(rows) < FITTED:
            rows = np.flatnonzero(label == k)
        own = used[rows] if len(rows) >= LEAST_POINTS else nearest_points(stands, surface, scale.reach_m)
        fit = simplest(surface, own, scale.size_m, flat) if len(own) >= LEAST_POINTS else None
        is_whole = is_whole and fit is not None
        fits.append(fit or _of_vertices(surface, mesh.vertices[np.unique(mesh.faces[patches.label == k])], scale))
    out, snaps = snapped(fits)
    return [f.surface for f in out], tuple(snaps), is_whole


def _of_vertices(surface: Surface, vertices: FloatArray, scale: Scale) -> Fit:
    """The surface of a patch as it was found."""
    sigma = max(scale.tolerance_m / 3, surface.rms_m)
    return Fit(surface=surface, points=vertices, sigma_m=sigma, covariance=covariance(surface, vertices, sigma))


def _in_mm(surface: Surface, middle: FloatArray) -> Surface:
    second = surface.second if surface.kind == CONE else surface.second * MILLIMETRES_PER_METRE
    return replace(
        surface, point=(surface.point - middle) * MILLIMETRES_PER_METRE, radius=surface.radius * MILLIMETRES_PER_METRE, second=second
    )  # fmt: skip


def _result(
    solid: Any, middle: FloatArray, scale: Scale, snaps: tuple[Snap, ...], proved: Compared, fillets: Sequence[Fillet] = (),
    drawn: Sequence[Surface] | None = None,
) -> Trued:  # fmt: skip
    """The file, proved by reading it back, and the triangles of its faces in their order.

    drawn : the surfaces, in millimetres, of a solid that has facets too: what lies on none of these is one.
    """
    placed = moved_by(solid, middle * MILLIMETRES_PER_METRE)
    try:
        text, numbers = step_of_solid(placed, OCC_RESOLUTION_M)
        found = read_back(text)
    except CadError as error:
        return _none(str(error))
    volume = volume_of(placed) / MILLIMETRES_PER_METRE**3
    if not (found.is_valid and found.n_solids == 1 and found.n_free_edges == 0 and abs(found.volume_m3 / volume - 1) < READS_BACK):
        return _none("the STEP file does not read back as the solid that was written")
    mesh, face = triangles_of(solid, middle, scale.tolerance_m)
    order = _order(mesh, face, found)
    if order is None:
        return _none("the faces of the STEP file are not those that were written")
    mesh = replace(mesh, face_region=order[face])
    made = [_in_m(s if drawn is None else as_facet(s, drawn), middle) for s in map(surface_of, faces_of(solid))]
    surfaces = [made[k] for k in np.argsort(order)]
    kinds, names = tuple(s.kind for s in surfaces), named_faces(mesh, surfaces)
    brep = Brep(
        step=named(text, numbers, names), face_names=names, face_kinds=kinds, region_of_face=np.arange(len(names)),
        facet_of_face=np.full(len(names), -1, np.int64), volume_m3=found.volume_m3, area_m2=found.area_m2, is_valid=found.is_valid,
        n_solids=found.n_solids, n_free_edges=found.n_free_edges, face_centre=found.face_centre, face_area=found.face_area,
    )  # fmt: skip
    boxed = with_exact_box(brep, placed, mesh, OCC_RESOLUTION_M)
    return Trued(brep=boxed, mesh=mesh, reason="", snaps=snaps, how=_told(snaps, brep, proved, fillets))


def _in_m(surface: Surface, middle: FloatArray) -> Surface:
    k = 1 / MILLIMETRES_PER_METRE
    second = surface.second if surface.kind == CONE else surface.second * k
    return replace(surface, point=surface.point * k + middle, radius=surface.radius * k, second=second)


def _order(mesh: TriangleMesh, face: IntArray, found: ReadBack) -> IntArray | None:
    """For each face of the shape its place in the file, by centre and area; None where they do not pair off."""
    n = int(face.max()) + 1
    if len(found.face_area) != n:
        return None
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    total = np.bincount(face, weights=area, minlength=n)
    middle = np.stack([np.bincount(face, weights=area * corners[:, :, k].mean(1), minlength=n) for k in range(3)], axis=1).astype(float)
    middle /= np.maximum(total, 1e-300)[:, None]
    gap = np.linalg.norm(middle[:, None] - found.face_centre[None], axis=2) + np.sqrt(np.abs(total[:, None] - found.face_area[None]))
    order = gap.argmin(1)
    return order if len(np.unique(order)) == n else None


def _told(snaps: Sequence[Snap], brep: Brep, proved: Compared, fillets: Sequence[Fillet]) -> dict[str, Any]:
    kinds = {kind: brep.face_kinds.count(kind) for kind in sorted(set(brep.face_kinds))}
    radii = {"fillets": [{"radius_m": f.radius_m, "std_m": f.std_m} for f in fillets]} if fillets else {}
    solid, surface = proved.holes
    holes = {"holes": {"solid": solid, "surface": surface}} if solid != surface else {}
    return radii | holes | {"faces": kinds, "snaps": sum(s.applied for s in snaps), "refused": sum(not s.applied for s in snaps)}


