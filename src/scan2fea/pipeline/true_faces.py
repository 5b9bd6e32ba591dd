"""The way of a surface that is bounded by planes, cylinders, cones and spheres: the solid of true faces, its tets, and the tests it must pass.

Where one fails the surface goes the way of free form (triangles to facets), and the report says why.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from scan2fea.cad import BOX_OFF, FACET, LEAST_LOST, PATCH, QUILTED, WHOLE, CadOptions, Trued, box_off_m
from scan2fea.errors import StageError
from scan2fea.kernel.boundary import boundary_surface
from scan2fea.kernel.coverage import NOISE_SIGMAS, REACH_SPACINGS, deviation
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import extent
from scan2fea.kernel.rays import first_hits, scene_of
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.faces_worker import drawn_solid_in_child, true_solid_in_child
from scan2fea.pipeline.part import Made, Part
from scan2fea.pipeline.record import Record, Tracked
from scan2fea.remeshing import chord_height, evened, looks_drawn, worst_dihedral
from scan2fea.tetmeshing import Filled, FillOptions, fill
from scan2fea.types import Brep, TetMesh, TriangleMesh
from scan2fea.verification.limits import limits
from scan2fea.verification.shape import deviation_checks, free_form_checks

TRUE, FACETS = "true faces", "facets"


def build_true(
    made: Made, surface: Tracked[TriangleMesh], source: Tracked[Part], config: Config, record: Record
) -> Tracked[TetMesh] | None:
    """Solid and tets of true faces, entered into `made`; None where the surface is none of these, with the reason in `made.how`."""
    noise, drawn = made.sigma_m if made.residual_m is None else made.residual_m, made.how.get("cad_reason", "")
    tets = _built(made, surface, source, config, record, {"spacing_m": made.spacing_m, "noise_m": noise})
    if tets is None and drawn:
        made.how["cad_reason"] += f"; {drawn}"
    return tets


def build_drawn(
    made: Made, repaired: Tracked[TriangleMesh], source: Tracked[Part], config: Config, record: Record
) -> Tracked[TetMesh] | None:
    """The same for a file with curves that were drawn: from its own triangles, or from even ones where these leave fewer faces (no triangles of a
    free form among them); None where it has points, no such curves, or is none of these.
    """
    mesh = repaired.value
    if made.part.mesh is None or not config.cad.true_faces or not looks_drawn(mesh) or not chord_height(mesh):
        return None
    found = [(record("faces", drawn_solid_in_child, repaired, options=config.cad, n_in=len(mesh.faces), count=_n_faces), mesh)]
    if found[0][0].value.brep is None or FACET in found[0][0].value.brep.face_kinds:
        try:
            even = record("even", evened, repaired, n_in=len(mesh.faces), count=lambda e: len(e.mesh.faces))
            surface = Tracked(even.value.mesh, even.key)
            scale = {"spacing_m": even.value.edge_m, "noise_m": even.value.chord_m}
            found.append((_found(surface, source, config, record, scale), surface.value))
        except StageError:
            pass
    reasons = []
    for solid, surface_of in sorted(found, key=lambda f: (f[0].value.brep is None, _n_faces(f[0].value))):
        tets = _filled(made, solid, surface_of, config, record)
        if tets is not None:
            return tets
        reasons.append(made.how["cad_reason"])
    made.how["cad_reason"] = "; ".join(reasons)
    return None


def _built(
    made: Made, surface: Tracked[TriangleMesh], source: Tracked[Part], config: Config, record: Record, scale: dict[str, float]
) -> Tracked[TetMesh] | None:
    """The solid from the triangles of a surface; where no tets fit into it, one with NURBS patches where its faces meet badly. scale : spacing and
    noise of its points.
    """
    found = _found(surface, source, config, record, scale)
    tets = _filled(made, found, surface.value, config, record)
    if tets is not None or found.value.brep is None or PATCH in found.value.brep.face_kinds:
        return tets
    reason = made.how["cad_reason"]
    tets = _filled(made, _found(surface, source, config, record, {**scale, "way": QUILTED}), surface.value, config, record)
    if tets is None:
        made.how["cad_reason"] = f"{reason}; {made.how['cad_reason']}"
    return tets


def _found(surface: Tracked[TriangleMesh], source: Tracked[Part], config: Config, record: Record, scale: dict[str, Any]) -> Tracked[Trued]:
    return record("faces", _true_solid, surface, source, options=config.cad, extra=scale, n_in=len(surface.value.faces), count=_n_faces)


def _filled(made: Made, found: Tracked[Trued], surface: TriangleMesh, config: Config, record: Record) -> Tracked[TetMesh] | None:
    """The tets inside a solid that was found, entered into `made`; None where there is none, or its tets fail."""
    made.how["cad_route"], made.how["cad_reason"] = FACETS, found.value.reason
    if found.value.brep is None:
        return None
    made.how["cad_reason"] = _misplaced(*_both(found.value))
    if made.how["cad_reason"]:
        return None
    try:
        filled = record("tets", _fill, found, options=config.tetmeshing, n_in=_n_faces(found.value), count=lambda f: len(f.tets.tets))
    except StageError as error:
        made.how["cad_reason"] = f"true faces were found but not meshed: {error}"
        return None
    tets = filled.value.tets
    problem = _problem(made, tets, config.fea.max_dof) or _seen_through(made, found.value, surface)
    if problem:
        made.how["cad_reason"] = problem
        return None
    made.brep, made.tets, made.snaps = found.value.brep, tets, found.value.snaps
    made.how.update(filled.value.how)
    made.how["cad_route"], made.how["cad_reason"] = TRUE, ""
    made.how.update({f"cad_{name}": found.value.how[name] for name in ("holes", "cylinders") if name in found.value.how})
    return Tracked(tets, filled.key)


def _true_solid(mesh: TriangleMesh, part: Part, options: CadOptions, *, spacing_m: float, noise_m: float, way: str = WHOLE) -> Trued:
    cloud = part.scan.cloud
    points = cloud.points if part.mesh is None else mesh.vertices
    resting = None
    if part.mesh is None and cloud.is_inferred is not None:
        points = points[~cloud.is_inferred]
        if cloud.normals is not None:
            resting = cloud.points[cloud.is_inferred], cloud.normals[cloud.is_inferred]
    return true_solid_in_child(mesh, points, options, spacing_m=spacing_m, noise_m=noise_m, resting=resting, way=way)


def _fill(found: Trued, options: FillOptions) -> Filled:
    mesh, brep = _both(found)
    return fill(mesh, brep, options)


def _both(found: Trued) -> tuple[TriangleMesh, Brep]:
    if found.mesh is None or found.brep is None:
        raise StageError("there is no solid of true faces")
    return found.mesh, found.brep


def _n_faces(found: Trued) -> int:
    return 0 if found.brep is None else len(found.brep.face_names)


def _problem(made: Made, tets: TetMesh, max_dof: int) -> str:
    """Why the tets of true faces would be refused later; then facets may still do. Faces narrower than elements make these small."""
    n_dof = 3 * len(tets.nodes)
    if n_dof > max_dof:
        return f"true faces were found, but the tets inside have {n_dof} degrees of freedom (fea.max_dof = {max_dof})"
    limit = float(limits()["tets.min_dihedral"]["limit"])
    worst = worst_dihedral(tets)
    if worst <= limit:
        return f"true faces were found, but the tets inside come out as flat as {worst:.3g} deg (limit {limit:g})"
    cloud = made.part.scan.cloud
    off = deviation(boundary_surface(tets), cloud.points, made.spacing_m, made.sigma_m, cloud.is_inferred)
    checks = (*deviation_checks(off, made.spacing_m, made.sigma_m), *free_form_checks(off, 1.0))
    failed = [check for check in checks if not check.passed]
    return f"true faces were found, but {failed[0].says}" if failed else ""


def _seen_through(made: Made, found: Trued, surface: TriangleMesh) -> str:
    """Whether sight lines pass through true faces that close a hole of the surface: then it is the surface that was seen."""
    if "holes" not in found.how or made.sensor != "known":
        return ""
    cloud, solid = made.part.scan.cloud, _both(found)[0]
    own = np.arange(len(cloud)) if cloud.is_inferred is None else np.flatnonzero(~cloud.is_inferred)
    origin = made.part.scan.sensors(own)
    way = cloud.points[own] - origin
    enters, _ = first_hits(scene_of(solid), origin, way)  # 1: at the point itself
    reach = REACH_SPACINGS * made.spacing_m + NOISE_SIGMAS * made.sigma_m
    passed = np.flatnonzero((1 - enters) * np.linalg.norm(way, axis=1) > reach)
    off = PointToMesh(surface).nearest(origin[passed] + enters[passed, None] * way[passed]).distance
    n_passed, holes = int(np.sum(off > reach)), found.how["holes"]
    said = f"{holes['solid']} holes go through the true faces, {holes['surface']} through the surface"
    return f"{said}, and {n_passed} sight lines pass where the true faces close it" if n_passed >= LEAST_LOST else ""


def _misplaced(mesh: TriangleMesh, brep: Brep) -> str:
    """Whether other programs would see the solid elsewhere: the box of a surface of revolution that stands askew comes out too wide."""
    off = box_off_m(brep.step, mesh)
    if off <= BOX_OFF * extent(mesh.vertices):
        return ""
    return f"true faces were found, but their box in the STEP file reaches {off * 1e3:.3g} mm beyond them (limit {BOX_OFF:.1%} of the size)"
