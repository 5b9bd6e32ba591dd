"""OUT/frame.json: the fitted members of a run as a wireframe."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from scan2fea.errors import StageError, require
from scan2fea.estimation.elbows import runs_of
from scan2fea.estimation.frame import frame, frame_rows
from scan2fea.fea import FeaOptions
from scan2fea.fea.wireframe import FrameModel, FrameResult, frame_model, solve_frame
from scan2fea.io import write_text
from scan2fea.pipeline.member_rows import change_row
from scan2fea.pipeline.results import finite_tree
from scan2fea.types import Member

FRAME, FRAME_DECK = "frame.json", "assembly_beam.inp"


def frame_of(members: Sequence[Member], options: FeaOptions) -> tuple[FrameModel, FrameResult]:
    """The members as one connected model of beams, pipes with elbows from corner to corner, solved. Raises StageError or UsageError."""
    require(all(member.change is None for member in members), StageError, "a member whose section changes along its axis is no beam of one section")
    wire = frame([run for member in members for run in runs_of(member)])
    sections = [(str(row["family"]), {str(k): float(v) for k, v in row["parameters_m"].items()}) for row in wire.section_rows]
    model = frame_model(wire.nodes, wire.elements, wire.member, wire.up, sections, wire.sections, options)
    return model, solve_frame(model)


def write_frame(out: Path, members: Sequence[Member], names: Sequence[str]) -> bool:
    """Write OUT/frame.json; False (and no file) where there is no member. A member whose section changes stands there with its change."""
    if not members:
        return False
    runs = [runs_of(member) for member in members]
    called = [name if len(own) == 1 else f"{name}_RUN_{k + 1}" for name, own in zip(names, runs, strict=True) for k in range(len(own))]
    rows = frame_rows(frame([run for own in runs for run in own]), called)
    for row, run in zip(rows["members"], (run for own in runs for run in own), strict=True):
        row |= {} if run.change is None else {"change": change_row(run)}
    write_text(out / FRAME, json.dumps(finite_tree(rows), indent=1, allow_nan=False) + "\n")
    return True
