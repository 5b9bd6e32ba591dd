"""The files of one object. Whatever exists is written; nothing is pretended."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scan2fea.cad import assembly
from scan2fea.errors import StageError, UsageError
from scan2fea.fea import write_bdf, write_inp
from scan2fea.fea.shell import write_shell_inp
from scan2fea.fea.wireframe import frame_result_rows, write_frame_inp
from scan2fea.io import write_cloud_ply, write_mesh_ply, write_msh, write_stl, write_text, write_vtu
from scan2fea.io.artifacts import load
from scan2fea.kernel.quality import tet_quality
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.frame_file import FRAME, FRAME_DECK, frame_of, write_frame
from scan2fea.pipeline.member_rows import member_row
from scan2fea.pipeline.part import Made
from scan2fea.pipeline.results import finite_tree
from scan2fea.pipeline.route import ESTIMATION
from scan2fea.types import FloatArray, PointCloud
from scan2fea.units import unit_system

BREP, MEMBER = "brep.npz", "member.npz"  # of each object, among what --resume reads

# Okabe and Ito's colours, which colour-blind readers tell apart
COLOURS = (
    (0.0, 0.447, 0.698),
    (0.902, 0.624, 0.0),
    (0.0, 0.62, 0.451),
    (0.8, 0.475, 0.655),
    (0.337, 0.706, 0.914),
    (0.835, 0.369, 0.0),
    (0.941, 0.894, 0.259),
)


def write_assembly(out: Path, keep: Path, objects: Sequence[Mapping[str, Any]]) -> None:
    """OUT/assembly.step: the solids of the converted objects, named and coloured. Not written where there is none."""
    converted = [row["id"] for row in objects if row["verdict"] == "converted"]
    if converted:
        breps = [load(keep / f"{number:02d}" / BREP) for number in converted]
        colours = [COLOURS[k % len(COLOURS)] for k in range(len(breps))]
        write_text(out / "assembly.step", assembly(breps, [f"OBJECT_{number:02d}" for number in converted], colours))


def write_members(out: Path, keep: Path, objects: Sequence[Mapping[str, Any]], config: Config) -> dict[str, Any] | None:
    """OUT/frame.json: the axes of the converted members, joined where they meet, and OUT/assembly_beam.inp: the same as one model of beams.

    Returns what that model answers, for report.json; None where there is no member. One that cannot be solved says why.
    """
    for name in (FRAME, FRAME_DECK):
        (out / name).unlink(missing_ok=True)
    built = [row["id"] for row in objects if row["verdict"] == "converted" and row["route"] == ESTIMATION]
    members = [load(keep / f"{number:02d}" / MEMBER) for number in built]
    if not write_frame(out, members, [f"OBJECT_{number:02d}" for number in built]):
        return None
    try:
        model, result = frame_of(members, config.fea)
    except (StageError, UsageError) as error:
        return {"failed": str(error)}
    write_text(out / FRAME_DECK, write_frame_inp(model, unit_system(config.export.units)))
    return frame_result_rows(model, result)


def write_object(made: Made, folder: Path, config: Config) -> list[str]:
    """Write the object's files into `folder`, which is emptied first; returns their names, sorted."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        if old.is_file():
            old.unlink()
    units = unit_system(config.export.units)
    write_cloud_ply(folder / "cloud.ply", made.part.scan.cloud, _columns(made))
    if made.surface is not None and len(made.surface.faces):
        write_mesh_ply(folder / "surface.ply", made.surface)
        write_stl(folder / "surface.stl", made.surface, units.length)
    if made.sheet is not None:
        write_mesh_ply(folder / "sheet.ply", made.sheet)
    if made.tets is not None:
        write_vtu(
            folder / "volume.vtu",
            made.tets,
            _point_data(made),
            {"min_dihedral_deg": tet_quality(made.tets.nodes, made.tets.tets)["min_dihedral_deg"]},
        )
        write_msh(folder / "volume.msh", made.tets)
    if made.member is not None:
        told = made.estimate
        row = finite_tree(member_row(made.member, told.p_fixed, told.given) if told is not None else member_row(made.member))
        write_text(folder / "member.json", json.dumps(row, indent=1, allow_nan=False) + "\n")
    if made.brep is not None:
        write_text(folder / "model.step", made.brep.step)
    if made.drawing is not None and made.drawing.drawing.brep is not None:
        found = made.drawing.found
        columns: dict[str, Any] = {"deviation_m": found.deviation_m, "local_m": found.local_m, "drawing_face": found.face.astype(np.int32)}
        write_cloud_ply(folder / "as_built.ply", PointCloud.of(made.drawing.points), columns)
        write_text(folder / "drawing.step", made.drawing.drawing.brep.step)
    if made.model is not None:
        write_text(folder / "model.inp", write_inp(made.model, units))
        write_text(folder / "model.bdf", write_bdf(made.model, units))
    if made.model is not None and made.member is not None:
        with contextlib.suppress(StageError):  # of a member that is no straight beam there is none; its solid stands by itself
            write_text(folder / "model_beam.inp", write_frame_inp(frame_of([made.member], config.fea)[0], units))
        with contextlib.suppress(StageError):  # nor are thick walls shells, nor bent pipes
            write_text(folder / "model_shell.inp", write_shell_inp(made.member, config.fea, units))
    return sorted(path.name for path in folder.iterdir() if path.is_file())


def _columns(made: Made) -> dict[str, FloatArray]:
    cloud = made.part.scan.cloud
    inferred = cloud.is_inferred if cloud.is_inferred is not None else np.zeros(len(cloud), bool)
    return {"is_inferred": inferred.astype(np.uint8)}


def _point_data(made: Made) -> dict[str, FloatArray]:
    if made.result is None:
        return {}
    shapes = {f"mode_{7 + k}": shape for k, shape in enumerate(made.result.mode_shapes)}
    first, *others = made.result.fields
    singular = np.zeros(len(first.von_mises_pa))
    singular[made.result.singular] = 1.0
    cases = {f"displacement_{field.name}_m": field.displacement_m for field in others} | {f"von_mises_{f.name}_pa": f.von_mises_pa for f in others}
    return {"displacement_m": first.displacement_m, "von_mises_pa": first.von_mises_pa, "is_singular": singular, **cases, **shapes}
