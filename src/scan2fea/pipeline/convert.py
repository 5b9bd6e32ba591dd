"""The chain of one object: shape -> repair -> remesh -> solid -> tets -> model -> solution -> checks -> files.

Never raises for what can go wrong with an object: `Made` keeps everything up to there, and the reason.
"""

from __future__ import annotations

import traceback
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.cad import to_brep
from scan2fea.errors import CrossingError, InternalError, MeshingError, ReconstructionError, RepairError, Scan2FeaError, StageError
from scan2fea.fea import build_model, solve
from scan2fea.io.artifacts import save
from scan2fea.kernel.boundary import boundary_surface
from scan2fea.kernel.coverage import deviation, face_origin
from scan2fea.kernel.distances import PointToMesh
from scan2fea.kernel.measures import extent, face_areas, volume
from scan2fea.kernel.noise import spacing
from scan2fea.pipeline.against import set_against
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.drift import moved
from scan2fea.pipeline.free_form import build_patches
from scan2fea.pipeline.members import build_member, choose_route, told_after_all
from scan2fea.pipeline.outputs import BREP, MEMBER, write_object
from scan2fea.pipeline.part import Made, Part
from scan2fea.pipeline.record import Record, Tracked
from scan2fea.pipeline.requires import noise_checks, spacing_checks
from scan2fea.pipeline.results import object_row
from scan2fea.pipeline.sheet import sheet_of
from scan2fea.pipeline.stations import open_volume
from scan2fea.pipeline.true_faces import build_drawn, build_true
from scan2fea.reconstruction import reconstruct
from scan2fea.remeshing import AIM_DEG, eased, remesh, worst_dihedral
from scan2fea.repair import Repaired, repair
from scan2fea.tetmeshing import ENVELOPE, Filled, fill, new_boundary
from scan2fea.types import MEASURED, Brep, FEModel, FEResult, IntArray, Member, TetMesh, TriangleMesh
from scan2fea.verification.limits import limits
from scan2fea.verification.mesh import brep_checks, surface_checks, tet_checks
from scan2fea.verification.response import response_checks
from scan2fea.verification.shape import deviation_checks, drift_checks, free_form_checks, stations_checks

EASINGS = 5  # times the surface is eased under tets that verification would refuse
GENTLE = 2  # times free form alone is eased under tets that it would take, but that are flatter than need be


def convert(part: Part, key: str, config: Config, record: Record, folder: Path) -> dict[str, Any]:
    """Everything for one object, its files in `folder`; returns its row of report.json."""
    made = Made(part=part)
    try:
        _chain(made, Tracked(part, key), config, record)
    except Scan2FeaError as error:
        made.stopped = str(error)
    except Exception as error:  # noqa: BLE001 - one object's fault must not cost the others; it is told as ours
        made.stopped = f"a fault of scan2fea ({type(error).__name__}: {error}); please report it"
        record.event("fault", text=traceback.format_exc())
    made.stopped = told_after_all(made, made.stopped)
    set_against(made, Tracked(part, key), config, record)
    if made.tets is None and made.surface is not None and part.mesh is None:
        made.sheet = sheet_of(part.scan, made.surface, made.spacing_m, made.sigma_m, config.reconstruction)
    files = write_object(made, folder, config)
    if made.brep is not None:
        save(made.brep, record.folder / BREP)  # for the assembly
    if made.member is not None and not made.refused:
        save(made.member, record.folder / MEMBER)  # for the wireframe
    return object_row(made, files)


def _chain(made: Made, source: Tracked[Part], config: Config, record: Record) -> None:
    if source.value.smeared:
        raise StageError(source.value.smeared)
    has_points = source.value.mesh is None
    made.checks += spacing_checks(source.value.scan.cloud, config.require) if has_points else []
    if any(not check.passed for check in made.checks):
        return  # what is demanded of the scan comes first
    member = choose_route(made, source, config, record)
    if member is None and source.value.cut_from:
        raise StageError(f"no member: {made.route.reason if made.route else ''}")  # free form would close it where it was cut off
    if member is not None:
        tets = build_member(made, member, config, record)
        made.checks += noise_checks(made.sigma_m, config.require)
    else:
        surface, repaired = _surface(made, source, config, record)
        if any(not check.passed for check in made.checks):
            return  # refused: what follows would only decorate a wrong shape
        true = build_drawn(made, repaired, source, config, record) or build_true(made, surface, source, config, record)
        tets = true or _solid_and_tets(made, surface, config, record)
    moved(made, "tets", boundary_surface(tets.value))
    _verify_geometry(made)
    if any(not check.passed for check in made.checks):
        return  # a solution on a wrong mesh would only look like one

    made.model, made.result = _solved(made, tets, member, config, record)
    model, solved = made.model, made.result
    made.checks += response_checks(model, solved, is_prism=member is None or not member.value.holes)


def _solved(
    made: Made, tets: Tracked[TetMesh], member: Tracked[Member] | None, config: Config, record: Record
) -> tuple[FEModel, FEResult]:
    """The model with the supports and loads of the options, and its solution; of a member with the cases that have closed forms."""
    number = {"number": made.part.id}
    n = len(tets.value.nodes)
    model = record("model", build_model, tets, options=config.fea, extra=number, n_in=n, count=lambda m: len(m.node_sets), keep=False)
    made.model = model.value
    source: list[Tracked[Any]] = [model] if member is None or member.value.bends else [model, member]  # bends have no closed forms
    solved = record("solve", _solve, *source, options=config.fea, n_in=len(tets.value.tets), count=lambda r: r.n_dof)
    return model.value, solved.value


def _solve(model: FEModel, *rest: Any) -> FEResult:
    *member, options = rest
    return solve(model, options, member[0] if member else None)


def _surface(made: Made, source: Tracked[Part], config: Config, record: Record) -> tuple[Tracked[TriangleMesh], Tracked[TriangleMesh]]:
    """The closed surface of a free form, with triangles that a mesher can use, and as repaired; or both as far as its checks let it come."""
    shaped = _shape(made, source, config, record)
    if any(not check.passed for check in made.checks):
        return shaped, shaped
    repaired = _repaired(made, shaped, config, record)
    for step, surface in repaired.value.stages:
        moved(made, f"repair: {step}", surface)
    moved(made, "repair", repaired.value.mesh)
    scale = {"spacing_m": made.spacing_m, "sigma_m": made.sigma_m if made.residual_m is None else made.residual_m}
    scale["is_unbiased"] = made.residual_m is not None  # fitted to ranges
    source_mesh = Tracked(repaired.value.mesh, repaired.key)
    remeshed = record(
        "remesh", remesh, source_mesh, options=config.remeshing, extra=scale, n_in=len(source_mesh.value.faces), count=lambda r: len(r.mesh.faces)
    )
    moved(made, "remesh", remeshed.value.mesh)
    made.how.update({"surface_relaxed": remeshed.value.relaxed} if remeshed.value.relaxed else {})
    return Tracked(remeshed.value.mesh, remeshed.key), source_mesh


def _repaired(made: Made, shaped: Tracked[TriangleMesh], config: Config, record: Record) -> Tracked[Repaired]:
    """The surface repaired. Where it crosses itself still, or much was cut out for that, the boundary of tets may take its place, repaired again."""

    def repaired(surface: Tracked[TriangleMesh]) -> Tracked[Repaired]:
        return record("repair", repair, surface, options=config.repair, n_in=len(surface.value.faces), count=lambda r: len(r.mesh.faces))

    def away(found: Tracked[Repaired]) -> float:
        """Of the vertices given, as a share of the size of the part."""
        distance = PointToMesh(found.value.mesh).nearest(shaped.value.vertices).distance
        return float(np.percentile(distance, 95)) / extent(shaped.value.vertices)

    cut: Tracked[Repaired] | None = None
    try:
        cut = repaired(shaped)
        if not cut.value.n_cut_out or away(cut) <= ENVELOPE:
            return cut
        reason = f"{cut.value.n_cut_out} crossing faces would have to be cut out"
    except CrossingError as error:
        reason = str(error)
    try:
        new = record("new boundary", new_boundary, shaped, options=config.tetmeshing, n_in=len(shaped.value.faces), count=lambda m: len(m.faces))
        found = repaired(new)
    except (MeshingError, RepairError) as error:
        if cut is not None:
            return cut
        raise RepairError(f"{reason} (fTetWild finds no other surface: {error})") from None
    if cut is not None and away(cut) <= away(found):
        return cut
    moved(made, "new boundary", new.value)
    made.how["new_boundary"] = reason.partition(":")[0]
    return found


def _solid_and_tets(made: Made, surface: Tracked[TriangleMesh], config: Config, record: Record) -> Tracked[TetMesh]:
    """The B-Rep and the tets inside it. Where these come out too flat the surface is eased there and both are made again; the best stays."""
    best: Tracked[Filled] | None = None
    patches = build_patches(made, surface, config, record)
    limit = float(limits()["tets.min_dihedral"]["limit"])
    gentle = 0
    for attempt in range(EASINGS + 1):
        try:
            brep = Tracked(patches, "patches") if patches is not None else _facets(surface, config, record)
            made.brep = made.brep or brep.value  # kept also where no tets follow
            inside = brep if patches is None else Tracked(None, "its own triangles")  # these follow the patches; their faces are too small for tets
            filled = record("tets", fill, surface, inside, options=config.tetmeshing, n_in=len(surface.value.faces), count=lambda f: len(f.tets.tets))
        except StageError:
            if best is None:
                raise
            break
        if best is None or worst_dihedral(filled.value.tets) > worst_dihedral(best.value.tets):
            best, made.brep = filled, brep.value
        worst = worst_dihedral(best.value.tets)
        gentle += worst > limit
        if worst >= AIM_DEG or gentle > GENTLE or attempt == EASINGS:
            break
        tets = Tracked(filled.value.tets, filled.key)
        how = {"attempt": 0 if gentle else attempt}  # planes give way only where the object would be refused otherwise
        eased_to = record("ease", eased, surface, tets, extra=how, n_in=len(tets.value.tets), count=lambda m: len(m.faces))
        if gentle and np.array_equal(eased_to.value.vertices, surface.value.vertices):
            break
        surface = eased_to
    if best is None:
        raise InternalError("no attempt at the tets ended")
    made.tets = best.value.tets
    made.how.update(best.value.how)
    return Tracked(best.value.tets, best.key)


def _facets(surface: Tracked[TriangleMesh], config: Config, record: Record) -> Tracked[Brep]:
    return record("solid", to_brep, surface, options=config.cad, n_in=len(surface.value.faces), count=lambda b: len(b.face_names))


def _shape(made: Made, source: Tracked[Part], config: Config, record: Record) -> Tracked[TriangleMesh]:
    """The closed surface of the object: given, or reconstructed from its points."""
    part = source.value
    if part.mesh is not None:
        made.spacing_m, made.sensor = spacing(part.mesh.vertices), "unknown"
        moved(made, "given", part.mesh)
        return Tracked(part.mesh, source.key)
    scan = Tracked(part.scan, source.key)
    try:
        found = record("reconstruct", reconstruct, scan, options=config.reconstruction, n_in=len(part.scan.cloud), count=lambda r: len(r.mesh.faces))
    except ReconstructionError:
        made.sheet = sheet_of(part.scan, None, 0.0, 0.0, config.reconstruction)
        raise
    made.spacing_m, made.sigma_m, made.sensor = found.value.spacing_m, found.value.sigma_m, found.value.sensor
    made.residual_m, made.carried = found.value.residual_m, found.value.carried
    made.how.update(found.value.how)
    made.checks += [*found.value.checks, *noise_checks(found.value.sigma_m, config.require)]
    moved(made, "reconstruct", found.value.mesh)
    return Tracked(found.value.mesh, found.key)


def _verify_geometry(made: Made) -> None:
    """The checks of the last geometry; deviation and origin of every face are entered into the surface."""
    surface, tets, brep, cloud = made.surface, made.tets, made.brep, made.part.scan.cloud
    if surface is None or tets is None or brep is None:
        raise InternalError("the geometry is verified before it is whole")
    enclosed = volume(surface)
    made.checks += surface_checks(surface)
    strays = made.estimate.stray_share if made.member is not None and made.estimate is not None else 0.0
    found = deviation(surface, cloud.points, made.spacing_m, made.sigma_m, cloud.is_inferred, strays)
    if made.part.mesh is None:
        origin = face_origin(surface, cloud.points, cloud.is_inferred, made.spacing_m, made.sigma_m)
        supported = _supported_share(made, surface, origin)
    else:  # faces were given: the surface is what was measured, wherever its vertices lie
        origin, supported = np.full(len(surface.faces), MEASURED), 0.0
        found = replace(found, measured_area_fraction=1.0)
    made.deviation, made.supported_share = found, supported
    made.surface = replace(surface, face_origin=origin, deviation_m=found.per_vertex_m)
    made.checks += deviation_checks(found, made.spacing_m, made.sigma_m)
    if made.member is None:
        made.checks += free_form_checks(found, supported)
        made.checks += stations_checks(*open_volume(made.part.scan, surface, made.spacing_m, made.sigma_m))
    steps = [row["step"] for row in made.drift]
    first = 0 if made.part.mesh is None else steps.index("repair")  # a file with faces may enter open: count from its repair
    ratio = made.thickness[-1] / made.thickness[first]
    thicker = float(np.median(ratio[np.isfinite(ratio)])) - 1 if np.isfinite(ratio).any() else np.nan
    settled = steps.index("repair") if made.member is None else 0  # repair may cut handles of noise; after it none may come or go
    told = made.how.get("cad_holes", {"solid": 0, "surface": 0})  # where true faces are right and the surface is not
    holes = made.handles[-1] - made.handles[settled] - (told["solid"] - told["surface"])
    made.checks += drift_checks(made.drift[-1]["volume_m3"], made.drift[first]["volume_m3"], thicker, holes)
    made.checks += [*tet_checks(tets, enclosed), *brep_checks(brep, enclosed)]


def _supported_share(made: Made, surface: TriangleMesh, origin: IntArray) -> float:
    """Share of the area that no point saw but that rests on a plane that was seen, or is the other face of a wall that was (points stand for it)."""
    stand_in = np.concatenate([made.part.scan.cloud.points[made.part.contact], made.carried])
    if not len(stand_in):
        return 0.0
    backed = face_origin(surface, stand_in, None, made.spacing_m, made.sigma_m) == MEASURED
    areas = face_areas(surface)
    return float(areas[backed & (origin != MEASURED)].sum() / areas.sum())
