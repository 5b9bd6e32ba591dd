"""A second opinion: CalculiX solves the static steps of the deck that is written, and its displacements are set beside ours."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scan2fea.errors import SolveError, require
from scan2fea.fea.deck import write_inp
from scan2fea.fea.static import SELF_WEIGHT, figure
from scan2fea.kernel.processes import run_limited
from scan2fea.types import CaseField, CaseResult, FEModel, FloatArray

PROGRAM, JOB = "ccx", "model"
LIMIT_S = 1200.0  # of processor time: ten times what 400 000 unknowns of a thin part take it
_BLOCK, _ROW, _WIDTH = " -4  DISP", " -1", 12  # of the result file: node in columns 4 to 13, then figures of 12 columns


def second_opinion(model: FEModel, fields: Sequence[CaseField], limit_s: float = LIMIT_S) -> tuple[CaseResult, ...]:
    """`calculix_difference` of each static case: the largest difference of a displacement to ours, over the largest displacement.

    Raises SolveError: the part floats (the deck fixes its place at three nodes, we at none), no such program, a limit that is passed, a program
    that ends with an error, or with other steps than the deck has.
    """
    require(not model.is_floating, SolveError, "CalculiX: a part that nothing holds has no place of its own to compare")
    require(shutil.which(PROGRAM) is not None, SolveError, f"CalculiX: there is no program {PROGRAM} here: install it, or set fea.solver to auto")
    deck = write_inp(model)
    names = [SELF_WEIGHT, *(case.name for case in model.cases)]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, f"{JOB}.inp").write_text(deck[: deck.index(f"** step {len(names) + 1}: modes")])
        try:
            ended = run_limited([PROGRAM, "-i", JOB], limit_s, folder=Path(folder))
        except subprocess.TimeoutExpired:
            raise SolveError(f"CalculiX was stopped after {limit_s:g} s of processor time: mesh coarser, or set fea.solver to auto") from None
        said = next((line.strip() for line in (ended.stdout + ended.stderr).splitlines() if "*ERROR" in line), "no message")
        require(ended.returncode == 0, SolveError, f"CalculiX ended with exit code {ended.returncode}: {said}")
        found = _displacements(Path(folder, f"{JOB}.frd"), len(model.mesh.nodes))
    require(len(found) == len(names), SolveError, f"CalculiX solved {len(found)} of {len(names)} static steps: {said}")
    ours = {field.name: field.displacement_m for field in fields}
    return tuple(_beside(name, ours[name], u) for name, u in zip(names, found, strict=True) if name in ours)


def _beside(name: str, ours: FloatArray, theirs: FloatArray) -> CaseResult:
    return figure(name, "calculix_difference", "share", float(np.abs(theirs - ours).max() / np.abs(ours).max()))


def _displacements(path: Path, n_nodes: int) -> list[FloatArray]:
    """(n, 3) of each step in the file, m; none where it is not there."""
    out = []
    for block in (path.read_text() if path.is_file() else "").split(_BLOCK)[1:]:
        u = np.full((n_nodes, 3), np.nan)
        for line in block.split("\n -3", 1)[0].splitlines():
            if line.startswith(_ROW):
                start = 13
                u[int(line[3:start]) - 1] = [float(line[k : k + _WIDTH]) for k in range(start, start + 3 * _WIDTH, _WIDTH)]
        out.append(u)
    return out
