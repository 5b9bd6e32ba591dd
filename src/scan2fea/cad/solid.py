"""A surface whose parts lie on planes, cylinders, cones and spheres, as the solid of these true faces; or why it is none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scan2fea.cad.bores import bored
from scan2fea.cad.brep import CadOptions
from scan2fea.cad.cells import cell_solid
from scan2fea.cad.compared import FIT_POINTS, LEFT_OUT, Compared, Scale, compared, triangles_of
from scan2fea.cad.evidence import asked_for
from scan2fea.cad.extruded import with_extruded
from scan2fea.cad.fillets import Fillet, fitted_fillets, renumbered, rounded, without_fillets
from scan2fea.cad.freeform import tolerance
from scan2fea.cad.live import is_valid
from scan2fea.cad.patches import Patches, segmented
from scan2fea.cad.quilted import quilted_solid
from scan2fea.cad.resting import Resting, resting_planes
from scan2fea.cad.revolved import turned_solid
from scan2fea.cad.rims import Rimmed, with_rims
from scan2fea.cad.rolled import with_rings_and_balls
from scan2fea.cad.roundings import free_share, smooth_share, unexplained, widened, without_roundings
from scan2fea.cad.sheets import FACET, MOST_AREA, MOST_TRIANGLES, RINGS, beyond, sewn_sheet, sheet, walls_of, without_walls
from scan2fea.cad.tangent import touching
from scan2fea.cad.traced import Traced, traced_solid
from scan2fea.cad.trued import Trued, covariance_in_mm, fits_of, in_mm, no_solid, trued
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import extent, face_areas, face_normals
from scan2fea.kernel.measures import volume as enclosed_volume
from scan2fea.kernel.noise import sampled_rows
from scan2fea.kernel.surfaces import SPHERE, Surface
from scan2fea.types import FloatArray, IntArray, TriangleMesh, Value
from scan2fea.units import MILLIMETRES_PER_METRE

MANY = 40  # surfaces: to cut them with each other takes longer than to trace their borders, which is tried first
MAX_TRACED = 300  # surfaces of a solid that is not cut: all are moved at once
MAX_SURFACES = 120  # cells are cut by every surface with every other: more take minutes
TOLERANCES = (1.0, 2.0)  # times the noise of the vertices for which the segmentation is tried
MARGINS = (1.0, 3.0, 8.0)  # times the reach by which faces are drawn beyond their region
SMOOTH = 0.5  # share of the borders of patches without an angle: more is free form in pieces (0 to 0.3 on bodies of few faces, 0.83 on a blob)
UNEXPLAINED = 0.004  # share of the area that may lie on no surface: more is free form
FREED = 3  # rounds in which what lies off a solid becomes free form
CLOSELY = 0.03  # spacings, besides the noise, that patches may lie off the surface (rms)
BIAS, REFUSES = 0.003, 4.0  # of the volume; standard deviations by which the points of a face may lie to one side of it
SCRAPS = 0.01  # of the area: surfaces that a wider tolerance does without
NOTHING_TOLD: Mapping[int, FloatArray] = {}
NO_FILLETS = "rounded edges could not be made"


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
        return no_solid("cad.true_faces is off")
    reason = ""
    stands = [] if resting is None else resting_planes(*resting, scale.tolerance_m)
    known = [r.surface for r in stands]
    near = _measured(mesh, points, scale)
    raw = _segmented(mesh, near, known, scale, TOLERANCES[0])
    asked = _asked(mesh, raw, near, known, scale) if len(raw.surfaces) > MANY else None  # the points ask for no more than there are
    is_large = asked is not None and len(asked.surfaces) > MANY
    if asked is not None and is_large:
        found = _traced(mesh, points, asked, near, scale, stands)
        if found.brep is not None:
            return found
    mixed: list[Patches] = []
    for factor, patches, sharp, fillets in _candidates(mesh, near, known, scale, raw, asked if near.density else None):
        lost = unexplained(mesh, patches, factor * scale.reach_m, near.face, near.density)
        said = _refused(patches, lost)
        if said:  # a head that is no ball leaves none where nothing blurs it
            turned = _built(mesh, points, patches, scale, stands, may_cut=False, may_turn=True) if lost > UNEXPLAINED else None
            if turned is not None and turned.brep is not None:
                return turned
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
        reason = found.reason
        if smooth > SMOOTH:  # with twice the tolerance the pieces are larger, and no sharper
            reason += f"{len(patches.surfaces)} pieces of surfaces that pass smoothly into each other: a free form"
            mixed.clear()
            break
        mixed.append(patches)
    asked = asked or _asked(mesh, raw, near, known, scale)
    found = _without_cells(mesh, points, asked, raw, near, scale, stands, is_traced=is_large)
    return found if found.brep is not None else _fewest([_mixed(mesh, points, p, scale, stands) for p in mixed], reason)


def quilted_true_solid(
    mesh: TriangleMesh,
    points: FloatArray,
    options: CadOptions = CadOptions(),
    *,
    spacing_m: float,
    noise_m: float,
    resting: tuple[FloatArray, FloatArray] | None = None,
) -> Trued:
    """The same with NURBS patches wherever surfaces meet in no edges, also where cells close a solid: one that cannot be meshed, say."""
    scale = Scale(spacing_m=spacing_m, noise_m=noise_m, size_m=extent(mesh.vertices))
    if not options.true_faces or not options.patches:
        return no_solid("cad.true_faces or cad.patches is off")
    stands = [] if resting is None else resting_planes(*resting, scale.tolerance_m)
    known = [r.surface for r in stands]
    near = _measured(mesh, points, scale)
    raw = _segmented(mesh, near, known, scale, TOLERANCES[0])
    return _quilted(mesh, points, _rims(mesh, points, _asked(mesh, raw, near, known, scale), raw, near, scale, stands), scale, stands)


def _without_cells(
    mesh: TriangleMesh, points: FloatArray, asked: Patches, raw: Patches, near: Measured, scale: Scale, stands: Sequence[Resting], *, is_traced: bool
) -> Trued:
    """By rims, traced, and with NURBS patches for what meets in no edges: the first without facets, else that of fewest faces."""
    rimmed, rims = _rimmed(mesh, points, asked, raw, near, scale, stands)
    if rimmed.brep is not None and not _n_facets(rimmed):
        return rimmed
    last = no_solid("") if is_traced else _traced(mesh, points, asked, near, scale, stands)
    if last.brep is not None and not _n_facets(last):
        return last
    return _fewest([rimmed, last, _quilted(mesh, points, rims, scale, stands)], "")


def _fewest(found: Sequence[Trued], reason: str) -> Trued:
    return min((f for f in found if f.brep is not None), key=_n_faces, default=no_solid(reason))


def _n_faces(found: Trued) -> int:
    return 0 if found.brep is None else len(found.brep.face_kinds)


def _n_facets(found: Trued) -> int:
    return 0 if found.brep is None else found.brep.face_kinds.count(FACET)


def _measured(mesh: TriangleMesh, points: FloatArray, scale: Scale) -> Measured:
    used = points[sampled_rows(len(points), FIT_POINTS, 0)]
    at = PointToMesh(mesh).nearest(used)
    is_given = float(at.distance.max(initial=0.0)) <= 1e-9 * scale.size_m  # vertices of the surface lie where its triangles end, not everywhere
    return Measured(points=used, face=at.face, density=0.0 if is_given else len(used) / float(face_areas(mesh).sum()))


def _segmented(mesh: TriangleMesh, near: Measured, known: list[Surface], scale: Scale, factor: float) -> Patches:
    found = segmented(mesh, factor * scale.tolerance_m, known)
    return bored(mesh, found, near.points, near.face) if near.density else found


_Candidate = tuple[float, Patches, Patches, tuple[Fillet, ...]]  # times the tolerance; patches; these without fillets; fillets


def _candidates(
    mesh: TriangleMesh, near: Measured, known: list[Surface], scale: Scale, raw: Patches, asked: Patches | None
) -> Iterator[_Candidate]:
    """The segmentations, the tight one first unless what it has more than the wide one are scraps: rounded creases in pieces.

    asked : what the points ask of `raw` where creases are rounded by no more than the reach; None where it is not known.
    """
    tight = _candidate(mesh, near, known, scale, TOLERANCES[0], raw, asked)
    made = (_candidate(mesh, near, known, scale, f, _segmented(mesh, near, known, scale, f)) for f in TOLERANCES[1:])
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


def _candidate(
    mesh: TriangleMesh, near: Measured, known: list[Surface], scale: Scale, factor: float, found: Patches, asked: Patches | None = None
) -> _Candidate:
    def evident(given: Patches) -> Patches:
        told = near.points, near.face, scale.tolerance_m
        return asked_for(mesh, without_roundings(mesh, given, factor * scale.reach_m, known, told), near.points, near.face, near.density)

    patches = evident(found) if asked is None else asked
    sharp, fillets = without_fillets(mesh, found, factor * scale.tolerance_m, near.points, near.face, scale.tolerance_m)
    if fillets:
        sharp, fillets = renumbered(evident(sharp), sharp, fillets)
    return factor, patches, sharp if fillets else patches, fillets


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
    told: Mapping[int, FloatArray] = NOTHING_TOLD,
) -> Trued:
    """Fit, snap, cut, round the edges, check; the first margin that passes."""
    fitted, snaps, is_whole = fits_of(mesh, points, patches, scale, stands, told=told)
    fits = [f.surface for f in fitted]
    middle = (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    local = TriangleMesh(vertices=(mesh.vertices - middle) * MILLIMETRES_PER_METRE, faces=mesh.faces)
    regions = [local.vertices[rows] for rows in widened(mesh, patches, fits, scale.reach_m)]
    best, as_found = [in_mm(s, middle) for s in fits], [in_mm(s, middle) for s in patches.surfaces]
    mm = MILLIMETRES_PER_METRE
    own = [local.vertices[np.unique(mesh.faces[patches.label == k])] for k in range(len(best))]
    best, limits = touching(best, own, scale.tolerance_m * mm, scale.reach_m * mm)
    reason = ""
    turning = best if is_whole else as_found
    is_turned = may_turn or any(s.kind == SPHERE for s in best)  # heads that are no spheres come as rings of them, which are not cut with each other
    if is_turned:
        turned, reason = _turned(mesh, local, points, patches, turning, scale, middle)
        if turned is not None:
            return turned
    if not may_cut:
        return no_solid(reason)
    if len(best) > MAX_SURFACES:
        return no_solid(f"{reason}{len(best)} surfaces, more than {MAX_SURFACES}")
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
                return no_solid(f"{reason}{len(fillets)} {problem}")
            found = Compared(problem=problem) if problem else compared(solid, mesh, points, middle, scale)
            problem = found.problem
            if not problem:
                return trued(solid, middle, scale, snaps, found, fillets, drawn if walls else None)
            first = problem if problem.endswith(LEFT_OUT) else first or problem
        if first.endswith(LEFT_OUT):  # the surfaces as they were found leave it out too
            break
    turned = None if is_turned or fillets or walls else _turned(mesh, local, points, patches, turning, scale, middle)[0]
    return no_solid(reason + first) if turned is None else turned  # rims narrower than a rounded crease are no patches


def _turned(
    mesh: TriangleMesh, local: TriangleMesh, points: FloatArray, patches: Patches, surfaces: list[Surface], scale: Scale, middle: FloatArray
) -> tuple[Trued | None, str]:
    """The surface as a body turned about an axis, or why it is none. local : the same, in millimetres around `middle`, as `surfaces`."""
    mm = MILLIMETRES_PER_METRE
    turned, reason = turned_solid(
        local, (points - middle) * mm, patches, surfaces, scale.spacing_m * mm, scale.noise_m * mm, scale.reach_m * mm
    )  # fmt: skip
    if turned is not None:
        found = compared(turned, mesh, points, middle, scale)
        reason = found.problem
        if not reason:
            return trued(turned, middle, scale, (), found), ""
    return None, f"turned about an axis: {reason}; "


def _mixed(mesh: TriangleMesh, points: FloatArray, patches: Patches, scale: Scale, stands: Sequence[Resting]) -> Trued:
    """True faces where surfaces explain the points, and facets on the walls between them that are free form."""
    if free_share(mesh, patches) > MOST_AREA:
        return no_solid("most of the area is free form")
    fits = [f.surface for f in fits_of(mesh, points, patches, scale, stands)[0]]
    own = [mesh.vertices[np.unique(mesh.faces[patches.label == k])] for k in range(len(fits))]
    best, _ = touching(fits, own, scale.tolerance_m, scale.reach_m)
    walls = walls_of(mesh, replace(patches, surfaces=tuple(best)), scale.reach_m)
    n, area = sum(map(len, walls)), face_areas(mesh)
    share = sum(float(area[rows].sum()) for rows in walls) / float(area.sum())
    if not n or n > MOST_TRIANGLES or share > MOST_AREA:
        return no_solid(f"{share:.0%} of the area in {n} triangles are free form" if n else "")
    return _built(mesh, points, without_walls(patches, walls), scale, stands, may_cut=True, walls=walls)


def _rimmed(
    mesh: TriangleMesh, points: FloatArray, patches: Patches, raw: Patches, near: Measured, scale: Scale, stands: Sequence[Resting]
) -> tuple[Trued, Rimmed]:
    """The solid whose rims, too narrow for patches, are told by the walls beside them; and the patches with these."""
    found = _rims(mesh, points, patches, raw, near, scale, stands)
    if not found.told:
        return no_solid(""), found
    made = _built(mesh, points, found.patches, scale, stands, may_cut=smooth_share(mesh, found.patches) <= SMOOTH, told=found.told)
    return made if made.brep is not None else _traced(mesh, points, found.patches, near, scale, stands, found.told), found


def _rims(
    mesh: TriangleMesh, points: FloatArray, patches: Patches, raw: Patches, near: Measured, scale: Scale, stands: Sequence[Resting]
) -> Rimmed:
    fits = fits_of(mesh, points, patches, scale, stands)[0]
    straight = replace(patches, surfaces=tuple(f.surface for f in fits))
    found = with_rims(mesh, straight, raw, near.points, near.face, scale.tolerance_m, scale.reach_m)
    return found if found.told else Rimmed(patches=patches, told={})


def _asked(mesh: TriangleMesh, raw: Patches, near: Measured, known: list[Surface], scale: Scale) -> Patches:
    """The patches that tracing begins with. Where the vertices are the points creases are sharp: what lies within twice the tolerance of two surfaces
    is a rounding, and no more.
    """
    told = near.points, near.face, scale.tolerance_m
    return asked_for(mesh, without_roundings(mesh, raw, _crease(near, scale), known, told), near.points, near.face, near.density)


def _crease(near: Measured, scale: Scale) -> float:
    return 2 * scale.tolerance_m if near.density == 0.0 else scale.reach_m


def _traced(
    mesh: TriangleMesh, points: FloatArray, patches: Patches, near: Measured, scale: Scale, stands: Sequence[Resting],
    told: Mapping[int, FloatArray] = NOTHING_TOLD,
) -> Trued:  # fmt: skip
    """The solid of the patches as they border on each other, where surfaces touch that cells cannot cut."""
    rims = {id(patches.surfaces[k]): used for k, used in told.items()}
    patches = with_rings_and_balls(mesh, patches, scale.tolerance_m)
    told = {k: rims[id(s)] for k, s in enumerate(patches.surfaces) if id(s) in rims}
    lost = unexplained(mesh, patches, _crease(near, scale), near.face, near.density)
    if lost > UNEXPLAINED or not 2 <= len(patches.surfaces) <= MAX_TRACED:
        return no_solid(_refused(patches, lost) or f"{len(patches.surfaces)} surfaces, more than {MAX_TRACED}")
    fits, snaps, _ = fits_of(mesh, points, patches, scale, stands, radii=False, told=told)
    middle = (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    mm = MILLIMETRES_PER_METRE
    local = TriangleMesh(vertices=(mesh.vertices - middle) * mm, faces=mesh.faces)
    surfaces = [in_mm(f.surface, middle) for f in fits]
    covariances = [covariance_in_mm(f) for f in fits]

    def built(label: IntArray, surfaces: list[Surface], *, walls: bool, bridged: bool) -> tuple[Traced, Compared]:
        told = covariances + [np.zeros((0, 0))] * (len(surfaces) - len(covariances))
        made = traced_solid(local, label, surfaces, told, scale.tolerance_m * mm, scale.spacing_m * mm, walls=walls, bridged=bridged)
        if made.solid is None or not is_valid(made.solid):
            return made, Compared(problem="the faces close no valid solid")
        return made, compared(made.solid, mesh, points, middle, scale)

    made, found = built(patches.label, surfaces, walls=False, bridged=True)
    if found.problem:
        first = found.problem
        made, found = built(patches.label, surfaces, walls=True, bridged=False)
        label, more = with_extruded(local, patches.label, surfaces, made.wall, scale.tolerance_m * mm, scale.spacing_m * mm)
        if len(more) > len(surfaces):
            drawn, proved = built(label, more, walls=True, bridged=True)
            if not proved.problem and (found.problem or drawn.n_facets < made.n_facets):
                made, found = drawn, proved
        if found.problem:
            return no_solid(first)
    return trued(made.solid, middle, scale, snaps, found, drawn=made.surfaces if made.n_facets else None)


def _quilted(mesh: TriangleMesh, points: FloatArray, rims: Rimmed, scale: Scale, stands: Sequence[Resting]) -> Trued:
    """True faces where surfaces explain the points and meet in edges, and NURBS patches for the rest."""
    patches, told = rims.patches, rims.told
    if free_share(mesh, patches) > MOST_AREA or smooth_share(mesh, patches) > SMOOTH or not 2 <= len(patches.surfaces) <= MAX_TRACED:
        return no_solid("most of the area is free form")
    fits, snaps, _ = fits_of(mesh, points, patches, scale, stands, radii=False, told=told)
    middle = (mesh.vertices.min(0) + mesh.vertices.max(0)) / 2
    mm = MILLIMETRES_PER_METRE
    local = TriangleMesh(vertices=(mesh.vertices - middle) * mm, faces=mesh.faces)
    free = beyond(mesh, replace(patches, surfaces=tuple(f.surface for f in fits)), scale.reach_m)
    surfaces, covariances = [in_mm(f.surface, middle) for f in fits], [covariance_in_mm(f) for f in fits]
    closely = scale.tolerance_m * mm, scale.spacing_m * mm
    limits = tolerance(scale.spacing_m, scale.noise_m) * mm, (scale.noise_m + CLOSELY * scale.spacing_m) * mm
    used = points[sampled_rows(len(points), FIT_POINTS, 0)]
    label, volume = patches.label[PointToMesh(mesh).nearest(used).face], enclosed_volume(mesh)
    reason = ""
    for _ in range(FREED):
        made = quilted_solid(local, patches.label, surfaces, covariances, *closely, free, *limits, scale.reach_m * mm)
        if made.solid is None or not is_valid(made.solid):
            return no_solid(reason or made.reason or "the faces close no valid solid")
        found = compared(made.solid, mesh, points, middle, scale, made.within / mm)
        shown = triangles_of(made.solid, middle, scale.tolerance_m, made.within / mm)[0]
        bias, std, refused = _bias(shown, used, label, volume)
        if not found.problem and abs(bias) <= BIAS + std:
            return trued(made.solid, middle, scale, snaps, found, within_m=made.within / mm, n_patches=made.n_patches)
        reason = reason or found.problem or f"the points say that true faces and patches hold {bias:+.1%} of the volume too much"
        if found.problem:
            off = PointToMesh(shown).nearest(mesh.vertices).distance > scale.stray_m
            more = made.free.copy()
            for _ in range(RINGS):
                more |= off[mesh.faces].any(1)
                off[mesh.faces[off[mesh.faces].any(1)]] = True
        else:
            more = made.free | np.isin(patches.label, refused)
        if (more == free).all():
            break
        free = more
    return no_solid(reason)


def _bias(shown: TriangleMesh, points: FloatArray, label: IntArray, volume: float) -> tuple[float, float, list[int]]:
    """By how much of its volume a solid is too large by the points, its standard deviation, and the surfaces whose points refuse them for part of it.

    label : (n,) surface of each point, -1 of none. The surface through the points rounds creases off, the points do not.
    """
    at = PointToMesh(shown).nearest(points)
    nearest = np.einsum("nk,nkx->nx", at.weights, shown.vertices[shown.faces[at.face]])
    off = -np.einsum("ij,ij->i", points - nearest, face_normals(shown)[at.face]) * float(face_areas(shown).sum()) / volume
    refused = []
    for k in np.unique(label[label >= 0]).tolist():
        own = off[label == k]
        part = float(own.sum()) / len(off)
        if abs(part) > BIAS / 3 and abs(float(own.mean())) > REFUSES * float(own.std()) / len(own) ** 0.5:
            refused.append(k)
    return float(off.mean()), float(off.std()) / len(off) ** 0.5, refused


def _with_fillets(solid: Any | None, fillets: Sequence[Fillet], drawn: Sequence[Surface], local: TriangleMesh) -> tuple[Any | None, str]:
    """The solid with its fillets, and "", or why there is none."""
    if solid is None or not is_valid(solid):
        return None, "the faces close no valid solid"
    if not fillets:
        return solid, ""
    made = rounded(solid, fillets, drawn, local)
    return made, "" if made is not None else NO_FILLETS
