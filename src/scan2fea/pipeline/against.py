"""Nominal against scanned: the drawing that a [[object]] table names, laid onto the measured points; how far these lie from each of its faces, and
what the drawn solid answers beside the scanned one.

Told only: a part that is not as drawn is converted as it is. Never raises for what can go wrong with the drawing: the row says so.
"""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.cad import read_nominal
from scan2fea.errors import CadError, Scan2FeaError, require
from scan2fea.fea import FeaOptions, build_model, solve
from scan2fea.io.artifacts import fingerprint
from scan2fea.io.files import sha256_of
from scan2fea.kernel.best_fit import as_placed, best_fit
from scan2fea.kernel.distances import sample_surface
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.faces_worker import drawing_in_child
from scan2fea.pipeline.part import Against, Made, Part
from scan2fea.pipeline.record import Record, Tracked, key_of
from scan2fea.tetmeshing import FillOptions, fill
from scan2fea.types import CaseResult, FEResult, FloatArray, TriangleMesh
from scan2fea.verification.drawing import as_built, general_tolerance

LISTED = 4  # faces out of tolerance that the verdict's line names
SAMPLES = 40_000  # of a file with faces: its vertices say nothing of the middle of a face
COMPARED = {"mass": ("mass_kg",), "self_weight": ("displacement_max_m", "stress_p99_pa")}  # and the frequencies; what rests on no names of faces


def set_against(made: Made, source: Tracked[Part], config: Config, record: Record) -> None:
    """Enter into `made` what the drawing of the object says, where one is given."""
    known = next((one for one in config.object if one.id == source.value.id and one.step), None)
    if known is None:
        return
    try:
        path = Tracked(Path(known.step), key_of("file", sha256_of(Path(known.step))))
        extra = {"tolerance_m": known.tolerance, "noise_m": [made.sigma_m, made.part.doubt.between_m]}
        shape = [] if made.surface is None else [Tracked(made.surface, fingerprint(made.surface))]
        found = record("drawing", _against, path, source, *shape, options=config.cad, extra=extra, n_in=len(source.value.scan.cloud), count=_n_faces)
        made.drawing, made.drawn_row = found.value, {"path": known.step}
        if found.value.found.fits and made.result is not None:
            options = replace(config.fea, supports=(), loads=(), member_cases=False, buckling=False, solver="auto")
            more = {"fill_options": config.tetmeshing}
            solved = record("drawing solved", _solved, found, options=options, extra=more, n_in=_n_faces(found.value), count=lambda r: r.n_dof)
            made.drawn_row["cases"] = _beside(made.result, solved.value, has_own_supports=bool(config.fea.supports))
    except (Scan2FeaError, OSError) as error:
        made.drawn_row = {**made.drawn_row, "path": known.step, "failed": str(error)}


def _n_faces(found: Against) -> int:
    return len(found.found.faces)


def _against(path: Path, part: Part, *rest: Any, tolerance_m: float | None, noise_m: list[float]) -> Against:
    *shape, options = rest
    surface = read_nominal(path)
    points, whole = _measured(part), _even(shape[0]) if shape and len(shape[0].faces) else None
    T = as_placed(best_fit(points, surface, shape=whole))
    drawing = drawing_in_child(path, T, options)
    if drawing.mesh is None or drawing.brep is None or drawing.mesh.face_region is None:
        raise CadError(f"{path}: {drawing.reason}")
    give = general_tolerance(float(np.ptp(surface.vertices, axis=0).max())) if tolerance_m is None else tolerance_m
    brep = drawing.brep
    found = as_built(points, drawing.mesh, drawing.mesh.face_region, brep.face_names, brep.face_kinds, give, np.array(noise_m))
    source = "ISO 2768-1, class m, of the largest size" if tolerance_m is None else "given"
    return Against(points=points, T_scene_drawing=T, drawing=drawing, found=found, tolerance_source=source)


def _measured(part: Part) -> FloatArray:
    """The measured points; of a file with faces points even over these."""
    if part.mesh is not None:
        return _even(part.mesh)
    cloud = part.scan.cloud
    return cloud.points if cloud.is_inferred is None else cloud.points[~cloud.is_inferred]


def _even(mesh: TriangleMesh) -> FloatArray:
    return sample_surface(mesh, SAMPLES, 0)[0]


def _solved(found: Against, options: FeaOptions, *, fill_options: FillOptions) -> FEResult:
    """Weight, self weight on its lowest faces and free modes of the drawn solid."""
    mesh, brep = found.drawing.mesh, found.drawing.brep
    require(mesh is not None and brep is not None, CadError, "there is no drawn solid")
    return solve(build_model(fill(mesh, brep, fill_options).tets, options), options)  # type: ignore[arg-type]


def _beside(scanned: FEResult, drawn: FEResult, *, has_own_supports: bool) -> list[dict[str, Any]]:
    """What both were solved for. has_own_supports : of the scanned part: its self weight is then another case."""
    own = {(case.name, case.measure): case for case in scanned.cases}
    rows = []
    for case in drawn.cases:
        other = own.get((case.name, case.measure))
        if other is not None and _is_compared(case, has_own_supports):
            difference = other.value / case.value - 1 if case.value else None
            rows.append({"name": case.name, "measure": case.measure, "unit": case.unit, "scanned": other.value, "drawn": case.value, "std": other.std,
                         "difference": difference})  # fmt: skip
    return rows


def _is_compared(case: CaseResult, has_own_supports: bool) -> bool:
    if case.name == "modal":
        return case.measure.endswith("_hz") and case.measure != "rigid_max_hz"
    return case.measure in COMPARED.get(case.name, ()) and not (case.name == "self_weight" and has_own_supports)


def drawing_row(made: Made) -> dict[str, Any] | None:
    """objects[].drawing."""
    if made.drawing is None:
        return made.drawn_row or None
    found = made.drawing.found
    out = [face.name for face in found.faces if face.is_out]
    row: dict[str, Any] = {**made.drawn_row, "T_scene_drawing": made.drawing.T_scene_drawing, "fits": found.fits, "share_out": found.share_out}
    row |= {"tolerance_m": found.tolerance_m, "tolerance_source": made.drawing.tolerance_source, "out_of_tolerance": out}
    row["not_seen"] = [face.name for face in found.faces if not face.is_seen]
    far = np.abs(found.deviation_m)
    row |= {"mean_m": float(found.deviation_m.mean()), "std_m": float(found.deviation_m.std()), "p95_m": float(np.percentile(far, 95))}
    row["faces"] = [{**dataclasses.asdict(face), "is_out": face.is_out} for face in found.faces]
    return row


def drawing_words(made: Made) -> str:
    """For the verdict's line."""
    row = drawing_row(made)
    if row is None:
        return ""
    name = Path(row["path"]).name
    if "fits" not in row:
        return f"; it was not compared with {name}: {row['failed']}"
    if not row["fits"]:
        return f"; {name} is no drawing of it: {row['share_out']:.0%} of its points lie more than {row['tolerance_m'] * 1e3:.3g} mm off"
    n, out = len(row["faces"]), row["out_of_tolerance"]
    listed = f" ({', '.join(out[:LISTED])}{', ...' if len(out) > LISTED else ''})" if out else ""
    said = f"; {len(out)} of the {n} faces of {name} are out of its tolerance of {row['tolerance_m'] * 1e3:.3g} mm{listed}"
    return said + (f"; the drawn solid was not solved: {row['failed']}" if "failed" in row else "")
