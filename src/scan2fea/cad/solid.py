"""A surface whose parts lie on planes, cylinders, cones and spheres, as the solid of these true faces; or why it is none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from scan2fea.cad.body import Body
from scan2fea.cad.brep import CadOptions
from scan2fea.cad.cells import cell_solid
from scan2fea.cad.compared import LEFT_OUT, Compared
from scan2fea.cad.diameters import with_diameters
from scan2fea.cad.extruded import with_extruded
from scan2fea.cad.fillets import Fillet, fitted_fillets, renumbered, rounded, without_fillets
from scan2fea.cad.live import is_valid
from scan2fea.cad.patches import Patches
from scan2fea.cad.quilting import freed
from scan2fea.cad.revolved import turned_solid
from scan2fea.cad.rims import Rimmed, with_rims
from scan2fea.cad.rolled import with_rings_and_balls
from scan2fea.cad.roundings import free_share, smooth_share, unexplained, widened
from scan2fea.cad.sheets import FACET, MOST_AREA, MOST_TRIANGLES, sewn_sheet, sheet, walls_of, without_walls
from scan2fea.cad.tangent import touching
from scan2fea.cad.traced import Traced, traced_solid
from scan2fea.cad.trued import Trued, covariance_in_mm, in_mm, no_solid, trued
from scan2fea.kernel.measures import face_areas
from scan2fea.kernel.surfaces import SPHERE, Surface
from scan2fea.types import FloatArray, IntArray, TriangleMesh
from scan2fea.units import MILLIMETRES_PER_METRE

MANY = 40  # surfaces: to cut them with each other takes longer than to trace their borders, which is tried first
MAX_TRACED = 300  # surfaces of a solid that is not cut: all are moved at once
MAX_SURFACES = 120  # cells are cut by every surface with every other: more take minutes
TOLERANCES = (1.0, 2.0)  # times the noise of the vertices for which the segmentation is tried
MARGINS = (1.0, 3.0, 8.0)  # times the reach by which faces are drawn beyond their region
SMOOTH = 0.5  # share of the borders of patches without an angle: more is free form in pieces (0 to 0.3 on bodies of few faces, 0.83 on a blob)
UNEXPLAINED = 0.004  # share of the area that may lie on no surface: more is free form
SCRAPS = 0.01  # of the area: surfaces that a wider tolerance does without
NOTHING_TOLD: Mapping[int, FloatArray] = {}
NO_FILLETS = "rounded edges could not be made"


WHOLE, QUILTED = "whole", "quilted"  # true faces, with NURBS patches only where these leave facets; or with them wherever surfaces meet in no edges


def true_solid(
    mesh: TriangleMesh,
    points: FloatArray,
    options: CadOptions = CadOptions(),
    *,
    spacing_m: float,
    noise_m: float,
    resting: tuple[FloatArray, FloatArray] | None = None,
    way: str = WHOLE,
) -> Trued:
    """The solid of true faces of a closed surface.

    points : (n, 3) measured, which the faces are fitted to.   spacing_m : of these.   noise_m : left in the vertices of `mesh`.
    resting : (k, 3) points inferred where the object stands on something, and their normals (k, 3) out of it.
    way : QUILTED is asked where cells close a solid that cannot be meshed, say.
    Nothing is raised where there is none: `reason` says why.
    """
    if not options.true_faces or (way == QUILTED and not options.patches):
        return no_solid("cad.true_faces is off" if not options.true_faces else "cad.patches is off")
    body = Body.of(mesh, points, spacing_m, noise_m, resting)
    return with_diameters(WAYS[way](body, body.segmented(TOLERANCES[0])), body.used)


def _whole(body: Body, raw: Patches) -> Trued:
    """Traced where there are many patches, cut out of cells, and what is left of ways; the first that holds."""
    reason = ""
    asked = body.evident(raw, body.crease_m) if len(raw.surfaces) > MANY else None  # the points ask for no more than there are
    is_large = asked is not None and len(asked.surfaces) > MANY
    if asked is not None and is_large:
        found = _traced(body, asked)
        if found.brep is not None:
            return found
    mixed: list[Patches] = []
    for factor, patches, sharp, fillets in _candidates(body, raw, asked if body.density else None):
        lost = _lost(body, patches, factor * body.scale.reach_m)
        said = _refused(patches, lost)
        if said:  # a head that is no ball leaves none where nothing blurs it
            turned = _built(body, patches, may_cut=False, may_turn=True) if lost > UNEXPLAINED else None
            if turned is not None and turned.brep is not None:
                return turned
            reason = reason or said
            mixed.append(patches)
            continue
        if fillets:
            found = _built(body, sharp, fillets, may_cut=smooth_share(body.mesh, sharp) <= SMOOTH)
            if found.brep is not None:
                return found
        smooth = smooth_share(body.mesh, patches)
        found = _built(body, patches, may_cut=smooth <= SMOOTH)
        if found.brep is not None:
            return found
        reason = found.reason
        if smooth > SMOOTH:  # with twice the tolerance the pieces are larger, and no sharper
            reason += f"{len(patches.surfaces)} pieces of surfaces that pass smoothly into each other: a free form"
            mixed.clear()
            break
        mixed.append(patches)
    found = _without_cells(body, body.evident(raw, body.crease_m) if asked is None else asked, raw, is_traced=is_large)
    return found if found.brep is not None else _fewest([_mixed(body, p) for p in mixed], reason)


def _quilted_alone(body: Body, raw: Patches) -> Trued:
    return _quilted(body, _rims(body, body.evident(raw, body.crease_m), raw))


WAYS = {WHOLE: _whole, QUILTED: _quilted_alone}


def _without_cells(body: Body, asked: Patches, raw: Patches, *, is_traced: bool) -> Trued:
    """By rims, traced, and with NURBS patches for what meets in no edges: the first without facets, else that of fewest faces."""
    rimmed, rims = _rimmed(body, asked, raw)
    if rimmed.brep is not None and not _n_facets(rimmed):
        return rimmed
    last = no_solid("") if is_traced else _traced(body, asked)
    if last.brep is not None and not _n_facets(last):
        return last
    return _fewest([rimmed, last, _quilted(body, rims)], "")


def _fewest(found: Sequence[Trued], reason: str) -> Trued:
    return min((f for f in found if f.brep is not None), key=_n_faces, default=no_solid(reason))


def _n_faces(found: Trued) -> int:
    return 0 if found.brep is None else len(found.brep.face_kinds)


def _n_facets(found: Trued) -> int:
    return 0 if found.brep is None else found.brep.face_kinds.count(FACET)


def _lost(body: Body, patches: Patches, reach_m: float) -> float:
    return unexplained(body.mesh, patches, reach_m, body.face, body.density)


_Candidate = tuple[float, Patches, Patches, tuple[Fillet, ...]]  # times the tolerance; patches; these without fillets; fillets


def _candidates(body: Body, raw: Patches, asked: Patches | None) -> Iterator[_Candidate]:
    """The segmentations, the tight one first unless what it has more than the wide one are scraps: rounded creases in pieces.

    asked : what the points ask of `raw` where creases are rounded by no more than the reach; None where it is not known.
    """
    tight = _candidate(body, TOLERANCES[0], raw, asked)
    made = (_candidate(body, f, body.segmented(f)) for f in TOLERANCES[1:])
    if smooth_share(body.mesh, tight[2]) > SMOOTH:
        yield tight
        yield from made
        return
    wide = next(made)
    area = face_areas(body.mesh)
    sizes = np.sort(np.bincount(tight[1].label + 1, weights=area, minlength=len(tight[1].surfaces) + 1)[1:])
    more = len(tight[1].surfaces) - len(wide[1].surfaces)
    scraps = more > 0 and float(sizes[:more].sum()) <= SCRAPS * float(area.sum()) and len(wide[3]) >= len(tight[3])
    wide_first = scraps and not _refused(wide[1], _lost(body, wide[1], wide[0] * body.scale.reach_m))
    yield from (wide, tight) if wide_first else (tight, wide)


def _candidate(body: Body, factor: float, found: Patches, asked: Patches | None = None) -> _Candidate:
    scale, reach_m = body.scale, factor * body.scale.reach_m
    patches = body.evident(found, reach_m) if asked is None else asked
    sharp, fillets = without_fillets(body.mesh, found, factor * scale.tolerance_m, body.used, body.face, scale.tolerance_m)
    if fillets:
        sharp, fillets = renumbered(body.evident(sharp, reach_m), sharp, fillets)
    return factor, patches, sharp if fillets else patches, fillets


def _refused(patches: Patches, lost: float) -> str:
    if lost > UNEXPLAINED:
        return f"{lost:.1%} of the area lies on no plane, cylinder, cone or sphere"
    if len(patches.surfaces) < 2:
        return "fewer than two surfaces"
    return ""


def _built(
    body: Body,
    patches: Patches,
    fillets: Sequence[Fillet] = (),
    *,
    may_cut: bool,
    may_turn: bool = False,
    walls: Sequence[IntArray] = (),
    told: Mapping[int, FloatArray] = NOTHING_TOLD,
) -> Trued:
    """Fit, snap, cut, round the edges, check; the first margin that passes."""
    mesh, scale, middle, local = body.mesh, body.scale, body.middle, body.local
    fitted, snaps, is_whole = body.fits(patches, told=told)
    fits = [f.surface for f in fitted]
    regions = [local.vertices[rows] for rows in widened(mesh, patches, fits, scale.reach_m)]
    best, as_found = [in_mm(s, middle) for s in fits], [in_mm(s, middle) for s in patches.surfaces]
    mm = MILLIMETRES_PER_METRE
    own = [local.vertices[np.unique(mesh.faces[patches.label == k])] for k in range(len(best))]
    best, limits = touching(best, own, scale.tolerance_m * mm, scale.reach_m * mm)
    reason = ""
    turning = best if is_whole else as_found
    is_turned = may_turn or any(s.kind == SPHERE for s in best)  # heads that are no spheres come as rings of them, which are not cut with each other
    if is_turned:
        turned, reason = _turned(body, patches, turning)
        if turned is not None:
            return turned
    if not may_cut:
        return no_solid(reason)
    if len(best) > MAX_SURFACES:
        return no_solid(f"{reason}{len(best)} surfaces, more than {MAX_SURFACES}")
    if fillets:
        fillets = fitted_fillets(fillets, fits, body.used, body.face, scale.tolerance_m)
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
            found = Compared(problem=problem) if problem else body.compared(solid)
            problem = found.problem
            if not problem:
                return trued(solid, middle, scale, snaps, found, fillets, drawn if walls else None)
            first = problem if problem.endswith(LEFT_OUT) else first or problem
        if first.endswith(LEFT_OUT):  # the surfaces as they were found leave it out too
            break
    turned = None if is_turned or fillets or walls else _turned(body, patches, turning)[0]
    return no_solid(reason + first) if turned is None else turned  # rims narrower than a rounded crease are no patches


def _turned(body: Body, patches: Patches, surfaces: list[Surface]) -> tuple[Trued | None, str]:
    """The surface as a body turned about an axis, or why it is none. surfaces : in millimetres around its middle."""
    mm, scale, middle = MILLIMETRES_PER_METRE, body.scale, body.middle
    turned, reason = turned_solid(
        body.local, (body.points - middle) * mm, patches, surfaces, scale.spacing_m * mm, scale.noise_m * mm, scale.reach_m * mm
    )  # fmt: skip
    if turned is not None:
        found = body.compared(turned)
        reason = found.problem
        if not reason:
            return trued(turned, middle, scale, (), found), ""
    return None, f"turned about an axis: {reason}; "


def _mixed(body: Body, patches: Patches) -> Trued:
    """True faces where surfaces explain the points, and facets on the walls between them that are free form."""
    mesh, scale = body.mesh, body.scale
    if free_share(mesh, patches) > MOST_AREA:
        return no_solid("most of the area is free form")
    fits = [f.surface for f in body.fits(patches)[0]]
    own = [mesh.vertices[np.unique(mesh.faces[patches.label == k])] for k in range(len(fits))]
    best, _ = touching(fits, own, scale.tolerance_m, scale.reach_m)
    walls = walls_of(mesh, replace(patches, surfaces=tuple(best)), scale.reach_m)
    n, area = sum(map(len, walls)), face_areas(mesh)
    share = sum(float(area[rows].sum()) for rows in walls) / float(area.sum())
    if not n or n > MOST_TRIANGLES or share > MOST_AREA:
        return no_solid(f"{share:.0%} of the area in {n} triangles are free form" if n else "")
    return _built(body, without_walls(patches, walls), may_cut=True, walls=walls)


def _rimmed(body: Body, patches: Patches, raw: Patches) -> tuple[Trued, Rimmed]:
    """The solid whose rims, too narrow for patches, are told by the walls beside them; and the patches with these."""
    found = _rims(body, patches, raw)
    if not found.told:
        return no_solid(""), found
    made = _built(body, found.patches, may_cut=smooth_share(body.mesh, found.patches) <= SMOOTH, told=found.told)
    return made if made.brep is not None else _traced(body, found.patches, found.told), found


def _rims(body: Body, patches: Patches, raw: Patches) -> Rimmed:
    straight = replace(patches, surfaces=tuple(f.surface for f in body.fits(patches)[0]))
    found = with_rims(body.mesh, straight, raw, body.used, body.face, body.scale.tolerance_m, body.scale.reach_m)
    return found if found.told else Rimmed(patches=patches, told={})


def _traced(body: Body, patches: Patches, told: Mapping[int, FloatArray] = NOTHING_TOLD) -> Trued:
    """The solid of the patches as they border on each other, where surfaces touch that cells cannot cut."""
    scale, middle, local, mm = body.scale, body.middle, body.local, MILLIMETRES_PER_METRE
    rims = {id(patches.surfaces[k]): used for k, used in told.items()}
    patches = with_rings_and_balls(body.mesh, patches, scale.tolerance_m)
    told = {k: rims[id(s)] for k, s in enumerate(patches.surfaces) if id(s) in rims}
    lost = _lost(body, patches, body.crease_m)
    if lost > UNEXPLAINED or not 2 <= len(patches.surfaces) <= MAX_TRACED:
        return no_solid(_refused(patches, lost) or f"{len(patches.surfaces)} surfaces, more than {MAX_TRACED}")
    fits, snaps, _ = body.fits(patches, radii=False, told=told)
    surfaces = [in_mm(f.surface, middle) for f in fits]
    covariances = [covariance_in_mm(f) for f in fits]

    size = scale.tolerance_m * mm, scale.spacing_m * mm

    def built(label: IntArray, surfaces: list[Surface], *, walls: bool, bridged: bool, parted: bool = False) -> tuple[Traced, Compared]:
        told = covariances + [np.zeros((0, 0))] * (len(surfaces) - len(covariances))
        made = traced_solid(local, label, surfaces, told, *size, walls=walls, bridged=bridged, parted=parted)
        if made.solid is None or not is_valid(made.solid):
            return made, Compared(problem="the faces close no valid solid")
        return made, body.compared(made.solid)

    made, found = built(patches.label, surfaces, walls=False, bridged=True)
    first = found.problem
    if found.problem:
        made, found = built(patches.label, surfaces, walls=False, bridged=True, parted=True)
    wall = made.pieces
    if found.problem:
        made, found = built(patches.label, surfaces, walls=True, bridged=False)
        wall = made.wall
    label, more = with_extruded(local, patches.label, surfaces, wall, *size) if wall.any() else (patches.label, surfaces)
    if len(more) > len(surfaces):
        drawn, proved = built(label, more, walls=True, bridged=True)
        if not proved.problem and (found.problem or drawn.n_facets <= made.n_facets):
            made, found = drawn, proved
    if found.problem:
        return no_solid(first)
    return trued(made.solid, middle, scale, snaps, found, drawn=made.surfaces if made.n_facets else None)


def _quilted(body: Body, rims: Rimmed) -> Trued:
    """With NURBS patches for the rest, unless that is most of it."""
    patches = rims.patches
    is_free = free_share(body.mesh, patches) > MOST_AREA or smooth_share(body.mesh, patches) > SMOOTH
    return no_solid("most of the area is free form") if is_free or not 2 <= len(patches.surfaces) <= MAX_TRACED else freed(body, rims)


def _with_fillets(solid: Any | None, fillets: Sequence[Fillet], drawn: Sequence[Surface], local: TriangleMesh) -> tuple[Any | None, str]:
    """The solid with its fillets, and "", or why there is none."""
    if solid is None or not is_valid(solid):
        return None, "the faces close no valid solid"
    if not fillets:
        return solid, ""
    made = rounded(solid, fillets, drawn, local)
    return made, "" if made is not None else NO_FILLETS
